"""Sorting particles by cell: a permutation, stable, complete; active nodes are the corners of occupied cells."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.spaces import RegularGrid, shape_functions, sort_particles

GRIDS = [
    RegularGrid([0.1, -0.2], [0.3, 0.25], [7, 5]),
    RegularGrid([0.0, 0.5, -1.0], [0.2, 0.1, 0.4], [5, 4, 3]),
]


@pytest.mark.parametrize("grid", GRIDS)
def test_particles_are_listed_cell_by_cell_in_stored_order(grid):
    points = grid.origin + np.random.default_rng(0).beta(0.5, 2.0, (300, grid.dimension)) * (
        grid.upper - grid.origin
    )
    active = sort_particles(grid, points)
    np.testing.assert_array_equal(np.sort(active.order), np.arange(300))
    cell = np.floor((points - grid.origin) / grid.spacing).astype(int)
    flat = np.ravel_multi_index(tuple(cell.T), tuple(grid.cells))
    for rank, occupied in enumerate(active.occupied):
        listed = active.order[active.starts[rank] : active.starts[rank + 1]]
        np.testing.assert_array_equal(listed, np.flatnonzero(flat == occupied))
        assert active.cell_numbers[occupied] == rank
    assert active.starts[-1] == 300
    assert np.count_nonzero(active.cell_numbers >= 0) == len(active.occupied)


@pytest.mark.parametrize("grid", GRIDS)
def test_active_nodes_are_those_of_the_particles_cells(grid):
    points = grid.origin + np.random.default_rng(1).uniform(size=(6, grid.dimension)) * (
        grid.upper - grid.origin
    )
    active = sort_particles(grid, points)
    np.testing.assert_array_equal(active.nodes, np.unique(shape_functions(grid, points).nodes))
    np.testing.assert_array_equal(active.node_numbers[active.nodes], np.arange(len(active.nodes)))
    assert np.count_nonzero(active.node_numbers >= 0) == len(active.nodes)


def test_particles_on_the_walls_belong_to_the_outer_cells():
    grid = GRIDS[0]
    active = sort_particles(grid, np.array([grid.origin, grid.upper]))
    np.testing.assert_array_equal(active.occupied, [0, grid.cell_count - 1])


@pytest.mark.parametrize("bad", [np.nan, 10.0, -10.0])
def test_a_particle_outside_the_box_is_named(bad):
    grid = GRIDS[1]
    points = np.tile(0.5 * (grid.origin + grid.upper), (4, 1))
    points[2, 1] = bad
    with pytest.raises(InputError) as error:
        sort_particles(grid, points)
    assert error.value.field == "positions[2]"


@pytest.mark.parametrize("shape", [(0, 2), (4, 3), (4,)])
def test_positions_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match="shape"):
        sort_particles(GRIDS[0], np.zeros(shape))
