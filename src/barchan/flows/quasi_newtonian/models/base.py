"""What every viscosity model offers to the flow: viscosity, derivatives, yield stress, regularisation (seed C, 3.4).

The regularised square of the shear rate, s = |g|^2 + eps^2, is formed by the flow; models take s as it is.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

Array: TypeAlias = NDArray[np.float64]

HALF_ROOT_TWO = math.sqrt(0.5)
"""sqrt(2)/2 of Eq. 3.5-3.8: with sigma = 2 eta g it makes |sigma| = sqrt(sigma:sigma) equal sqrt(2) times the shear stress."""


class ViscosityModel(ABC):
    """A viscosity eta(s, p) of the regularised square s = |g|^2 + eps^2 of the shear rate and of the pressure p.

    Models are frozen dataclasses; lengths, masses and times are in any one system of units (SI: Pa s, Pa, 1/s).

    Attributes
    ----------
    eps : regularisation of the shear rate [1/s], >= 0, and > 0 when the model is singular.
    """

    eps: float

    @property
    def uses_pressure(self) -> bool:
        """Whether the viscosity depends on the pressure."""
        return False

    @property
    def singular(self) -> bool:
        """Whether the viscosity is unbounded as s -> 0: then eps must be > 0."""
        return False

    @abstractmethod
    def viscosity(self, s: Array, p: Array) -> Array:
        """Viscosities [stress time] at s > 0 [1/time^2] and pressures p, arrays of one shape."""

    @abstractmethod
    def derivatives(self, s: Array, p: Array) -> tuple[Array, Array]:
        """(d eta / d s, d eta / d p) at s and p, arrays of one shape.

        Where s = 0 (only without regularisation) the first is 0: the flow multiplies it by g g, which vanishes faster.
        """

    def yield_stress(self, p: Array) -> Array | None:
        """Shear stress tau_y at which the matter starts to flow under the pressures p: |sigma| = sqrt(2) tau_y there.

        None when the model has no yield stress.
        """
        return None

    def with_eps(self, eps: float) -> ViscosityModel:
        """The same model under another regularisation; InputError when it does not allow it."""
        changes: dict[str, Any] = {"eps": eps}
        return replace(self, **changes)  # type: ignore[type-var]

    def at_other_points(self, transfer: Callable[[Array], Array]) -> ViscosityModel:
        """The model for other points than those its own fields are given at; `transfer` carries such a field over."""
        return self

    def _check_eps(self) -> None:
        checked("eps", self.eps)
        if self.singular and self.eps <= 0.0:
            raise InputError(
                "model.eps",
                self.eps,
                f"> 0: the viscosity of {type(self).__name__} is unbounded where nothing shears",
            )


def checked(
    field: str, value: Any, least: float = 0.0, most: float = math.inf, *, positive: bool = False
) -> float:
    """`value` as a number in [least, most], or in the open interval when `positive`; InputError naming `model.field`."""
    bounds = ("> " if positive else ">= ") + f"{least:g}"
    if most < math.inf:
        bounds += (" and < " if positive else " and <= ") + f"{most:g}"
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"model.{field}", value, f"a number {bounds}") from None
    if positive:
        allowed = math.isfinite(number) and least < number < most
    else:
        allowed = math.isfinite(number) and least <= number <= most
    if not allowed:
        raise InputError(f"model.{field}", value, f"a finite number {bounds}")
    return number


def power(s: Array, exponent: float) -> Array:
    """s ** exponent, and 0 where s = 0 (no matter the exponent)."""
    s = np.asarray(s, dtype=np.float64)
    return np.power(s, exponent, out=np.zeros_like(s), where=s > 0.0)
