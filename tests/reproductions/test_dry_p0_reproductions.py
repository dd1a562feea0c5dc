"""Reproductions of the mesh-based model: the jobs they ask for and the laws they fit (seed B, Fig. 7.5-7.6)."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.reproductions import column_law_p0, silo_p0
from barchan.reproductions.workshop import Job, Workshop


class Rehearsal(Workshop):
    """A workshop whose runs are made up by a function of the job."""

    def __init__(self, out: Path, make: Any) -> None:
        super().__init__(out, quick=True)
        self.make = make
        self.jobs: list[Job] = []

    def run(self, jobs: Any) -> Any:
        self.jobs = list(jobs)
        return [self.make(job) for job in jobs]


def a_column(job: Job) -> Any:
    """A column that follows the published law exactly."""
    a = float(job.overrides["fill.height"])
    factor, exponent = column_law_p0.PUBLISHED["low" if a < 3.0 else "high"]
    names = (
        "run_out_bulk",
        "height_ratio",
        "max_speed",
        "excess",
        "worst_certificate",
        "steps",
        "seconds_total",
    )
    summary = dict.fromkeys(names, 0.0) | {
        "run_out": factor * a**exponent, "converged": True, "volume_drift": 0.0,
        "min_volume_fraction": 0.0, "max_volume_fraction": 1.0,
    }  # fmt: skip
    return SimpleNamespace(summary=summary)


def a_silo(job: Job) -> Any:
    """Grains that run evenly, and a fluid whose discharge goes with the root of its height."""
    times = np.linspace(0.01, 19.0, 1900)
    volume = 16.0 - 0.8 * times if job.overrides["material.friction"] else 16.0 * (1.0 - times / 19.5) ** 2
    summary = {"converged": True, "volume": volume[-1], "volume_drift": 0.0, "max_volume_fraction": 1.0}
    scene = scenes.load(job.scene, **job.overrides).parameters.model_dump()
    results = SimpleNamespace(steps={"time": times, "volume": volume}, scene=scene)
    return SimpleNamespace(summary=summary, observables={"volume": np.array([16.0])}, results=results)


class TestColumnLaw:
    def test_it_finds_the_exponents_of_columns_that_follow_the_law(self, tmp_path: Path) -> None:
        report = column_law_p0.reproduce(Rehearsal(tmp_path, a_column))
        (table,) = report.tables
        exponents = {row[1]: float(row[5]) for row in table.rows}
        assert exponents["a >= 3"] == pytest.approx(0.73, abs=0.01)
        assert exponents["a <= 3"] == pytest.approx(1.1, abs=0.02)  # a = 3 belongs to both regimes
        assert {"run_out.csv", "column_law_p0.png"} <= {path.name for path in tmp_path.iterdir()}

    def test_every_job_is_a_valid_scene_with_room_for_its_run_out(self, tmp_path: Path) -> None:
        rehearsal = Rehearsal(tmp_path, a_column)
        column_law_p0.reproduce(rehearsal)
        for job in rehearsal.jobs:
            scene = scenes.load(job.scene, **job.overrides).parameters
            a = scene.fill.height
            factor, exponent = column_law_p0.PUBLISHED["low" if a <= 3.0 else "high"]
            assert scene.mesh.size[0] > 1.0 + 1.4 * factor * a**exponent
            assert scene.mesh.size[1] >= a
            assert scene.spacing == pytest.approx((1.0 / 8.0, 1.0 / 8.0))
            assert scene.fill.length == 1.0

    def test_the_readings_of_the_grain_diameter_differ(self, tmp_path: Path) -> None:
        rehearsal = Rehearsal(tmp_path, a_column)
        column_law_p0.reproduce(rehearsal)
        diameters = {
            (job.label.startswith("height"), job.overrides["fill.height"]): job.overrides[
                "material.grain_diameter"
            ]
            for job in rehearsal.jobs
        }
        assert len({value for (height, _), value in diameters.items() if not height}) == 1
        assert all(value == pytest.approx(a / 25.0) for (height, a), value in diameters.items() if height)


class TestHourglass:
    def test_it_tells_an_hourglass_from_a_clepsydra(self, tmp_path: Path) -> None:
        report = silo_p0.reproduce(Rehearsal(tmp_path, a_silo))
        verdicts = {row[0]: row[5] for row in report.tables[0].rows}
        assert verdicts == {"0": "decreasing", "0.3": "constant", "0.5": "constant"}
        discharges = {row[0]: float(row[1]) for row in report.tables[0].rows}
        assert discharges["0.5"] == pytest.approx(1.6, rel=1e-3)  # of the whole silo
        assert {"discharge.csv", "silo_p0.png"} <= {path.name for path in tmp_path.iterdir()}

    def test_the_wedge_left_over_stands_at_the_rest_angle(self) -> None:
        job = Job("mu0.5", "silo_p0", {"material.friction": 0.5})
        share = silo_p0.final_share(0.5, a_silo(job))
        assert share * 16.0 == pytest.approx(0.5 * 1.5**2 * np.tan(np.arcsin(0.5)))
