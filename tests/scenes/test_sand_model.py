"""The sand scene on the real material point method: filling, bodies, storage, resuming, and laws that short runs must obey."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from barchan import results, scenes
from barchan.scenes.granular.discharge import discharge_figures, mean_discharge
from barchan.scenes.kinds.sand.model import SandModel
from barchan.scenes.kinds.sand.observables import momentum_drift
from barchan.scenes.validation import validate

BOX_2D: dict[str, Any] = {"size": [0.4, 0.2], "cells": [16, 8]}
BOX_3D: dict[str, Any] = {"size": [0.2, 0.2, 0.2], "cells": [6, 6, 6]}


def scene_of(box: dict[str, Any], **tables: Any) -> scenes.Scene:
    """A small scene: quick steps, two particles along each edge of a cell."""
    return scenes.Scene(
        validate({
            "scene": {"name": "small", "kind": "sand", **tables.pop("scene", {})},
            "box": box,
            "material": {"density": 1500.0, "friction": 0.5, **tables.pop("material", {})},
            "particles": {"per_cell": 2, **tables.pop("particles", {})},
            "time": {"end": 0.02, "frame_rate": 100.0, "step": 0.005, **tables.pop("time", {})},
            **tables,
        })
    )  # fmt: skip


def bed(depth: float, box: dict[str, Any]) -> dict[str, Any]:
    size = [*box["size"][:-1], depth]
    return {"bed": {"position": [0.5 * length for length in size], "size": size}}


class TestMatter:
    @pytest.mark.parametrize(
        ("piece", "volume"),
        [
            ({"shape": "sphere", "radius": 0.07, "position": [0.1, 0.1, 0.1]}, 4.0 / 3.0 * math.pi * 0.07**3),
            ({"shape": "cylinder", "radius": 0.06, "height": 0.1, "position": [0.1, 0.1, 0.05]}, math.pi * 0.06**2 * 0.1),
            ({"shape": "cone", "radius": 0.09, "height": 0.12, "position": [0.1, 0.1, 0.0]}, math.pi * 0.09**2 * 0.04),
            ({"size": [0.1, 0.08, 0.06], "rotation": [0.0, 0.0, 30.0], "position": [0.1, 0.1, 0.1]}, 0.1 * 0.08 * 0.06),
        ],
    )  # fmt: skip
    def test_round_pieces_have_their_volume_and_centre(self, piece: dict[str, Any], volume: float) -> None:
        box = {**BOX_3D, "cells": [12, 12, 12]}
        state = scene_of(box, matter={"piece": piece}).model().initial()
        assert state.volumes.sum() == pytest.approx(volume, rel=0.01)
        centre = np.average(state.positions, axis=0, weights=state.volumes)
        assert centre[:2] == pytest.approx([0.1, 0.1], abs=1e-4)

    def test_matter_leaves_room_for_bodies(self) -> None:
        ball = {"shape": "sphere", "radius": 0.05, "position": [0.1, 0.1, 0.08]}
        state = scene_of(BOX_3D, matter=bed(0.2, BOX_3D), bodies={"ball": ball}).model().initial()
        assert state.volumes.sum() == pytest.approx(0.2**3 - 4.0 / 3.0 * math.pi * 0.05**3, rel=5e-3)
        away = np.linalg.norm(state.positions - [0.1, 0.1, 0.08], axis=1)
        assert away.min() > 0.049

    def test_pieces_know_their_material_velocity_and_orientation(self) -> None:
        pieces = {
            "low": {
                "position": [0.2, 0.05],
                "size": [0.4, 0.1],
                "velocity": [1.0, 0.0],
                "orientation": "aligned",
            },
            "high": {"position": [0.2, 0.125], "size": [0.4, 0.05], "material": "light"},
        }
        # what must be shared by all materials is the same
        light = {"density": 1500.0, "friction": 0.2, "anisotropy": 0.5}
        scene = scene_of(BOX_2D, matter=pieces, materials={"light": light}, material={"anisotropy": 0.5})
        state = scene.model().initial()
        below = state.positions[:, 1] < 0.1
        assert np.array_equal(state.materials == 0, below)
        assert np.all(state.velocities[below] == [1.0, 0.0]) and not state.velocities[~below].any()
        assert np.all(state.orientations[below] == [[0.0, 0.0], [0.0, 1.0]])
        assert np.all(state.orientations[~below] == 0.5 * np.eye(2))


class TestBodies:
    def test_a_driven_gate_is_lifted_at_its_speed(self) -> None:
        gate = {"shape": "box", "size": [0.02, 0.18], "position": [0.25, 0.09], "motion": "driven"}
        gate |= {"velocity": [0.0, 0.7], "start": 0.005}
        column = {"column": {"position": [0.1, 0.05], "size": [0.2, 0.1]}}
        run = scene_of(BOX_2D, matter=column, bodies={"gate": gate}).run(progress=False)
        assert run.observables["gate_z"] == pytest.approx([0.09, 0.0935, 0.1005], abs=1e-9)
        assert run.observables["gate_vz"][-1] == pytest.approx(0.7)

    def test_a_scripted_body_follows_its_rows(self) -> None:
        bar = {
            "shape": "box", "size": [0.05, 0.02], "motion": "scripted", "times": [0.0, 0.01, 0.02],
            "positions": [[0.1, 0.15], [0.2, 0.15], [0.2, 0.18]], "rotations": [[0.0], [90.0], [90.0]],
        }  # fmt: skip
        run = scene_of(BOX_2D, matter=bed(0.05, BOX_2D), bodies={"bar": bar}).run(progress=False)
        assert run.observables["bar_x"] == pytest.approx([0.1, 0.2, 0.2])
        assert run.observables["bar_z"] == pytest.approx([0.15, 0.15, 0.18])
        assert run.observables["bar_angle"] == pytest.approx(np.radians([0.0, 90.0, 90.0]))

    def test_a_free_body_above_the_sand_falls_freely(self) -> None:
        ball = {
            "shape": "sphere",
            "radius": 0.02,
            "position": [0.2, 0.15],
            "motion": "free",
            "density": 3000.0,
        }
        run = scene_of(BOX_2D, matter=bed(0.05, BOX_2D), bodies={"ball": ball}).run(progress=False)
        assert run.observables["ball_vz"][-1] == pytest.approx(-9.81 * 0.02)

    def test_momentum_of_ball_and_sand_is_conserved_without_gravity(self) -> None:
        ball = {
            "shape": "sphere",
            "radius": 0.03,
            "position": [0.06, 0.1, 0.1],
            "motion": "free",
            "density": 5000.0,
        }
        ball |= {"velocity": [2.0, 0.3, 0.0], "spin": [0.0, 5.0, 0.0]}
        lump = {"lump": {"position": [0.13, 0.1, 0.1], "size": [0.06, 0.08, 0.08]}}
        scene = scene_of(
            BOX_3D, matter=lump, bodies={"ball": ball}, scene={"gravity": 0.0}, time={"end": 0.03}
        )
        run = scene.run(progress=False)
        assert run.observables["momentum_x"][-1] > 0.01  # the sand was hit
        assert run.summary["momentum_drift"] < 1e-10

    def test_a_fixed_body_never_moves(self) -> None:
        plate = {"shape": "plate_with_hole", "size": [0.5, 0.05], "hole": 0.1, "position": [0.2, 0.075]}
        fill = {"fill": {"position": [0.2, 0.15], "size": [0.4, 0.1]}}
        run = scene_of(
            BOX_2D, matter=fill, bodies={"plate": plate}, walls={"z_min": "open"}, observe={"level": 0.1},
            time={"end": 0.3, "frame_rate": 20.0},
        ).run(progress=False)  # fmt: skip
        assert np.ptp(run.observables["plate_z"]) == 0.0
        left = run.observables["volume_above"]
        assert np.all(np.diff(left) <= 1e-12) and left[-1] < left[0]


class TestRuns:
    @pytest.fixture
    def scene(self) -> scenes.Scene:
        ball = {
            "shape": "sphere",
            "radius": 0.04,
            "position": [0.1, 0.1, 0.12],
            "motion": "free",
            "density": 5000.0,
        }
        ball |= {"velocity": [0.0, 0.0, -1.0]}
        return scene_of(
            BOX_3D, matter=bed(0.06, BOX_3D), bodies={"ball": ball}, time={"end": 0.04, "frame_rate": 50.0},
            observe={"outline": "crater", "outline_height": 0.06},
        )  # fmt: skip

    def test_a_run_leaves_pictures_animation_and_figures(self, scene: scenes.Scene, tmp_path: Path) -> None:
        run = scene.run(tmp_path / "run", progress=False)
        pictures = {path.name for path in (tmp_path / "run" / "pictures").iterdir()}
        assert pictures == {"section.png", "above.png", "pressure.png", "curves.png", "sand.gif"}
        stored = results.open(tmp_path / "run")
        assert stored.particles(-1)["positions"].shape[1] == 3
        assert run.summary["ball_z"] < 0.12
        assert run.summary["converged"] and run.summary["volume_left"] == pytest.approx(1.0)
        assert {"bodies_kinetic_energy", "total_momentum_z", "outline_circularity", "ball_qw"} <= set(
            run.observables
        )

    def test_resuming_from_a_checkpoint_repeats_the_bits(self, scene: scenes.Scene) -> None:
        model = scene.model()
        state, _ = model.advance(model.initial(), 0.005)
        (straight, record), (resumed, repeated) = (
            model.advance(begin, 0.005) for begin in (state, model.restore(model.arrays(state)))
        )
        assert record == repeated
        for name, array in model.arrays(straight).items():
            assert np.array_equal(array, model.arrays(resumed)[name]), name

    def test_steps_let_neither_grain_nor_body_cross_more_than_their_share_of_a_cell(
        self, scene: scenes.Scene
    ) -> None:
        model = scene.model()
        assert isinstance(model, SandModel)
        arrays = model.arrays(model.initial())
        arrays["bodies_velocities"] = np.array([[0.0, 30.0, 40.0]])
        assert 50.0 * model.longest_step(model.restore(arrays)) == pytest.approx(0.2 / 6)

    def test_a_run_ends_when_all_rests_or_the_silo_is_empty(self) -> None:
        resting = scene_of(BOX_2D, matter=bed(0.05, BOX_2D), time={"end": 1.0, "rest_speed": 0.5})
        assert resting.run(progress=False).summary["end_time"] < 0.1
        falling = scene_of(
            BOX_2D,
            matter={"drop": {"position": [0.2, 0.15], "size": [0.05, 0.05]}},
            time={"end": 1.0},
            observe={"level": 0.12, "until_share": 0.5},
        )
        run = falling.run(progress=False)
        assert run.summary["end_time"] < 0.3
        assert run.observables["volume_above"][-1] < 0.5 * run.observables["volume_above"][0]

    def test_a_slope_makes_matter_flow_down_it(self) -> None:
        column = {"column": {"position": [0.2, 0.04], "size": [0.1, 0.08]}}
        run = scene_of(BOX_2D, matter=column, scene={"slope_deg": 25.0}, time={"end": 0.05}).run(
            progress=False
        )
        assert run.observables["momentum_x"][-1] > 0.0

    def test_grains_stay_in_the_box_and_belong_to_particles(self) -> None:
        scene = scene_of(BOX_2D, matter=bed(0.05, BOX_2D), particles={"grains": 3, "resample": True})
        model = scene.model()
        state = model.initial()
        grains = model.frame(state)["grains"]
        assert len(grains["owners"]) == 3 * state.particle_count
        assert np.all(grains["positions"] >= 0.0) and np.all(grains["positions"] <= BOX_2D["size"])


class TestDischarge:
    def test_a_constant_discharge_is_found(self) -> None:
        times = np.linspace(0.0, 1.0, 41)
        found = discharge_figures(times, 3.0 * (1.0 - 0.9 * times))
        assert found["discharge"] == pytest.approx(2.7)
        assert found["discharge_variation"] == pytest.approx(0.0, abs=1e-9)
        assert found["discharge_trend"] == pytest.approx(1.0)

    def test_a_tank_of_water_discharges_less_and_less(self) -> None:
        times = np.linspace(0.0, 0.9, 91)
        found = discharge_figures(times, (1.0 - times) ** 2)  # Torricelli
        assert found["discharge_trend"] < 0.75
        assert found["discharge_variation"] > 0.2

    def test_a_silo_that_does_not_empty_has_no_discharge(self) -> None:
        found = discharge_figures(np.array([0.0, 1.0]), np.array([1.0, 0.5]))
        assert found["discharge"] is None and found["share_left"] == 0.5

    def test_a_part_of_the_volume_is_enough_for_a_mean_discharge(self) -> None:
        times = np.array([0.0, 1.0, 2.0])
        assert mean_discharge(times, np.array([2.0, 1.6, 1.0]), (0.9, 0.7)) == pytest.approx(
            0.4 / (5.0 / 6.0)
        )
        assert mean_discharge(times, np.array([2.0, 1.6, 1.5]), (0.9, 0.7)) is None


def test_momentum_drift_is_relative_to_the_momentum_there_is() -> None:
    observables = {
        "momentum_x": np.array([0.0, 1.0]), "momentum_z": np.array([0.0, 0.0]),
        "total_momentum_x": np.array([2.0, 2.2]), "total_momentum_z": np.array([0.0, 0.0]),
    }  # fmt: skip
    assert momentum_drift(observables, 2) == pytest.approx(0.1)
