"""What happens at the boundary of a quasi-Newtonian flow (seed C 8.2), slip with friction and ends of channels included."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from barchan.errors import InputError
from barchan.flows.conditions import FreeSlip, NoSlip, Pressure, Stress, Symmetry, Velocity
from barchan.spaces.mixed import sampled
from barchan.spaces.quadratic import Boundary

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


def prescribed_pressure(condition: Condition | None, side: Boundary) -> np.ndarray:
    """(F, R) pressure that a condition sets on an open part: 0 where it says nothing of stresses."""
    points = side.points.reshape(-1, 2)
    if isinstance(condition, ChannelEnd):
        return sampled(condition.pressure, points, "pressure").reshape(side.weights.shape)
    if isinstance(condition, Pressure | Stress):
        tensors = condition.at(points).reshape(*side.weights.shape, 2, 2)
        return -np.einsum("fqa,fqab,fqb->fq", side.normals, tensors, side.normals)
    return np.zeros(side.weights.shape)
