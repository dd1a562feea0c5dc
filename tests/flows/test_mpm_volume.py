"""The correction of excess volume: reduces it, respects walls and symmetry, stays within the energy allowed to it."""

import numpy as np
import pytest

from barchan.flows.mpm import Material, State, Wall, Walls, fill_box
from barchan.flows.mpm._volume_kernels import gather_poisson, least_potential
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.transfer import move_particles, particles_to_grid
from barchan.flows.mpm.volume import volume_shift, within_energy
from barchan.spaces import RegularGrid

DIMENSIONS = [2, 3]


def squeezed(d: int) -> tuple[RegularGrid, State]:
    """A block in the middle of a box, with 10 % too much matter in its core."""
    grid = RegularGrid(np.zeros(d), np.full(d, 0.1), np.full(d, 8))
    state = fill_box(grid, np.full(d, 0.2), np.full(d, 0.6), 3, Material(1000.0, 0.5))
    core = np.all(np.abs(state.positions - 0.4) < 0.1, axis=1)
    return grid, State.at_start(state.positions, np.where(core, 1.1, 1.0) * state.volumes)


def excess(grid: RegularGrid, state: State) -> float:
    matter = particles_to_grid(grid, state)
    return float(np.sum(np.maximum(matter.volumes - matter.capacities, 0.0)))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_repeated_shifts_remove_the_excess(d):
    grid, state = squeezed(d)
    start = excess(grid, state)
    assert start > 0.0
    for _ in range(15):
        matter = particles_to_grid(grid, state)
        rest = np.zeros_like(matter.velocities)
        shift = volume_shift(matter, rest, 0.01, 1.0, 0.3)
        assert np.all(np.abs(shift) <= 0.05 * grid.spacing)
        moved = move_particles(matter, rest, state.positions, np.zeros_like(state.positions), 0.01, 1, shift)
        state = State.at_start(moved, state.volumes)
    assert excess(grid, state) < 0.3 * start


@pytest.mark.parametrize("d", DIMENSIONS)
def test_matter_with_room_is_left_alone(d):
    grid, state = squeezed(d)
    matter = particles_to_grid(grid, State.at_start(state.positions, 0.5 * state.volumes))
    assert not np.any(volume_shift(matter, np.zeros_like(matter.velocities), 0.01, 1.0, 0.3))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_symmetric_excess_is_shifted_symmetrically(d):
    grid, state = squeezed(d)
    matter = particles_to_grid(grid, state)
    shift = volume_shift(matter, np.zeros_like(matter.velocities), 0.01, 1.0, 0.3)
    assert np.max(np.abs(shift)) > 1e-4
    index = grid.node_indices(matter.active.nodes)
    index[:, 0] = grid.cells[0] - index[:, 0]
    there = matter.active.node_numbers[np.ravel_multi_index(tuple(index.T), tuple(grid.nodes))]
    mirrored = shift[there].copy()
    mirrored[:, 0] *= -1.0
    np.testing.assert_allclose(mirrored, shift, atol=1e-10)


def test_nothing_is_shifted_through_a_wall():
    grid = RegularGrid(np.zeros(2), np.full(2, 0.1), np.full(2, 4))
    state = fill_box(grid, [0, 0], [0.2, 0.2], 3, Material(1000.0, 0.5))
    matter = particles_to_grid(grid, State.at_start(state.positions, 1.1 * state.volumes))
    shift = volume_shift(matter, np.zeros_like(matter.velocities), 0.01, 1.0, 0.3)
    nodes = grid.node_indices(matter.active.nodes)
    assert np.any(shift)
    assert not np.any(shift[nodes == 0])


def test_a_shift_raises_the_matter_by_no_more_than_the_energy_allowed():
    gravity = np.array([0.0, -10.0])
    masses, shift = np.array([1.0, 2.0]), np.array([[0.0, 0.1], [0.3, 0.2]])
    np.testing.assert_array_equal(within_energy(shift, masses, gravity, 1e9), shift)
    limited = within_energy(shift, masses, gravity, 1.0)
    assert np.isclose(10.0 * np.sum(masses * limited[:, 1]), 0.5, rtol=1e-12)
    assert not np.any(within_energy(shift, masses, gravity, 0.0))
    assert not np.any(within_energy(shift, masses, gravity, -1.0))
    np.testing.assert_array_equal(within_energy(-shift, masses, gravity, 0.0), -shift)


def poisson(grid: RegularGrid, state: State) -> tuple[np.ndarray, np.ndarray]:
    """K (n, 3^d) and the numbers (n, 3^d) of the neighbours."""
    matter = particles_to_grid(grid, state)
    stencil, tables = matter.stencil, moment_tables(grid.dimension)
    neighbours = np.where(stencil.linked, stencil.neighbours, -1).astype(np.int32)
    stiffness = np.zeros(neighbours.shape)
    gather_poisson(stencil.cells, tables.slots, tables.product, stencil.slopes, matter.moments, stiffness)
    return stiffness, neighbours


def dense(stiffness: np.ndarray, neighbours: np.ndarray) -> np.ndarray:
    full = np.zeros((len(neighbours),) * 2)
    rows, slots = np.nonzero(neighbours >= 0)
    full[rows, neighbours[rows, slots]] = stiffness[rows, slots]
    return full


@pytest.mark.parametrize("d", DIMENSIONS)
def test_the_stiffness_is_the_sum_of_products_of_slopes(d):
    grid, state = squeezed(d)
    full = dense(*poisson(grid, state))
    table = VelocityBasis(grid, "Q1").evaluate(state.positions)
    numbers = particles_to_grid(grid, state).active.node_numbers[
        VelocityBasis(grid, "Q1").of_cells(table.cells)
    ]
    expected = np.zeros_like(full)
    products = np.einsum("p,pik,pjk->pij", state.volumes, table.gradients, table.gradients)
    for p in range(len(numbers)):
        expected[np.ix_(numbers[p], numbers[p])] += products[p]
    np.testing.assert_allclose(full, expected, rtol=1e-6, atol=1e-9 * np.max(expected))


def test_the_potential_solves_the_complementarity_problem():
    grid, state = squeezed(2)
    stiffness, neighbours = poisson(grid, state)
    target = np.random.default_rng(0).normal(size=len(neighbours)) - 0.8
    potential = least_potential(stiffness, neighbours, target, 4000)
    surplus = dense(stiffness, neighbours) @ potential - target
    assert np.any(potential > 0.0)
    assert np.all(potential >= 0.0)
    assert np.min(surplus) > -1e-6
    assert np.max(np.abs(potential * surplus)) < 1e-5 * np.max(potential)


def test_a_full_box_is_not_stirred():
    """Particles at random fill a box: the shifts even their numbers in the cells out, and never the other way."""
    rng = np.random.default_rng(1)
    grid = RegularGrid(np.zeros(2), np.ones(2), np.full(2, 12))
    state = State.at_start(rng.uniform(0.0, 12.0, (12 * 12 * 16, 2)), np.full(12 * 12 * 16, 1.0 / 16.0))

    def spread(state: State) -> float:
        return float(np.histogram2d(*state.positions.T, bins=[np.arange(13)] * 2)[0].std())

    first, before = spread(state), excess(grid, state)
    for _ in range(60):
        matter = particles_to_grid(grid, state)
        rest = np.zeros_like(matter.velocities)
        shift = volume_shift(matter, rest, 0.01, 1.0, 0.3)
        moved = move_particles(matter, rest, state.positions, np.zeros_like(state.positions), 0.01, 1, shift)
        state = State.at_start(moved, state.volumes)
    assert excess(grid, state) < 0.4 * before
    assert spread(state) < 0.95 * first


def test_matter_that_leaves_through_an_open_face_is_not_pushed_back():
    grid = RegularGrid(np.zeros(2), np.full(2, 0.1), np.full(2, 4))
    state = fill_box(grid, [0, 0], [0.4, 0.1], 3, Material(1000.0, 0.5))
    matter = particles_to_grid(grid, state)
    falling = np.zeros_like(matter.velocities)
    falling[:, 1] = -1.0
    assert np.any(volume_shift(matter, falling, 0.05, 1.0, 0.3, Walls({"z_min": Wall("slip")})))
    assert not np.any(volume_shift(matter, falling, 0.05, 1.0, 0.3, Walls({"z_min": Wall("open")})))
