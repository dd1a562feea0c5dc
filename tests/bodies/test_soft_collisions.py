"""Collisions of two soft spheres end as the formulas say (seed C, 3.2.2), and contact springs obey the laws of mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from barchan.bodies.soft import Hertzian, Hookean, SoftSpheres, Wall, calibrated, collision
from barchan.bodies.soft._contact_kernels import contact_force
from barchan.bodies.soft.laws import ContactLaw
from barchan.errors import InputError

RADII, DENSITIES = (0.5, 0.3), (2.0, 3.0)


def measured_restitution(law: ContactLaw, dimension: int, share: float, speed: float = 1.0) -> float:
    """Restitution of a head-on collision of two unequal grains, in a direction along no axis, simulated."""
    spheres = SoftSpheres(RADII, DENSITIES, law, 0.3, gravity=np.zeros(dimension))
    direction = np.arange(1.0, dimension + 1.0)
    direction /= np.linalg.norm(direction)
    positions = np.stack([np.zeros(dimension), 0.82 * direction])
    velocities = 0.5 * speed * np.stack([direction, -direction])
    state = spheres.start(positions, velocities)
    dt = spheres.time_step(speed, share)
    state = spheres.advance(state, dt, math.ceil(0.2 / speed / dt))
    after = state.bodies.velocities
    np.testing.assert_allclose(state.bodies.spins, 0.0, atol=1e-10)
    return float((after[1] - after[0]) @ direction / speed)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("restitution", [0.5, 0.7, 0.9, 1.0])
@pytest.mark.parametrize("attractive", [True, False])
def test_a_hookean_collision_has_the_restitution_of_the_formula(
    dimension: int, restitution: float, attractive: bool
) -> None:
    law = Hookean.of_restitution(1e4, restitution, attractive=attractive)
    assert law.restitution(0.1) == pytest.approx(restitution, rel=1e-10)
    assert measured_restitution(law, dimension, 0.02) == pytest.approx(restitution, rel=0.01)


@pytest.mark.parametrize("restitution", [0.3, 0.7, 0.95])
@pytest.mark.parametrize("speed", [0.1, 3.0])
def test_a_hertzian_collision_has_the_same_restitution_at_every_speed(
    restitution: float, speed: float
) -> None:
    law = Hertzian.of_restitution(1e7, restitution)
    assert measured_restitution(law, 3, 0.01, speed) == pytest.approx(restitution, rel=0.01)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 1.0), st.floats(1e-3, 1e3), st.floats(1e2, 1e8), st.floats(1e-3, 10.0), st.booleans())
def test_closed_forms_of_the_linear_spring_are_those_of_the_integrated_equation(
    restitution: float, mass: float, stiffness: float, speed: float, attractive: bool
) -> None:
    law = Hookean.of_restitution(stiffness, restitution, attractive=attractive)
    seen = collision(law, mass, 0.1, speed)
    assert seen.restitution == pytest.approx(restitution, rel=1e-6)
    assert seen.duration == pytest.approx(law.contact_duration(mass), rel=1e-6)


def test_the_dashpot_of_the_seed_has_its_formula() -> None:
    law, mass = Hookean(1e4, damping_rate=60.0), 0.3
    formula = math.exp(-math.pi * 60.0 / math.sqrt(4.0 * 1e4 / mass - 60.0**2))
    assert law.restitution(mass) == pytest.approx(formula, rel=1e-12)
    assert collision(law, mass, 0.1, 2.0).restitution == pytest.approx(formula, rel=1e-8)
    assert law.restitution(0.5 * mass) > law.restitution(mass)


@pytest.mark.parametrize("ratio", [0.5, 0.999999999, 1.0, 1.7])
def test_a_contact_that_cannot_pull_ends_even_when_overdamped(ratio: float) -> None:
    law = Hookean(100.0, ratio, attractive=False)
    seen = collision(law, 1.0, 1.0, 1.0)
    assert seen.restitution == pytest.approx(law.restitution(1.0), rel=1e-6)
    assert seen.duration == pytest.approx(law.contact_duration(1.0), rel=1e-5)


def test_closed_forms_of_the_hertzian_spring() -> None:
    mass, radius, speed = 0.2, 0.05, 0.7
    for restitution in (0.2, 0.6, 0.99):
        law = Hertzian.of_restitution(1e8, restitution, 0.25)
        assert law.restitution() == pytest.approx(restitution, rel=1e-12)
        assert collision(law, mass, radius, speed).restitution == pytest.approx(restitution, rel=1e-5)
    elastic = Hertzian(1e8, 0.25)
    seen = collision(elastic, mass, radius, speed)
    assert seen.duration == pytest.approx(elastic.contact_duration(mass, radius, speed), rel=1e-6)
    assert seen.depth == pytest.approx(elastic.depth(mass, radius, speed), rel=1e-6)


def test_viscoelastic_spheres_lose_more_in_faster_collisions_and_are_calibrated_at_one() -> None:
    law = calibrated(Hertzian(1e8), 0.8, 0.2, 0.05, 1.0)
    assert collision(law, 0.2, 0.05, 1.0).restitution == pytest.approx(0.8, rel=1e-7)
    slow, fast = (collision(law, 0.2, 0.05, speed).restitution for speed in (0.1, 10.0))
    assert slow > 0.82 and fast < 0.75


@pytest.mark.parametrize("law", [Hookean.of_restitution(1e4, 0.8), Hertzian.of_restitution(1e7, 0.8)])
def test_a_grain_bounces_on_a_wall_as_on_a_grain_of_infinite_mass(law: ContactLaw) -> None:
    spheres = SoftSpheres([0.5], 2.0, law, 0.3, [Wall((1.0, 2.0, 2.0), -0.6)], gravity=np.zeros(3))
    normal = np.array([1.0, 2.0, 2.0]) / 3.0
    state = spheres.start(np.zeros((1, 3)), [-normal])
    dt = spheres.time_step(1.0, 0.01)
    state = spheres.advance(state, dt, math.ceil(0.3 / dt))
    np.testing.assert_allclose(state.bodies.velocities[0], 0.8 * normal, rtol=0.01)


@pytest.mark.parametrize("share", [1.0 / 20.0, 1.0 / 50.0])
def test_an_oblique_collision_conserves_momentum_and_angular_momentum_and_no_energy_is_made(
    share: float,
) -> None:
    for law in (Hookean.of_restitution(1e4, 0.7), Hertzian.of_restitution(1e7, 0.7)):
        spheres = SoftSpheres(RADII, DENSITIES, law, 0.4, gravity=np.zeros(3), rolling_friction=0.1)
        state = spheres.start(
            [[0.0, 0.0, 0.0], [0.75, 0.3, 0.1]],
            [[0.5, 0.2, 0.0], [-0.5, 0.1, 0.3]],
            [[1.0, 2.0, 3.0], [0.0, -2.0, 1.0]],
        )
        mass, moment = spheres.masses, spheres.moments

        def momenta(s, mass=mass, moment=moment) -> NDArray[np.float64]:  # type: ignore[no-untyped-def]
            b = s.bodies
            turning = mass @ np.cross(b.positions, b.velocities) + moment @ b.spins
            return np.concatenate([mass @ b.velocities, turning])

        before, energy = momenta(state), spheres.energy(state)
        dt = spheres.time_step(1.0, share)
        state = spheres.advance(state, dt, math.ceil(0.3 / dt))
        now = spheres.energy(state)
        assert now.dissipated > 0.01 * energy.total and now.normal == 0.0
        np.testing.assert_allclose(momenta(state), before, atol=1e-12)
        assert now.translation + now.rotation < energy.total


def _turned(axis: NDArray[np.float64], angle: float, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    turned: NDArray[np.float64] = c * vector + s * np.cross(axis, vector) + (1.0 - c) * (axis @ vector) * axis
    return turned


@settings(max_examples=10, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_a_strained_contact_that_turns_like_a_rigid_body_turns_its_force(axis: list[float]) -> None:
    """Objectivity: the tangential and rolling springs follow the pair, around its normal too."""
    unit = np.array(axis) / np.linalg.norm(axis)
    law = Hookean(1e3, tangential_damping=0.0).numbers()
    memory = np.array([0.0, 1e-3, -2e-3, 0.0, 5e-4, 1e-3, 1e3 * 2.0 / 7.0])
    normal, steps = np.array([1.0, 0.0, 0.0]), 2000
    forces, springs = [], memory.copy()
    for k in range(steps + 1):
        angle = 0.5 * math.pi * k / steps
        n = _turned(unit, angle, normal)
        rate = unit  # one radian a second
        velocity = 1.98 * np.cross(rate, n)
        spin = (float(rate[0]), float(rate[1]), float(rate[2]))
        force, torque, _, _ = contact_force(
            law, 0.5, 0.9, 1.0, 0.5, 0.02, tuple(n), tuple(velocity), (0.99, 0.99), (spin, spin), memory,
            0.5 * math.pi / steps,
        )  # fmt: skip
        forces.append(np.array([force, torque]))
    for first, last in zip(forces[0], forces[-1], strict=True):
        np.testing.assert_allclose(
            last, _turned(unit, 0.5 * math.pi, first), atol=2e-3 * np.linalg.norm(first)
        )
    assert np.linalg.norm(memory[:3]) == pytest.approx(np.linalg.norm(springs[:3]), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Hookean(0.0), "contact.stiffness"),
        (lambda: Hookean(1.0, -0.1), "contact.damping_ratio"),
        (lambda: Hookean.of_restitution(1.0, 0.0), "restitution"),
        (lambda: Hertzian(1e6, 0.7), "contact.poisson_ratio"),
        (lambda: Hertzian.of_restitution(1e6, 1.5), "restitution"),
        (lambda: Hertzian(1e6, damping_rate=1.0).restitution(), "contact"),
        (lambda: collision(Hookean(1.0, 2.0), 1.0, 1.0, 1.0), "contact"),
        (lambda: Hookean(1.0).restitution(-1.0), "mass"),
        (lambda: calibrated(Hertzian(1e6), 1.0, 1.0, 1.0, 1.0), "restitution"),
    ],
)
def test_bad_numbers_are_named(make, field: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.field == field
