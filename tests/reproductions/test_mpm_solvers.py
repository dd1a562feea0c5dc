"""The profiles of Fig. 7.24 are drawn from real steps of the material point method, all of which get solved."""

from __future__ import annotations

from pathlib import Path

import pytest

from barchan.friction import solve
from barchan.reproductions import mpm_solvers
from barchan.reproductions.mpm_solvers import BEST, VARIANTS, sources, step_problems
from barchan.reproductions.workshop import Workshop


def test_problems_are_steps_of_their_columns() -> None:
    plane, space = sources(quick=True)
    found = dict(step_problems(plane))
    assert list(found) == ["plane-2", "plane-20"]
    assert {problem.s for problem in found.values()} == {3}
    assert solve(found["plane-20"], tol=1e-6).converged
    assert {problem.s for _, problem in step_problems(space)} == {6}


def test_full_sets_have_the_size_of_a_profile() -> None:
    assert 10 <= sum(len(source.steps) for source in sources(quick=False)) <= 20


def test_the_reproduction_solves_every_problem_and_leaves_its_profile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mpm_solvers, "sources", lambda quick: sources(quick)[:1])
    report = mpm_solvers.reproduce(Workshop(tmp_path, quick=True))
    assert report.converged
    sizes, profile = report.tables
    assert len(sizes.rows) == 2 and [row[0] for row in profile.rows] == [
        variant.label for variant in VARIANTS
    ]
    assert profile.rows[0][0] == BEST and profile.rows[0][4] == "100"
    assert {"profile.png", "results.csv", "results.md", "residuals.png"} <= {
        path.name for path in tmp_path.iterdir()
    }
