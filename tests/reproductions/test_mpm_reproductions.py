"""Reproductions of the material point scenes: jobs load and hold the whole flow, small runs leave tables and pictures."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from barchan import reproductions, scenes
from barchan.reproductions import anisotropy, column_law, mpm_table, silo_discharge, tower_cohesion
from barchan.reproductions.workshop import Workshop, published
from barchan.scenes.kinds.sand.model import check_outlets
from barchan.scenes.kinds.sand.options import remarks

NAMES = (
    "heap_roundness", "column_law", "column_heights", "anisotropy", "column_profiles", "zhu_bridson", "silo_discharge",
    "tower_cohesion", "mpm_table",
)  # fmt: skip
TINY = {"box.cells": [10, 2, 5], "per_cell": 1, "time.end": 0.05, "time.frame_rate": 40.0}


def test_all_of_the_chapter_are_there() -> None:
    assert set(NAMES) <= set(reproductions.NAMES)


def test_the_published_table_is_that_of_the_reference(shared_data: Path) -> None:
    lines = (shared_data / "reference" / "mpm_scenes.csv").read_text().splitlines()
    assert published("mpm_scenes") == list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [row["scene"] for row in published("mpm_scenes")] == list(mpm_table.SCENES)


@pytest.mark.parametrize("name", mpm_table.SCENES)
def test_the_table_runs_scenes_on_the_grid_of_the_seed(name: str) -> None:
    (row,) = (row for row in published("mpm_scenes") if row["scene"] == name)
    scene, overrides = mpm_table.SCENES[name]
    cells = scenes.load(scene, **overrides).parameters.box.cells  # type: ignore[attr-defined]
    assert "x".join(map(str, cells)) == row["grid"]
    coarse = scenes.load(scene, **mpm_table.COARSE[name]).parameters
    if coarse.scene.kind == "sand":
        check_outlets(coarse)  # type: ignore[arg-type]


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("ratio", column_law.RATIOS)
def test_the_boxes_of_the_columns_hold_their_run_out(ratio: float, quick: bool) -> None:
    job = column_law.column_job(ratio, quick)
    parameters = scenes.load(job.scene, **job.overrides).parameters
    room = (parameters.box.size[0] - column_law.LENGTH) / column_law.LENGTH  # type: ignore[attr-defined]
    published_run_out = 1.82 * ratio**1.1 if ratio < 3.0 else 2.8 * ratio**0.73
    assert room > 1.2 * published_run_out
    assert parameters.column.height / parameters.column.length == pytest.approx(ratio)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("scene", "coarse"), [("silo_2d", silo_discharge.COARSE_2D), ("silo_3d", silo_discharge.COARSE_3D)]
)
def test_quick_silos_have_the_level_of_the_full_ones_and_open_outlets(
    scene: str, coarse: dict[str, Any]
) -> None:
    parameters = scenes.load(scene, **coarse).parameters
    plate = parameters.bodies.plate  # type: ignore[attr-defined]
    assert plate.position[-1] + 0.5 * plate.size[-1] == pytest.approx(parameters.observe.level)  # type: ignore[attr-defined]
    check_outlets(parameters)  # type: ignore[arg-type]


def test_cohesion_is_lasting_only_where_the_stresses_can_hold_it() -> None:
    for _, overrides in tower_cohesion.CASES:
        assert remarks(scenes.load("tower", **overrides).parameters) == []  # type: ignore[arg-type]


def test_a_small_reproduction_leaves_a_table_and_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anisotropy, "COARSE", TINY)
    report = anisotropy.reproduce(Workshop(tmp_path, quick=True, processes=1))
    assert report.converged
    assert [row[0] for row in report.tables[0].rows] == [name for name, _ in anisotropy.CASES]
    assert {"anisotropy.csv", "anisotropy_profiles.png", "anisotropy_speeds.png"} <= {
        p.name for p in tmp_path.iterdir()
    }
