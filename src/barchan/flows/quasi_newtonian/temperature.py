"""Viscosity that depends on the temperature: eta(theta) = a(theta) eta (seed C, chapter 7, item 4).

a is the factor of Arrhenius, exp(E / (R theta)), or of Williams, Landel and Ferry, exp(-C1 t / (C2 + t)), t = theta - theta_r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.models.base import Array, ViscosityModel, checked


class TemperatureFactor(Protocol):
    """A function of temperatures, array in and out, that multiplies the viscosity."""

    def __call__(self, temperature: Array) -> Array: ...


@dataclass(frozen=True)
class Arrhenius:
    """a = exp(E / (R theta)), theta in kelvin.

    activation_energy : E >= 0 [J/mol]. gas_constant : R > 0 [J/(mol K)].

    Raises InputError for numbers out of range; called, for temperatures <= 0.
    """

    activation_energy: float
    gas_constant: float = 8.314462618

    def __post_init__(self) -> None:
        checked("activation_energy", self.activation_energy)
        checked("gas_constant", self.gas_constant, positive=True)

    def __call__(self, temperature: Array) -> Array:
        theta = np.asarray(temperature, dtype=np.float64)
        if not np.all(theta > 0.0):
            raise InputError("model.temperature", temperature, "> 0 kelvin")
        return np.exp(self.activation_energy / (self.gas_constant * theta))


@dataclass(frozen=True)
class WilliamsLandelFerry:
    """a = exp(-C1 (theta - theta_r) / (C2 + theta - theta_r)), 1 at the reference theta_r.

    C1 : >= 0 (natural logarithm: 2.303 times the constant tabulated for log10). C2 : > 0 [K]. reference : theta_r, in the
    unit of the temperatures (kelvin or degrees Celsius).

    Raises InputError for numbers out of range; called, for temperatures <= theta_r - C2, where the law ends.
    """

    C1: float
    C2: float
    reference: float

    def __post_init__(self) -> None:
        checked("C1", self.C1)
        checked("C2", self.C2, positive=True)
        checked("reference", self.reference, least=-np.inf)

    def __call__(self, temperature: Array) -> Array:
        above = np.asarray(temperature, dtype=np.float64) - self.reference
        if not np.all(self.C2 + above > 0.0):
            raise InputError(
                "model.temperature", temperature, f"above reference - C2 = {self.reference - self.C2:g}"
            )
        return np.exp(-self.C1 * above / (self.C2 + above))


@dataclass(frozen=True)
class WithTemperature(ViscosityModel):
    """A model whose viscosity, and with it the yield stress, is multiplied by a(theta).

    model : the viscosity at a = 1. factor : `Arrhenius`, `WilliamsLandelFerry` or any positive function of temperatures.
    temperature : theta, a number, or an array of the shape of the points the flow asks at, (C, Q).

    Raises InputError for temperatures or factors that are not finite and positive; called, for arrays of another shape.
    """

    model: ViscosityModel
    factor: TemperatureFactor
    temperature: ArrayLike
    eps: float = field(init=False)
    _scale: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.model, ViscosityModel):
            raise InputError("model.model", self.model, "a viscosity model")
        try:
            theta = np.asarray(self.temperature, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError("model.temperature", self.temperature, "a number or an array") from None
        if not np.all(np.isfinite(theta)):
            raise InputError("model.temperature", self.temperature, "finite")
        with np.errstate(over="ignore"):
            scale = np.asarray(self.factor(theta), dtype=np.float64)
        if scale.shape != theta.shape or not np.all(np.isfinite(scale)) or np.any(scale <= 0.0):
            raise InputError("model.factor", self.factor, "finite and positive at the temperatures given")
        object.__setattr__(self, "_scale", scale)
        object.__setattr__(self, "eps", self.model.eps)

    @property
    def uses_pressure(self) -> bool:
        return self.model.uses_pressure

    @property
    def singular(self) -> bool:
        return self.model.singular

    def viscosity(self, s: Array, p: Array) -> Array:
        return self._at(s) * self.model.viscosity(s, p)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        by_rate, by_pressure = self.model.derivatives(s, p)
        return self._at(s) * by_rate, self._at(s) * by_pressure

    def yield_stress(self, p: Array) -> Array | None:
        bare = self.model.yield_stress(p)
        return None if bare is None else self._at(p) * bare

    def with_eps(self, eps: float) -> WithTemperature:
        return replace(self, model=self.model.with_eps(eps))

    def at_other_points(self, transfer: Callable[[Array], Array]) -> WithTemperature:
        inner = self.model.at_other_points(transfer)
        if self._scale.ndim == 0:
            return replace(self, model=inner)
        return replace(self, model=inner, temperature=transfer(np.asarray(self.temperature, dtype=float)))

    def _at(self, values: Array) -> Array:
        if self._scale.ndim and self._scale.shape != np.shape(values):
            raise InputError(
                "model.temperature",
                f"array of shape {self._scale.shape}",
                f"a number or of shape {np.shape(values)}",
            )
        return self._scale
