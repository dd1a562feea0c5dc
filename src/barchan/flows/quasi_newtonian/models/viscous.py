"""Fluids whose viscosity depends on the shear rate alone: Newtonian, power law, Bingham, Herschel-Bulkley.

Seed C, Eq. 3.3-3.5 (5.2 for the cylinder, where eps itself is added to |g|^2: there `eps` is its square root).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.flows.quasi_newtonian.models.base import HALF_ROOT_TWO, Array, ViscosityModel, checked, power


@dataclass(frozen=True)
class Newtonian(ViscosityModel):
    """eta = eta_0 (seed C, Eq. 3.3).

    dynamic_viscosity : eta_0 > 0 [stress time]. eps changes nothing.

    Raises InputError for numbers out of range.
    """

    dynamic_viscosity: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("dynamic_viscosity", self.dynamic_viscosity, positive=True)
        self._check_eps()

    def viscosity(self, s: Array, p: Array) -> Array:
        return np.full(np.shape(s), float(self.dynamic_viscosity))

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        return np.zeros(np.shape(s)), np.zeros(np.shape(s))


@dataclass(frozen=True)
class PowerLaw(ViscosityModel):
    """eta = K s^(m/2 - 1): thinning for m < 2, Newtonian for m = 2, thickening for m > 2 (seed C, Eq. 3.4).

    consistency : K > 0 [stress time^(m - 1)]. exponent : m >= 1 (below, the stress would
    fall with the shear rate). eps [1/time] > 0 when m < 2.

    Raises InputError for numbers out of range.
    """

    consistency: float
    exponent: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("consistency", self.consistency, positive=True)
        checked("exponent", self.exponent, least=1.0)
        self._check_eps()

    @property
    def singular(self) -> bool:
        return self.exponent < 2.0

    def viscosity(self, s: Array, p: Array) -> Array:
        if self.exponent == 2.0:
            return np.full(np.shape(s), float(self.consistency))
        return self.consistency * power(s, 0.5 * self.exponent - 1.0)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        slope = 0.5 * self.exponent - 1.0
        return self.consistency * slope * power(s, slope - 1.0), np.zeros(np.shape(s))


@dataclass(frozen=True)
class HerschelBulkley(ViscosityModel):
    """eta = K s^(m/2 - 1) + (sqrt(2)/2) tau_y s^(-1/2): a power law beyond a yield stress.

    consistency : K > 0 [stress time^(m - 1)]. exponent : m >= 1; m = 2 is Bingham.
    yield_point : tau_y >= 0 [stress]. eps [1/time] > 0 unless tau_y = 0 and m >= 2.

    Raises InputError for numbers out of range.
    """

    consistency: float
    exponent: float
    yield_point: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("consistency", self.consistency, positive=True)
        checked("exponent", self.exponent, least=1.0)
        checked("yield_point", self.yield_point)
        self._check_eps()

    @property
    def singular(self) -> bool:
        return self.exponent < 2.0 or self.yield_point > 0.0

    def viscosity(self, s: Array, p: Array) -> Array:
        viscous = PowerLaw(self.consistency, self.exponent, self.eps).viscosity(s, p)
        return viscous + HALF_ROOT_TWO * self.yield_point * power(s, -0.5)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        viscous, by_pressure = PowerLaw(self.consistency, self.exponent, self.eps).derivatives(s, p)
        return viscous - 0.5 * HALF_ROOT_TWO * self.yield_point * power(s, -1.5), by_pressure

    def yield_stress(self, p: Array) -> Array | None:
        return np.full(np.shape(p), float(self.yield_point))


@dataclass(frozen=True)
class Bingham(ViscosityModel):
    """eta = eta_0 + (sqrt(2)/2) tau_y s^(-1/2) (seed C, Eq. 3.5).

    plastic_viscosity : eta_0 > 0 [stress time]. yield_point : tau_y >= 0 [stress]. eps [1/time] > 0 unless tau_y = 0.

    Raises InputError for numbers out of range.
    """

    plastic_viscosity: float
    yield_point: float
    eps: float = 0.0

    def __post_init__(self) -> None:
        checked("plastic_viscosity", self.plastic_viscosity, positive=True)
        checked("yield_point", self.yield_point)
        self._check_eps()

    @property
    def singular(self) -> bool:
        return self.yield_point > 0.0

    def viscosity(self, s: Array, p: Array) -> Array:
        return self.plastic_viscosity + HALF_ROOT_TWO * self.yield_point * power(s, -0.5)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        return -0.5 * HALF_ROOT_TWO * self.yield_point * power(s, -1.5), np.zeros(np.shape(s))

    def yield_stress(self, p: Array) -> Array | None:
        return np.full(np.shape(p), float(self.yield_point))
