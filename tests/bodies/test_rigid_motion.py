"""Rigid bodies move by Newton's and Euler's laws: momentum is kept, rotations stay rotations, held components stay held."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.rigid import (
    Body,
    BodyState,
    BodyStates,
    Box,
    Cylinder,
    Fixed,
    Free,
    HalfSpace,
    Moved,
    Prescribed,
    Shape,
    Sphere,
    angular_momentum,
    body_distance,
    body_normals,
    body_surface,
    contact_columns,
    generalised_masses,
    generalised_velocities,
    is_driven,
    kinetic_energy,
    moved,
    predicted_velocities,
    rotations,
    to_body,
    to_world,
    wheel,
)
from barchan.errors import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])
NONE = np.zeros(3)


def start(body: Body) -> BodyState:
    return BodyStates.at_start([body]).row(0)


def run(body: Body, steps: int, dt: float, gravity: np.ndarray = NONE) -> BodyState:
    state = start(body)
    for n in range(steps):
        state = moved(body, state, predicted_velocities(body, state, gravity, dt, n * dt), dt, n * dt)
    return state


def brick(**options: object) -> Body:
    return Body(Box([0.3, 0.2, 0.1]), density=1000.0, **options)  # type: ignore[arg-type]


def test_inertia_of_known_solids() -> None:
    np.testing.assert_allclose(Body(Sphere(0.1), mass=2.0).principal_moments, 0.4 * 2.0 * 0.01)
    np.testing.assert_allclose(
        brick().principal_moments, brick().mass / 3.0 * np.array([0.05, 0.10, 0.13]), rtol=1e-14
    )
    rod = Body(Cylinder(0.1, 0.5, axis=0), mass=3.0)
    along, across = 0.5 * 3.0 * 0.01, 3.0 * (3 * 0.01 + 1.0) / 12.0
    np.testing.assert_allclose(np.diag(rod.inertia), [along, across, across], rtol=1e-14)
    assert Body(Sphere(0.1, 2), mass=2.0).principal_moments == pytest.approx([0.5 * 2.0 * 0.01])
    assert Body(Box([0.2, 0.1]), density=5.0).mass == pytest.approx(0.4)


def test_principal_axes_make_the_inertia_diagonal() -> None:
    turn = rotations.exponential(np.array([0.3, -0.5, 0.8]))
    body = Body(Moved(Box([0.3, 0.2, 0.1]), [0.4, 0.0, -0.2], turn), density=1000.0)
    np.testing.assert_allclose(body.centre, [0.4, 0.0, -0.2], atol=1e-14)
    diagonal = body.principal_axes.T @ body.inertia @ body.principal_axes
    np.testing.assert_allclose(diagonal, np.diag(body.principal_moments), atol=1e-12)
    np.testing.assert_allclose(np.sort(body.principal_moments), brick().principal_moments, rtol=1e-12)


def test_a_hundred_thousand_steps_leave_a_rotation_a_rotation() -> None:
    rotation, spin = rotations.identity(3), np.array([30.0, -20.0, 50.0])
    for _ in range(100_000):
        rotation = rotations.turned(rotation, spin, 1e-2)
    turn = rotations.matrix(rotation)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    exact = rotations.matrix(rotations.exponential(1000.0 * spin))
    np.testing.assert_allclose(turn, exact, atol=1e-7)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
)
def test_quaternions_act_as_their_matrices(a: list[float], b: list[float]) -> None:
    p, q = rotations.exponential(np.array(a)), rotations.exponential(np.array(b))
    np.testing.assert_allclose(
        rotations.matrix(rotations.product(p, q)), rotations.matrix(p) @ rotations.matrix(q), atol=1e-13
    )
    back = rotations.quaternion_of(rotations.matrix(p))
    np.testing.assert_allclose(np.abs(back @ p), 1.0, atol=1e-12)
    again = rotations.exponential(rotations.logarithm(p))
    np.testing.assert_allclose(rotations.matrix(again), rotations.matrix(p), atol=1e-12)


def test_a_top_keeps_its_angular_momentum_exactly_and_its_energy_to_second_order() -> None:
    def drift(dt: float) -> tuple[float, float]:
        top = brick(spin=[1.0, 6.0, 0.5])  # about the unstable middle axis
        before, after = start(top), run(top, round(4.0 / dt), dt)
        momentum, energy = angular_momentum(top, before), kinetic_energy(top, before)
        return (
            float(np.linalg.norm(angular_momentum(top, after) - momentum) / np.linalg.norm(momentum)),
            abs(kinetic_energy(top, after) / energy - 1.0),
        )

    coarse, fine = drift(0.01), drift(0.005)
    assert coarse[0] < 1e-11 and fine[0] < 1e-11
    assert coarse[1] < 0.01
    assert fine[1] < 0.4 * coarse[1]


def test_a_symmetric_top_turns_at_the_rate_of_euler() -> None:
    """Free precession: the spin across the axis turns in the body at (I3 - I1) / I1 * w3."""
    rod = Body(Cylinder(0.1, 0.4, axis=2), mass=1.0, spin=[0.5, 0.0, 4.0])
    i1, i3 = rod.principal_moments[0], rod.principal_moments[2]
    after = run(rod, 2000, 1e-3)
    inside = rotations.matrix(after.rotation).T @ after.spin
    rate = (i3 - i1) / i1 * 4.0 * 2.0
    np.testing.assert_allclose(inside[:2], 0.5 * np.array([np.cos(rate), np.sin(rate)]), atol=2e-3)


def test_a_body_thrown_falls_and_its_centre_ignores_its_spin() -> None:
    off_centre = Moved(Box([0.3, 0.2, 0.1]), [0.5, 0.0, 0.0])
    body = Body(
        off_centre, density=500.0, position=[1.0, 2.0, 3.0], velocity=[1.0, 0.0, 2.0], spin=[0.0, 3.0, 1.0]
    )
    dt, steps = 0.01, 100
    after = run(body, steps, dt, GRAVITY)
    centre = to_world(after, body.centre[None])[0]
    fall = -9.81 * dt * dt * steps * (steps + 1) / 2
    np.testing.assert_allclose(centre, [1.5 + 1.0, 2.0, 3.0 + 2.0 + fall], atol=1e-11)
    np.testing.assert_allclose(after.velocity, [1.0, 0.0, 2.0 - 9.81], atol=1e-12)


def test_impulses_at_a_point_change_the_momenta_by_exactly_themselves() -> None:
    """M (v' - v*) = C^T p is what a solver does; the body then carries p and its moment about the centre, to rounding."""
    rng = np.random.default_rng(3)
    body = brick(position=[0.1, 0.2, 0.3], velocity=[0.3, 0.1, -1.0], spin=[2.0, -1.0, 4.0])
    state = run(body, 7, 0.01)
    point, impulse, dt = state.position + rng.normal(size=3) * 0.2, rng.normal(size=3) * 20.0, 0.01
    predicted = predicted_velocities(body, state, GRAVITY, dt, 0.0)
    columns = contact_columns(body, state, point[None])[0]
    solved = predicted + np.einsum("bij,i->bj", columns, impulse) / generalised_masses(body, state)
    after = moved(body, state, solved, dt, 0.0)
    gained = body.mass * (after.velocity - state.velocity - dt * GRAVITY)
    np.testing.assert_allclose(gained, impulse, atol=1e-11)
    turned = angular_momentum(body, after) - angular_momentum(body, state)
    np.testing.assert_allclose(turned, np.cross(point - state.position, impulse), atol=1e-11)


@pytest.mark.parametrize("d", [2, 3])
def test_contact_columns_are_the_velocity_of_the_matter(d: int) -> None:
    shape: Shape = Moved(Box([0.3, 0.2, 0.1][:d]), [0.2, 0.1, 0.0][:d])
    spin = [1.0, -2.0, 0.5] if d == 3 else 1.5
    body = Body(
        shape, density=800.0, rotation=None if d == 3 else 0.4, velocity=[0.3, -0.1, 0.6][:d], spin=spin
    )
    state, dt = start(body), 1e-6
    points = np.random.default_rng(1).normal(size=(20, d))
    columns = contact_columns(body, state, points)
    assert columns.shape == (20, 2, d, d)
    blocks = generalised_velocities(body, state)
    velocities = columns[:, 0] @ blocks[0] + columns[:, 1] @ blocks[1]
    after = moved(body, state, predicted_velocities(body, state, np.zeros(d), dt, 0.0), dt, 0.0)
    np.testing.assert_allclose(velocities, (to_world(after, to_body(state, points)) - points) / dt, atol=1e-4)


def test_mass_matrix_gives_the_kinetic_energy() -> None:
    body = brick(velocity=[1.0, 2.0, 3.0], spin=[4.0, 5.0, 6.0], rotation=rotations.exponential(np.ones(3)))
    blocks = generalised_velocities(body, start(body))
    energy = 0.5 * np.sum(generalised_masses(body, start(body)) * blocks**2)
    assert energy == pytest.approx(kinetic_energy(body, start(body)), rel=1e-13)


def test_a_held_component_stays_at_zero_and_the_rest_moves() -> None:
    motion = Free(held=("y", "spin_x", "spin_z"), torque=[0.3, 0.2, 0.1], force=[1.0, 5.0, 0.0])
    body = Body(
        wheel(0.2, 0.05, 6, 0.03),
        mass=2.0,
        rotation=rotations.exponential(np.array([0.0, 0.7, 0.0])),
        motion=motion,
    )
    after = run(body, 100, 0.01, GRAVITY)
    assert after.velocity[1] == 0.0 and after.position[1] == 0.0
    assert after.spin[0] == 0.0 and after.spin[2] == 0.0
    assert after.spin[1] == pytest.approx(0.2 / body.inertia[1, 1], rel=1e-9)
    assert after.velocity[0] == pytest.approx(0.5, rel=1e-12)
    masses = generalised_masses(body, after)
    assert np.isinf(masses[0, 1]) and np.sum(np.isinf(masses[1])) == 2


def test_one_held_spin_leaves_the_inertia_across_it() -> None:
    body = brick(
        motion=Free(held=("spin_z",)),
        rotation=rotations.exponential(np.array([0.4, 0.3, 0.9])),
        spin=[1.0, 2.0, 0.0],
    )
    blocks = generalised_velocities(body, start(body))
    masses = generalised_masses(body, start(body))
    finite = np.isfinite(masses[1])
    assert np.sum(finite) == 2 and np.all(blocks[1][~finite] == 0.0)
    energy = 0.5 * np.sum(masses[1][finite] * blocks[1][finite] ** 2)
    assert energy == pytest.approx(kinetic_energy(body, start(body)), rel=1e-12)
    assert run(body, 50, 0.01).spin[2] == pytest.approx(0.0, abs=1e-14)


def test_a_torque_of_the_body_turns_with_it() -> None:
    quarter = rotations.exponential(np.array([0.0, 0.0, 0.5 * np.pi]))
    for frame, axis in (("body", [0.0, 1.0, 0.0]), ("world", [1.0, 0.0, 0.0])):
        body = Body(Sphere(0.1), mass=1.0, rotation=quarter, torque=[0.02, 0.0, 0.0], torque_frame=frame)
        np.testing.assert_allclose(run(body, 10, 0.1).spin, 5.0 * np.array(axis), atol=1e-12)


def test_loads_may_depend_on_time() -> None:
    body = Body(Sphere(0.1), mass=2.0, motion=Free(force=lambda t: [t, 0.0, 0.0]), force=[0.0, 4.0, 0.0])
    after = run(body, 10, 0.1)
    np.testing.assert_allclose(
        after.velocity, [sum(0.1 * n * 0.1 / 2 for n in range(10)), 2.0, 0.0], atol=1e-12
    )


def test_a_plane_body_turns_by_its_torque() -> None:
    disk = Body(Sphere(0.2, 2), mass=3.0, torque=0.6, rotation=0.1)
    after = run(disk, 10, 0.1, np.zeros(2))
    inertia = 0.5 * 3.0 * 0.04
    assert after.spin[0] == pytest.approx(0.6 / inertia)
    assert after.rotation[0] == pytest.approx(0.1 + 0.6 / inertia * 0.01 * 55)
    masses = generalised_masses(disk, after)
    assert masses[1, 1] == 1.0 and masses[1, 0] == pytest.approx(inertia)
    held = Body(Sphere(0.2, 2), mass=3.0, torque=0.6, motion=Free(held=("spin", "z")))
    still = run(held, 10, 0.1, np.array([0.0, -9.81]))
    assert still.spin[0] == 0.0 and still.velocity[1] == 0.0


def test_a_prescribed_body_passes_through_its_key_frames() -> None:
    quarter = rotations.exponential(np.array([0.0, 0.5 * np.pi, 0.0]))
    motion = Prescribed(
        [0.0, 1.0, 2.0], [[0, 0, 0], [1, 0, 0], [1, 0, 3]], [rotations.identity(3), quarter, quarter]
    )  # type: ignore[arg-type]
    gate = Body(Box([0.1, 0.1, 0.1]), motion=motion)
    assert is_driven(gate) and np.all(np.isinf(generalised_masses(gate, start(gate))))
    state = start(gate)
    for n in range(30):
        blocks = predicted_velocities(gate, state, GRAVITY, 0.1, 0.1 * n)
        expected = [1, 0, 0] if n < 10 else ([0, 0, 3] if n < 20 else [0, 0, 0])
        np.testing.assert_allclose(blocks[0], expected, atol=1e-12)
        np.testing.assert_allclose(blocks[1], [0, 0.5 * np.pi if n < 10 else 0, 0], atol=1e-12)
        state = moved(gate, state, blocks, 0.1, 0.1 * n)
        if n == 9:
            np.testing.assert_allclose(state.position, [1, 0, 0], atol=1e-12)
            np.testing.assert_allclose(state.rotation, quarter, atol=1e-12)
    np.testing.assert_allclose(state.position, [1, 0, 3], atol=1e-12)
    assert np.all(state.velocity == 0.0)


def test_a_plane_key_frame_may_turn_many_times() -> None:
    motion = Prescribed([0.0, 2.0], [[0, 0], [0, 0]], [0.0, 8 * np.pi])  # type: ignore[arg-type]
    blocks = predicted_velocities(
        body := Body(Box([0.1, 0.2]), motion=motion), start(body), np.zeros(2), 0.5, 0.5
    )
    np.testing.assert_allclose(blocks[1], [4 * np.pi, 0.0])


def test_a_fixed_body_stays() -> None:
    wall = Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed(), friction=0.3)
    state = start(wall)
    assert np.all(predicted_velocities(wall, state, GRAVITY, 0.1, 0.0) == 0.0)
    assert moved(wall, state, np.zeros((2, 3)), 0.1, 0.0) is state
    assert kinetic_energy(wall, state) == 0.0


def test_a_placed_body_sees_the_world_from_its_frame() -> None:
    turn = rotations.exponential(np.array([0.2, 0.9, -0.4]))
    body = Body(Box([0.3, 0.2, 0.1]), density=1.0, position=[1.0, 2.0, 3.0], rotation=turn)
    state = start(body)
    surface = body_surface(body, state, 0.05)
    np.testing.assert_allclose(body_distance(body, state, surface.points), 0.0, atol=1e-12)
    np.testing.assert_allclose(to_world(state, to_body(state, surface.points)), surface.points, atol=1e-13)
    outside = surface.points + 0.01 * surface.normals
    np.testing.assert_allclose(body_distance(body, state, outside), 0.01, atol=1e-12)
    np.testing.assert_allclose(body_normals(body, state, outside), surface.normals, atol=1e-9)


def test_states_survive_storage() -> None:
    bodies = [brick(position=[0, 0, 1], spin=[1, 2, 3]), Body(Sphere(0.1), mass=1.0)]
    states = BodyStates.at_start(bodies)
    again = BodyStates.from_arrays(states.arrays())
    for name, value in states.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], value)
    assert len(BodyStates.none(2)) == 0 and len(BodyStates.at_start([], 3)) == 0
    rebuilt = BodyStates.of([states.row(0), states.row(1)], 3)
    np.testing.assert_array_equal(rebuilt.spins, states.spins)
    with pytest.raises(InputError, match=r"bodies\.spins"):
        BodyStates.from_arrays({k: v for k, v in states.arrays().items() if k != "spins"})
    with pytest.raises(InputError, match="unit"):
        BodyStates(np.zeros((1, 3)), np.zeros((1, 4)), np.zeros((1, 3)), np.zeros((1, 3)))


BALL = Sphere(0.1)
BAD = {
    "body.shape": lambda: Body("ball", mass=1.0),
    "body.density": lambda: Body(BALL),
    "body.mass": lambda: Body(BALL, mass=1.0, density=1.0),
    "body.b.mass": lambda: Body(BALL, name="b", mass=-1.0),
    "body.friction": lambda: Body(BALL, mass=1.0, friction=-0.1),
    "body.position": lambda: Body(BALL, mass=1.0, position=[0.0, 1.0]),
    "body.rotation": lambda: Body(BALL, mass=1.0, rotation=[1.0, 1.0, 0.0, 0.0]),
    "body.velocity": lambda: Body(BALL, motion=Fixed(), velocity=[1.0, 0.0, 0.0]),
    "body.spin": lambda: Body(BALL, mass=1.0, spin=[np.nan, 0.0, 0.0]),
    "body.motion": lambda: Body(BALL, mass=1.0, motion="free"),
    "body.torque_frame": lambda: Body(BALL, mass=1.0, torque_frame="wheel"),
    "shape": lambda: Body(HalfSpace([0.0, 0.0, 1.0]), density=1.0),
    "motion.held": lambda: Free(held=("roll",)),
    "motion.times": lambda: Prescribed([0.0, 0.0], [[0, 0], [1, 0]]),
    "motion.positions": lambda: Prescribed([0.0, 1.0], [[0, 0]]),
    "motion.rotations": lambda: Prescribed([0.0, 1.0], [[0, 0], [1, 0]], [0.0]),
}


@pytest.mark.parametrize("field", BAD)
def test_bad_bodies_are_refused_by_name(field: str) -> None:
    with pytest.raises(InputError) as raised:
        BAD[field]()
    assert raised.value.field == field


def test_contradictions_are_refused() -> None:
    track = Prescribed([0.0, 1.0], [[0, 0, 0], [1, 0, 0]])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="as its motion says"):
        Body(BALL, motion=track, position=[0.0, 0.0, 1.0])
    with pytest.raises(InputError, match="dimension"):
        Body(Sphere(0.1, 2), motion=track)
    with pytest.raises(InputError, match="starts to move"):
        Body(BALL, mass=1.0, motion=Free(held=("x",)), velocity=[1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="2D"):
        Body(Sphere(0.1, 2), mass=1.0, motion=Free(held=("spin_x",)))
    with pytest.raises(InputError, match=r"motion\.force"):
        Body(BALL, mass=1.0, motion=Free(force=lambda t: [t]))
