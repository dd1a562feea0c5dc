"""What contact detection finds: places where two bodies touch or nearly do, with gaps, normals and lasting names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._clipping import FEATURE_BITS


@dataclass(frozen=True, eq=False)
class ContactSet:
    """k contacts, sorted by their keys.

    first, second : (k,) int32 numbers of the bodies, first < second.
    points : (k, d) [m] in the middle between the two boundaries.
    normals : (k, d) unit, from `second` to `first`.
    gaps : (k,) [m] along the normal, negative where the bodies overlap.
    keys : (k,) int64, all different; the same features of the same bodies have the same key in every step.
    """

    first: NDArray[np.int32]
    second: NDArray[np.int32]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    gaps: NDArray[np.float64]
    keys: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.gaps)

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.points.shape[1])

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> ContactSet:
        """Some of the contacts: their numbers in increasing order, or a mask (k,)."""
        return ContactSet(
            self.first[rows],
            self.second[rows],
            self.points[rows],
            self.normals[rows],
            self.gaps[rows],
            self.keys[rows],
        )

    def carried(self, keys: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (k, ...) of these contacts from those (m, ...) of contacts with sorted `keys` (m,); zero for new ones."""
        result = np.zeros((len(self), *values.shape[1:]))
        if len(keys):
            rows = np.minimum(np.searchsorted(keys, self.keys), len(keys) - 1)
            known = keys[rows] == self.keys
            result[known] = values[rows[known]]
        return result


def deepest(contacts: ContactSet) -> tuple[tuple[int, int] | None, float]:
    """The pair of bodies with the least gap and how deep they overlap [m], negative when apart.

    (None, -inf) without contacts.
    """
    if len(contacts) == 0:
        return None, -np.inf
    worst = int(np.argmin(contacts.gaps))
    return (int(contacts.first[worst]), int(contacts.second[worst])), -float(contacts.gaps[worst])


@dataclass(frozen=True, eq=False)
class RawContacts:
    """Contacts of pieces: pieces (k, 2), points, normals from the first piece to the second (k, 3), gaps and features (k,)."""

    pieces: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    gaps: NDArray[np.float64]
    features: NDArray[np.int64]


def merged(parts: Sequence[RawContacts], body: NDArray[np.int64], dimension: int) -> ContactSet:
    """All contacts with numbers of bodies and keys, sorted by key; normals from the body of the later number."""
    pieces = np.concatenate([np.zeros((0, 2), dtype=np.int64)] + [p.pieces for p in parts])
    points = np.concatenate([np.zeros((0, 3))] + [p.points for p in parts])
    normals = np.concatenate([np.zeros((0, 3))] + [p.normals for p in parts])
    gaps = np.concatenate([np.zeros(0)] + [p.gaps for p in parts])
    features = np.concatenate([np.zeros(0, dtype=np.int64)] + [p.features for p in parts])
    turned = pieces[:, 0] > pieces[:, 1]
    low, high = np.minimum(pieces[:, 0], pieces[:, 1]), np.maximum(pieces[:, 0], pieces[:, 1])
    keys = (low << (2 * FEATURE_BITS)) | (high << FEATURE_BITS) | features
    # normals point from the first piece to the second; those of a contact from the second body to the first
    np.negative(normals, where=~turned[:, None], out=normals)
    first, second = body[low].astype(np.int32), body[high].astype(np.int32)
    points, normals = points[:, :dimension], normals[:, :dimension]
    if np.all(keys[:-1] < keys[1:]):
        contiguous = np.ascontiguousarray
        return ContactSet(first, second, contiguous(points), contiguous(normals), gaps, keys)
    order = np.argsort(keys, kind="stable")
    return ContactSet(first[order], second[order], points[order], normals[order], gaps[order], keys[order])
