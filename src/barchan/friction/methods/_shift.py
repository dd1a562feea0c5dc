"""The De Saxce shift s(u) of a running method: followed with a lag that grows when the method stagnates.

Seed B puts s of the last rates into w; with inertia or long steps the couple (forces, shift) may then cycle. A lagging shift
makes the sequence of convex problems slow compared with the method (Cadoux's fixed point, seed B 2.3.2, under-relaxed).
"""

from __future__ import annotations

import math

import numpy as np

from barchan.errors import InputError
from barchan.friction.methods._scaled import ScaledProblem

FIRST_RATE = 1.0
SMALLEST_RATE = 0.03
SLOWER = 0.3
PATIENCE = 100
PROGRESS = 0.9


class LaggedShift:
    """Normal part `value` (n,) of a shift that moves the fraction `rate` of the way to s(u) at each update.

    `rate` starts at the given number and is multiplied by SLOWER (down to SMALLEST_RATE) whenever PATIENCE iterations pass
    without the residual falling by the factor PROGRESS. Raises InputError unless 0 < rate <= 1.
    """

    def __init__(self, scaled: ScaledProblem, rates: np.ndarray, rate: float = FIRST_RATE) -> None:
        if not 0.0 < rate <= 1.0:
            raise InputError("shift_rate", rate, "above 0 and at most 1")
        self.scaled = scaled
        self.rate = rate
        self.value = scaled.shift(rates)
        self._goal = math.inf
        self._reached = 0

    def follow(self, u: np.ndarray) -> None:
        """Move towards s(u), u (n, s) scaled rates."""
        if not self.scaled.associated:
            self.value = self.value + self.rate * (self.scaled.shift(u) - self.value)

    def added_to(self, u: np.ndarray) -> np.ndarray:
        """u plus the shift (n, s); u itself for associated laws."""
        if self.scaled.associated:
            return u
        out = u.copy()
        out[:, 0] += self.value
        return out

    def watch(self, iteration: int, residual: float) -> None:
        """Note the residual of an iteration and slow down on stagnation."""
        if residual <= PROGRESS * self._goal:
            self._goal, self._reached = residual, iteration
        elif iteration - self._reached >= PATIENCE:
            self.rate = min(self.rate, max(SLOWER * self.rate, SMALLEST_RATE))
            self._reached = iteration
