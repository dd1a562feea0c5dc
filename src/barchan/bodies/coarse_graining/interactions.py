"""What coarse graining reads: where the grains are and how they move, and which forces act between them (seed C, 3.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
WALL = -1


@dataclass(frozen=True, eq=False)
class Grains:
    """n grains as points of mass.

    positions (n, d) [m] of their centres. velocities (n, d) [m/s]. masses (n,) [kg]. volumes (n,) [m^d].
    """

    positions: Vector
    velocities: Vector
    masses: Vector
    volumes: Vector

    def __post_init__(self) -> None:
        positions = inputs.table("grains.positions", self.positions, (2, 3), 0)
        n, d = positions.shape
        for name, shape in (("velocities", (n, d)), ("masses", (n,)), ("volumes", (n,))):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise InputError(f"grains.{name}", value.shape, f"finite, of shape {shape}")
            object.__setattr__(self, name, value)
        if np.any(self.masses <= 0.0) or np.any(self.volumes <= 0.0):
            raise InputError("grains.masses", "masses or volumes not above 0", "positive")
        object.__setattr__(self, "positions", positions)

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.positions.shape[1])


@dataclass(frozen=True, eq=False)
class Interactions:
    """k forces between grains, or on grains by walls.

    first (k,) : the grain acted on. second (k,) : the other one, or -1 for a wall or any body that is not part of the flow.
    forces (k, d) [N] on the first. branches (k, d) [m] : r_ij = r_i - r_j between the centres, the second's being the image
        that touches; for a wall a_ik = r_i - c_ik from the contact. normals (k, d) : unit, to the first.
    points (k, d) [m] : the contacts.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    forces: Vector
    branches: Vector
    normals: Vector
    points: Vector

    def __post_init__(self) -> None:
        k = len(self.first)
        for name in ("forces", "branches", "normals", "points"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.ndim != 2 or len(value) != k or value.shape[1] not in (2, 3):
                raise InputError(f"interactions.{name}", value.shape, f"of shape ({k}, 2) or ({k}, 3)")
            object.__setattr__(self, name, value)
        if len(self.second) != k:
            raise InputError("interactions.second", len(self.second), f"{k} numbers")
        for name in ("first", "second"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def of_contacts(
        cls,
        centres: ArrayLike,
        first: ArrayLike,
        second: ArrayLike,
        points: ArrayLike,
        normals: ArrayLike,
        forces: ArrayLike,
        driven: ArrayLike,
    ) -> Interactions:
        """From contacts of bodies: forces (k, d) [N] act on the bodies `first` at `points`, normals point to the first.

        centres (b, d) : centres of mass of all bodies. driven (b,) : those that are walls; a contact of two of them is left
        out. `first` and `second` of the result number the others alone, in their order: rows of the `Grains` made of them.
        Contact impulses of a step become forces when divided by it. Not for periodic images.
        """
        x, at, f = (np.asarray(a, dtype=np.float64) for a in (centres, points, forces))
        n = np.asarray(normals, dtype=np.float64)
        i, j = np.asarray(first, dtype=np.int64), np.asarray(second, dtype=np.int64)
        walls = np.asarray(driven, dtype=np.bool_)
        swap = walls[i]
        i, j = np.where(swap, j, i), np.where(swap, i, j)
        sign = np.where(swap, -1.0, 1.0)[:, None]
        wall = walls[j]
        branches = x[i] - np.where(wall[:, None], at, x[j])
        kept, rows = ~walls[i], np.cumsum(~walls) - 1
        others = np.where(wall, WALL, rows[j])
        vectors = (sign * f, branches, sign * n, at)
        return cls(rows[i[kept]], others[kept], *(vector[kept] for vector in vectors))
