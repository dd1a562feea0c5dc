"""What brakes discrete elastic rods besides friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.errors import InputError


@dataclass(frozen=True)
class Damping:
    """What brakes rods besides friction.

    internal : [s] times the stiffness (J^T K J, which rigid motions do not feel).  mass : [1/s] times the mass.
    air : force on a length of fibre over its velocity [kg/(m s)].
    """

    internal: float = 0.0
    mass: float = 0.0
    air: float = 0.0

    def __post_init__(self) -> None:
        for name in ("internal", "mass", "air"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"damping.{name}", value, "a number not below zero")


NO_DAMPING = Damping()
