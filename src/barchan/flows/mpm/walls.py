"""What the six (four in the plane) faces of the box do to the matter: stick, slip, or Coulomb friction (seed B, 7.5.1).

Stick and slip fix velocity components at wall nodes; a frictional wall adds one contact per active node to the problem.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.spaces import RegularGrid

KINDS = ("slip", "stick", "friction")


@dataclass(frozen=True)
class Wall:
    """One face.

    kind : "slip" (no velocity through the wall), "stick" (no velocity at the wall) or "friction" (matter may leave the
        wall but not enter it, and slides under Coulomb's law).
    friction : physical coefficient >= 0 of a frictional wall.

    Raises InputError for an unknown kind or a coefficient that is negative or not finite.
    """

    kind: Literal["slip", "stick", "friction"] = "slip"
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


def free_components(grid: RegularGrid, walls: Walls, nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
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


@dataclass(frozen=True)
class WallContacts:
    """Contacts of active nodes with frictional walls; a node on two such walls has two contacts.

    numbers : (k,) active numbers of the nodes, faces one after the other.
    keys : (k,) int64 `node id * 2 d + face`, unique names of the contacts by which stresses are found again.
    areas : (k,) area [m^(d-1)] a node stands for: its volume of matter over half a cell's height.
    frames : (k, d, d) rows: inward normal, then the tangents.
    friction : (k,) physical coefficients.
    """

    numbers: NDArray[np.int64]
    keys: NDArray[np.int64]
    areas: NDArray[np.float64]
    frames: NDArray[np.float64]
    friction: NDArray[np.float64]


def wall_contacts(
    grid: RegularGrid, walls: Walls, nodes: NDArray[np.int64], node_volumes: NDArray[np.float64]
) -> WallContacts:
    """Contacts of the active nodes (n,), whose volumes of matter are `node_volumes` (n,) [m^d]."""
    d = grid.dimension
    numbers, keys, areas, frames, friction = [], [], [], [], []
    for face, wall in enumerate(walls.on(d)):
        if wall.kind != "friction":
            continue
        axis, upper = divmod(face, 2)
        found = np.flatnonzero(grid.on_face(nodes, axis, bool(upper)))
        frame = np.roll(np.eye(d), -axis, axis=0)
        frame[0] *= -1.0 if upper else 1.0
        numbers.append(found)
        keys.append(nodes[found] * (2 * d) + face)
        areas.append(node_volumes[found] / (0.5 * grid.spacing[axis]))
        frames.append(np.broadcast_to(frame, (len(found), d, d)))
        friction.append(np.full(len(found), float(wall.friction)))
    if not numbers:
        empty = np.zeros(0, dtype=np.int64)
        return WallContacts(empty, empty, np.zeros(0), np.zeros((0, d, d)), np.zeros(0))
    return WallContacts(*(np.concatenate(parts) for parts in (numbers, keys, areas, frames, friction)))
