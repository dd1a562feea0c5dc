"""Table 4.3 and Fig. 4.8 are made from real steps of fibre scenes, all of which get solved."""

from __future__ import annotations

from pathlib import Path

import pytest

from barchan.friction import solve
from barchan.reproductions import hair_solvers, local_solvers
from barchan.reproductions.hair_problems import Source, hair_problems, sources
from barchan.reproductions.workshop import Workshop, published

SMALL = (Source("wisp", "wisp", {"fibres.count": 12}, (15, 40)),)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer fibres than even a quick reproduction has."""
    monkeypatch.setattr("barchan.reproductions.hair_problems.sources", lambda quick: SMALL)


def test_problems_are_steps_with_contacts() -> None:
    found = dict(hair_problems(quick=True))
    assert list(found) == ["wisp-15", "wisp-40"]
    assert all(problem.s == 3 and problem.n > 20 for problem in found.values())
    assert solve(found["wisp-40"], tol=1e-6).converged


def test_full_sets_have_both_models_of_fibres() -> None:
    chosen = sources(quick=False)
    assert 12 <= sum(len(source.steps) for source in chosen) <= 30
    assert {source.overrides.get("fibres.model", "helices") for source in chosen} == {"helices", "rods"}


def test_each_local_solver_has_its_line_of_the_table(tmp_path: Path) -> None:
    report = local_solvers.reproduce(Workshop(tmp_path, quick=True))
    assert report.converged
    table = report.tables[1]
    names = [local_solvers.seed_name(row[0]) for row in table.rows]
    assert names[:-1] == [row["solver"] for row in published("local_solvers")] and names[-1] == ""
    hybrid = next(row for row in table.rows if row[0] == "fischer-burmeister+enumerative")
    assert float(hybrid[5]) == 0.0 and float(hybrid[11]) == 1.0
    assert (tmp_path / "sweeps.png").stat().st_size > 10_000


def test_the_profile_has_every_solver(tmp_path: Path) -> None:
    report = hair_solvers.reproduce(Workshop(tmp_path, quick=True))
    assert report.converged
    assert [row[0] for row in report.tables[1].rows] == [variant.label for variant in hair_solvers.VARIANTS]
    assert {"profile.png", "results.csv", "results.md"} <= {path.name for path in tmp_path.iterdir()}
