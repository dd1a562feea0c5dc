"""The deterministic double of a flow, for tests of storing and resuming."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

import barchan

FAKE_FLOW = Path(__file__).with_name("fake_flow.py")


@pytest.fixture(scope="session")
def fake_flow() -> ModuleType:
    """The module fake_flow.py beside this file."""
    specification = importlib.util.spec_from_file_location("fake_flow", FAKE_FLOW)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules["fake_flow"] = module
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def python_environment() -> dict[str, str]:
    """Environment of a subprocess that imports the same barchan as this one."""
    return {**os.environ, "PYTHONPATH": str(Path(barchan.__file__).parents[1])}
