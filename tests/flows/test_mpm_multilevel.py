"""Starts from coarser grids: fewer sweeps, the same solution."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.flows.mpm import Material, Options, State, Stepper, Walls, fill_box
from barchan.flows.mpm.multilevel import _coarser, _interpolated
from barchan.spaces import RegularGrid

MATERIAL = Material(1500.0, 0.5)


def bed(d: int, cells: int, **options) -> tuple[Stepper, State]:
    grid = RegularGrid(np.zeros(d), np.full(d, 1.0 / cells), np.full(d, cells))
    state = fill_box(grid, np.zeros(d), np.append(np.ones(d - 1), 0.75), 2, MATERIAL)
    return Stepper(grid, MATERIAL, Walls.cuve(d), options=Options(**options)), state


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("stress", ["Q1", "Q1d"])
def test_a_bed_starts_with_fewer_sweeps_and_the_same_velocities(d, stress):
    records, states = {}, {}
    choices = {"stress": stress, "method": "gauss_seidel", "tolerance": 1e-5, "max_sweeps": 50000}
    for multilevel in (False, True):
        stepper, state = bed(d, 24 if d == 2 else 12, multilevel=multilevel, **choices)
        states[multilevel], records[multilevel] = stepper.advance(state, 1 / 240)
    assert records[True].converged
    assert records[False].converged
    assert records[True].sweeps < 0.6 * records[False].sweeps
    scale = 9.81 / 240
    np.testing.assert_allclose(states[True].velocities, states[False].velocities, atol=2e-3 * scale)


def test_later_steps_start_from_the_last_one():
    stepper, state = bed(2, 16)
    state, _ = stepper.advance(state, 1 / 240)
    step = stepper._build(state, 1 / 240)
    np.testing.assert_array_equal(step.start[: len(step.rows.ids)], state.node_stresses)


def test_grids_get_coarser_until_too_few_cells_are_left():
    stepper, _ = bed(3, 13)
    setting, cells = stepper.setting, []
    while setting is not None:
        cells.append(setting.grid.cells.tolist())
        np.testing.assert_allclose(setting.grid.upper, 1.0, rtol=1e-12)
        setting = _coarser(setting)
    assert cells == [[13] * 3, [7] * 3, [4] * 3]


def test_stresses_that_are_linear_in_space_survive_the_interpolation():
    grid = RegularGrid([0.1, 0.2], [0.3, 0.25], [4, 5])
    nodes = np.arange(grid.node_count)
    places = grid.origin + np.random.default_rng(0).uniform(size=(50, 2)) * (grid.upper - grid.origin)
    slope = np.array([[1.0, 2.0, -3.0], [0.5, 0.0, 4.0]])
    found = _interpolated(grid, nodes, grid.node_positions(nodes) @ slope, places)
    np.testing.assert_allclose(found, places @ slope, atol=1e-12)
    some = _interpolated(grid, nodes[:7], np.ones((7, 3)), places)
    assert set(np.unique(np.round(some, 12))) <= {0.0, 1.0}
