"""Table 4.4 is made from real steps of cloth scenes: every route meets its certificate, nodal ones without a dense operator."""

from __future__ import annotations

from pathlib import Path

import pytest

from barchan.bench.nodal import time_dual, time_nodal
from barchan.reproductions import nodal_cloth
from barchan.reproductions.hair_problems import Source, step_problems
from barchan.reproductions.workshop import Workshop, published

SMALL = (("skirt", Source("skirt", "skirt", {"cloth.spacing": 0.08}, (3,))),)


def test_the_table_has_both_routes_and_the_seed_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(nodal_cloth, "sources", lambda quick: SMALL)
    report = nodal_cloth.reproduce(Workshop(tmp_path, quick=True))
    assert report.converged
    (row,) = report.tables[0].rows
    assert len(row) == len(nodal_cloth.HEADS) and row[0] == "skirt"
    assert row[10:16] == list(published("nodal_cloth")[1].values())[1:]
    timings = (tmp_path / "timings.csv").read_text().splitlines()
    assert len(timings) == 1 + 1 + len(nodal_cloth.VARIANTS)


def test_full_sets_stand_for_the_three_scenes_of_the_seed() -> None:
    names = [seed for seed, _ in nodal_cloth.sources(quick=False)]
    assert names == [row["scene"] for row in published("nodal_cloth")]


def test_both_routes_end_with_the_same_certificate() -> None:
    ((_, problem),) = step_problems(SMALL[0][1])
    dual, nodal = time_dual(problem, 1e-6), time_nodal(problem, 1e-6, "cadoux")
    assert dual.certificate <= 1e-6 and nodal.certificate <= 1e-6
    assert dual.total == dual.build + dual.solve > 0.0
