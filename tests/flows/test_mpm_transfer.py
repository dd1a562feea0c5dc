"""Transfers conserve mass, momentum and angular momentum, keep affine motions, and do not depend on the thread count."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.mpm import State
from barchan.flows.mpm.transfer import (
    grid_to_particles,
    move_particles,
    particles_to_grid,
    substeps_needed,
)
from barchan.spaces import RegularGrid, shape_functions

DIMENSIONS = [2, 3]


def wedge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Antisymmetric a (x) b - b (x) a, the angular momentum tensor in any dimension."""
    return a[..., :, None] * b[..., None, :] - b[..., :, None] * a[..., None, :]


def angular_momentum(grid, state) -> np.ndarray:
    """Of affine particles: x ^ V v + V sum_i w_i (y_i - x) ^ c (y_i - x)."""
    shapes = shape_functions(grid, state.positions)
    arms = grid.node_positions(shapes.nodes) - state.positions[:, None, :]
    spin = wedge(arms, np.einsum("pkl,pjl->pjk", state.affine, arms))
    total = wedge(state.positions, state.velocities) + np.einsum("pj,pjkl->pkl", shapes.weights, spin)
    return np.einsum("p,pkl->kl", state.volumes, total)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_particles_to_grid_conserves_mass_and_both_momenta(random_state, d):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    np.testing.assert_allclose(np.sum(matter.volumes), np.sum(state.volumes), rtol=1e-13)
    momentum = matter.volumes[:, None] * matter.velocities
    np.testing.assert_allclose(
        np.sum(momentum, axis=0), state.volumes @ state.velocities, rtol=1e-9, atol=1e-12
    )
    nodes = grid.node_positions(matter.active.nodes)
    np.testing.assert_allclose(
        np.sum(wedge(nodes, momentum), axis=0), angular_momentum(grid, state), atol=1e-9
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_grid_to_particles_conserves_both_momenta(random_state, d):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    field = np.random.default_rng(4).normal(size=matter.velocities.shape)
    velocities, affine = grid_to_particles(matter, field, state.positions)
    after = State.from_arrays(state.arrays() | {"velocities": velocities, "affine": affine})
    momentum = matter.volumes[:, None] * field
    np.testing.assert_allclose(state.volumes @ velocities, np.sum(momentum, axis=0), atol=1e-12)
    nodes = grid.node_positions(matter.active.nodes)
    np.testing.assert_allclose(
        angular_momentum(grid, after), np.sum(wedge(nodes, momentum), axis=0), atol=1e-9
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_node_volumes_are_the_integrals_of_the_shape_functions(random_state, d):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    shapes = shape_functions(grid, state.positions)
    expected = np.bincount(
        shapes.nodes.ravel(), (state.volumes[:, None] * shapes.weights).ravel(), minlength=grid.node_count
    )
    np.testing.assert_allclose(matter.volumes, expected[matter.active.nodes], rtol=1e-8)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_affine_motions_survive_the_round_trip(random_state, d):
    grid, state = random_state(d)
    gradient = np.random.default_rng(5).normal(size=(d, d))
    moving = state.arrays() | {
        "velocities": state.positions @ gradient.T + 1.0,
        "affine": np.broadcast_to(gradient, (state.particle_count, d, d)),
    }
    matter = particles_to_grid(grid, State.from_arrays(moving))
    np.testing.assert_allclose(
        matter.velocities, grid.node_positions(matter.active.nodes) @ gradient.T + 1.0, atol=1e-9
    )
    velocities, affine = grid_to_particles(matter, matter.velocities, state.positions)
    np.testing.assert_allclose(velocities, moving["velocities"], atol=1e-9)
    np.testing.assert_allclose(affine, moving["affine"], atol=1e-6)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_pic_ignores_the_gradients_and_loses_kinetic_energy(random_state, d):
    grid, state = random_state(d)
    plain = State.from_arrays(state.arrays() | {"affine": np.zeros_like(state.affine)})
    matter = particles_to_grid(grid, state, affine=False)
    np.testing.assert_array_equal(matter.velocities, particles_to_grid(grid, plain).velocities)
    on_grid = np.sum(matter.volumes[:, None] * matter.velocities**2)
    velocities, _ = grid_to_particles(matter, matter.velocities, state.positions)
    assert on_grid < np.sum(state.volumes[:, None] * state.velocities**2)
    assert np.sum(state.volumes[:, None] * velocities**2) < on_grid


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_gradient_across_a_face_is_hidden_from_nodes_that_carry_almost_nothing(d, random_state):
    grid, _ = random_state(d)
    near = grid.origin + grid.spacing * np.append(np.full(d - 1, 1.5), 1.0 + 1e-6)
    state = State.at_start(near[None], np.ones(1), np.ones((1, d)))
    across = np.zeros((1, d, d))
    across[0, :, -1] = 1e3
    matter = particles_to_grid(grid, State.from_arrays(state.arrays() | {"affine": across}))
    np.testing.assert_allclose(matter.velocities, 1.0, atol=1e3 * grid.spacing[-1] * 2e-4)
    along = np.zeros((1, d, d))
    along[0, :, 0] = 1.0
    matter = particles_to_grid(grid, State.from_arrays(state.arrays() | {"affine": along}))
    arms = grid.node_positions(matter.active.nodes)[:, :1] - near[0]
    np.testing.assert_allclose(
        matter.velocities, 1.0 + np.broadcast_to(arms, matter.velocities.shape), atol=1e-9
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_particle_on_a_face_leaves_no_node_without_mass(random_state, d):
    grid, _ = random_state(d)
    on_node = grid.node_positions([int(np.ravel_multi_index(np.ones(d, int), tuple(grid.nodes)))])
    matter = particles_to_grid(grid, State.at_start(on_node, np.ones(1), np.ones((1, d))))
    assert np.all(matter.volumes > 0.0)
    np.testing.assert_allclose(matter.velocities, 1.0, rtol=1e-12)


def rotation(x: np.ndarray, rate: float) -> np.ndarray:
    """Velocity of the rigid rotation in the first and the last axis around the origin."""
    velocity = np.zeros_like(x)
    velocity[:, 0], velocity[:, -1] = -rate * x[:, -1], rate * x[:, 0]
    return velocity


@pytest.mark.parametrize("d", DIMENSIONS)
def test_the_move_through_a_rotation_keeps_volumes_to_third_order(d):
    grid = RegularGrid(-np.ones(d), np.full(d, 0.1), np.full(d, 20))
    lattice = np.stack(np.meshgrid(*[np.linspace(-0.4, 0.4, 9)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    state = State.at_start(lattice, np.ones(len(lattice)))
    matter = particles_to_grid(grid, state)
    rate, dt = 1.0, 0.1
    field = rotation(grid.node_positions(matter.active.nodes), rate)
    velocities, _ = grid_to_particles(matter, field, lattice)
    moved = move_particles(matter, field, lattice, velocities, dt, 1)
    plane = [0, d - 1]
    growth = np.linalg.norm(moved[:, plane], axis=1) / np.maximum(
        np.linalg.norm(lattice[:, plane], axis=1), 1e-300
    )
    off_axis = (np.linalg.norm(lattice[:, plane], axis=1) > 0.05) & np.all(np.abs(lattice) < 0.35, axis=1)
    # A midpoint step multiplies radii by sqrt(1 + (rate dt)^4 / 4), an Euler step by sqrt(1 + (rate dt)^2).
    np.testing.assert_allclose(growth[off_axis], np.sqrt(1 + (rate * dt) ** 4 / 4), rtol=1e-7)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_no_particle_leaves_the_box_and_empty_cells_carry_the_last_velocity(random_state, d):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    field = np.full(matter.velocities.shape, 7.0)
    velocities, _ = grid_to_particles(matter, field, state.positions)
    short = move_particles(matter, field, state.positions, velocities, 0.01, 4)
    free = np.all(short < grid.upper - 0.01, axis=1)
    np.testing.assert_allclose(short[free], state.positions[free] + 0.07, rtol=1e-12)
    far = move_particles(
        matter, field, state.positions, velocities, 10.0, substeps_needed(matter, field, 10.0, 0.5)
    )
    assert np.all(far < grid.upper)
    np.testing.assert_allclose(far, np.broadcast_to(grid.upper, far.shape), atol=1e-8)


def test_substeps_follow_the_fastest_node_in_cells(random_state):
    grid, state = random_state(2)
    matter = particles_to_grid(grid, state)
    field = np.zeros(matter.velocities.shape)
    assert substeps_needed(matter, field, 1.0, 0.5) == 1
    field[3, 1] = -2.0 * grid.spacing[1]
    assert substeps_needed(matter, field, 1.0, 0.5) == 4


@pytest.mark.parametrize("d", DIMENSIONS)
def test_mirrored_particles_give_mirrored_fields(random_state, d):
    grid, state = random_state(d)
    flip = np.ones(d)
    flip[0] = -1.0
    mirrored = State.from_arrays(
        state.arrays()
        | {
            "positions": np.where(flip < 0, grid.origin + grid.upper - state.positions, state.positions),
            "velocities": flip * state.velocities,
            "affine": flip[:, None] * state.affine * flip,
        }
    )
    one, other = particles_to_grid(grid, state), particles_to_grid(grid, mirrored)
    index = grid.node_indices(one.active.nodes)
    index[:, 0] = grid.cells[0] - index[:, 0]
    there = other.active.node_numbers[np.ravel_multi_index(tuple(index.T), tuple(grid.nodes))]
    np.testing.assert_allclose(other.volumes[there], one.volumes, rtol=1e-9)
    np.testing.assert_allclose(other.velocities[there], flip * one.velocities, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_transfers_give_the_same_bytes_on_one_and_two_threads(random_state, bytes_by_threads, d):
    grid, state = random_state(d, count=500)

    def transfer():
        matter = particles_to_grid(grid, state)
        velocities, affine = grid_to_particles(matter, matter.velocities, state.positions)
        moved = move_particles(matter, matter.velocities, state.positions, velocities, 0.1, 3)
        return matter.volumes, matter.velocities, matter.gradients(), velocities, affine, moved

    one, two = bytes_by_threads(transfer)
    assert one == two


def test_particles_outside_the_grid_are_refused(random_state):
    grid, state = random_state(2)
    outside = State.from_arrays(state.arrays() | {"positions": state.positions + 10.0})
    with pytest.raises(InputError, match="inside the box"):
        particles_to_grid(grid, outside)
