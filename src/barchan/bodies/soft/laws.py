"""Contact laws of soft spheres: linear (Hookean) and Hertzian springs with dashpots (seed C, 3.2.1 and 3.2.2).

A law knows its numbers and, in closed form where there is one, what a head-on collision does: how long it lasts and with what
coefficient of restitution it ends. Overlap is delta, m* = m_i m_j / (m_i + m_j), R* = R_i R_j / (R_i + R_j).

Two slips of the seed, derived afresh: e = exp(-pi gamma_n / sqrt(4 k_n / m* - gamma_n^2)), and the Hertzian normal constant
is 4 E* / 3. Its tangential moduli add as compliances: 1 / G* = (2 - nu_i) / G_i + (2 - nu_j) / G_j.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import gamma as gamma_function

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

HOOKEAN, HERTZIAN = 0, 1
# 2 * integral of dx / sqrt(1 - x^(5/2)) over 0..1: the elastic Hertzian contact lasts this times its depth over the speed.
_HERTZ_TIME = 0.8 * math.sqrt(math.pi) * gamma_function(0.4) / gamma_function(0.9)


@dataclass(frozen=True)
class Hookean:
    """Linear spring and dashpot: f_n = k_n delta + c_n d(delta)/dt, c_n = 2 zeta sqrt(k_n m*) + gamma_n m*.

    stiffness : k_n > 0 [N/m], in the plane per metre of depth.
    damping_ratio : zeta >= 0, the same restitution for all pairs; below 1 unless `attractive` is false.
    damping_rate : gamma_n >= 0 [1/s], the seed's dashpot: its restitution depends on the masses.
    tangential_stiffness : k_t / k_n >= 0 (2/7: normal and tangential oscillations have one period).
    tangential_damping : c_t / c_n >= 0.
    attractive : whether the dashpot may pull at the end of a contact, which then lasts until the overlap is gone (the seed's
        first criterion); else a contact ends for good when its force vanishes (the second one).
    """

    stiffness: float
    damping_ratio: float = 0.0
    damping_rate: float = 0.0
    tangential_stiffness: float = 2.0 / 7.0
    tangential_damping: float = 0.5
    attractive: bool = True

    def __post_init__(self) -> None:
        inputs.positive("contact.stiffness", self.stiffness)
        names = ("damping_ratio", "damping_rate", "tangential_stiffness", "tangential_damping")
        for name in names:
            inputs.not_negative(f"contact.{name}", getattr(self, name))

    @classmethod
    def of_restitution(
        cls,
        stiffness: float,
        restitution: float,
        tangential_stiffness: float = 2.0 / 7.0,
        tangential_damping: float = 0.5,
        attractive: bool = True,
    ) -> Hookean:
        """The law whose head-on collisions have `restitution` in (0, 1], whatever the masses and speeds."""
        e = _restitution(restitution)
        ratio = -math.log(e) / math.hypot(math.pi, math.log(e))
        if not attractive and e < 1.0:
            ratio = float(brentq(lambda z: _linear_restitution(z, False) - e, 0.0, 100.0 / e, xtol=1e-14))
        return cls(stiffness, ratio, 0.0, tangential_stiffness, tangential_damping, attractive)

    def restitution(self, mass: float) -> float:
        """Coefficient of restitution of a head-on collision of effective mass m* [kg]."""
        return _linear_restitution(self._ratio(mass), self.attractive)

    def contact_duration(self, mass: float) -> float:
        """How long a head-on collision of effective mass m* [kg] lasts [s]; infinite for an overdamped attractive one."""
        return _linear_duration(self._ratio(mass), self.attractive) / math.sqrt(self.stiffness / mass)

    def shortest_time(self, mass: float, radius: float, speed: float | None) -> float:
        """Duration of the undamped contact [s], the time a step has to resolve."""
        return math.pi * math.sqrt(mass / self.stiffness)

    def depth(self, mass: float, radius: float, speed: float) -> float:
        """Deepest overlap [m] of an undamped collision at `speed`."""
        return speed * math.sqrt(mass / self.stiffness)

    def _ratio(self, mass: float) -> float:
        mass = inputs.positive("mass", mass)
        return self.damping_ratio + 0.5 * self.damping_rate * math.sqrt(mass / self.stiffness)

    def numbers(self) -> NDArray[np.float64]:
        """What the kernels read: kind, k_n, 2 zeta sqrt(k_n), gamma_n, k_t / k_n, c_t / c_n, attractive."""
        damping = 2.0 * self.damping_ratio * math.sqrt(self.stiffness)
        shares = (self.tangential_stiffness, self.tangential_damping)
        return np.array(
            [HOOKEAN, self.stiffness, damping, self.damping_rate, *shares, float(self.attractive)]
        )


@dataclass(frozen=True)
class Hertzian:
    """Hertz' spring between equal materials: f_n = K delta^(3/2) + c_n d(delta)/dt, K = (4/3) E* sqrt(R*).

    c_n = a sqrt(m* K) delta^(1/4) + gamma_n m* sqrt(R* delta); k_t = 8 G* sqrt(R* delta).

    young_modulus : E > 0 [Pa]. poisson_ratio : nu in (-1, 0.5].
    damping : a >= 0: restitution does not depend on mass or speed; below sqrt(5) unless `attractive` is false.
    damping_rate : gamma_n >= 0 [1/(m s)], the seed's viscoelastic dashpot: faster collisions lose more.
    tangential_damping : c_t / c_n >= 0. attractive : as in `Hookean`.

    In the plane a disc stands for one ball per metre of depth.
    """

    young_modulus: float
    poisson_ratio: float = 0.3
    damping: float = 0.0
    damping_rate: float = 0.0
    tangential_damping: float = 0.5
    attractive: bool = True

    def __post_init__(self) -> None:
        inputs.positive("contact.young_modulus", self.young_modulus)
        if not (np.isfinite(self.poisson_ratio) and -1.0 < self.poisson_ratio <= 0.5):
            raise InputError("contact.poisson_ratio", self.poisson_ratio, "above -1 and at most 0.5")
        for name in ("damping", "damping_rate", "tangential_damping"):
            inputs.not_negative(f"contact.{name}", getattr(self, name))

    @classmethod
    def of_restitution(
        cls,
        young_modulus: float,
        restitution: float,
        poisson_ratio: float = 0.3,
        tangential_damping: float = 0.5,
    ) -> Hertzian:
        """The law whose head-on collisions have `restitution` in (0, 1], whatever the masses and speeds.

        a = -sqrt(5) ln e / sqrt(ln^2 e + pi^2), exact (Antypov and Elliott, EPL 94, 50004, 2011).
        """
        log = math.log(_restitution(restitution))
        damping = -math.sqrt(5.0) * log / math.hypot(log, math.pi)
        return cls(young_modulus, poisson_ratio, damping, 0.0, tangential_damping)

    @property
    def normal_modulus(self) -> float:
        """(4/3) E* [Pa], E* = E / (2 (1 - nu^2))."""
        return 2.0 / 3.0 * self.young_modulus / (1.0 - self.poisson_ratio**2)

    @property
    def tangential_modulus(self) -> float:
        """8 G* [Pa], G* = G / (2 (2 - nu)), G = E / (2 (1 + nu))."""
        return 2.0 * self.young_modulus / ((1.0 + self.poisson_ratio) * (2.0 - self.poisson_ratio))

    def restitution(self) -> float:
        """Coefficient of restitution of `damping` alone; with a `damping_rate` integrate a `collision`."""
        if self.damping_rate > 0.0 or not self.attractive:
            raise InputError("contact", self, "without damping_rate and attractive: else use `collision`")
        ratio = self.damping / math.sqrt(5.0)
        return math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 0.0

    def contact_duration(self, mass: float, radius: float, speed: float) -> float:
        """Duration [s] of the undamped collision at `speed`: 2.943 depth / speed."""
        return _HERTZ_TIME * self.depth(mass, radius, speed) / speed

    def shortest_time(self, mass: float, radius: float, speed: float | None) -> float:
        """As `contact_duration`, at the largest `speed` expected."""
        if speed is None:
            raise InputError("speed", None, "given: a Hertzian contact is shorter, the faster it is")
        return self.contact_duration(mass, radius, inputs.positive("speed", speed))

    def depth(self, mass: float, radius: float, speed: float) -> float:
        """Deepest overlap [m] of an undamped collision at `speed`: (5 m* v^2 / (4 K))^(2/5)."""
        stiffness = self.normal_modulus * math.sqrt(radius)
        return (1.25 * mass * speed**2 / stiffness) ** 0.4

    def numbers(self) -> NDArray[np.float64]:
        """What the kernels read: kind, 4 E* / 3, a sqrt(4 E* / 3), gamma_n, 8 G*, c_t / c_n, attractive."""
        damping = self.damping * math.sqrt(self.normal_modulus)
        rest = (self.damping_rate, self.tangential_modulus, self.tangential_damping, float(self.attractive))
        return np.array([HERTZIAN, self.normal_modulus, damping, *rest])


ContactLaw = Hookean | Hertzian


def _restitution(value: float) -> float:
    if not (np.isfinite(value) and 0.0 < value <= 1.0):
        raise InputError("restitution", value, "above 0 and at most 1")
    return float(value)


def _linear_restitution(ratio: float, attractive: bool) -> float:
    """exp(-eta t_c) (seed C, 3.2.2), eta = `ratio` omega_0; where overdamped, of the force's end."""
    duration = _linear_duration(ratio, attractive)
    return math.exp(-ratio * duration) if math.isfinite(duration) else 0.0


def _linear_duration(ratio: float, attractive: bool) -> float:
    """omega_0 t_c: until the overlap is gone (attractive), or until the force is."""
    if attractive:
        return math.pi / math.sqrt(1.0 - ratio**2) if ratio < 1.0 else math.inf
    if ratio < 1.0:
        omega = math.sqrt(1.0 - ratio**2)
        return (math.pi - math.atan2(2.0 * ratio * omega, omega**2 - ratio**2)) / omega
    omega = math.sqrt(ratio**2 - 1.0)
    # (ratio + omega)^2 = (ratio + omega) / (ratio - omega), without the difference of near equals
    return 2.0 * math.log(ratio + omega) / omega if omega > 1e-7 else 2.0
