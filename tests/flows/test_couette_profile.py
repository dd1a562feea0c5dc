"""The exact Couette flow: no slip, balance of moments, closed forms of special fluids, what has no solution."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.couette import couette_profile
from barchan.flows.quasi_newtonian.models import Bingham, ModifiedPoliquen, Newtonian, Poliquen, PowerLaw

INNER, OUTER, SPEED = 0.019, 0.024, 0.019886667


def granular(eps):
    return ModifiedPoliquen(0.15, 0.27, 0.06, 0.001, 1.0, 1487.0 / 1500.0, eps=eps)


def test_a_newtonian_fluid_has_the_classical_profile():
    r = np.linspace(INNER, OUTER, 11)
    speeds, _, _ = couette_profile(Newtonian(2.0), INNER, OUTER, SPEED).at(r)
    expected = SPEED * INNER / r * (OUTER**2 - r**2) / (OUTER**2 - INNER**2)
    assert speeds == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_power_law_fluid_has_the_classical_profile():
    # |sigma| ~ |g|^(m-1) = 1/r^2, so omega is affine in r^(-2/(m-1)).
    m, r = 3.0, np.linspace(INNER, OUTER, 11)
    speeds, _, _ = couette_profile(PowerLaw(0.7, m), INNER, OUTER, SPEED).at(r)
    power = -2.0 / (m - 1.0)
    turning = SPEED / INNER * (r**power - OUTER**power) / (INNER**power - OUTER**power)
    assert speeds == pytest.approx(r * turning, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("eps", [1e-1, 1e-3, 1e-5])
def test_walls_do_not_slip_and_the_moment_is_the_same_on_every_circle(eps):
    profile = couette_profile(granular(eps), INNER, OUTER, SPEED)
    r = np.linspace(INNER, OUTER, 101)
    speeds, rates, viscosities = profile.at(r)
    assert speeds[0] == pytest.approx(SPEED, rel=1e-12)
    assert abs(speeds[-1]) < 1e-15 * SPEED
    assert np.all(np.diff(speeds) < 0.0)
    assert math.sqrt(2.0) * viscosities * rates * r**2 == pytest.approx(profile.torque, rel=1e-12)


@pytest.mark.parametrize("model", [granular(1e-2), Bingham(1.0, 3.0, 1e-2)])
def test_the_profile_obeys_the_differential_equation(model):
    profile = couette_profile(model, INNER, OUTER, SPEED)

    def turning(r, _):
        return [-math.sqrt(2.0) * float(profile.at([r])[1][0]) / r]

    found = solve_ivp(
        turning, (INNER, OUTER), [SPEED / INNER], rtol=1e-9, atol=1e-12 * SPEED / INNER, max_step=1e-4
    )
    assert abs(found.y[0, -1]) < 1e-7 * SPEED / INNER


def test_the_law_is_that_of_the_seed():
    profile = couette_profile(granular(1e-2), INNER, OUTER, SPEED)
    _, rates, viscosities = profile.at(np.linspace(INNER, OUTER, 9))
    s = np.sqrt(rates**2 + 1e-4)
    assert viscosities == pytest.approx(0.1487 / s + 0.26766 / (59.7394 + s), rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ((granular(1e-2), OUTER, INNER, SPEED), "outer"),
        ((granular(1e-2), INNER, OUTER, 0.0), "speed"),
        # The stress is bounded: the speed of the wall grows only with the logarithm of the shear rate there.
        ((granular(1e-2), INNER, OUTER, 100.0), "speed"),
        ((Poliquen(0.15, 0.27, 0.06, 1e-3, 1.0, 1e-2), INNER, OUTER, SPEED), "model"),
    ],
)
def test_what_has_no_such_flow_is_refused(arguments, field):
    with pytest.raises(InputError) as caught:
        couette_profile(*arguments)
    assert caught.value.field == field


def test_radii_outside_of_the_gap_are_refused():
    with pytest.raises(InputError, match="radii"):
        couette_profile(Newtonian(1.0), INNER, OUTER, SPEED).at([0.5 * INNER])
