"""What the parts of the boundary do to the matter: no slip, slip, Coulomb friction, or nothing (seed B, 7.2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from barchan.errors import InputError

KINDS = ("no_slip", "slip", "friction", "free")


@dataclass(frozen=True)
class Boundary:
    """One part of the boundary. Matter may leave any wall towards the inside, and enters none.

    kind : "no_slip" (a rough wall: matter moves along it only by shearing itself, under its own friction), "slip", "friction"
        (Coulomb contact with a coefficient of the wall) or "free" (matter falls out and does not come back).
    friction : physical coefficient >= 0 of a frictional wall.

    Raises InputError for an unknown kind or a coefficient that is negative or not finite.
    """

    kind: Literal["no_slip", "slip", "friction", "free"] = "slip"
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("boundary.kind", self.kind, "one of " + ", ".join(KINDS))
        given = self.friction
        if not isinstance(given, (int, float)) or not math.isfinite(given) or given < 0.0:
            raise InputError("boundary.friction", given, "a finite number >= 0")
