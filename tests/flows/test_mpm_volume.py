"""The correction of excess volume: reduces it, respects walls and symmetry, stays within the energy allowed to it."""

import numpy as np
import pytest

from barchan.flows.mpm import Material, State, fill_box
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
