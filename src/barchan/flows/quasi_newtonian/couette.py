"""The exact flow between two coaxial cylinders of a fluid whose viscosity depends on the shear rate (seed C, chapter 6).

With u = r omega(r) e_theta the stress is T / r^2 and |g| = r |omega'| / sqrt(2): sqrt(2) eta(|g|^2 + eps^2) |g| = T / r^2.
Along the gap d ln r = -d ln(tau) / 2, hence omega is an integral over ln |g|, in which the law is smooth however small eps is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.models import ViscosityModel

Vector = NDArray[np.float64]

ROOT_TWO = math.sqrt(2.0)
# Shear rates (in units of speed over gap) between which those at the inner wall are sought, as natural logarithms.
_SLOWEST, _FASTEST = math.log(1e-12), math.log(1e12)
# The integrand is analytic in a strip of width pi around the line of ln |g|: twelve points on a panel give all digits.
_PANEL = 0.05
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True, eq=False)
class CouetteProfile:
    """The steady flow of one fluid between cylinders, the inner one turning, without slip.

    torque : T = r^2 stress, the moment on the inner cylinder over 2 pi, per unit of its length.
    """

    model: ViscosityModel
    inner: float
    outer: float
    speed: float
    torque: float

    def at(self, radii: ArrayLike) -> tuple[Vector, Vector, Vector]:
        """Speeds, shear rates |g| and viscosities, each (n,), at radii (n,) in [inner, outer].

        Raises InputError for radii outside of the gap.
        """
        r = np.atleast_1d(np.asarray(radii, dtype=np.float64))
        slack = 1e-9 * self.outer
        if not np.all((r >= self.inner - slack) & (r <= self.outer + slack)):
            raise InputError("radii", radii, f"between {self.inner:g} and {self.outer:g}")
        r = np.clip(r, self.inner, self.outer)
        logs = _log_rates(self.model, self.torque / r**2)
        slowest = float(_log_rates(self.model, np.array([self.torque / self.outer**2]))[0])
        rates = np.exp(logs)
        speeds = r * _turning(self.model, slowest, logs)
        return speeds, rates, _viscosity(self.model, rates)


def couette_profile(model: ViscosityModel, inner: float, outer: float, speed: float) -> CouetteProfile:
    """The exact flow when the inner of two cylinders of radii `inner` < `outer` turns with the wall speed `speed` > 0.

    Relative errors are about 1e-12. Raises InputError for radii out of order, a speed that is not positive, a viscosity that
    depends on the pressure, and a speed beyond those any shear rate up to 1e12 speed / gap gives: where the stress is bounded,
    as that of the modified Poliquen model is by sqrt(2) (alpha + beta) P, the speed grows with the logarithm of the rate only.
    """
    if not 0.0 < inner < outer < math.inf:
        raise InputError("outer", outer, f"finite and above the inner radius {inner:g}, which is positive")
    if not (0.0 < speed < math.inf):
        raise InputError("speed", speed, "a positive number")
    if model.uses_pressure:
        raise InputError("model", type(model).__name__, "a viscosity that does not depend on the pressure")
    scale = math.log(speed / (outer - inner))

    def excess(log_rate: float) -> float:
        torque = _stress(model, np.exp(np.array([log_rate]))) * inner**2
        slowest = float(_log_rates(model, torque / outer**2)[0])
        return float(_turning(model, slowest, np.array([log_rate]))[0]) * inner / speed - 1.0

    low, high = scale + _SLOWEST, scale + _FASTEST
    if excess(high) < 0.0:
        raise InputError("speed", speed, "slower: no torque below the greatest stress of the fluid drives it")
    log_rate = brentq(excess, low, high, xtol=1e-14, rtol=1e-15)
    torque = float(_stress(model, np.exp(np.array([log_rate])))[0]) * inner**2
    return CouetteProfile(model, float(inner), float(outer), float(speed), torque)


def _viscosity(model: ViscosityModel, rates: Vector) -> Vector:
    s = rates**2 + model.eps**2
    return np.asarray(model.viscosity(s, np.zeros_like(s)))


def _stress(model: ViscosityModel, rates: Vector) -> Vector:
    return ROOT_TWO * _viscosity(model, rates) * rates


def _log_rates(model: ViscosityModel, stresses: Vector) -> Vector:
    """ln |g| at which the stresses (n,) are reached, by bisection: the stress grows with the rate."""
    low, high = np.full(stresses.shape, -90.0), np.full(stresses.shape, 90.0)
    for _ in range(70):
        middle = 0.5 * (low + high)
        beyond = _stress(model, np.exp(middle)) > stresses
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.asarray(0.5 * (low + high))


def _integrand(model: ViscosityModel, logs: Vector) -> Vector:
    """-d omega / d ln |g| without sign: |g| / sqrt(2) times d ln(tau) / d ln |g| = 1 + 2 |g|^2 eta' / eta."""
    rates = np.exp(logs)
    s = rates**2 + model.eps**2
    slope, _ = model.derivatives(s, np.zeros_like(s))
    return np.asarray(rates / ROOT_TWO * (1.0 + 2.0 * rates**2 * slope / _viscosity(model, rates)))


def _turning(model: ViscosityModel, slowest: float, logs: Vector) -> Vector:
    """Angular velocities (n,) where ln |g| is `logs` (n,), the outer wall, at rest, having `slowest`."""
    fastest = max(float(np.max(logs)), slowest)
    knots = np.linspace(slowest, fastest, max(2, math.ceil((fastest - slowest) / _PANEL) + 1))
    whole = np.concatenate([[0.0], np.cumsum(_panels(model, knots[:-1], knots[1:]))])
    place = np.clip(np.searchsorted(knots, logs, side="right") - 1, 0, len(knots) - 2)
    return np.asarray(whole[place] + _panels(model, knots[place], logs))


def _panels(model: ViscosityModel, start: Vector, end: Vector) -> Vector:
    """Integrals (n,) over the intervals from `start` (n,) to `end` (n,)."""
    half = 0.5 * (end - start)
    points = 0.5 * (start + end)[:, None] + half[:, None] * _NODES
    return np.asarray(half * (_integrand(model, points) @ _WEIGHTS))
