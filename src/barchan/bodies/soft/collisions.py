"""A head-on collision integrated to rounding: restitution and duration where a contact law has no closed form.

The one-dimensional equation m* d2(delta)/dt2 = -f_n(delta, d(delta)/dt) of seed C, 3.2.2, in units of the law's own depth and
time, so that the answer is as exact for sand as for boulders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from barchan.bodies.rigid import inputs
from barchan.bodies.soft._contact_kernels import normal_law
from barchan.bodies.soft.laws import ContactLaw, Hertzian
from barchan.errors import InputError

_STOPPED = 1e-8  # coefficient of restitution


@dataclass(frozen=True)
class Collision:
    """How a head-on collision ended: coefficient of `restitution`, `duration` [s] and deepest overlap `depth` [m]."""

    restitution: float
    duration: float
    depth: float


def collision(contact: ContactLaw, mass: float, radius: float, speed: float) -> Collision:
    """Head-on collision of effective mass m* [kg] and radius R* [m] at the relative `speed` [m/s].

    Ends where the overlap is gone, or for a law that is not `attractive` where the force is. InputError when it never ends.
    """
    mass, radius = inputs.positive("mass", mass), inputs.positive("radius", radius)
    speed = inputs.positive("speed", speed)
    numbers = contact.numbers()
    depth = contact.depth(mass, radius, speed)
    time = depth / speed

    def force(overlap: float, rate: float) -> float:
        elastic, dashpot, _ = normal_law(numbers, mass, radius, max(overlap, 0.0) * depth)
        return float(elastic + dashpot * rate * speed)

    def rates(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -force(y[0], y[1]) * time / (mass * speed)]

    def over(_: float, y: np.ndarray) -> float:
        # Past the overlap an elastic force is zero for good, which has no crossing to be found.
        if contact.attractive or y[0] <= 0.0:
            return float(y[0])
        return float(force(y[0], y[1]) * time / (mass * speed))

    def deepest(_: float, y: np.ndarray) -> float:
        return float(y[1])

    over.terminal = True  # type: ignore[attr-defined]
    over.direction = -1  # type: ignore[attr-defined]
    run = solve_ivp(
        rates, (0.0, 1e4), [0.0, 1.0], method="DOP853", events=(over, deepest), rtol=1e-10, atol=1e-13
    )
    # an overdamped contact creeps towards zero overlap, and gets there only by rounding
    if not len(run.t_events[0]) or -run.y_events[0][0][1] < _STOPPED:
        raise InputError("contact", contact, "damped little enough for a collision to end")
    end = run.y_events[0][0]
    most = max((float(y[0]) for y in run.y_events[1]), default=0.0)
    return Collision(float(-end[1]), float(run.t_events[0][0]) * time, most * depth)


def calibrated(contact: Hertzian, restitution: float, mass: float, radius: float, speed: float) -> Hertzian:
    """`contact` with the viscoelastic `damping_rate` that gives `restitution` in (0, 1) at one mass, radius and speed.

    The seed's Hertzian dashpot has no single coefficient of restitution: slower collisions lose less than this one.
    """
    if not 0.0 < restitution < 1.0:
        raise InputError("restitution", restitution, "between 0 and 1")
    bare = replace(contact, damping=0.0, damping_rate=0.0)
    # rate that makes the dashpot as strong as the spring at the depth and speed of this collision
    depth = bare.depth(mass, radius, speed)
    unit = bare.normal_modulus * depth / (mass * speed)

    def surplus(log_rate: float) -> float:
        damped = replace(bare, damping_rate=unit * float(np.exp(log_rate)))
        return collision(damped, mass, radius, speed).restitution - restitution

    rate = unit * float(np.exp(brentq(surplus, np.log(1e-6), np.log(3.0), xtol=1e-10)))
    return replace(bare, damping_rate=rate)
