"""What happens at the boundary of a quasi-Newtonian flow (seed C 8.2), slip with friction and ends of channels included."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from barchan.errors import InputError
from barchan.flows.conditions import FreeSlip, NoSlip, Pressure, Stress, Symmetry, Velocity
from barchan.spaces.mixed import sampled

__all__ = [
    "ChannelEnd",
    "Condition",
    "FreeSlip",
    "NoSlip",
    "Pressure",
    "Slip",
    "Stress",
    "Symmetry",
    "Velocity",
]


@dataclass(frozen=True)
class Slip:
    """Wall that matter neither leaves nor enters, with a linear friction along it: t . sigma n = -friction (u - velocity) . t.

    friction : >= 0 (Pa s/m), number or callable x (n, 2) -> (n,); 0 is free slip.  velocity : of the wall, (2,) or callable.
    """

    friction: float | Callable[[np.ndarray], Any]
    velocity: Any = None

    def coefficients(self, points: np.ndarray) -> np.ndarray:
        """(n,) friction at points (n, 2). Raises InputError when negative."""
        values = sampled(self.friction, points, "slip.friction")
        if np.any(values < 0.0):
            raise InputError("slip.friction", float(values.min()), "at least 0")
        return values


@dataclass(frozen=True)
class ChannelEnd:
    """Flow across the part is normal to it, under a given pressure: two ends with two pressures prescribe a pressure drop.

    Unlike `Pressure`, which leaves both components free, it lets a parallel flow leave as it came.
    pressure : number (Pa) or callable x (n, 2) -> (n,).
    """

    pressure: float | Callable[[np.ndarray], Any]


Condition: TypeAlias = NoSlip | Velocity | FreeSlip | Stress | Pressure | Slip | ChannelEnd
