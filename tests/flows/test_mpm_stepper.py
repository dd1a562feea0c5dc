"""Whole steps: free fall, hydrostatic rest, walls, frictional slopes, energy, volume, symmetry, resuming, determinism."""

import numpy as np
import pytest
from stepping import run

from barchan.cones import chi
from barchan.flows.mpm import Material, Options, State, Stepper, Wall, Walls, fill_box
from barchan.flows.mpm.assembly import viscous_stiffness
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.transfer import particles_to_grid
from barchan.flows.mpm.velocity import velocity_field
from barchan.flows.mpm.viscosity import unconstrained_velocities
from barchan.flows.mpm.walls import free_components
from barchan.spaces import RegularGrid

DIMENSIONS = [2, 3]
MATERIAL = Material(1500.0, 0.5)


def box(d: int, size: float = 0.4, cells: int = 8) -> RegularGrid:
    return RegularGrid(np.zeros(d), np.full(d, size / cells), np.full(d, cells))


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("transfer", ["apic", "pic"])
def test_a_block_falls_freely_as_symplectic_euler_says(d, transfer):
    grid = box(d)
    start = fill_box(grid, np.full(d, 0.1), np.full(d, 0.3), 2, MATERIAL)
    dt, steps = 0.005, 10
    stepper = Stepper(grid, MATERIAL, Walls.cuve(d), options=Options(transfer=transfer))
    state, records = run(stepper, start, steps, dt)
    fall = np.zeros(d)
    fall[-1] = -9.81 * dt**2 * steps * (steps + 1) / 2
    np.testing.assert_allclose(state.positions, start.positions + fall, atol=1e-10)
    np.testing.assert_allclose(state.velocities[:, -1], -9.81 * dt * steps, rtol=1e-9)
    np.testing.assert_allclose(state.node_stresses, 0.0, atol=1e-6 * 1500 * 9.81 * 0.2)
    assert all(record.converged for record in records)
    assert state.step == steps
    assert state.time == pytest.approx(dt * steps)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_column_as_wide_as_its_box_rests_and_carries_its_weight(d, friction):
    grid, material = box(d, cells=6), Material(1500.0, friction)
    height = 4 * grid.spacing[-1]
    start = fill_box(grid, np.zeros(d), np.append(np.full(d - 1, 0.4), height), 2, material)
    options = Options(tolerance=1e-6, rest_tolerance=1e-6, max_sweeps=20000)
    state, records = run(Stepper(grid, material, Walls(), options=options), start, 3, 0.005)
    vertical = chi(state.node_stresses)[:, -1, -1]
    depth, capacity = height - grid.node_positions(state.node_ids)[:, -1], grid.node_volumes(state.node_ids)
    levels = np.unique(np.round(depth, 9))
    means = [
        np.average(vertical[here], weights=capacity[here]) for here in (np.isclose(depth, z) for z in levels)
    ]
    # Node stresses are known up to an alternating mode without force; the mean over a layer of cells is what bears.
    borne = 0.5 * (np.array(means)[1:] + np.array(means)[:-1])
    np.testing.assert_allclose(borne, 1500 * 9.81 * 0.5 * (levels[1:] + levels[:-1]), atol=0.2)
    assert records[-1].max_speed < 1e-6 * np.sqrt(9.81 * height)
    np.testing.assert_allclose(state.positions, start.positions, atol=1e-7 * height)
    assert records[-1].max_volume_fraction < 1.0 + 1e-7


def test_heaps_below_their_friction_angle_stay_and_steeper_ones_flow():
    grid = box(2, cells=10)
    block = fill_box(grid, [0.04, 0.0], [0.36, 0.2], 3, MATERIAL)
    middle = np.abs(block.positions[:, 0] - 0.2)
    heap = block.positions[:, 1] < 0.9 * (0.16 - middle) * 0.4
    start = State.at_start(block.positions[heap], block.volumes[heap])
    energies = {}
    for friction in (0.0, 0.8):
        stepper = Stepper(grid, Material(1500.0, friction), Walls.cuve(2))
        _, records = run(stepper, start, 50, 0.005)
        energies[friction] = records[-1].kinetic_energy
    assert energies[0.8] < 0.01 * energies[0.0]


@pytest.mark.parametrize("d", DIMENSIONS)
def test_walls_hold_the_matter_and_stick_where_they_should(d):
    grid = box(d, cells=6)
    start = fill_box(grid, np.full(d, 0.1), np.full(d, 0.3), 2, MATERIAL)
    thrown = State.from_arrays(start.arrays() | {"velocities": start.velocities + 2.0})
    stepper = Stepper(grid, MATERIAL, Walls({"z_min": Wall("stick"), "x_max": Wall("stick")}))
    state, records = run(stepper, thrown, 25, 0.01)
    assert np.all((state.positions > grid.origin) & (state.positions < grid.upper))
    fixed = ~free_components(grid, stepper.walls, state.node_ids)
    assert not np.any(state.node_velocities[fixed])
    assert np.isclose(records[-1].total_volume, np.sum(start.volumes), rtol=1e-14)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("wall_friction", [0.2, 0.0])
def test_a_sliding_block_is_braked_by_the_coulomb_friction_of_the_floor(d, wall_friction):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.05), np.append([16, 4][: d - 1], 4))
    material = Material(1500.0, 0.9)
    lower, upper = np.append([0.1, 0.0][: d - 1], 0.0), np.append([0.3, 0.2][: d - 1], 0.1)
    start = fill_box(grid, lower, upper, 2, material)
    velocities = np.zeros_like(start.velocities)
    velocities[:, 0] = 1.0
    walls = Walls({"z_min": Wall("friction", wall_friction)})
    stepper = Stepper(grid, material, walls, options=Options(tolerance=1e-6, max_sweeps=5000))
    dt, steps = 0.005, 8
    state, _ = run(stepper, State.from_arrays(start.arrays() | {"velocities": velocities}), steps, dt)
    mean = np.sum(state.volumes[:, None] * state.velocities, axis=0) / np.sum(state.volumes)
    assert mean[0] == pytest.approx(1.0 - wall_friction * 9.81 * dt * steps, abs=0.02)
    if wall_friction > 0.0:
        traction = state.contact_tractions
        tangential = np.linalg.norm(traction[:, 1:], axis=1)
        assert np.all(traction[:, 0] >= 0.0)
        assert np.all(tangential <= wall_friction * traction[:, 0] * (1 + 1e-9) + 1e-9)
        assert len(state.contact_keys) == len(traction) > 0


def collapse(d: int) -> tuple[RegularGrid, State]:
    cells = [20, 8] if d == 2 else [10, 3, 6]
    spacing = np.full(d, 0.02)
    grid = RegularGrid(np.zeros(d), spacing, cells)
    upper = np.array([0.12, 0.12]) if d == 2 else np.array([0.08, 0.06, 0.08])
    return grid, fill_box(grid, np.zeros(d), upper, 2, MATERIAL)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_collapse_loses_energy_keeps_volume_and_follows_the_friction_law(d):
    grid, start = collapse(d)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(d))
    state, records = run(stepper, start, 40, 1 / 240)
    energy = np.array([record.kinetic_energy + record.potential_energy for record in records])
    assert np.all(np.diff(energy) <= 1e-6 * energy[0])
    assert energy[-1] < 0.99 * energy[0]
    assert np.array_equal(state.volumes, start.volumes)
    assert all(record.residual <= 1e-4 for record in records)
    normal, deviator = state.node_stresses[:, 0], np.linalg.norm(state.node_stresses[:, 1:], axis=1)
    assert np.all(normal >= 0.0)
    assert np.all(deviator <= np.sqrt(2 / d) * 0.5 * normal * (1 + 1e-9) + 1e-9)
    assert np.max(state.positions[:, 0]) > np.max(start.positions[:, 0]) + 0.002


def test_the_viscous_step_damps_shear_as_its_stiffness_says():
    grid, start = collapse(2)
    velocities = start.positions @ np.array([[0.0, 1.0], [0.0, 0.0]]).T
    moving = State.from_arrays(start.arrays() | {"velocities": velocities})
    matter = particles_to_grid(grid, moving)
    field = velocity_field(matter, moving, VelocityBasis(grid), 1500.0, True)
    free = free_components(grid, Walls.cuve(2), matter.active.nodes)
    dt, gravity = 0.01, np.array([0.0, -9.81])
    inertia = 1500.0 * matter.volumes / dt

    def velocities_with(viscosity):
        return unconstrained_velocities(field, viscosity, moving.volumes, free, inertia, gravity, dt, 1e-12)

    inviscid, viscous = velocities_with(0.0), velocities_with(5.0)
    np.testing.assert_allclose(inviscid[free], (matter.velocities - [0, 9.81 * dt])[free], rtol=1e-13)
    # Assembled from cell moments or applied particle by particle: the same operator.
    np.testing.assert_allclose(velocities_with(np.full(moving.particle_count, 5.0)), viscous, atol=1e-8)
    assert not np.any(viscous[~free])
    work = np.sum(inertia[:, None] * (inviscid - viscous) * viscous)
    stiffness = viscous_stiffness(matter, 5.0, free)
    assert work == pytest.approx(viscous.ravel() @ (stiffness @ viscous.ravel()), rel=1e-8)
    assert work > 0.0


def test_rate_dependent_friction_raises_the_friction_of_flowing_matter_only():
    grid, start = collapse(2)
    material = Material(1500.0, 0.3, friction_increment=0.3, grain_diameter=0.005)
    state, _ = run(Stepper(grid, material, Walls.cuve(2)), start, 12, 1 / 240)
    assert np.all((state.node_friction >= 0.3) & (state.node_friction <= 0.6))
    flowing = (state.node_friction > 0.31) & (state.node_stresses[:, 0] > 0.0)
    assert np.any(flowing)
    plain, _ = run(Stepper(grid, Material(1500.0, 0.3), Walls.cuve(2)), start, 12, 1 / 240)
    assert np.max(state.positions[:, 0]) < np.max(plain.positions[:, 0])


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_run_resumed_from_its_arrays_gives_the_same_bytes(d):
    grid, start = collapse(d)
    walls = Walls({"z_min": Wall("friction", 0.4)})
    straight, _ = run(Stepper(grid, MATERIAL, walls), start, 6, 1 / 240)
    half, _ = run(Stepper(grid, MATERIAL, walls), start, 3, 1 / 240)
    copied = {name: array.copy() for name, array in half.arrays().items()}
    resumed, _ = run(Stepper(grid, MATERIAL, walls), State.from_arrays(copied), 3, 1 / 240)
    for name, array in straight.arrays().items():
        assert array.tobytes() == resumed.arrays()[name].tobytes(), name


def test_a_step_gives_the_same_bytes_on_one_and_two_threads(bytes_by_threads):
    grid, start = collapse(2)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2))
    one, two = bytes_by_threads(lambda: run(stepper, start, 4, 1 / 240)[0].arrays().values())
    assert one == two


def test_a_symmetric_column_collapses_symmetrically():
    grid = RegularGrid([0.0, 0.0], [0.02, 0.02], [16, 6])
    start = fill_box(grid, [0.1, 0.0], [0.22, 0.08], 2, MATERIAL)
    options = Options(tolerance=1e-10, max_sweeps=20000)
    state, records = run(Stepper(grid, MATERIAL, Walls.cuve(2), options=options), start, 10, 1 / 240)
    mirror = [int(np.argmin(np.abs(start.positions - [0.32 - x, z]).sum(axis=1))) for x, z in start.positions]
    np.testing.assert_allclose(state.positions[mirror, 0], 0.32 - state.positions[:, 0], atol=1e-7 * 0.08)
    np.testing.assert_allclose(state.positions[mirror, 1], state.positions[:, 1], atol=1e-7 * 0.08)
    assert records[-1].max_speed > 0.05


def test_the_problem_of_a_step_can_be_taken_away_and_is_the_one_solved():
    grid, start = collapse(2)
    stepper = Stepper(grid, MATERIAL, Walls({"z_min": Wall("friction", 0.4)}))
    state, record = stepper.advance(start, 1 / 240)
    problem = stepper.problem(start, 1 / 240)
    assert problem.n == record.blocks
    assert problem.s == 3
    stresses = np.zeros((problem.n, 3))
    stresses[: len(state.node_ids)] = state.node_stresses
    stresses[len(state.node_ids) :, :2] = state.contact_tractions
    balance = problem.M @ state.node_velocities.ravel() - problem.f - problem.H.T @ stresses.ravel()
    np.testing.assert_allclose(balance, 0.0, atol=1e-10 * np.max(np.abs(problem.f)))
