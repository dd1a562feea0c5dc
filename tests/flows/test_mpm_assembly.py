"""The assembled operators are the integrals of seed B 7.3.1: virtual work, constant strain, allowance, viscous energy."""

import numpy as np
import pytest

from barchan.cones import chi, chi_inverse
from barchan.flows.mpm import Material, Wall, Walls, fill_box
from barchan.flows.mpm.assembly import (
    compression_allowance,
    strain_operator,
    viscous_stiffness,
)
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.contacts import wall_contacts, with_contact_rows
from barchan.flows.mpm.stresses import StressRows, stress_rows
from barchan.flows.mpm.transfer import particles_to_grid
from barchan.flows.mpm.velocity import velocity_field
from barchan.flows.mpm.walls import free_components
from barchan.spaces import RegularGrid, shape_functions

DIMENSIONS = [2, 3]


def rows_of(grid, state, matter) -> StressRows:
    return stress_rows("Q1", matter, velocity_field(matter, state, VelocityBasis(grid), 1.0, True), state)


def all_free(matter) -> np.ndarray:
    return np.ones(matter.velocities.shape, dtype=bool)


def strain_rates_at_particles(grid, state, matter, field) -> np.ndarray:
    """D(u)(x_p), (P, d, d), by the reference shape functions."""
    shapes = shape_functions(grid, state.positions)
    gradient = np.einsum("pja,pjb->pab", field[matter.active.node_numbers[shapes.nodes]], shapes.gradients)
    return 0.5 * (gradient + np.swapaxes(gradient, 1, 2))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_virtual_work_of_any_stress_is_exact(d, random_state):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    strain = strain_operator(rows_of(grid, state, matter), all_free(matter))
    rng = np.random.default_rng(1)
    stress, field = (
        rng.normal(size=(len(matter.volumes), 3 * d - 3)),
        rng.normal(size=matter.velocities.shape),
    )
    shapes = shape_functions(grid, state.positions)
    tau = np.einsum("pj,pjab->pab", shapes.weights, chi(stress)[matter.active.node_numbers[shapes.nodes]])
    work = np.einsum("p,pab,pab->", state.volumes, tau, strain_rates_at_particles(grid, state, matter, field))
    np.testing.assert_allclose(stress.ravel() @ (strain @ field.ravel()), work, rtol=1e-7)
    np.testing.assert_allclose((strain.T @ stress.ravel()) @ field.ravel(), work, rtol=1e-7)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_linear_velocity_has_its_strain_rate_at_every_node(d, random_state):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    gradient = np.random.default_rng(2).normal(size=(d, d))
    field = grid.node_positions(matter.active.nodes) @ gradient.T
    rates = (strain_operator(rows_of(grid, state, matter), all_free(matter)) @ field.ravel()).reshape(
        len(field), -1
    )
    expected = 2.0 * chi_inverse(0.5 * (gradient + gradient.T))
    np.testing.assert_allclose(
        rates / matter.volumes[:, None], np.broadcast_to(expected, rates.shape), rtol=1e-5
    )


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_constrained_component_neither_strains_nor_is_forced(d, random_state):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    free = all_free(matter)
    free[::3, 0] = False
    strain = strain_operator(rows_of(grid, state, matter), free)
    field = np.where(free, 0.0, np.random.default_rng(3).normal(size=free.shape))
    assert not np.any(strain @ field.ravel())
    full = strain_operator(rows_of(grid, state, matter), all_free(matter))
    field = np.where(free, np.random.default_rng(3).normal(size=free.shape), 0.0)
    np.testing.assert_allclose(strain @ field.ravel(), full @ field.ravel(), atol=1e-14)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_the_pattern_holds_exactly_the_nodes_that_share_an_occupied_cell(d, random_state):
    grid, state = random_state(d, count=25)
    matter = particles_to_grid(grid, state)
    strain = strain_operator(rows_of(grid, state, matter), all_free(matter))
    corners = matter.active.node_numbers[shape_functions(grid, state.positions).nodes]
    expected = np.zeros((len(matter.volumes), len(matter.volumes)), dtype=bool)
    for cell in corners:
        expected[np.ix_(cell, cell)] = True
    found = np.zeros_like(expected)
    found[np.repeat(np.arange(len(found)), np.diff(strain.indptr)), strain.indices] = True
    np.testing.assert_array_equal(found, expected)
    assert strain.has_sorted_indices


@pytest.mark.parametrize("d", DIMENSIONS)
def test_packed_matter_may_not_compress_inside_and_loose_matter_may(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.1), np.full(d, 6))
    material = Material(1000.0, 0.5, max_volume_fraction=0.6)
    state = fill_box(grid, np.zeros(d), np.full(d, 0.4), 3, material)
    matter = particles_to_grid(grid, state)
    rows = rows_of(grid, state, matter)
    allowance = compression_allowance(rows, 0.6, 0.02, 0.01)
    assert not np.any(allowance[:, 1:])
    inside = np.all(grid.node_positions(matter.active.nodes) < 0.4 - 1e-9, axis=1)
    np.testing.assert_allclose(allowance[inside, 0], 0.0, atol=1e-12 * grid.cell_volume / 0.01)
    # The empty part of a surface node's support is no room: the block is packed up to its surface.
    np.testing.assert_allclose(allowance[:, 0], 0.0, atol=1e-12 * grid.cell_volume / 0.01)
    # k(tau) = integral of beta Tr(tau) / d: against tau = w_i chi(r), Tr chi(r) = sqrt(2 d) r_N.
    allowance = compression_allowance(rows, 0.8, 0.02, 0.01)
    beta = (0.98 * 0.8 * matter.occupied_capacities - matter.volumes) / 0.01
    expected = beta / d * np.trace(chi(np.eye(3 * d - 3)[0]))
    np.testing.assert_allclose(allowance[:, 0], expected, rtol=1e-12)
    assert np.all(matter.occupied_capacities <= matter.capacities * (1.0 + 1e-12))
    # Nearly packed matter counts as packed.
    assert not np.any(compression_allowance(rows, 0.61, 0.02, 0.01))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_excess_volume_is_not_pushed_out_again(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.1), np.full(d, 4))
    state = fill_box(grid, np.zeros(d), np.full(d, 0.4), 2, Material(1000.0, 0.5))
    rows = rows_of(grid, state, particles_to_grid(grid, state))
    assert not np.any(compression_allowance(rows, 0.9, 0.02, 0.01))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_viscous_energy_is_the_sum_over_particles(d, random_state):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    stiffness = viscous_stiffness(matter, 0.7, all_free(matter))
    one, other = np.random.default_rng(4).normal(size=(2, *matter.velocities.shape))
    rates = [strain_rates_at_particles(grid, state, matter, field) for field in (one, other)]
    work = 0.7 * np.einsum("p,pab,pab->", state.volumes, *rates)
    np.testing.assert_allclose(one.ravel() @ (stiffness @ other.ravel()), work, rtol=1e-7)
    np.testing.assert_allclose(other.ravel() @ (stiffness @ one.ravel()), work, rtol=1e-7)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_rigid_motions_have_no_viscous_energy(d, random_state):
    grid, state = random_state(d)
    matter = particles_to_grid(grid, state)
    spin = np.triu(np.arange(1.0, d * d + 1.0).reshape(d, d), 1)
    field = grid.node_positions(matter.active.nodes) @ (spin - spin.T) + 1.0
    stiffness = viscous_stiffness(matter, 1.0, all_free(matter))
    scale = np.max(np.abs(stiffness.data)) * np.max(np.abs(field))
    np.testing.assert_allclose(stiffness @ field.ravel(), 0.0, atol=1e-9 * scale)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_wall_rows_measure_the_velocity_off_the_wall_and_along_it(d, random_state):
    grid, state = random_state(d)
    faces = {"z_min": Wall("friction", 0.5), "x_max": Wall("friction", 0.2), "x_min": Wall("slip")}
    walls = Walls(faces)
    shifted = state.positions.copy()
    shifted[:20, 0] = grid.upper[0] - 1e-3
    shifted[20:40, -1] = grid.origin[-1] + 1e-3
    state = type(state).at_start(shifted, state.volumes)
    matter = particles_to_grid(grid, state)
    free = free_components(grid, walls, matter.active.nodes)
    contacts = wall_contacts(
        velocity_field(matter, state, VelocityBasis(grid), 1.0, True), walls, matter.volumes
    )
    strain = strain_operator(rows_of(grid, state, matter), free)
    rows = with_contact_rows(strain, contacts, free, 0)
    field = np.where(free, np.random.default_rng(5).normal(size=free.shape), 0.0)
    u = (rows @ field.ravel()).reshape(-1, 3 * d - 3)
    np.testing.assert_array_equal(u[: len(field)].ravel(), strain @ field.ravel())
    contact = u[len(field) :] / contacts.areas[:, None]
    on_floor = contacts.friction == 0.5
    at = field[contacts.indices]
    np.testing.assert_allclose(contact[on_floor, 0], at[on_floor, -1], rtol=1e-13)
    np.testing.assert_allclose(contact[~on_floor, 0], -at[~on_floor, 0], rtol=1e-13)
    tangential = np.sum(at**2, axis=1) - contact[:, 0] ** 2
    np.testing.assert_allclose(np.sum(contact[:, 1:d] ** 2, axis=1), tangential, rtol=1e-10, atol=1e-12)
    assert not np.any(u[len(field) :, d:])
    assert len(np.unique(contacts.keys)) == len(contacts.keys)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_contact_areas_of_a_full_floor_add_up_to_it(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.1), np.full(d, 5))
    state = fill_box(grid, np.zeros(d), grid.upper, 3, Material(1000.0, 0.5))
    matter = particles_to_grid(grid, state)
    field = velocity_field(matter, state, VelocityBasis(grid), 1.0, True)
    contacts = wall_contacts(field, Walls({"z_min": Wall("friction", 0.5)}), matter.volumes)
    np.testing.assert_allclose(np.sum(contacts.areas), 0.5 ** (d - 1), rtol=1e-12)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_assembly_gives_the_same_bytes_on_one_and_two_threads(d, random_state, bytes_by_threads):
    grid, state = random_state(d, count=500)

    def assemble():
        matter = particles_to_grid(grid, state)
        free = all_free(matter)
        strain, stiffness = (
            strain_operator(rows_of(grid, state, matter), free),
            viscous_stiffness(matter, 1.0, free),
        )
        return strain.data, strain.indices, stiffness.data

    one, two = bytes_by_threads(assemble)
    assert one == two
