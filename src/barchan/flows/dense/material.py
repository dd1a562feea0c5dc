"""What flows: Drucker-Prager parameters, viscosity and density, uniform or varying in space (seed A, 3; seed B, 6.1).

Coefficients given by people are physical (mu_hat); cone coordinates need sqrt(2/d) mu_hat (ERRATA 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from barchan.cones import DruckerPrager
from barchan.errors import InputError
from barchan.spaces.mixed import sampled

Parameter: TypeAlias = "float | Callable[[np.ndarray], np.ndarray]"


def _number(field: str, value: Any, allowed: str, positive: bool = False) -> None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if not math.isfinite(number) or number < 0.0 or (positive and number == 0.0):
        raise InputError(field, value, allowed)


@dataclass(frozen=True)
class MuI:
    """Friction that grows with the inertial number I = |D_T| d_g / sqrt(p / rho) (seed B, 0.3.3).

    mu_hat(I) = mu_static + (mu_dynamic - mu_static) I / (reference + I), physical coefficients; |D_T| = sqrt(J2(D)) is half
    of du/dy in simple shear (a source that puts du/dy into I has half this `reference`, or twice this `grain_diameter`).
    grain_diameter in the unit of length of the flow.

    Raises InputError unless 0 <= mu_static <= mu_dynamic, reference > 0 and grain_diameter >= 0.
    """

    mu_static: float
    mu_dynamic: float
    reference: float = 0.4
    grain_diameter: float = 0.0

    def __post_init__(self) -> None:
        _number("mu.mu_static", self.mu_static, "a finite number >= 0")
        _number("mu.reference", self.reference, "a finite number > 0", positive=True)
        _number("mu.grain_diameter", self.grain_diameter, "a finite number >= 0")
        _number("mu.mu_dynamic", self.mu_dynamic, "a finite number >= mu_static")
        if self.mu_dynamic < self.mu_static:
            raise InputError("mu.mu_dynamic", self.mu_dynamic, f"at least mu_static = {self.mu_static}")

    def at(self, shear_rate: np.ndarray, pressure: np.ndarray, density: np.ndarray) -> np.ndarray:
        """(n,) physical coefficients; where the pressure vanishes I is infinite under shear, and 0 without it."""
        speed = np.asarray(shear_rate) * self.grain_diameter
        # I / (I_0 + I), multiplied out by sqrt(p / rho): p -> 0 needs no division by zero.
        total = speed + self.reference * np.sqrt(np.maximum(pressure, 0.0) / density)
        share = np.divide(speed, total, out=np.zeros_like(total), where=total > 0.0)
        return self.mu_static + (self.mu_dynamic - self.mu_static) * share


@dataclass(frozen=True)
class RateViscosity:
    """Viscosity that depends on the shear rate, eta = function(|D(u)|), found by a fixed point.

    function : (n,) shear rates |D| = sqrt(D:D / 2) (half of du/dy in simple shear) -> (n,) viscosities.
    smallest, largest : bounds that keep the discrete problem well posed where the function vanishes or blows up.
    reference_rate : shear rate at which the fixed point starts.

    Raises InputError unless 0 < smallest < largest and reference_rate > 0.
    """

    function: Callable[[np.ndarray], np.ndarray]
    smallest: float = 1e-8
    largest: float = 1e8
    reference_rate: float = 1.0

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InputError("viscosity.function", self.function, "a callable of the shear rates (n,)")
        for name in ("smallest", "largest", "reference_rate"):
            _number(f"viscosity.{name}", getattr(self, name), "a finite number > 0", positive=True)
        if self.smallest >= self.largest:
            raise InputError("viscosity.smallest", self.smallest, f"below largest = {self.largest}")

    def at(self, shear_rate: np.ndarray) -> np.ndarray:
        """(n,) viscosities within the bounds; InputError when the function gives NaN or another shape."""
        value = np.asarray(self.function(np.asarray(shear_rate)), dtype=float)
        if value.shape != np.shape(shear_rate) or np.isnan(value).any():
            raise InputError(
                "viscosity.function", f"array of shape {value.shape}", "one number per shear rate"
            )
        return np.clip(value, self.smallest, self.largest)


@dataclass(frozen=True)
class Material:
    """Viscoplastic matter: sigma = 2 eta (Dev D + (bulk / d) tr D 1) - lambda, lambda under the law of Drucker and Prager.

    Every parameter but `bulk` is a number or a callable x (n, d) -> (n,).

    Parameters
    ----------
    mu : physical friction coefficient mu_hat >= 0 (2D: sine of the Mohr-Coulomb angle), or a `MuI`.
    bingham : shear stress sigma_S >= 0 sustained without pressure, measured as sqrt(J2) (simple shear: |tau_xy|).
    tensile_yield : cohesion c >= 0: the mean tension sustained; the pressure may fall to -c.
    dilatancy : zeta, physical like mu, 0 <= zeta <= mu; 0 keeps the volume in shear.
    viscosity : eta, or a `RateViscosity`; 1 / Re when dimensionless. Creeping flow needs eta > 0.
    bulk : b >= 0, weight of the volumetric part of the viscous stress (seed A writes D^b).
    density : rho, 1 when dimensionless.

    Raises InputError for numbers out of range; fields are checked where they are sampled.
    """

    mu: Parameter | MuI = 0.0
    bingham: Parameter = 0.0
    tensile_yield: Parameter = 0.0
    dilatancy: Parameter = 0.0
    viscosity: Parameter | RateViscosity = 1.0
    bulk: float = 1.0
    density: Parameter = 1.0

    def __post_init__(self) -> None:
        for name in ("mu", "bingham", "tensile_yield", "dilatancy", "viscosity", "density", "bulk"):
            value = getattr(self, name)
            if not callable(value) and not isinstance(value, (MuI, RateViscosity)):
                _number(f"material.{name}", value, "a finite number >= 0")
        if callable(self.bulk):
            raise InputError("material.bulk", self.bulk, "a finite number >= 0")
        smallest = self.mu.mu_static if isinstance(self.mu, MuI) else self.mu
        if not callable(smallest) and not callable(self.dilatancy) and self.dilatancy > smallest:
            raise InputError(
                "material.dilatancy", self.dilatancy, f"at most the friction coefficient {smallest}"
            )

    @classmethod
    def dimensionless(cls, reynolds: float, bingham: float = 0.0, **others: Any) -> Material:
        """Material in units of L, sqrt(g L) and rho g L: viscosity 1 / Re, bingham = Bi, density 1 (seed A, 4.1).

        Raises InputError unless Re > 0 (may be infinite) and Bi >= 0.
        """
        if not isinstance(reynolds, (int, float)) or math.isnan(reynolds) or reynolds <= 0.0:
            raise InputError("reynolds", reynolds, "a number > 0")
        return cls(viscosity=1.0 / reynolds, bingham=bingham, **others)

    @property
    def nonlinear(self) -> bool:
        """Whether friction or viscosity depend on the flow."""
        return isinstance(self.mu, MuI) or isinstance(self.viscosity, RateViscosity)

    def sampled(self, name: str, points: np.ndarray) -> np.ndarray:
        """(n,) values of a parameter at points (n, d), checked to be >= 0."""
        values = sampled(getattr(self, name), points, f"material.{name}")
        if len(values) and values.min() < 0.0:
            raise InputError(f"material.{name}", f"field with values down to {values.min():g}", ">= 0")
        return values

    def law_at(
        self, points: np.ndarray, shear_rate: np.ndarray | None = None, pressure: np.ndarray | None = None
    ) -> DruckerPrager:
        """Law of the points (n, d) in cone coordinates; mu(I) takes the flow's (n,) shear rates and pressures, or rest."""
        count, d = points.shape
        scale = math.sqrt(2.0 / d)
        if isinstance(self.mu, MuI):
            density = np.maximum(self.sampled("density", points), np.finfo(float).tiny)
            rest = np.zeros(count)
            mu = self.mu.at(
                rest if shear_rate is None else shear_rate, rest if pressure is None else pressure, density
            )
        else:
            mu = self.sampled("mu", points)
        dilatancy = self.sampled("dilatancy", points)
        if (dilatancy > mu).any():
            raise InputError(
                "material.dilatancy", f"field up to {dilatancy.max():g}", "at most mu everywhere"
            )
        return DruckerPrager(
            scale * mu,
            self.sampled("bingham", points),
            self.sampled("tensile_yield", points) / scale,
            scale * dilatancy,
        )
