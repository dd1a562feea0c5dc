"""Fixtures and settings shared by all tests."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import settings

import barchan

# Compilation makes the first example slow, so no deadline; CI draws the same examples every time.
settings.register_profile("barchan", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "barchan")

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of reference data next to the repository; tests that need it skip when it is absent."""
    if not (SHARED / "data").is_dir():
        pytest.skip(f"reference data not found: {SHARED} is kept beside the repository, not in it")
    return SHARED


@pytest.fixture(scope="session")
def python_environment() -> dict[str, str]:
    """Environment of a subprocess that imports the same barchan as this one."""
    return {**os.environ, "PYTHONPATH": str(Path(barchan.__file__).parents[1])}


@pytest.fixture(scope="session")
def load_script() -> Callable[[Path], ModuleType]:
    """`load_script(path)` -> the module of a file that is in no package, such as a script of tools/."""

    def load(path: Path) -> ModuleType:
        specification = importlib.util.spec_from_file_location(path.stem, path)
        assert specification is not None
        assert specification.loader is not None
        module = importlib.util.module_from_spec(specification)
        sys.modules[path.stem] = module  # dataclasses look their own module up
        specification.loader.exec_module(module)
        return module

    return load


@pytest.fixture
def bytes_by_threads() -> Callable[[Callable[[], Iterable[np.ndarray]]], list[bytes]]:
    """`bytes_by_threads(compute)` -> the bytes of the arrays it returns, on one thread and on two; skips where there is one."""
    import numba

    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("Numba has a single thread here")

    def on(threads: int, compute: Callable[[], Iterable[np.ndarray]]) -> bytes:
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            return b"".join(array.tobytes() for array in compute())
        finally:
            numba.set_num_threads(before)

    return lambda compute: [on(threads, compute) for threads in (1, 2)]
