"""What the six (four in the plane) faces of the box do to the matter: stick, slip, Coulomb friction, or let it out.

Stick and slip fix velocity components at wall nodes (seed B, 7.5.1); a frictional wall adds one contact per active node to the
problem; an open face holds nothing back, and particles that reach it leave the simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.spaces import RegularGrid

KINDS = ("slip", "stick", "friction", "open")


@dataclass(frozen=True)
class Wall:
    """One face.

    kind : "slip" (no velocity through the wall), "stick" (no velocity at the wall), "friction" (matter may leave the
        wall but not enter it, and slides under Coulomb's law) or "open" (matter leaves through it).
    friction : physical coefficient >= 0 of a frictional wall.

    Raises InputError for an unknown kind or a coefficient that is negative or not finite.
    """

    kind: Literal["slip", "stick", "friction", "open"] = "slip"
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("wall.kind", self.kind, "one of " + ", ".join(KINDS))
        if (
            not isinstance(self.friction, (int, float))
            or not math.isfinite(self.friction)
            or self.friction < 0.0
        ):
            raise InputError("wall.friction", self.friction, "a finite number >= 0")


def face_names(dimension: int) -> tuple[str, ...]:
    """Names of the faces, ordered by axis then side: x_min, x_max, (y_min, y_max,) z_min, z_max."""
    axes = "xz" if dimension == 2 else "xyz"
    return tuple(f"{axis}_{side}" for axis in axes for side in ("min", "max"))


@dataclass(frozen=True)
class Walls:
    """The faces of the box; those not named slip.

    faces : face name ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max"; z is the vertical, the last axis) -> Wall.

    Raises InputError for an unknown face name or a value that is not a Wall.
    """

    faces: Mapping[str, Wall] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, wall in self.faces.items():
            if name not in face_names(3):
                raise InputError("walls", name, "a face among " + ", ".join(face_names(3)))
            if not isinstance(wall, Wall):
                raise InputError(f"walls.{name}", wall, "a Wall")

    @classmethod
    def cuve(cls, dimension: int) -> Walls:
        """The tank of seed B's scenes: floor stick, sides and lid slip."""
        faces = {name: Wall("slip") for name in face_names(dimension)}
        return cls(faces | {"z_min": Wall("stick")})

    def on(self, dimension: int) -> tuple[Wall, ...]:
        """(2 d) walls in the order of `face_names`; InputError when a face does not exist in the plane."""
        names = face_names(dimension)
        for name in self.faces:
            if name not in names:
                raise InputError("walls", name, "a face among " + ", ".join(names) + " in 2D")
        return tuple(self.faces.get(name, Wall("slip")) for name in names)


class Faces(Protocol):
    """What walls ask of a grid or a velocity basis."""

    @property
    def dimension(self) -> int: ...

    def on_face(self, ids: NDArray[np.int64], axis: int, upper: bool) -> NDArray[np.bool_]: ...


def free_components(grid: Faces, walls: Walls, nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n, d) whether each velocity component of the nodes (n,) may move: stick fixes all, slip the normal one."""
    free = np.ones((len(nodes), grid.dimension), dtype=np.bool_)
    for face, wall in enumerate(walls.on(grid.dimension)):
        axis, upper = divmod(face, 2)
        at_face = grid.on_face(nodes, axis, bool(upper))
        if wall.kind == "stick":
            free[at_face] = False
        elif wall.kind == "slip":
            free[at_face, axis] = False
    return free


def left_through(grid: RegularGrid, walls: Walls, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(P,) whether each particle at `positions` (P, d) has reached an open face (within 1e-6 of a cell)."""
    out = np.zeros(len(positions), dtype=np.bool_)
    for face, wall in enumerate(walls.on(grid.dimension)):
        if wall.kind == "open":
            axis, upper = divmod(face, 2)
            slack = 1e-6 * grid.spacing[axis]
            edge = grid.upper[axis] - slack if upper else grid.origin[axis] + slack
            out |= positions[:, axis] >= edge if upper else positions[:, axis] <= edge
    return out
