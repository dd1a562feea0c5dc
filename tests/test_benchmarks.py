"""The benchmarks still fit the code they measure: each can be imported, and names what exists. Nothing is timed here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from barchan import friction
from barchan.flows.mpm import stepper

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"
SCRIPTS = sorted(FOLDER.glob("bench_*.py"))


@pytest.fixture
def script(
    load_script: Callable[[Path], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], ModuleType]:
    """`script(name)` -> a script of benchmarks/ as a module."""
    monkeypatch.syspath_prepend(FOLDER)
    return lambda name: load_script(FOLDER / f"{name}.py")


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_each_script_has_a_main_and_explains_itself(path: Path, script: Callable[[str], ModuleType]) -> None:
    module = script(path.stem)
    assert callable(module.main)
    assert module.__doc__


def test_every_function_of_a_phase_is_called_by_the_stepper(script: Callable[[str], ModuleType]) -> None:
    phases = script("bench_mpm_step").PHASES
    called = stepper.Stepper.advance.__code__.co_names
    for code in vars(stepper.Stepper).values():
        called += getattr(getattr(code, "__code__", None), "co_names", ())
    assert all(name in called and hasattr(stepper, name) for names in phases.values() for name in names)


def test_the_made_up_problems_have_the_structure_they_claim(script: Callable[[str], ModuleType]) -> None:
    module = script("bench_local_block")
    pile, flow = module.pile(30, np.random.default_rng(0)), module.flow(3, np.random.default_rng(0))
    assert (pile.n, pile.s, pile.is_reduced) == (30, 3, True)
    assert (flow.n, flow.s, flow.velocity_block) == (27, 6, 3)
    assert np.all(np.diff(flow.h_rows.indptr) == 27)
    assert friction.solve(pile, tol=1e-6).converged
