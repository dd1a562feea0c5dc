"""Bodies that overlap or are outside the box are refused; those that only touch, or walls that stick out, are not."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Box,
    Fixed,
    HalfSpace,
    Prescribed,
    Sphere,
    check_bodies,
    funnel,
    sample_mesh,
)
from barchan.errors import InputError

LOWER, UPPER = [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]


def ball(x: float, z: float = 0.5, radius: float = 0.1, name: str = "") -> Body:
    return Body(Sphere(radius), name=name, density=1.0, position=[x, 0.5, z])


def test_bodies_apart_or_just_touching_pass() -> None:
    check_bodies([], LOWER, UPPER)
    check_bodies([ball(0.3), ball(0.5), ball(0.7)], LOWER, UPPER)
    floor = Body(HalfSpace([0.0, 0.0, 1.0], 0.4), motion=Fixed())
    check_bodies([ball(0.3), floor], LOWER, UPPER)
    check_bodies([ball(0.3, z=0.0)], LOWER, UPPER)  # half below the floor, its centre in the box


@pytest.mark.parametrize("gap", [0.19, 0.1, 0.0])
def test_overlapping_balls_are_refused(gap: float) -> None:
    with pytest.raises(InputError, match=r"left and right.*apart"):
        check_bodies([ball(0.4, name="left"), ball(0.4 + gap, name="right")], LOWER, UPPER)


def test_a_body_inside_another_is_refused() -> None:
    with pytest.raises(InputError, match="apart"):
        check_bodies([ball(0.5, radius=0.3), ball(0.5, radius=0.05)], LOWER, UPPER)


def test_a_ball_in_the_ground_or_in_a_mesh_is_refused() -> None:
    floor = Body(HalfSpace([0.0, 0.0, 1.0], 0.45), motion=Fixed(), name="floor")
    with pytest.raises(InputError, match="floor"):
        check_bodies([ball(0.3), floor], LOWER, UPPER)
    animal = Body(sample_mesh(0.5, 20), name="animal", density=1.0, position=[0.5, 0.5, 0.3])
    with pytest.raises(InputError, match="animal"):
        check_bodies([animal, ball(0.65, z=0.35)], LOWER, UPPER)


def test_a_body_outside_the_box_is_refused() -> None:
    with pytest.raises(InputError, match="outside"):
        check_bodies([ball(1.5)], LOWER, UPPER)
    with pytest.raises(InputError, match="centre in the box"):
        check_bodies([ball(1.05)], LOWER, UPPER)
    with pytest.raises(InputError, match="outside"):
        check_bodies([Body(Box([0.1] * 3), motion=Fixed(), position=[0.5, 0.5, -1.0])], LOWER, UPPER)
    with pytest.raises(InputError, match="outside"):
        check_bodies([Body(HalfSpace([0.0, 0.0, 1.0], -0.5), motion=Fixed())], LOWER, UPPER)
    with pytest.raises(InputError, match="fills the box"):
        check_bodies([Body(Sphere(3.0), motion=Fixed(), position=[0.5] * 3)], LOWER, UPPER)
    gate = Body(Box([0.1] * 3), motion=Prescribed([0.0, 1.0], [[0.5, 0.5, 1.05], [0.5, 0.5, 2.0]]))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="centre in the box"):
        check_bodies([gate], LOWER, UPPER)


def test_a_fixed_body_may_stick_out() -> None:
    cone = Body(funnel(0.6, 0.1, 0.8, 0.05), motion=Fixed(), position=[0.5, 0.5, 0.5])
    check_bodies([cone], LOWER, UPPER)


def test_moved_states_are_checked_where_they_are() -> None:
    bodies = [ball(0.3), ball(0.7)]
    rows = BodyStates.at_start(bodies)
    close = BodyStates(
        rows.positions * [1.0, 1.0, 1.0] - [[-0.3, 0, 0], [0, 0, 0]],
        rows.rotations,
        rows.velocities,
        rows.spins,
    )
    with pytest.raises(InputError, match="apart"):
        check_bodies(bodies, LOWER, UPPER, close)
    check_bodies(bodies, LOWER, UPPER, close, tolerance=0.2)
    with pytest.raises(InputError, match="dimension"):
        check_bodies([Body(Sphere(0.1, 2), mass=1.0)], LOWER, UPPER)
    assert np.all(rows.positions[:, 2] == 0.5)
