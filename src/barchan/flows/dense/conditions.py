"""What happens at the named parts of the boundary of a dense flow, walls with Coulomb friction among it (seed B, 6.2.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from barchan.errors import InputError
from barchan.flows.conditions import FreeSlip, NoSlip, Pressure, Stress, Symmetry, Velocity

__all__ = ["Condition", "FreeSlip", "FrictionalWall", "NoSlip", "Pressure", "Stress", "Symmetry", "Velocity"]


@dataclass(frozen=True)
class FrictionalWall:
    """Rigid wall with Coulomb friction: matter may leave it, not enter it, and slides along it under friction.

    mu : physical coefficient >= 0, number or callable x (n, d) -> (n,).  velocity : of the wall, (d,) or callable; None: 0.
    """

    mu: float | Callable[[np.ndarray], Any]
    velocity: Any = None

    def __post_init__(self) -> None:
        if not callable(self.mu):
            allowed = "a finite number >= 0"
            try:
                number = float(self.mu)
            except (TypeError, ValueError):
                raise InputError("wall.mu", self.mu, allowed) from None
            if not math.isfinite(number) or number < 0.0:
                raise InputError("wall.mu", self.mu, allowed)


Condition: TypeAlias = NoSlip | Velocity | FreeSlip | Stress | Pressure | FrictionalWall
