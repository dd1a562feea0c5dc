"""The column scene on the real material point method: geometry, walls, storage fields, and a short real run."""

from __future__ import annotations

import numpy as np
import pytest

from barchan import scenes
from barchan.flows.mpm import Wall
from barchan.scenes.granular.building import active_cells, build_walls
from barchan.scenes.kinds.column.model import ColumnModel
from barchan.scenes.kinds.column.observables import column_volume
from barchan.spaces import RegularGrid

SMALL_2D = {
    "box.size": [0.4, 0.15],
    "box.cells": [16, 6],
    "column.length": 0.12,
    "column.height": 0.11,
    "time.end": 0.05,
    "time.frame_rate": 40.0,
    "time.step": 0.0125,
    "time.adaptive": True,
    "per_cell": 2,
}
SMALL_3D = {"box.cells": [20, 2, 10], "time.end": 0.02, "time.frame_rate": 100.0, "per_cell": 2}


@pytest.fixture(params=["2D", "3D"])
def scene(request: pytest.FixtureRequest) -> scenes.Scene:
    if request.param == "2D":
        return scenes.load("collapse", **SMALL_2D)
    return scenes.load("collapse_3d", **SMALL_3D)


def test_the_initial_state_fills_the_column_exactly(scene: scenes.Scene) -> None:
    parameters = scene.parameters
    state = ColumnModel(parameters).initial()
    assert float(state.volumes.sum()) == pytest.approx(column_volume(parameters), rel=1e-13)
    assert np.all(state.positions[:, 0] < parameters.column.position + parameters.column.length)
    assert np.all(state.positions[:, -1] < parameters.column.height)
    centre = np.average(state.positions, axis=0, weights=state.volumes)
    assert centre[0] == pytest.approx(0.5 * parameters.column.length, rel=1e-12)
    assert centre[-1] == pytest.approx(0.5 * parameters.column.height, rel=1e-12)


def test_walls_are_those_of_the_scene() -> None:
    walls = {"x_min": "stick", "y_min": "slip", "z_min": {"friction": 0.5}, "z_max": {"friction": 0.0}}
    faces = build_walls(scenes.load("collapse_3d", walls=walls).parameters.walls).faces
    assert faces["x_min"] == Wall("stick")
    assert faces["y_min"] == Wall("slip")
    assert faces["z_min"] == Wall("friction", 0.5)
    assert faces["z_max"] == Wall("friction", 0.0)
    assert set(build_walls(scenes.load("collapse").parameters.walls).faces) == {
        "x_min",
        "x_max",
        "z_min",
        "z_max",
    }


def test_adaptive_steps_let_no_particle_cross_more_than_its_share_of_a_cell(scene: scenes.Scene) -> None:
    model = ColumnModel(scene.parameters)
    state = model.initial()
    assert model.longest_step(state) == scene.parameters.time.step
    velocities = np.zeros_like(state.velocities)
    velocities[3, 0] = -50.0
    fast = model.restore({**model.arrays(state), "velocities": velocities})
    edge = min(scene.parameters.spacing)
    assert 50.0 * model.longest_step(fast) == pytest.approx(scene.parameters.time.cfl * edge)


@pytest.mark.parametrize("cells", [(4, 3), (3, 2, 2)])
def test_active_cells_of_a_full_grid_are_all_cells_with_positive_orientation(cells: tuple[int, ...]) -> None:
    grid = RegularGrid.from_box([1.0] * len(cells), cells)
    ids = np.arange(grid.node_count)
    corners = grid.node_positions(ids)[active_cells(ids, grid.nodes)]
    assert len(corners) == grid.cell_count
    # the first edges of XDMF's quadrilateral and hexahedron, taken in order, are right-handed
    last = 3 if len(cells) == 2 else 4
    edges = np.stack(
        [corners[:, k] - corners[:, 0] for k in ((1, last) if len(cells) == 2 else (1, 3, last))], axis=1
    )
    assert np.linalg.det(edges) == pytest.approx(grid.cell_volume)
    assert corners.mean(axis=1).mean(axis=0) == pytest.approx(0.5)


def test_a_cell_with_an_inactive_corner_is_left_out() -> None:
    grid = RegularGrid.from_box([1.0, 1.0], [2, 2])
    ids = np.delete(np.arange(9), 8)
    assert len(active_cells(ids, grid.nodes)) == 3
    assert active_cells(np.zeros(0, dtype=np.int64), grid.nodes).shape == (0, 4)


def test_a_short_real_run_keeps_its_volume_loses_energy_and_records_every_step(scene: scenes.Scene) -> None:
    run = scene.run(progress=False)
    steps, summary = run.results.steps, run.summary
    assert len(run.observables["time"]) == 3
    assert summary["steps"] == len(steps["time"]) > 0
    assert steps["time"][-1] == pytest.approx(scene.parameters.time.end)
    assert summary["volume_drift"] <= 1e-12
    assert summary["final_energy"] < summary["initial_energy"]
    assert summary["front"] >= run.observables["front"][0]
    grid = run.results.grid(-1)
    assert set(grid) >= {"stresses", "pressures", "shear_stresses", "volume_fractions", "cells", "node_ids"}
    assert np.all(grid["pressures"] >= 0.0)  # no tension in dry matter
    assert grid["cells"].max() < len(grid["node_ids"])


def test_resuming_a_real_run_from_its_checkpoint_repeats_the_bits(scene: scenes.Scene) -> None:
    model = ColumnModel(scene.parameters)
    state, _ = model.advance(model.initial(), 0.005)
    restored = model.restore(model.arrays(state))
    (straight, record), (resumed, repeated) = model.advance(state, 0.005), model.advance(restored, 0.005)
    assert record == repeated
    for name, array in model.arrays(straight).items():
        assert np.array_equal(array, model.arrays(resumed)[name]), name
