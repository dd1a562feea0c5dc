"""The regular grid and its multilinear shape functions: partition of unity, exactness on linear fields, input errors."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.spaces import RegularGrid, interpolate, shape_functions

GRIDS = [
    RegularGrid([0.1, -0.2], [0.3, 0.25], [4, 3]),
    RegularGrid([0.0, 0.5, -1.0], [0.2, 0.1, 0.4], [3, 2, 4]),
]


def points_in(grid: RegularGrid, count: int, seed: int) -> np.ndarray:
    return grid.origin + np.random.default_rng(seed).uniform(size=(count, grid.dimension)) * (
        grid.upper - grid.origin
    )


@pytest.mark.parametrize("grid", GRIDS)
def test_shape_functions_are_a_partition_of_unity(grid):
    shapes = shape_functions(grid, points_in(grid, 200, 0))
    assert np.all(shapes.weights >= 0.0)
    np.testing.assert_allclose(np.sum(shapes.weights, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.sum(shapes.gradients, axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("grid", GRIDS)
def test_linear_fields_and_their_gradients_are_exact(grid):
    slope, constant = np.arange(1.0, grid.dimension + 1.0), 0.7
    nodal = grid.node_positions(np.arange(grid.node_count)) @ slope + constant
    points = points_in(grid, 200, 1)
    shapes = shape_functions(grid, points)
    np.testing.assert_allclose(interpolate(grid, nodal, points), points @ slope + constant, atol=1e-13)
    gradient = np.einsum("pj,pjk->pk", nodal[shapes.nodes], shapes.gradients)
    np.testing.assert_allclose(gradient, np.broadcast_to(slope, gradient.shape), atol=1e-12)


@pytest.mark.parametrize("grid", GRIDS)
def test_gradients_match_finite_differences(grid):
    points, step = points_in(grid, 50, 2), 1e-7
    inside = np.all(np.abs((points - grid.origin) / grid.spacing % 1.0 - 0.5) < 0.49, axis=1)
    points = points[inside]
    shapes = shape_functions(grid, points)
    for axis in range(grid.dimension):
        offset = step * np.eye(grid.dimension)[axis]
        forward, backward = shape_functions(grid, points + offset), shape_functions(grid, points - offset)
        np.testing.assert_array_equal(forward.nodes, shapes.nodes)
        slope = (forward.weights - backward.weights) / (2 * step)
        np.testing.assert_allclose(slope, shapes.gradients[:, :, axis], atol=1e-6)


@pytest.mark.parametrize("grid", GRIDS)
def test_interpolation_reproduces_nodal_values(grid):
    nodal = np.random.default_rng(3).normal(size=(grid.node_count, 2))
    positions = grid.node_positions(np.arange(grid.node_count))
    np.testing.assert_allclose(
        interpolate(grid, nodal, np.clip(positions, grid.origin, grid.upper)), nodal, atol=1e-12
    )


@pytest.mark.parametrize("grid", GRIDS)
def test_node_volumes_add_up_to_the_box(grid):
    volumes = grid.node_volumes(np.arange(grid.node_count))
    assert np.isclose(np.sum(volumes), np.prod(grid.upper - grid.origin), rtol=1e-14)
    corner, inner = 0, int(np.ravel_multi_index(np.ones(grid.dimension, int), tuple(grid.nodes)))
    assert np.isclose(volumes[corner], grid.cell_volume / 2**grid.dimension)
    assert np.isclose(volumes[inner], grid.cell_volume)


def test_grid_of_a_box_has_the_size_asked_for():
    grid = RegularGrid.from_box([1.25, 0.25, 0.35], [40, 10, 20])
    np.testing.assert_allclose(grid.upper, [1.25, 0.25, 0.35])
    np.testing.assert_array_equal(grid.nodes, [41, 11, 21])
    assert grid.node_count == 41 * 11 * 21


def test_faces_are_found_by_axis_and_side():
    grid = GRIDS[0]
    ids = np.arange(grid.node_count)
    x = grid.node_positions(ids)[:, 0]
    np.testing.assert_array_equal(grid.on_face(ids, 0, upper=False), np.isclose(x, grid.origin[0]))
    np.testing.assert_array_equal(grid.on_face(ids, 0, upper=True), np.isclose(x, grid.upper[0]))


@pytest.mark.parametrize(
    ("origin", "spacing", "cells", "field"),
    [
        ([0, 0], [0.1, 0.1], [10, 0], "grid.cells"),
        ([0, 0], [0.1, 0.1], [10, 2.5], "grid.cells"),
        ([0, 0], [0.1, -0.1], [10, 10], "grid.spacing"),
        ([0, 0], [0.1, 0.0], [10, 10], "grid.spacing"),
        ([0, np.nan], [0.1, 0.1], [10, 10], "grid.origin"),
        ([0, 0, 0], [0.1, 0.1], [10, 10], "grid.cells"),
        ([0], [0.1], [10], "grid.origin"),
        ([0, 0], ["a", 0.1], [10, 10], "grid.spacing"),
        ([0, 0, 0], [1.0, 1.0, 1.0], [10**5, 10**5, 10**5], "grid.cells"),
    ],
)
def test_a_grid_that_cannot_be_is_refused_by_name(origin, spacing, cells, field):
    with pytest.raises(InputError) as error:
        RegularGrid(origin, spacing, cells)
    assert error.value.field == field


def test_a_box_without_size_is_refused():
    with pytest.raises(InputError, match="positive"):
        RegularGrid.from_box([1.0, 0.0], [10, 10])


def test_points_outside_the_box_are_refused():
    with pytest.raises(InputError, match="inside the box"):
        shape_functions(GRIDS[0], np.array([[5.0, 0.0]]))
