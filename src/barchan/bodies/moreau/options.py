"""Numerical and mechanical choices of the Moreau-Jean step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from barchan.errors import InputError
from barchan.friction import methods

RULES = ("geometric", "mean", "min", "max")


@dataclass(frozen=True)
class Options:
    """How a step is made.

    tolerance : certificate aimed at.  max_sweeps, min_sweeps, method : of the friction solver (`barchan.friction`).
    theta : share of the end velocity in the move of the bodies, 1/2 to 1 (seed B, 2.2.2: below 1 impacts may rebound).
    restitution, tangential_restitution : Newton's coefficients, 0 to 1: u_N^+ >= -e u_N^-, u_T^+ + e_T u_T^- against friction.
    rest_speed : approaches slower than this [m/s] do not rebound.
    mixing : friction of a pair of bodies from their own coefficients.  pairs : coefficients of pairs by names, before `mixing`.
    recovery : share of an overlap that is pushed out in a step, 0 to 1.
    margin : contacts are looked for up to this gap [m] beyond what bodies may cross in a step.
    joint_recovery : share of a joint's error that is taken back in a step.

    Raises InputError for a value out of range.
    """

    tolerance: float = 1e-6
    max_sweeps: int = 10_000
    min_sweeps: int = 0
    method: str = "auto"
    theta: float = 1.0
    restitution: float = 0.0
    tangential_restitution: float = 0.0
    rest_speed: float = 0.0
    mixing: Literal["geometric", "mean", "min", "max"] = "geometric"
    pairs: Mapping[tuple[str, str], float] = field(default_factory=dict)
    recovery: float = 0.2
    margin: float = 0.0
    joint_recovery: float = 0.5

    def __post_init__(self) -> None:
        ranges = {
            "theta": (0.5, 1.0), "restitution": (0.0, 1.0), "tangential_restitution": (0.0, 1.0),
            "recovery": (0.0, 1.0), "joint_recovery": (0.0, 1.0), "rest_speed": (0.0, math.inf),
            "margin": (0.0, math.inf),
        }  # fmt: skip
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value) or not low <= value <= high:
                above = f" to {high:g}" if math.isfinite(high) else " or more"
                raise InputError(f"options.{name}", value, f"a number from {low:g}{above}")
        if not (
            isinstance(self.tolerance, (int, float))
            and math.isfinite(self.tolerance)
            and self.tolerance > 0.0
        ):
            raise InputError("options.tolerance", self.tolerance, "a finite number > 0")
        for name, least in (("max_sweeps", 1), ("min_sweeps", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InputError(f"options.{name}", value, f"a whole number >= {least}")
        if self.mixing not in RULES:
            raise InputError("options.mixing", self.mixing, "one of " + ", ".join(RULES))
        if self.method not in methods():
            raise InputError("options.method", self.method, "one of " + ", ".join(methods()))
        for pair, value in self.pairs.items():
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= 0.0):
                raise InputError(f"options.pairs.{'+'.join(pair)}", value, "a finite coefficient >= 0")
