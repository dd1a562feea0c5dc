"""A folder of its own for every test of the command line, small runs, and the line a mistake must give."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from barchan import cli, friction
from barchan.cones import Coulomb

SMALL = (
    *("box.size=[0.4, 0.15]", "box.cells=[16, 6]", "column.length=0.12", "height=0.11", "per_cell=2"),
    *("frame_rate=50", "time.step=0.01"),
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every test works in a folder of its own."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def small_run() -> Callable[..., list[str]]:
    """`small_run("key=value", ...)` -> arguments of `barchan` that run a small column, so changed."""
    return lambda *pairs: [
        "run",
        "collapse",
        *(word for pair in (*SMALL, *pairs) for word in ("--set", pair)),
    ]


@pytest.fixture
def complaint(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """`complaint(arguments...)` -> the single line on standard error of a command that ends with exit code 2."""

    def complain(*arguments: str) -> str:
        capsys.readouterr()
        assert cli.main(arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith("barchan: error: ")
        assert error.count("\n") == 1
        assert "Traceback" not in error
        return error

    return complain


@pytest.fixture
def problem_file(tmp_path: Path) -> str:
    """A well-posed reduced problem of four contacts."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(12, 12))
    problem = friction.Problem.reduced(
        W=root @ root.T + np.eye(12), b=rng.normal(size=12), law=Coulomb(np.full(4, 0.5)), block_size=3
    )
    path = tmp_path / "four.hdf5"
    friction.write(path, problem)
    return str(path)
