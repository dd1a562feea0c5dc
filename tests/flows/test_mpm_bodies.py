"""Rigid bodies in the matter: action and reaction, friction of their boundaries, pistons, gates, balls that sink or lie."""

from __future__ import annotations

import numpy as np
import pytest
from stepping import run

from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Box,
    Cylinder,
    Fixed,
    Free,
    Moved,
    Prescribed,
    Sphere,
    Union,
    angular_momentum,
    body_distance,
)
from barchan.bodies.rigid.rotations import matrix
from barchan.flows.mpm import Material, Options, State, Stepper, Wall, Walls, fill_box, fill_shape
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.transfer import particles_to_grid
from barchan.flows.mpm.walls import face_names
from barchan.spaces import RegularGrid

DIMENSIONS = [2, 3]
MATERIAL = Material(1500.0, 0.5)


def box(d: int, size: float = 1.0, cells: int = 12) -> RegularGrid:
    return RegularGrid(np.zeros(d), np.full(d, size / cells), np.full(d, cells))


def ball(d: int, radius: float, density: float, **how) -> Body:
    return Body(Sphere(radius, dimension=2) if d == 2 else Sphere(radius), density=density, **how)


def wedge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., :, None] * b[..., None, :] - b[..., :, None] * a[..., None, :]


def momenta(stepper: Stepper, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Momentum (d,) and angular momentum (d, d) of matter and bodies."""
    masses, basis = stepper.setting.masses(state), VelocityBasis(stepper.grid, stepper.options.velocity)
    linear = masses @ state.velocities
    table = basis.evaluate(state.positions)
    places = basis.positions(np.arange(int(np.prod(basis.lattice))))[basis.of_cells(table.cells)]
    arms = places - state.positions[:, None, :]
    spin = np.einsum(
        "pj,pjkl->pkl", table.weights, wedge(arms, np.einsum("pkl,pjl->pjk", state.affine, arms))
    )
    angular = np.einsum("p,pkl->kl", masses, wedge(state.positions, state.velocities) + spin)
    d = stepper.grid.dimension
    for number, body in enumerate(stepper.bodies):
        row = state.bodies.row(number)
        linear = linear + body.mass * row.velocity
        own = angular_momentum(body, row)
        if d == 2:
            whole = np.array([[0.0, own[0]], [-own[0], 0.0]])
        else:
            whole = np.array([[0, own[2], -own[1]], [-own[2], 0, own[0]], [own[1], -own[0], 0]])
        angular = angular + wedge(body.mass * row.position, row.velocity) + whole
    return linear, angular


def off_centre(d: int) -> Body:
    """A stick that flies into the matter askew and spins."""
    shape = Box([0.16, 0.07]) if d == 2 else Box([0.16, 0.07, 0.09])
    turn = 0.3 if d == 2 else np.array([np.cos(0.2), 0.0, np.sin(0.2), 0.0])
    spin = 4.0 if d == 2 else np.array([1.0, 4.0, -2.0])
    velocity = np.append([0.5, 0.1][: d - 1], -3.0)
    return Body(
        shape, density=3000.0, friction=0.4, position=np.append(np.full(d - 1, 0.47), 0.76), rotation=turn, velocity=velocity,
        spin=spin,
    )  # fmt: skip


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("velocity", ["Q1", "P1", "B2"])
def test_a_body_hits_floating_matter_and_no_momentum_is_lost(d, velocity):
    grid = box(d)
    state = fill_box(grid, np.full(d, 0.25), np.append(np.full(d - 1, 0.75), 0.58), 2, MATERIAL)
    body, options = off_centre(d), Options(velocity=velocity, volume_correction=0.0)
    stepper = Stepper(grid, MATERIAL, Walls(), gravity=0.0, options=options, bodies=[body])
    state = stepper.started(state)
    before, speed = momenta(stepper, state), state.bodies.velocities[0, -1]
    for _ in range(14):
        state, _ = stepper.advance(state, 1 / 480)
        after = momenta(stepper, state)
        scale = float(body.mass * 3.0)
        np.testing.assert_allclose(after[0], before[0], atol=1e-10 * scale)
        # Between the solve and the next, places move with velocities that are not the momentum's over the mass (midpoint
        # steps): second order in dt. The exchange itself is exact, see the next test.
        np.testing.assert_allclose(after[1], before[1], atol=2e-3 * scale)
    assert state.bodies.velocities[0, -1] > 0.9 * speed


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("velocity", ["Q1", "P1", "B2"])
def test_forces_between_body_and_matter_are_opposite_and_have_no_moment(d, velocity):
    grid = box(d)
    state = fill_box(grid, np.full(d, 0.25), np.append(np.full(d - 1, 0.75), 0.72), 2, MATERIAL)
    body = off_centre(d)
    walls = Walls({face: Wall("open") for face in face_names(d)})  # which hold nothing, not even the body
    stepper = Stepper(grid, MATERIAL, walls, options=Options(velocity=velocity), bodies=[body])
    step = stepper._build(stepper.started(state), 1 / 240)
    contacts, count = step.contacts, len(step.velocity.ids)
    assert len(contacts) > 4
    assert len(np.unique(contacts.keys)) == len(contacts)
    rows = slice(len(step.rows.ids), None)
    r = np.zeros(step.start.shape)
    r[rows, :d] = np.random.default_rng(0).normal(size=(len(contacts), d))
    force = (step.problem.H.T @ r.ravel()).reshape(-1, d)
    on_matter, on_body = force[:count], force[count]
    scale = np.max(np.abs(force))
    np.testing.assert_allclose(np.sum(on_matter, axis=0), -on_body, atol=1e-11 * scale * count)
    # A rigid rotation of everything together is resisted by nothing; bodies turn about their principal axes.
    turned = matrix(body.rotation) @ body.principal_axes if d == 3 else np.eye(2)
    for axis in [np.array([0.0, 0.0, 1.0])] if d == 2 else np.eye(3):
        arms = np.zeros((count, 3))
        arms[:, :d] = step.velocity.places - body.position
        v = np.zeros(force.shape)
        v[:count] = np.cross(axis, arms)[:, :d]
        v[count + 1] = turned.T @ axis if d == 3 else [1.0, 0.0]
        relative = (step.problem.H @ v.ravel()).reshape(len(step.start), -1)[rows, :d]
        np.testing.assert_allclose(relative, 0.0, atol=1e-10)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("friction", [0.3, 0.0])
def test_a_plate_brakes_a_sliding_block_by_its_coulomb_friction(d, friction):
    cells = np.append([20, 4][: d - 1], 6)
    grid, material = RegularGrid(np.zeros(d), np.full(d, 0.05), cells), Material(1500.0, 0.9)
    plate = Body(
        Box(np.append(np.full(d - 1, 1.0), 0.1)),
        friction=friction,
        motion=Fixed(),
        position=np.append(np.full(d - 1, 0.5), 0.0),
    )
    lower, upper = np.append([0.1, 0.0][: d - 1], 0.1), np.append([0.4, 0.2][: d - 1], 0.2)
    start = fill_box(grid, lower, upper, 2, material)
    velocities = np.zeros_like(start.velocities)
    velocities[:, 0] = 1.0
    options = Options(tolerance=1e-7, max_sweeps=10000)
    stepper = Stepper(grid, material, Walls(), options=options, bodies=[plate])
    dt, steps = 0.005, 8
    state, _ = run(stepper, State.from_arrays(start.arrays() | {"velocities": velocities}), steps, dt)
    mean = state.volumes @ state.velocities / np.sum(state.volumes)
    assert mean[0] == pytest.approx(1.0 - friction * 9.81 * dt * steps, abs=0.01)
    assert abs(mean[-1]) < 0.03  # its vertical faces slump


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_piston_raises_the_bed_on_it_at_its_speed(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.05), np.append([4, 3][: d - 1], 8))
    speed, thick = 0.3, 0.1
    place = np.append(0.5 * grid.upper[:-1], 0.0)
    lifted = place + np.append(np.zeros(d - 1), speed)
    piston = Body(
        Box(np.append(np.full(d - 1, 0.3), thick)),
        friction=0.0,
        motion=Prescribed([0.0, 1.0], [place, lifted]),
    )
    low, high = np.append(np.zeros(d - 1), thick), np.append(grid.upper[:-1], thick + 0.15)
    start = fill_box(grid, low, high, 2, MATERIAL)
    # Without the volume correction, which moves packed matter off the lattice by some hundredths of a cell.
    options = Options(tolerance=1e-8, max_sweeps=20000, volume_correction=0.0)
    state, _ = run(Stepper(grid, MATERIAL, Walls(), options=options, bodies=[piston]), start, 20, 1 / 200)
    assert np.mean(state.velocities[:, -1]) == pytest.approx(speed, rel=0.03)
    np.testing.assert_allclose(state.positions[:, -1], start.positions[:, -1] + 0.1 * speed, atol=0.05 * 0.05)
    assert state.bodies.positions[0, -1] == pytest.approx(0.1 * speed, rel=1e-9)


def bed_with_ball(d: int, density: float, gap: float = 0.0):
    cells = 16 if d == 2 else 8
    grid = box(d, cells=cells)
    state = fill_box(grid, np.zeros(d), np.append(np.ones(d - 1), 0.5), 2, MATERIAL)
    body = ball(d, 0.18, density, position=np.append(np.full(d - 1, 0.5), 0.68 + gap))
    return grid, state, body


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_ball_put_on_a_bed_sinks_a_little_and_comes_to_rest(d):
    grid, state, body = bed_with_ball(d, 2500.0)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(d), bodies=[body])
    heights = []
    for _ in range(120 if d == 2 else 70):
        state, _ = stepper.advance(state, 1 / 240)
        heights.append(state.bodies.positions[0, -1])
        distances = body_distance(body, state.bodies.row(0), state.positions)
        assert np.min(distances) > -1e-9
    assert 0.45 < heights[-1] < 0.69
    assert abs(heights[-1] - heights[-10]) < 0.002
    np.testing.assert_allclose(state.bodies.velocities[0], 0.0, atol=0.05)
    np.testing.assert_allclose(state.bodies.positions[0, :-1], 0.5, atol=0.01)


def test_no_particle_is_left_inside_a_fast_body():
    """A stick that crosses more than a cell in a step: matter is moved out of where it has come to be."""
    grid = RegularGrid(np.zeros(2), np.full(2, 0.05), np.array([16, 16]))
    state = fill_box(grid, [0.0, 0.0], [0.8, 0.4], 2, MATERIAL)
    body = Body(
        Box([0.1, 0.15]), density=8000.0, position=[0.4, 0.58], rotation=0.5, velocity=[0.5, -6.0], spin=3.0
    )
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[body])
    for _ in range(20):
        state, _ = stepper.advance(state, 0.01)
        assert np.min(body_distance(body, state.bodies.row(0), state.positions)) > -1e-9
    assert state.bodies.positions[0, 1] < 0.3


def test_a_body_lighter_than_sand_lies_on_it():
    grid, state, body = bed_with_ball(2, 100.0)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[body])
    state, _ = run(stepper, state, 60, 1 / 240)
    assert state.bodies.positions[0, 1] == pytest.approx(0.68, abs=0.03)
    assert abs(state.bodies.velocities[0, 1]) < 0.02


def test_a_light_body_inside_the_sand_does_not_rise_and_a_liquid_lifts_it():
    grid = box(2, cells=16)
    body = ball(2, 0.15, 100.0, position=[0.5, 0.35])
    shape, hole = Box([0.5, 0.35]), Moved(Sphere(0.15, dimension=2), [0.5, 0.35])
    bed = fill_shape(grid, Moved(shape, [0.5, 0.35]), 3, MATERIAL, outside=[hole])
    rises = {}
    for friction in (0.0, 0.7):
        material = Material(1500.0, friction)
        stepper = Stepper(grid, material, Walls.cuve(2), bodies=[body])
        state, _ = run(stepper, bed, 40, 1 / 240)
        rises[friction] = state.bodies.positions[0, 1] - 0.35
    assert rises[0.0] > 0.03
    assert abs(rises[0.7]) < 0.2 * rises[0.0]


@pytest.mark.parametrize("d", DIMENSIONS)
def test_cells_cut_by_a_plate_have_the_room_below_it(d):
    grid, depth = box(d, cells=8), 0.125
    state = fill_box(grid, np.zeros(d), np.append(np.ones(d - 1), 0.5), 2, MATERIAL)
    occupied = particles_to_grid(grid, state).active.occupied
    rooms = []
    for height in (0.5, 0.5 - depth):
        place = np.append(np.full(d - 1, 0.5), height + 0.2)
        plate = Body(Box(np.append(np.full(d - 1, 1.0), 0.2)), motion=Fixed(), position=place)
        coupling = Stepper(grid, MATERIAL, Walls(), bodies=[plate]).setting.coupling
        shares = coupling.free_shares(BodyStates.at_start([plate]), occupied)
        assert np.all((shares >= 0.0) & (shares <= 1.0))
        rooms.append(grid.cell_volume * float(np.sum(np.mean(shares, axis=1))))
    assert rooms[0] == pytest.approx(0.5, rel=1e-9)
    assert rooms[1] == pytest.approx(0.5 - depth, rel=1e-9)


def test_the_room_beside_a_body_is_what_is_left_of_its_cells():
    grid = box(2, cells=20)
    disk = Moved(Sphere(0.23, dimension=2), [0.5, 0.45])
    body = Body(Sphere(0.23, dimension=2), motion=Fixed(), position=[0.5, 0.45])
    state = fill_shape(grid, Box([2.0, 2.0]), 4, MATERIAL, outside=[disk])
    rooms = []
    for bodies in ([body], []):
        stepper = Stepper(grid, MATERIAL, Walls(), bodies=bodies)
        rooms.append(float(np.sum(stepper._build(stepper.started(state), 0.01).rows.room)))
    assert rooms[0] == pytest.approx(1.0 - np.pi * 0.23**2, rel=0.01)
    assert rooms[1] > rooms[0]


def test_a_gate_holds_a_column_until_it_is_lifted():
    grid = RegularGrid(np.zeros(2), np.full(2, 0.05), np.array([20, 10]))
    start = fill_box(grid, [0.0, 0.0], [0.25, 0.3], 2, MATERIAL)
    gate = Body(
        Box([0.03, 0.25]), friction=0.0,
        motion=Prescribed([0.0, 0.1, 0.2], [[0.28, 0.25], [0.28, 0.25], [0.28, 0.8]]),
    )  # fmt: skip
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[gate])
    held, _ = run(stepper, start, 24, 1 / 240)
    assert np.max(held.positions[:, 0]) < 0.2501
    np.testing.assert_allclose(held.positions, start.positions, atol=0.003)
    free, _ = run(stepper, held, 60, 1 / 240)
    assert np.max(free.positions[:, 0]) > 0.32


def test_components_that_are_held_stay_and_the_others_move():
    grid = box(2, cells=12)
    state = fill_box(grid, [0.0, 0.0], [1.0, 0.4], 2, MATERIAL)
    body = Body(
        Box([0.15, 0.08]), density=4000.0, position=[0.35, 0.62], rotation=0.4, velocity=[0.0, -2.0],
        motion=Free(held=("x", "spin")),
    )  # fmt: skip
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[body])
    state, _ = run(stepper, state, 30, 1 / 240)
    assert state.bodies.positions[0, 0] == 0.35
    assert state.bodies.rotations[0, 0] == pytest.approx(0.4, abs=1e-15)
    assert state.bodies.positions[0, 1] < 0.58
    loose = Body(body.shape, density=4000.0, position=[0.35, 0.62], rotation=0.4, velocity=[0.0, -2.0])
    other, _ = run(
        Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[loose]),
        fill_box(grid, [0, 0], [1, 0.4], 2, MATERIAL),
        30,
        1 / 240,
    )
    assert abs(other.bodies.rotations[0, 0] - 0.4) > 0.02


def test_contacts_of_several_bodies_and_walls_have_names_of_their_own():
    grid = box(3, cells=8)
    state = fill_box(grid, np.zeros(3), [1.0, 1.0, 0.5], 2, MATERIAL)
    bodies = [
        ball(3, 0.1, 2000.0, position=[0.3, 0.3, 0.5]),
        Body(
            Union(Box([0.1, 0.1, 0.02]), Cylinder(0.05, 0.2, axis=2)),
            motion=Fixed(),
            position=[0.7, 0.7, 0.4],
        ),
    ]
    walls = Walls({"z_min": Wall("friction", 0.3), "x_min": Wall("friction", 0.2)})
    stepper = Stepper(grid, MATERIAL, walls, bodies=bodies)
    state, _ = run(stepper, state, 2, 1 / 240)
    keys = state.contact_keys
    assert len(np.unique(keys)) == len(keys)
    assert np.count_nonzero(keys < 0) > 20
    assert np.count_nonzero(keys >= 0) == 9 * 9 + 9 * 5  # the floor, and the wall up to the height of the bed
    assert set(np.unique((-1 - keys[keys < 0]) % 2)) == {0, 1}
    assert np.all(state.contact_tractions[:, 0] >= 0.0)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_a_free_body_falls_onto_the_floor_of_the_box_and_stays_there(d):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.05), np.full(d, 12))
    edge = np.full(d, 0.06)
    block = Body(Box(edge), density=3000.0, friction=0.4, position=np.append(np.full(d - 1, 0.4), 0.09))
    grains = fill_box(grid, np.zeros(d), np.full(d, 0.1), 2, MATERIAL)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(d), options=Options(tolerance=1e-6), bodies=[block])
    state, records = run(stepper, grains, 40, 0.005)
    assert state.bodies.positions[0, -1] == pytest.approx(0.06, abs=1e-4)
    assert np.linalg.norm(state.bodies.velocities[0]) < 1e-4
    assert np.linalg.norm(state.bodies.spins[0]) < 1e-3
    assert all(record.converged for record in records)


def test_a_body_slides_along_the_floor_under_its_own_friction_and_no_face_lets_it_out():
    grid = RegularGrid(np.zeros(2), np.full(2, 0.05), np.array([40, 8]))
    grains = fill_box(grid, [1.9, 0.0], [2.0, 0.05], 2, MATERIAL)
    block = Body(Box([0.08, 0.05]), density=2000.0, friction=0.3, position=[0.3, 0.05], velocity=[1.0, 0.0])
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), options=Options(tolerance=1e-8), bodies=[block])
    dt, steps = 0.005, 30
    state, _ = run(stepper, grains, steps, dt)
    assert state.bodies.velocities[0, 0] == pytest.approx(1.0 - 0.3 * 9.81 * dt * steps, abs=0.02)
    fast = Body(Box([0.08, 0.05]), density=2000.0, friction=0.0, position=[0.3, 0.05], velocity=[-20.0, 0.0])
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), options=Options(tolerance=1e-8), bodies=[fast])
    state, _ = run(stepper, grains, 10, dt)
    assert state.bodies.positions[0, 0] >= 0.08 - 1e-6


def test_a_body_that_starts_half_outside_of_the_box_is_not_thrown_into_it():
    grid = RegularGrid(np.zeros(2), np.full(2, 0.05), np.array([12, 8]))
    grains = fill_box(grid, [0.0, 0.0], [0.6, 0.1], 2, MATERIAL)
    wheel = Body(Sphere(0.1, dimension=2), density=2000.0, position=[0.3, 0.35])
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), bodies=[wheel])
    state, _ = run(stepper, grains, 4, 0.005)
    assert state.bodies.velocities[0, 1] == pytest.approx(-9.81 * 0.02, rel=1e-6)
