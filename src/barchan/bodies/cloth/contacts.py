"""Contacts of a cloth as arrays, and the rows they make in the friction problem of a step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ClothContacts:
    """k contacts; the relative velocity of one is sum_j weights_j v_(vertices_j) less the drift of the obstacle.

    keys : (k,) lasting names.  bodies : (k,) number of the obstacle, -1 for the cloth itself.
    vertices : (k, 4) numbers, -1 where there are fewer, and weights (k, 4), which sum up to 1 (obstacle) or 0 (cloth).
    points, normals : (k, 3), normals unit, towards the cloth (its first side).  gaps : (k,) [m], negative for overlaps.
    drift : (k, 3) [m/s] mean velocity of the obstacle's matter over the step.  friction : (k,).
    """

    keys: Whole
    bodies: Whole
    vertices: Whole
    weights: Vector
    points: Vector
    normals: Vector
    gaps: Vector
    drift: Vector
    friction: Vector

    def __len__(self) -> int:
        return len(self.gaps)

    def rows(self, size: int, dt: float, recovery: float) -> tuple[sp.bsr_array, Vector]:
        """H (3 k, 3 `size`), blocks weight E^T with rows normal, tangent, tangent, and w (3 k,) [m/s].

        w holds the gap over dt, so that the predicted gap is not negative (seed B, 2.14); of an overlap a share `recovery`.
        """
        turn = contact_frames(self.normals)
        offsets = -np.einsum("kij,kj->ki", turn, self.drift)
        offsets[:, 0] += np.where(self.gaps > 0.0, 1.0, recovery) * self.gaps / dt
        order = np.argsort(np.where(self.vertices < 0, size, self.vertices), axis=1, kind="stable")
        vertices = np.take_along_axis(self.vertices, order, axis=1)
        weights = np.take_along_axis(self.weights, order, axis=1)
        there = vertices >= 0
        blocks = weights[:, :, None, None] * turn[:, None, :, :]
        starts = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        operator = sp.bsr_array(
            (np.ascontiguousarray(blocks[there]), vertices[there].astype(np.int32), starts.astype(np.int32)),
            shape=(3 * len(self), 3 * size),
        )
        return operator, offsets.ravel()

    def beside(self, pinned: NDArray[np.bool_], given: Vector) -> ClothContacts:
        """The contacts with `pinned` (n,) vertices taken for obstacles that move as `given` (n, 3) [m/s].

        Contacts between pinned vertices alone are left out.
        """
        held = pinned[self.vertices] & (self.vertices >= 0)
        if not np.any(held):
            return self
        drift = self.drift - np.einsum("kj,kji->ki", np.where(held, self.weights, 0.0), given[self.vertices])
        other = replace(
            self,
            drift=drift,
            vertices=np.where(held, -1, self.vertices),
            weights=np.where(held, 0.0, self.weights),
        )
        moving = np.any(other.vertices >= 0, axis=1)
        return ClothContacts(*(getattr(other, name)[moving] for name in self.__dataclass_fields__))


def joined(first: ClothContacts, second: ClothContacts) -> ClothContacts:
    """The contacts of both, one after the other."""
    names = ClothContacts.__dataclass_fields__
    return ClothContacts(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in names))


def mixed_friction(one: float, other: float, rule: str) -> float:
    """Coefficient of a pair of surfaces."""
    if rule == "geometric":
        return float(np.sqrt(one * other))
    if rule == "mean":
        return 0.5 * (one + other)
    return min(one, other) if rule == "min" else max(one, other)
