"""Viscosities given by a user, and the check of any model's derivatives against differences (seed C, 3.4).

A user writes eta(s) and d eta / d s, or eta(s, p) and both derivatives; nothing else of the flow changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.models.base import Array, ViscosityModel

RATES = np.geomspace(1e-3, 1e3, 25)
PRESSURES = np.geomspace(1e-2, 1e4, 13)


@dataclass(frozen=True)
class UserModel(ViscosityModel):
    """A viscosity from one function and one derivative, s = |g|^2 + eps^2, arrays of any shape in and out.

    function : eta(s), or eta(s, p) when `uses_pressure`.
    derivative : d eta / d s of s, or (d eta / d s, d eta / d p) of (s, p).
    eps : regularisation [1/time]; > 0 when the function is not finite at s = 0.
    uses_pressure : whether the functions take the pressure too; they must then make sense of p <= 0 themselves.
    yield_function : tau_y(p), or None for a fluid without yield stress.

        carreau = UserModel(lambda s: (1 + s) ** -0.2, lambda s: -0.2 * (1 + s) ** -1.2)
        largest_error = max(check_derivatives(carreau))

    Raises InputError for what is not callable, for eps out of range, and for results of another shape or not finite.
    """

    function: Callable[..., Any]
    derivative: Callable[..., Any]
    eps: float = 0.0
    uses_pressure: bool = False
    yield_function: Callable[[Array], Any] | None = None

    def __post_init__(self) -> None:
        for name in ("function", "derivative", "yield_function"):
            given = getattr(self, name)
            if not callable(given) and not (name == "yield_function" and given is None):
                raise InputError(f"model.{name}", given, "callable")
        self._check_eps()

    @property
    def singular(self) -> bool:
        with np.errstate(all="ignore"):
            return not bool(np.all(np.isfinite(self._call(self.function, np.zeros(1), np.ones(1)))))

    def viscosity(self, s: Array, p: Array) -> Array:
        return _shaped("function", self._call(self.function, s, p), s)

    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        result = self._call(self.derivative, s, p)
        if not self.uses_pressure:
            return _shaped("derivative", result, s), np.zeros(np.shape(s))
        if not isinstance(result, tuple) or len(result) != 2:
            raise InputError(
                "model.derivative", type(result).__name__, "a function giving (d eta/d s, d eta/d p)"
            )
        return _shaped("derivative", result[0], s), _shaped("derivative", result[1], s)

    def yield_stress(self, p: Array) -> Array | None:
        if self.yield_function is None:
            return None
        return _shaped("yield_function", self.yield_function(p), p)

    def _call(self, function: Callable[..., Any], s: Array, p: Array) -> Any:
        return function(s, p) if self.uses_pressure else function(s)


def _shaped(field: str, result: Any, like: Array) -> Array:
    values = np.asarray(result, dtype=np.float64)
    if values.shape == ():
        values = np.full(np.shape(like), float(values))
    if values.shape != np.shape(like):
        raise InputError(f"model.{field}", f"result of shape {values.shape}", f"of shape {np.shape(like)}")
    if not np.all(np.isfinite(values)):
        raise InputError(f"model.{field}", "result that is not finite", "finite wherever the flow needs it")
    return values


def check_derivatives(
    model: ViscosityModel, rates: ArrayLike = RATES, pressures: ArrayLike = PRESSURES, step: float = 1e-3
) -> tuple[float, float]:
    """Largest errors of d eta / d s and d eta / d p against central differences of fourth order.

    Parameters
    ----------
    model : its `eps` is added as the flow does, s = rate^2 + eps^2.
    rates, pressures : (n,) shear rates [1/time] and (m,) pressures; every pair is checked.
    step : of the differences, relative to s and to p.

    Returns errors relative to |derivative| + eta / s (eta / p), which is what they weigh in the Jacobian. A sound model
    gives less than 1e-9. Raises InputError for rates or pressures that are not positive.
    """
    rate, pressure = np.asarray(rates, dtype=np.float64), np.asarray(pressures, dtype=np.float64)
    for field, values in (("rates", rate), ("pressures", pressure)):
        if values.size == 0 or not np.all(np.isfinite(values)) or np.min(values) <= 0.0:
            raise InputError(field, values, "finite and positive")
    squares, p = np.meshgrid(rate.ravel() ** 2 + model.eps**2, pressure.ravel(), indexing="ij")
    by_rate, by_pressure = model.derivatives(squares, p)
    eta = np.abs(model.viscosity(squares, p))

    def error(given: Array, variable: Array, value: Callable[[float], Array]) -> float:
        one, two = (value(1.0 + k * step) - value(1.0 - k * step) for k in (1, 2))
        measured = (8.0 * one - two) / (12.0 * step * variable)
        scale = np.abs(given) + eta / variable
        return float(np.max(np.abs(measured - given) / np.where(scale > 0.0, scale, 1.0)))

    return (
        error(by_rate, squares, lambda factor: model.viscosity(factor * squares, p)),
        error(by_pressure, p, lambda factor: model.viscosity(squares, factor * p)),
    )
