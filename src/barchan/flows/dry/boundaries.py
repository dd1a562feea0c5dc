"""What the parts of the boundary do to the matter: no slip, slip, Coulomb friction, or nothing (seed B, 7.2.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.dry._kernels import FREE, INNER, STICKY, WALL
from barchan.flows.dry.cells import Cells

KINDS = ("no_slip", "slip", "friction", "free")
_CODES = {"no_slip": STICKY, "slip": WALL, "friction": WALL, "free": FREE}


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


AnyBoundary = TypeVar("AnyBoundary", bound=Boundary)


def boundaries_of_parts(
    cells: Cells, given: Mapping[str, AnyBoundary], kind: type[AnyBoundary]
) -> tuple[AnyBoundary, ...]:
    """Boundaries in the order of `cells.names`; parts not given are slip walls.

    Raises InputError for a name that the mesh does not have, and for a value that is no `kind`.
    """
    for name, boundary in given.items():
        if name not in cells.names:
            raise InputError(f"boundaries.{name}", "unknown", "a part of the mesh: " + ", ".join(cells.names))
        if not isinstance(boundary, kind):
            raise InputError(f"boundaries.{name}", boundary, f"a {kind.__name__}")
    return tuple(given.get(name, kind()) for name in cells.names)


def codes_of_sides(cells: Cells, boundaries: tuple[Any, ...]) -> NDArray[np.int64]:
    """(c, k) what the kernels are told of each side: INNER, WALL, STICKY or FREE."""
    code = np.array([_CODES[boundary.kind] for boundary in boundaries])
    return np.where(cells.parts >= 0, code[cells.parts], INNER).astype(np.int64)
