"""Velocity bases: partitions of unity that reproduce affine fields, their gradients, and transfers that conserve momentum."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.flows.mpm import State
from barchan.flows.mpm import _basis_kernels as kernels
from barchan.flows.mpm.bases import VELOCITIES, VelocityBasis, corner_shares, simplex_weights
from barchan.flows.mpm.transfer import particles_to_grid
from barchan.flows.mpm.velocity import shown_gradients, velocity_field
from barchan.spaces import RegularGrid

DIMENSIONS = [2, 3]


def grid_of(d: int) -> RegularGrid:
    # One axis with a single cell in 3D, where a spline has both its ends in that cell.
    return (
        RegularGrid([0.1, -0.2], [0.3, 0.25], [6, 5])
        if d == 2
        else RegularGrid([0, 0.5, -1], [0.2, 0.1, 0.4], [4, 1, 2])
    )


def points_in(grid: RegularGrid, count: int = 300, margin: float = 0.0) -> np.ndarray:
    """Random points, `margin` (in cells) away from the faces of cells, and from their diagonals with high probability."""
    rng, d = np.random.default_rng(1), grid.dimension
    local = rng.integers(0, grid.cells, size=(count, d)) + rng.uniform(margin, 1.0 - margin, size=(count, d))
    return grid.origin + grid.spacing * local


def wedge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., :, None] * b[..., None, :] - b[..., :, None] * a[..., None, :]


def angular_momentum(basis: VelocityBasis, state: State) -> np.ndarray:
    """Of affine particles: x ^ V v + V sum_i w_i (y_i - x) ^ c (y_i - x)."""
    table = basis.evaluate(state.positions)
    arms = basis.positions(np.arange(int(np.prod(basis.lattice))))[basis.of_cells(table.cells)]
    arms = arms - state.positions[:, None, :]
    spin = wedge(arms, np.einsum("pkl,pjl->pjk", state.affine, arms))
    total = wedge(state.positions, state.velocities) + np.einsum("pj,pjkl->pkl", table.weights, spin)
    return np.einsum("p,pkl->kl", state.volumes, total)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", VELOCITIES)
def test_functions_are_not_negative_add_up_to_one_and_reproduce_affine_fields(name, d):
    basis, points = VelocityBasis(grid_of(d), name), points_in(grid_of(d))
    table, places = basis.evaluate(points), basis.positions(np.arange(int(np.prod(basis.lattice))))
    functions = basis.of_cells(table.cells)
    assert np.all(table.weights >= 0.0)
    np.testing.assert_allclose(np.sum(table.weights, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(np.einsum("pj,pjk->pk", table.weights, places[functions]), points, atol=1e-12)
    np.testing.assert_allclose(np.sum(table.gradients, axis=1), 0.0, atol=1e-12)
    identity = np.einsum("pjk,pjl->pkl", places[functions], table.gradients)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(d), identity.shape), atol=1e-12)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", VELOCITIES)
def test_gradients_are_the_differences_of_the_values(name, d):
    basis, points, step = VelocityBasis(grid_of(d), name), points_in(grid_of(d), margin=1e-3), 1e-6
    table = basis.evaluate(points)
    inside = np.ones(len(points), dtype=bool)
    for axis in range(d):
        ahead, behind = (basis.evaluate(points + sign * step * np.eye(d)[axis]) for sign in (1.0, -1.0))
        # Linear functions have a kink on the diagonals.
        inside &= (ahead.simplices == table.simplices) & (behind.simplices == table.simplices)
        slopes = (ahead.weights - behind.weights) / (2.0 * step)
        np.testing.assert_allclose(slopes[inside], table.gradients[inside, :, axis], atol=1e-6)
    assert np.count_nonzero(inside) > 0.9 * len(points)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_fields_are_continuous_between_cells_and_gradients_of_splines_too(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.5), np.full(d, 4))
    rng = np.random.default_rng(3)
    faces = rng.integers(1, 4, size=200) * 0.5
    points = rng.uniform(0.0, 2.0, size=(200, d))
    for name in VELOCITIES:
        basis = VelocityBasis(grid, name)
        values = rng.normal(size=int(np.prod(basis.lattice)))
        jumps = []
        for axis in range(d):
            sides = []
            for side in (-1e-9, 1e-9):
                beside = points.copy()
                beside[:, axis] = faces + side
                table = basis.evaluate(beside)
                here = values[basis.of_cells(table.cells)]
                sides.append(
                    (
                        np.einsum("pj,pj->p", table.weights, here),
                        np.einsum("pjk,pj->pk", table.gradients, here),
                    )
                )
            np.testing.assert_allclose(sides[0][0], sides[1][0], atol=1e-6)
            jumps.append(np.max(np.abs(sides[0][1] - sides[1][1])))
        if name == "B2":
            assert max(jumps) < 1e-5
        else:
            assert min(jumps) > 0.1


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", VELOCITIES)
def test_only_functions_of_a_face_see_it(name, d):
    basis = VelocityBasis(grid_of(d), name)
    points, ids = points_in(basis.grid), np.arange(int(np.prod(basis.lattice)))
    for axis in range(d):
        for upper in (False, True):
            at_face = points.copy()
            at_face[:, axis] = basis.grid.upper[axis] if upper else basis.grid.origin[axis]
            table = basis.evaluate(at_face)
            seen = basis.on_face(ids, axis, upper)[basis.of_cells(table.cells)]
            np.testing.assert_allclose(np.sum(np.where(seen, table.weights, 0.0), axis=1), 1.0, atol=1e-8)
    assert np.array_equal(np.ravel_multi_index(tuple(basis.indices(ids).T), tuple(basis.lattice)), ids)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_simplices_fill_the_cell_and_their_coordinates_find_the_point(d):
    grid = RegularGrid(np.zeros(d), np.ones(d), np.ones(d, dtype=int))
    points = np.random.default_rng(2).uniform(size=(4000, d))
    table = VelocityBasis(grid, "P1").evaluate(points)
    weights, corners = simplex_weights(table), kernels.simplex_corners(d)
    places = np.stack(np.meshgrid(*[[0.0, 1.0]] * d, indexing="ij"), axis=-1).reshape(-1, d)
    np.testing.assert_allclose(np.sum(weights, axis=1), 1.0, rtol=1e-14)
    found = np.einsum("pa,pak->pk", weights, places[corners[table.simplices]])
    np.testing.assert_allclose(found, points, atol=1e-12)
    counts = np.bincount(table.simplices, minlength=len(corners)) / len(points)
    np.testing.assert_allclose(counts, 1.0 / len(corners), atol=0.05)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_shares_of_half_cells_are_the_integrals_of_the_corner_functions(d):
    grid, parts = RegularGrid(np.zeros(d), np.ones(d), np.ones(d, dtype=int)), 8
    middle = (np.arange(parts) + 0.5) / parts  # exact for functions that are linear along the axes
    points = np.stack(np.meshgrid(*[middle] * d, indexing="ij"), axis=-1).reshape(-1, d)
    table = VelocityBasis(grid, "Q1").evaluate(points)
    half = np.floor(2.0 * points).astype(int) @ (2 ** np.arange(d)[::-1])
    expected = np.zeros((2**d, 2**d))
    np.add.at(expected, half, table.weights / len(points))
    np.testing.assert_allclose(corner_shares(d), expected, rtol=1e-12)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", VELOCITIES)
def test_to_the_grid_and_back_mass_and_both_momenta_are_conserved(random_state, name, d):
    grid, state = random_state(d)
    basis = VelocityBasis(grid, name)
    densities = np.random.default_rng(6).uniform(1.0, 2.0, state.particle_count)
    heavy = State.from_arrays(state.arrays() | {"volumes": densities * state.volumes})
    field = velocity_field(particles_to_grid(grid, state), state, basis, densities, True)
    np.testing.assert_allclose(np.sum(field.masses), np.sum(heavy.volumes), rtol=1e-12)
    momenta = field.masses[:, None] * field.velocities
    np.testing.assert_allclose(
        np.sum(momenta, axis=0), heavy.volumes @ state.velocities, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        np.sum(wedge(field.places, momenta), axis=0), angular_momentum(basis, heavy), atol=1e-9
    )
    values = np.random.default_rng(4).normal(size=field.velocities.shape)
    momenta = field.masses[:, None] * values
    velocities, slopes = field.to_particles(values)
    after = State.from_arrays(
        heavy.arrays() | {"velocities": velocities, "affine": field.affine(values, slopes)}
    )
    np.testing.assert_allclose(heavy.volumes @ velocities, np.sum(momenta, axis=0), atol=1e-11)
    np.testing.assert_allclose(
        angular_momentum(basis, after), np.sum(wedge(field.places, momenta), axis=0), atol=1e-9
    )


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", VELOCITIES)
def test_affine_motions_survive_the_round_trip(random_state, name, d):
    grid, state = random_state(d)
    gradient = np.random.default_rng(5).normal(size=(d, d))
    moving = State.from_arrays(
        state.arrays()
        | {
            "velocities": state.positions @ gradient.T + 1.0,
            "affine": np.broadcast_to(gradient, (state.particle_count, d, d)),
        }
    )
    field = velocity_field(particles_to_grid(grid, moving), moving, VelocityBasis(grid, name), 1.0, True)
    there = field.masses > 0.0
    np.testing.assert_allclose(field.velocities[there], (field.places @ gradient.T + 1.0)[there], atol=1e-8)
    velocities, slopes = field.to_particles(field.velocities)
    np.testing.assert_allclose(velocities, moving.velocities, atol=1e-8)
    np.testing.assert_allclose(slopes, moving.affine, atol=1e-6)
    np.testing.assert_allclose(field.affine(field.velocities, slopes), moving.affine, atol=1e-6)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_tables_of_multilinear_functions_say_the_same_as_sums_over_cells(random_state, d):
    grid, state = random_state(d)
    matter, basis = particles_to_grid(grid, state), VelocityBasis(grid, "Q1")
    table = basis.evaluate(state.positions)
    rows = matter.active.node_numbers[basis.of_cells(table.cells)]
    masses, momenta = np.zeros(len(matter.volumes)), np.zeros(matter.velocities.shape)
    kernels.scatter_affine(
        rows, table.weights, state.volumes, grid.node_positions(matter.active.nodes), state.positions,
        state.velocities, state.affine, masses, momenta,
    )  # fmt: skip
    np.testing.assert_allclose(masses, matter.volumes, rtol=1e-12)
    np.testing.assert_allclose(momenta / masses[:, None], matter.velocities, rtol=1e-9, atol=1e-9)
    fast = velocity_field(matter, state, basis, 1.0, True)
    values = np.random.default_rng(7).normal(size=fast.velocities.shape)
    velocities, slopes = fast.to_particles(values)
    found, gradients = np.empty_like(velocities), np.empty_like(slopes)
    kernels.gather(rows, table.weights, values, found)
    kernels.gradients_at(rows, table.gradients, values, gradients)
    np.testing.assert_allclose(found, velocities, atol=1e-12)
    np.testing.assert_allclose(gradients, slopes, atol=1e-10)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", ["P1", "B2"])
def test_particles_move_with_the_field_and_stay_in_the_box(random_state, name, d):
    grid, state = random_state(d)
    field = velocity_field(particles_to_grid(grid, state), state, VelocityBasis(grid, name), 1.0, True)
    values = np.full(field.velocities.shape, 0.7)
    places, substeps = field.moved(values, np.full(state.positions.shape, 0.7), 0.1, 0.5)
    free = np.all(places < grid.upper - 0.01, axis=1)
    np.testing.assert_allclose(places[free], state.positions[free] + 0.07, rtol=1e-10)
    assert substeps == int(np.ceil(np.max(0.07 / grid.spacing) / 0.5))
    far, _ = field.moved(100.0 * values, np.full(state.positions.shape, 70.0), 1.0, 0.5)
    assert np.all(far < grid.upper)


@pytest.mark.parametrize("name", ["P1", "B2"])
def test_the_velocities_at_the_nodes_are_those_of_the_field(random_state, name):
    grid, state = random_state(2)
    field = velocity_field(particles_to_grid(grid, state), state, VelocityBasis(grid, name), 1.0, True)
    gradient = np.array([[1.0, 2.0], [-3.0, 0.5]])
    nodes = grid.node_positions(field.matter.active.nodes)
    constant = np.broadcast_to([3.0, -4.0], field.velocities.shape)
    np.testing.assert_allclose(
        field.at_nodes(np.ascontiguousarray(constant)), np.tile([3.0, -4.0], (len(nodes), 1))
    )
    found = field.at_nodes(field.places @ gradient.T + 4.0)
    index = grid.node_indices(field.matter.active.nodes)
    stencil = field.matter.stencil.cells
    # Where a cell beside the node is empty, only some functions are known there.
    known = np.all((stencil >= 0) | (index == 0).any(axis=1)[:, None], axis=1) & np.all(index > 0, axis=1)
    assert np.count_nonzero(known) > 5
    np.testing.assert_allclose(found[known], (nodes @ gradient.T + 4.0)[known], atol=1e-7)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_gradients_across_a_near_face_are_hidden_as_with_sums_over_cells(random_state, d):
    grid, state = random_state(d)
    near = (state.positions - grid.origin) / grid.spacing
    near = np.floor(near) + np.where(
        np.arange(d) == 0, 10.0 ** np.linspace(-8, -1, len(near))[:, None], near % 1.0
    )
    state = State.from_arrays(state.arrays() | {"positions": grid.origin + grid.spacing * near})
    basis = VelocityBasis(grid, "Q1")
    table, matter = basis.evaluate(state.positions), particles_to_grid(grid, state)
    masses, momenta = np.zeros(len(matter.volumes)), np.zeros(matter.velocities.shape)
    kernels.scatter_affine(
        matter.active.node_numbers[basis.of_cells(table.cells)], table.weights, state.volumes,
        grid.node_positions(matter.active.nodes), state.positions, state.velocities,
        shown_gradients(basis, state), masses, momenta,
    )  # fmt: skip
    np.testing.assert_allclose(momenta / masses[:, None], matter.velocities, rtol=1e-6, atol=1e-6)
    assert not np.allclose(shown_gradients(basis, state), state.affine)
    np.testing.assert_array_equal(shown_gradients(VelocityBasis(grid, "B2"), state), state.affine)
