"""Granular matter as a fluid whose viscosity depends on shear rate and pressure: Schaeffer, Tardos, Poliquen.

Seed C, Eq. 3.6-3.8 and 6.15. Pressures below 0 have no meaning here (8.2): the flow refuses a negative mean pressure, and
single points below 0 on the way to the solution are taken as 0, with derivative 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barchan.flows.quasi_newtonian.models.base import HALF_ROOT_TWO, Array, ViscosityModel, checked, power


def _clipped(p: Array) -> tuple[Array, Array]:
    """Pressures cut off at 0, and 1 where they are positive, else 0: the derivative of the cut."""
    p = np.asarray(p, dtype=np.float64)
    return np.maximum(p, 0.0), np.asarray(p > 0.0, dtype=np.float64)


class _Frictional(ViscosityModel):
    """A friction of rough grains, proportional to the pressure and independent of slow rates."""

    angle: float

    @property
    def uses_pressure(self) -> bool:
        return True

    @property
    def singular(self) -> bool:
        return True

    def yield_stress(self, p: Array) -> Array | None:
        return math.sin(math.radians(self.angle)) * _clipped(p)[0]


@dataclass(frozen=True)
class Tardos(_Frictional):
    """eta = (sqrt(2)/2) p (sin(phi) s^(-1/2) + b cos(phi) s^((n-1)/2)) (seed C, Eq. 3.7).

    A Coulomb friction that grows with the shear rate, from quasi-static to intermediate flow.

    angle : of internal friction, phi in (0, 90) degrees. b : >= 0 [time^n], cohesion per pressure and rate^n. n : > 0.
    eps [1/time] > 0. p is taken as 0 where it is negative.

    Raises InputError for numbers out of range.
    """

    angle: float
    b: float
    n: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("angle", self.angle, 0.0, 90.0, positive=True)
        checked("b", self.b)
        checked("n", self.n, positive=True)
        self._check_eps()

    def _parts(self) -> tuple[float, float]:
        phi = math.radians(self.angle)
        return HALF_ROOT_TWO * math.sin(phi), HALF_ROOT_TWO * self.b * math.cos(phi)

    def _per_pressure(self, s: Array) -> Array:
        plastic, viscous = self._parts()
        return plastic * power(s, -0.5) + viscous * power(s, 0.5 * (self.n - 1.0))

    def viscosity(self, s: Array, p: Array) -> Array:
        return _clipped(p)[0] * self._per_pressure(s)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        plastic, viscous = self._parts()
        pressure, pressed = _clipped(p)
        slope = 0.5 * (self.n - 1.0)
        by_rate = -0.5 * plastic * power(s, -1.5) + viscous * slope * power(s, slope - 1.0)
        return pressure * by_rate, pressed * self._per_pressure(s)


@dataclass(frozen=True)
class Schaeffer(_Frictional):
    """eta = (sqrt(2)/2) p sin(phi) s^(-1/2): Coulomb friction whatever the shear rate (seed C, Eq. 3.6).

    angle : of internal friction, phi in (0, 90) degrees. eps [1/time] > 0. p is taken as 0 where it is negative.

    Raises InputError for numbers out of range.
    """

    angle: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("angle", self.angle, 0.0, 90.0, positive=True)
        self._check_eps()

    def viscosity(self, s: Array, p: Array) -> Array:
        return Tardos(self.angle, 0.0, 1.0, self.eps).viscosity(s, p)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        return Tardos(self.angle, 0.0, 1.0, self.eps).derivatives(s, p)


def _inertial(rate: Array, diameter: float, scale: Array | float) -> Array:
    """1 / (rate + scale / diameter), written so that no grain diameter is divided by, and 0 where both vanish."""
    total = rate * diameter + scale
    return np.divide(diameter, total, out=np.zeros_like(total), where=total > 0.0)


@dataclass(frozen=True)
class Poliquen(ViscosityModel):
    """eta = (sqrt(2)/2) (alpha p / |g| + beta d p / (delta sqrt(p / rho) + |g| d)): the mu(I) rheology (seed C, Eq. 3.8).

    The friction coefficient is mu(I) = alpha + beta I / (delta + I), I = |g| d / sqrt(p / rho), |g| = sqrt(s).

    alpha : >= 0, friction of slow flow (mu_s). beta : >= 0, its growth to fast flow (mu_2 - mu_s); not both 0.
    delta : > 0, the inertial number (I_0) at half the growth. grain_diameter : d > 0 [length]. density : rho > 0.
    eps [1/time] > 0 unless alpha = 0. p is taken as 0 where it is negative.

    Raises InputError for numbers out of range.
    """

    alpha: float
    beta: float
    delta: float
    grain_diameter: float
    density: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        _check_friction(self.alpha, self.beta, self.delta, self.grain_diameter, self.density)
        self._check_eps()

    @property
    def uses_pressure(self) -> bool:
        return True

    @property
    def singular(self) -> bool:
        return self.alpha > 0.0

    def viscosity(self, s: Array, p: Array) -> Array:
        pressure, _ = _clipped(p)
        share = _inertial(np.sqrt(s), self.grain_diameter, self.delta * np.sqrt(pressure / self.density))
        return HALF_ROOT_TWO * pressure * (self.alpha * power(s, -0.5) + self.beta * share)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        pressure, pressed = _clipped(p)
        rate, scale = np.sqrt(s), self.delta * np.sqrt(pressure / self.density)
        share = _inertial(rate, self.grain_diameter, scale)
        inverse = power(s, -0.5)
        by_rate = -self.alpha * inverse**3 - self.beta * share**2 * inverse
        # d/dp of p / (|g| d + scale), scale ~ sqrt(p): (|g| d + scale / 2) / (|g| d + scale)^2.
        half = rate + 0.5 * scale / self.grain_diameter
        by_pressure = self.alpha * inverse + self.beta * share**2 * half
        return 0.5 * HALF_ROOT_TWO * pressure * by_rate, HALF_ROOT_TWO * pressed * by_pressure

    def yield_stress(self, p: Array) -> Array | None:
        return self.alpha * _clipped(p)[0]


@dataclass(frozen=True)
class ModifiedPoliquen(ViscosityModel):
    """The Poliquen viscosity under one constant pressure P, eta = (sqrt(2)/2) tau_0 (alpha / |g| + ...) P (seed C, Eq. 6.15).

    |sigma| grows with |g| towards sqrt(2) tau_0 (alpha + beta) P: a greater stress has no solution (ERRATA 11).

    alpha, beta, delta, grain_diameter, density : as in `Poliquen`. pressure : P > 0.
    factor : tau_0 > 0, the seed's sqrt(2), which makes (sqrt(2)/2) tau_0 equal 1; 1 gives `Poliquen` at p = P.
    eps [1/time] > 0 unless alpha = 0.

    Raises InputError for numbers out of range.
    """

    alpha: float
    beta: float
    delta: float
    grain_diameter: float
    density: float
    pressure: float
    factor: float = math.sqrt(2.0)
    eps: float = 0.0

    def __post_init__(self) -> None:
        _check_friction(self.alpha, self.beta, self.delta, self.grain_diameter, self.density)
        checked("pressure", self.pressure, positive=True)
        checked("factor", self.factor, positive=True)
        self._check_eps()

    @property
    def singular(self) -> bool:
        return self.alpha > 0.0

    def viscosity(self, s: Array, p: Array) -> Array:
        constant, share = self._shares(s)
        return constant * (self.alpha * power(s, -0.5) + self.beta * share)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        constant, share = self._shares(s)
        inverse = power(s, -0.5)
        by_rate = -0.5 * constant * (self.alpha * inverse**3 + self.beta * share**2 * inverse)
        return by_rate, np.zeros(np.shape(s))

    def yield_stress(self, p: Array) -> Array | None:
        return np.full(np.shape(p), float(self.factor * self.alpha * self.pressure))

    def _shares(self, s: Array) -> tuple[float, Array]:
        scale = self.delta * math.sqrt(self.pressure / self.density)
        share = _inertial(np.sqrt(s), self.grain_diameter, scale)
        return HALF_ROOT_TWO * self.factor * self.pressure, share


def _check_friction(alpha: float, beta: float, delta: float, grain_diameter: float, density: float) -> None:
    checked("alpha", alpha)
    checked("beta", beta, positive=float(alpha) == 0.0)
    checked("delta", delta, positive=True)
    checked("grain_diameter", grain_diameter, positive=True)
    checked("density", density, positive=True)
