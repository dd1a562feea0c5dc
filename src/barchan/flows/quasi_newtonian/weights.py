"""How the adaptive Newton method weighs the Newton part of the Jacobian: the strategies of seed C 4.3 and 8.1.

Each maps the residual change Q = |R_n| / |R_n-1| to the factor by which delta is multiplied; delta never exceeds 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barchan.errors import InputError

LEAST = 0.2
"""No weight after the first is smaller (4.3.4: "the lowest value"); delta_0 = 0 of Table 12 could not grow at all."""


def f1(q: float) -> float:
    """Eq. 4.12 and 8.16: the final strategy of phase 4."""
    return 0.2 + 4.0 / (0.7 + _exp(1.5 * q))


def f2(q: float) -> float:
    """Eq. 8.17."""
    return 0.2 + 19.1957 / (4.0515 + _exp(3.008 * q))


def f3(q: float) -> float:
    """Eq. 8.18: the one for granular flow."""
    return 0.2 + 17.694 / (8.83 + _exp(2.608 * q))


def phase2(q: float) -> float:
    """Phase 2 (4.3.2): up by 1.2, down by 0.8."""
    return 1.2 if q < 1.0 else 0.8


def phase2_slow(q: float) -> float:
    """Phase 2 as in the comparison of phases (4.3.5, Fig. 11-12)."""
    if q < 0.5:
        return 1.1
    return 1.05 if q < 1.0 else 0.8


def phase3(q: float) -> float:
    """Phase 3 (4.3.3): piecewise smooth."""
    if q < 0.8:
        return 4.0 + 0.52 / (q - 1.0)
    if q < 1.0:
        return 1.0 + 10.0 * (q - 1.0) ** 2
    return 0.8 / q


def _exp(x: float) -> float:
    return float(np.exp(min(x, 700.0)))


FACTORS: dict[str, Callable[[float], float]] = {
    "f1": f1,
    "f2": f2,
    "f3": f3,
    "phase2": phase2,
    "phase2-slow": phase2_slow,
    "phase3": phase3,
}
STRATEGIES = ("phase1", *FACTORS)


@dataclass
class AdaptiveWeight:
    """The weight delta of one solve.

    strategy : "phase1" (0.5 or `start` until the residual falls below `radius`, then 1), or one of FACTORS.
    start : delta_0 in [0, 1].  radius : of phase 1.

    Raises InputError for an unknown strategy or a start out of range.
    """

    strategy: str = "f1"
    start: float = 0.2
    radius: float = 1e-3

    def __post_init__(self) -> None:
        if self.strategy not in STRATEGIES:
            raise InputError("strategy", self.strategy, "one of " + ", ".join(STRATEGIES))
        if not 0.0 <= self.start <= 1.0:
            raise InputError("delta0", self.start, "between 0 and 1")
        if not self.radius > 0.0:
            raise InputError("radius", self.radius, "positive")
        self.value = self.start

    def update(self, residual: float, before: float | None) -> float:
        """The weight of the next step, from the residual now and that one step before (None at the start)."""
        if self.strategy == "phase1":
            if residual < self.radius:
                self.value = 1.0
        elif before is not None and before > 0.0:
            factor = FACTORS[self.strategy](residual / before)
            self.value = min(1.0, max(LEAST, self.value * factor))
        return self.value
