"""Numerical choices of the steps of a cloth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from barchan.errors import InputError
from barchan.friction import methods

RULES = ("geometric", "mean", "min", "max")


@dataclass(frozen=True)
class ClothOptions:
    """How a step is made.

    tolerance : certificate aimed at.  method : of `barchan.friction`; "auto" takes the nodal algorithm where it applies.
    max_sweeps : most iterations of the solver, None for its own limit.
    iterations : linearisations in a step (seed B, 2.16), each a friction problem; 1 is the linearised implicit step.
    recovery : share of an overlap that is pushed out in a step, 0 to 1.
    margin : [m] gap up to which contacts are looked for beyond what vertices may cross in a step.
    self_contact : whether the cloth touches itself.
    mixing : friction of cloth and body from the coefficients of both.

    Raises InputError for a value out of range.
    """

    tolerance: float = 1e-6
    method: str = "auto"
    max_sweeps: int | None = None
    iterations: int = 1
    recovery: float = 0.5
    margin: float = 0.0
    self_contact: bool = False
    mixing: Literal["geometric", "mean", "min", "max"] = "geometric"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.tolerance) and self.tolerance > 0.0):
            raise InputError("options.tolerance", self.tolerance, "a finite number > 0")
        for name in ("max_sweeps", "iterations"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
                raise InputError(f"options.{name}", value, "a whole number >= 1")
        if not 0.0 <= self.recovery <= 1.0:
            raise InputError("options.recovery", self.recovery, "a number from 0 to 1")
        if not (math.isfinite(self.margin) and self.margin >= 0.0):
            raise InputError("options.margin", self.margin, "a finite number >= 0")
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
        if self.mixing not in RULES:
            raise InputError("options.mixing", self.mixing, "one of " + ", ".join(RULES))
