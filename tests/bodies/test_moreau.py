"""Laws of the Moreau-Jean step: slope, stack, impact, top, joints, driven bodies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.moreau import (
    Assembly,
    AssemblyState,
    BallJoint,
    DistanceJoint,
    FixedJoint,
    Hinge,
    Options,
    Slider,
)
from barchan.bodies.rigid import Body, Box, Fixed, HalfSpace, Prescribed, Sphere
from barchan.errors import InputError

G = 9.81
EXACT = Options(tolerance=1e-10)


def _floor(d: int, friction: float = 0.5) -> Body:
    up = np.eye(d)[-1]
    return Body(HalfSpace(up, 0.0), "floor", friction, motion=Fixed())


def _run(
    assembly: Assembly, steps: int, dt: float, state: AssemblyState | None = None
) -> tuple[AssemblyState, list]:
    state, records = state or assembly.started(), []
    for _ in range(steps):
        state, record = assembly.advance(state, dt)
        records.append(record)
    return state, records


def _tilted(angle: float, d: int) -> np.ndarray:
    gravity = np.zeros(d)
    gravity[0], gravity[-1] = G * math.sin(angle), -G * math.cos(angle)
    return gravity


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("above", [-1e-6, 1e-6])
def test_a_block_slides_when_the_slope_passes_its_friction(d: int, above: float) -> None:
    mu = 0.4
    angle = math.atan(mu) + above
    half = (0.1,) * (d - 1) + (0.05,)
    block = Body(Box(half), "block", mu, density=1000.0, position=(0.0,) * (d - 1) + (0.05,))
    assembly = Assembly(
        [_floor(d, mu), block], gravity=_tilted(angle, d), options=replace(EXACT, tolerance=1e-12)
    )
    state, _ = _run(assembly, 20, 0.01)
    speed = state.bodies.velocities[1, 0]
    expected = max(0.0, G * (math.sin(angle) - mu * math.cos(angle)) * 0.2)
    assert speed == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_a_sliding_block_gains_the_exact_speed_in_every_step(d: int) -> None:
    mu, angle = 0.3, 0.6
    half = (0.1,) * (d - 1) + (0.02,)
    block = Body(Box(half), "block", mu, density=1000.0, position=(0.0,) * (d - 1) + (0.02,))
    assembly = Assembly([_floor(d, mu), block], gravity=_tilted(angle, d), options=EXACT)
    state = assembly.started()
    for step in range(1, 11):
        state, _ = assembly.advance(state, 0.01)
        gained = G * (math.sin(angle) - mu * math.cos(angle)) * 0.01 * step
        assert state.bodies.velocities[1, 0] == pytest.approx(gained, rel=1e-7)


def test_a_stack_of_ten_boxes_stands_still() -> None:
    boxes = [
        Body(Box((0.05, 0.05)), f"box {i}", 0.5, density=1000.0, position=(0.0, 0.05 + 0.1 * i))
        for i in range(10)
    ]
    assembly = Assembly([_floor(2), *boxes], options=Options(tolerance=1e-8))
    state, records = _run(assembly, 200, 0.01)
    moved = state.bodies.positions[1:] - np.array([body.position for body in boxes])
    assert np.max(np.abs(moved)) < 1e-6 * 0.1
    assert all(record.converged for record in records)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_ball_rebounds_by_newtons_coefficient_and_no_energy_is_made(restitution: float) -> None:
    ball = Body(Sphere(0.1), "ball", 0.0, density=1000.0, position=(0.0, 0.0, 1.0))
    assembly = Assembly([_floor(3), ball], options=replace(EXACT, restitution=restitution, rest_speed=1e-3))
    state, before, dt = assembly.started(), [], 1e-3
    speeds = []
    for _ in range(700):
        state, record = assembly.advance(state, dt)
        before.append(record.kinetic_energy + record.potential_energy)
        speeds.append(state.bodies.velocities[1, 2])
    assert np.max(np.diff(before)) <= 1e-9 * before[0]
    falling = min(speeds)
    # Without restitution the step of the impact ends in touch, the next one at rest.
    after = speeds[int(np.argmin(speeds)) + 2]
    assert after == pytest.approx(-restitution * falling, abs=4.0 * G * dt)


def test_an_asymmetric_top_keeps_its_angular_momentum() -> None:
    top = Body(Box((0.3, 0.2, 0.1)), "top", density=1000.0, spin=(0.3, 5.0, 0.2))
    assembly = Assembly([top], gravity=0.0)
    table = assembly.table

    def momentum(state: AssemblyState) -> np.ndarray:
        axes = table.spin_axes(state.bodies)[0]
        return axes @ (table.moments[0] * (axes.T @ state.bodies.spins[0]))

    start = assembly.started()
    state, records = _run(assembly, 1000, 0.01, start)
    assert np.allclose(momentum(state), momentum(start), rtol=1e-8)
    turned = np.abs(state.bodies.spins[0] - start.bodies.spins[0])
    assert np.max(turned) > 0.1
    assert records[-1].kinetic_energy == pytest.approx(records[0].kinetic_energy, rel=1e-2)


@pytest.mark.parametrize("d", [2, 3])
def test_a_pendulum_on_a_ball_joint_keeps_its_length_and_its_period(d: int) -> None:
    anchor = np.zeros(d)
    bob_at = np.zeros(d)
    bob_at[0], bob_at[-1] = 0.05, -math.sqrt(1.0 - 0.05**2)
    hook = Body(Sphere(0.01, dimension=d), "hook", motion=Fixed(), position=anchor)
    bob = Body(Sphere(0.01, dimension=d), "bob", mass=1.0, position=bob_at)
    assembly = Assembly([hook, bob], [BallJoint(0, 1, anchor)], options=EXACT)
    state, crossings, dt = assembly.started(), [], 1e-3
    for _ in range(2100):
        previous = state.bodies.positions[1, 0]
        state, record = assembly.advance(state, dt)
        assert record.joint_error < 1e-4
        if previous > 0.0 >= state.bodies.positions[1, 0]:
            crossings.append(state.time)
    assert np.linalg.norm(state.bodies.positions[1]) == pytest.approx(1.0, abs=1e-4)
    quarter = 0.5 * math.pi * math.sqrt((1.0 + 0.4 * 1e-4 if d == 3 else 1.0 + 0.5e-4) / G)
    assert crossings[0] == pytest.approx(quarter, rel=0.01)


def test_joints_leave_exactly_the_motion_they_allow() -> None:
    cube = Box((0.1, 0.1, 0.1))

    def after(joint: object, push: tuple[float, ...], turn: tuple[float, ...]) -> AssemblyState:
        base = Body(cube, "base", motion=Fixed())
        arm = Body(cube, "arm", density=500.0, position=(0.5, 0.0, 0.0), velocity=push, spin=turn)
        state, records = _run(Assembly([base, arm], [joint], gravity=0.0, options=EXACT), 50, 0.002)  # type: ignore[list-item]
        assert records[-1].joint_error < 1e-3
        return state

    fixed = after(FixedJoint(0, 1, (0.25, 0.0, 0.0)), (0.0, 1.0, 0.3), (0.5, 0.0, 0.2))
    assert np.allclose(fixed.bodies.velocities[1], 0.0, atol=1e-9)
    hinged = after(Hinge(0, 1, (0.25, 0.0, 0.0), axis=(0.0, 0.0, 1.0)), (0.0, 1.0, 0.5), (0.0, 0.0, 0.0))
    assert abs(hinged.bodies.velocities[1, 2]) < 1e-9 and np.allclose(
        hinged.bodies.spins[1, :2], 0.0, atol=1e-6
    )
    assert hinged.bodies.spins[1, 2] > 1.0
    slid = after(Slider(0, 1, (0.25, 0.0, 0.0), axis=(0.0, 1.0, 0.0)), (0.3, 1.0, 0.5), (0.1, 0.2, 0.3))
    assert slid.bodies.velocities[1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    rod = after(
        DistanceJoint(0, 1, (0.0, 0.0, 0.0), second_anchor=(0.5, 0.0, 0.0)), (0.3, 1.0, 0.0), (0.0, 0.0, 0.0)
    )
    assert np.linalg.norm(rod.bodies.positions[1]) == pytest.approx(0.5, abs=1e-3)


def test_a_moving_floor_drags_a_block_along() -> None:
    belt = Body(Box((5.0, 0.1)), "belt", 0.5, motion=Prescribed([0.0, 10.0], [[0.0, -0.1], [10.0, -0.1]]))
    block = Body(Box((0.1, 0.05)), "block", 0.5, density=1000.0, position=(0.0, 0.05))
    state, _ = _run(Assembly([belt, block], options=EXACT), 50, 0.01)
    assert state.bodies.velocities[1, 0] == pytest.approx(1.0, abs=1e-6)
    early, _ = _run(Assembly([belt, block], options=EXACT), 10, 0.01)
    assert early.bodies.velocities[1, 0] == pytest.approx(0.5 * G * 0.1, rel=1e-6)


def test_a_state_written_and_read_again_continues_with_the_same_bytes() -> None:
    balls = [
        Body(Sphere(0.1), f"b{i}", density=1000.0, position=(0.05 * i, 0.0, 0.1 + 0.19 * i)) for i in range(4)
    ]
    assembly = Assembly([_floor(3), *balls])
    state, _ = _run(assembly, 20, 0.005)
    again = AssemblyState.from_arrays(state.arrays())
    one, two = assembly.advance(state, 0.005)[0], assembly.advance(again, 0.005)[0]
    for a, b in zip(one.arrays().values(), two.arrays().values(), strict=True):
        assert np.array_equal(a, b)


def _ball(name: str, x: float, speed: float, d: int = 2, y: float = 0.0) -> Body:
    across = (0.0,) * (d - 2)
    return Body(
        Sphere(0.01, d), name, density=2500.0, position=(x, *across, y), velocity=(speed, *across, 0.0)
    )


@pytest.mark.parametrize("d", [2, 3])
def test_a_ball_does_not_run_into_one_that_stops_ahead_of_it(d: int) -> None:
    # both go at 3 m/s, so their gap does not close until the wall stops the first within the step
    wall = Body(HalfSpace(-np.eye(d)[0]), "wall", position=[0.024] + [0.0] * (d - 1), motion=Fixed())
    balls = [_ball("ahead", 0.01, 3.0, d), _ball("behind", -0.014, 3.0, d)]
    assembly = Assembly([wall, *balls], gravity=0.0, options=EXACT)
    state, record = assembly.advance(assembly.started(), 0.01)
    assert record.converged
    gap = state.bodies.positions[1, 0] - state.bodies.positions[2, 0] - 0.02
    assert -1e-9 <= gap < 1e-6


def test_a_push_goes_through_a_row_of_balls_that_do_not_touch_within_one_step() -> None:
    # nothing but the first moves: the contacts between the others are there only once the step is solved
    row = [_ball(f"ball {i}", 0.0205 * i, 3.0 if i == 0 else 0.0) for i in range(6)]
    assembly = Assembly(row, gravity=0.0, options=EXACT)
    state, _ = assembly.advance(assembly.started(), 0.01)
    gaps = np.diff(state.bodies.positions[:, 0]) - 0.02
    assert np.all(gaps > -1e-3 * 0.01)
    assert state.bodies.velocities[-1, 0] > 0.0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([2, 3]))
def test_round_bodies_never_overlap_however_fast_they_meet(seed: int, d: int) -> None:
    # gaps of convex round bodies are never less than their linear prediction: contacts alone keep them apart
    rng = np.random.default_rng(seed)
    places = 0.021 * np.stack(np.unravel_index(np.arange(4**d), (4,) * d), axis=1)
    bodies = [
        Body(Sphere(0.01, d), f"{i}", density=2500.0, position=place, velocity=rng.normal(0.0, 2.0, d))
        for i, place in enumerate(places)
    ]
    assembly = Assembly(bodies, gravity=0.0, options=Options(tolerance=1e-8))
    state = assembly.started()
    for _ in range(3):
        state, record = assembly.advance(state, 0.005)
        found = assembly.geometry.detect(state.bodies, 0.0).gaps
        assert record.converged and np.all(found > -2e-3 * 0.01)


def test_fixed_bodies_join_no_contacts_together() -> None:
    balls = [_ball(f"ball {i}", 0.1 * i, 0.0, y=0.01) for i in range(3)]
    assembly = Assembly([_floor(2), *balls], options=EXACT)
    problem = assembly.problem(assembly.started(), 0.01)
    coupling = (abs(problem.H) @ abs(problem.H).T).toarray()
    assert problem.n == 3 and problem.H.nnz == 3 * 2 * 4
    assert all(coupling[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].sum() == 0.0 for i, j in ((0, 1), (1, 2)))


def test_bad_input_is_named() -> None:
    ball = Body(Sphere(0.1), density=1.0)
    with pytest.raises(InputError, match="bodies"):
        Assembly([])
    with pytest.raises(InputError, match=r"options\.theta"):
        Options(theta=0.2)
    with pytest.raises(InputError, match="joint"):
        Assembly([ball], [BallJoint(0, 1, (0.0, 0.0, 0.0))])
    with pytest.raises(InputError, match="gravity"):
        Assembly([ball], gravity=(1.0, 2.0))
    assembly = Assembly([ball])
    with pytest.raises(InputError, match="dt"):
        assembly.advance(assembly.started(), 0.0)
