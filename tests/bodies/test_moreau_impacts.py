"""Impacts with restitution up to 1 never make energy, whatever friction does, and lose none that Newton's law keeps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.moreau import Assembly, Options
from barchan.bodies.rigid import Body, Box, Fixed, HalfSpace, Sphere

STEP = 1e-4
SIGNED = st.floats(-1.0, 1.0)


def thrown(angle: float, velocity: float, spin: float, friction: float, options: Options) -> list[float]:
    """Kinetic energies of a slender rod that hits the floor with its tip, without gravity."""
    height = 0.5 * abs(math.sin(angle)) + 0.02 * abs(math.cos(angle)) + 1e-6
    rod = Body(
        Box((0.5, 0.02)), "rod", friction, 100.0, position=(0.0, height), rotation=angle,
        velocity=(velocity, -1.0), spin=spin,
    )  # fmt: skip
    floor = Body(HalfSpace((0.0, 1.0)), "floor", friction, motion=Fixed())
    assembly = Assembly([floor, rod], gravity=0.0, options=options)
    state = assembly.started()
    found = [assembly.table.kinetic_energy(state.bodies)]
    for _ in range(4):
        state, record = assembly.advance(state, STEP)
        found.append(record.kinetic_energy)
    return found


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, math.pi), SIGNED, SIGNED, st.floats(0.0, 1.2), st.sampled_from([0.0, 0.5, 1.0]),
    st.sampled_from([0.0, 0.6]),
)  # fmt: skip
def test_a_rod_that_hits_the_floor_gains_no_energy(
    angle: float, velocity: float, spin: float, friction: float, restitution: float, tangential: float
) -> None:
    options = Options(tolerance=1e-10, restitution=restitution, tangential_restitution=tangential)
    energies = thrown(angle, velocity, 2.0 * spin, friction, options)
    assert max(np.diff(energies)) <= 1e-8 * energies[0]


def test_a_blow_that_would_make_energy_keeps_it_all() -> None:
    """Newton's law with e = 1 would raise this rod's energy by a tenth (it slides back after the blow)."""
    energies = thrown(1.87, -0.59, 0.4, 0.39, Options(tolerance=1e-10, restitution=1.0))
    assert energies[-1] == pytest.approx(energies[0], rel=0.05)
    assert energies[-1] <= energies[0]


@pytest.mark.parametrize("angle", [0.4, 1.2, 1.5])
def test_without_friction_the_rebound_is_newtons_and_keeps_the_energy(angle: float) -> None:
    energies = thrown(angle, 0.3, 0.5, 0.0, Options(tolerance=1e-10, restitution=1.0))
    np.testing.assert_allclose(energies, energies[0], rtol=1e-8)


@pytest.mark.parametrize("d", [2, 3])
def test_bodies_that_meet_all_at_once_gain_no_energy(d: int) -> None:
    """Boxes and balls thrown at each other: the sum of all impacts of a step loses energy, step by step."""
    rng = np.random.default_rng(d)
    bodies = []
    for number in range(8):
        place = np.zeros(d)
        place[:2] = 0.26 * (number % 3), 0.26 * (number // 3)
        shape = Box((0.12, 0.02, 0.05)[:d]) if number % 2 else Sphere(0.1, d)
        spin = 5.0 * rng.standard_normal(1 if d == 2 else 3)
        turn = float(spin[0]) if d == 2 else spin
        velocity = 4.0 * (0.26 - place) + 0.3 * rng.standard_normal(d)
        body = Body(shape, f"body_{number}", 0.6, 100.0, position=place, velocity=velocity, spin=turn)
        bodies.append(body)
    assembly = Assembly(bodies, gravity=0.0, options=Options(tolerance=1e-9, restitution=1.0, recovery=0.0))
    state = assembly.started()
    energies = [assembly.table.kinetic_energy(state.bodies)]
    touched = 0
    for _ in range(60):
        state, record = assembly.advance(state, 2e-3)
        energies.append(record.kinetic_energy)
        touched += record.contacts
    assert touched > 6
    # a free box keeps its angular momentum exactly, its energy to second order in the step
    assert max(np.diff(energies)) <= (1e-7 if d == 2 else 2e-4) * energies[0]
