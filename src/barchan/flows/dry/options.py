"""Numerical options of the mesh-based model, documented one by one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral
from typing import Literal

from barchan.errors import InputError
from barchan.friction import methods

INERTIA = ("explicit", "conservative")


@dataclass(frozen=True)
class Options:
    """How a step is solved; nothing here changes the physical model.

    Parameters
    ----------
    tolerance : certificate that the friction problem of each step must reach, stresses being compared with the mean overburden.
    max_sweeps : bound on the work of the solver in a step; an unconverged step is accepted as it is, and recorded so.
    min_sweeps : sweeps made even when the stresses of the last step already meet the tolerance.
    method : any name of `barchan.friction.methods()`.
    inertia : "explicit" carries velocities by the explicit upwind form of the seed, weighted by the volume fraction;
        "conservative" carries momentum implicitly, like the volume fraction (see `transport`).
    empty : cells with at most this volume fraction are left out of the momentum balance.
    viscous_tolerance : relative residual of the conjugate gradients of the viscous step (seed B, Eq. 7.22).

    Raises
    ------
    InputError : for a value out of range.
    """

    tolerance: float = 1e-4
    max_sweeps: int = 10_000
    min_sweeps: int = 5
    method: str = "auto"
    inertia: Literal["explicit", "conservative"] = "explicit"
    empty: float = 1e-12
    viscous_tolerance: float = 1e-10

    def __post_init__(self) -> None:
        for name in ("tolerance", "empty", "viscous_tolerance"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value) or not 0.0 < value < 1.0:
                raise InputError(f"options.{name}", value, "a number between 0 and 1")
        for name, least in (("max_sweeps", 1), ("min_sweeps", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
                raise InputError(f"options.{name}", value, f"a whole number >= {least}")
        if self.inertia not in INERTIA:
            raise InputError("options.inertia", self.inertia, "one of " + ", ".join(INERTIA))
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
