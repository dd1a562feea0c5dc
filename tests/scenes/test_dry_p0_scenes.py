"""Scenes of dry grains on a mesh: parameters, bad input, resuming, measures, and the hourglass (seed B, Fig. 7.5-7.6)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import scenes
from barchan.errors import InputError
from barchan.scenes.kinds.dry_p0.model import DryModel, front_of
from barchan.scenes.kinds.dry_p0.report import discharge_by_tenths
from barchan.scenes.parameters import SceneParameters

COLUMN = {
    "mesh.size": [3.0, 1.2], "mesh.cells": [15, 6], "fill.height": 1.0, "time.end": 0.6, "time.step": 0.05,
}  # fmt: skip
SILO = {"mesh.size": [2.0, 3.0], "mesh.cells": [8, 12], "fill.height": 3.0, "time.step": 0.1}


def model(name: str, **overrides: Any) -> DryModel:
    built = scenes.load(name, **overrides).model()
    assert isinstance(built, DryModel)
    return built


class TestParameters:
    @pytest.mark.parametrize(
        ("name", "overrides", "word"),
        [
            ("silo_p0", {"outlet.width": 0.05}, "outlet.width.*one cell"),
            ("silo_p0", {"outlet.position": 1.8}, "outlet.width"),
            ("silo_p0", {"fill.height": 9.0}, "fill.height"),
            ("collapse_p0", {"fill.length": 9.0}, "fill.length"),
            ("collapse_p0", {"fill.position": 8.5}, "fill.position"),
            ("collapse_p0", {"material.friction": -0.1}, "material.friction"),
            ("collapse_p0", {"mesh.shape": "hexagon"}, "mesh.shape"),
            ("collapse_p0", {"mesh.cells": [0, 4]}, "mesh.cells"),
            ("collapse_p0", {"walls.z_min": "sticky"}, "walls.z_min"),
            ("collapse_p0", {"solver.method": "magic"}, "solver.method"),
            ("collapse_p0", {"solver.inertia": "none"}, "solver.inertia"),
            ("collapse_p0", {"time.frame_rate": 1e9}, "time.frame_rate"),
            ("collapse_p0", {"material.max_volume_fraction": 1.2}, "material.max_volume_fraction"),
        ],
    )
    def test_bad_ones_are_refused_by_name(self, name: str, overrides: dict[str, Any], word: str) -> None:
        with pytest.raises(InputError, match=word):
            scenes.load(name, **overrides)

    @pytest.mark.parametrize("shape", ["triangle", "quadrilateral"])
    def test_the_outlet_is_as_wide_as_asked_for_on_any_mesh(self, shape: str) -> None:
        built = model(
            "silo_p0", **SILO, **{"mesh.shape": shape, "outlet.width": 0.61, "outlet.position": 0.13}
        )
        facets = built.mesh.facets[:, built.mesh.boundaries["outlet"]]
        x = built.mesh.p[0][facets]
        assert (x.min(), x.max()) == pytest.approx((0.13, 0.74))

    def test_a_floor_that_is_all_outlet_lets_everything_fall(self) -> None:
        run = scenes.load(
            "silo_p0", **{**SILO, "outlet.width": 2.0, "time.end": 4.0, "walls.x_max": "slip"}
        ).run(progress=False)
        assert run.summary["volume"] <= 0.1 * 6.0


class TestMeasures:
    def test_the_front_is_interpolated_between_columns(self) -> None:
        x, height = np.arange(0.5, 5.0), np.array([2.0, 1.0, 0.5, 0.1, 0.0])
        assert front_of(x, height, 0.3, 5.0) == pytest.approx(3.0)
        assert front_of(x, np.zeros(5), 0.3, 5.0) == 0.0
        assert front_of(x, np.ones(5), 0.3, 5.0) == 5.0

    @pytest.mark.parametrize("shape", ["triangle", "quadrilateral"])
    def test_the_profile_holds_all_the_matter(self, shape: str) -> None:
        built = model("collapse_p0", **COLUMN, **{"mesh.shape": shape})
        profile = built.profile(built.initial())
        assert np.sum(profile["surface_height"]) * 0.2 == pytest.approx(1.0)
        assert profile["surface_height"][:5] == pytest.approx(1.0, rel=0.02)

    def test_a_steady_discharge_has_seven_equal_tenths(self) -> None:
        times = np.linspace(0.1, 9.0, 90)
        assert discharge_by_tenths(times, 10.0 - times, 10.0) == pytest.approx(np.ones(7))
        assert len(discharge_by_tenths(times[:50], 10.0 - times[:50], 10.0)) == 0


class TestRuns:
    def test_a_resumed_run_ends_with_the_same_bytes(self, tmp_path: Path) -> None:
        scene = scenes.load("collapse_p0", **COLUMN)
        whole = scene.model()
        state = whole.initial()
        for _ in range(4):
            state, _ = whole.advance(state, 0.05)
        again, other = whole.restore(whole.arrays(state)), scene.model()
        one, two = whole.advance(state, 0.05)[0], other.advance(again, 0.05)[0]
        assert all(np.array_equal(a, two.arrays()[name]) for name, a in one.arrays().items())

    def test_a_column_collapses_within_its_bounds(self, tmp_path: Path) -> None:
        run = scenes.load("collapse_p0", **{**COLUMN, "time.end": 4.0}).run(
            out=tmp_path / "run", progress=False
        )
        summary = run.summary
        assert summary["converged"]
        assert summary["worst_certificate"] <= 1e-4
        assert summary["volume_drift"] <= 1e-12
        assert summary["min_volume_fraction"] >= 0.0
        assert summary["max_volume_fraction"] <= 1.0
        assert 0.8 < summary["run_out"] < 2.0
        assert {path.name for path in (tmp_path / "run" / "pictures").iterdir()} == {
            "strip.png", "fields.png", "profile.png", "front.png",
        }  # fmt: skip

    def test_a_silo_runs_empty_and_draws_its_volume(self, tmp_path: Path) -> None:
        run = scenes.load("silo_p0", **SILO, **{"time.end": 20.0, "material.friction": 0.3}).run(
            out=tmp_path / "run", progress=False
        )
        assert run.summary["volume"] < 0.2 * 6.0  # two cells across the outlet: the rest of the wedge stays
        assert run.summary["volume_drift"] <= 1e-12
        assert run.summary["mean_discharge"] > 0.0
        assert (tmp_path / "run" / "pictures" / "volume.png").exists()


@pytest.mark.slow
class TestHourglass:
    """Bar: constant within 5 % from 0.9 V0 to 0.2 V0 with friction, decreasing without (seed B, Fig. 7.5)."""

    @pytest.mark.parametrize("friction", [0.0, 0.3, 0.5])
    def test_the_discharge_is_constant_with_friction_only(self, friction: float) -> None:
        scene = scenes.load("silo_p0", **{"material.friction": friction})
        assert isinstance(scene.parameters, SceneParameters)
        run = scene.run(progress=False)
        assert run.summary["converged"]
        if friction > 0.0:
            assert run.summary["discharge_deviation"] <= 0.0505
        else:
            steps = run.results.steps
            rates = discharge_by_tenths(steps["time"], steps["volume"], float(run.observables["volume"][0]))
            assert np.all(np.diff(rates) < 0.0)
            assert rates[-1] < 0.6 * rates[0]
