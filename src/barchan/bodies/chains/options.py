"""Numerical choices of the implicit step of a chain."""

from __future__ import annotations

import math
from dataclasses import dataclass

from barchan.errors import InputError
from barchan.friction import methods


@dataclass(frozen=True)
class ChainOptions:
    """How a step is made.

    iterations : most linearisations of a step: 1 is the linearised step (seed B, 2.16), more repeat it towards (2.15).
    settled : change of the velocities, relative, at which the repetition ends.
    tolerance, method, max_sweeps : certificate aimed at, friction solver and its iterations (`barchan.friction`).
    recovery : share of an overlap with an obstacle that is pushed out in a step, 0 to 1.

    Raises InputError for a value out of range.
    """

    iterations: int = 1
    settled: float = 1e-10
    tolerance: float = 1e-6
    method: str = "auto"
    max_sweeps: int = 10_000
    recovery: float = 0.2

    def __post_init__(self) -> None:
        for name in ("iterations", "max_sweeps"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(f"options.{name}", value, "a whole number >= 1")
        for name in ("settled", "tolerance"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0.0:
                raise InputError(f"options.{name}", value, "a finite number > 0")
        if not isinstance(self.recovery, (int, float)) or not 0.0 <= self.recovery <= 1.0:
            raise InputError("options.recovery", self.recovery, "a number from 0 to 1")
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
