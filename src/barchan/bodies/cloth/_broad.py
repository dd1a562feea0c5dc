"""Pairs of triangles of one surface that are close: boxes in the grid of contact detection."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact._grids import Extents, close_pairs
from barchan.bodies.contact.arrays import POLYTOPE

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


def close_triangles(vertices: Vector, triangles: Whole, reach: float) -> Whole:
    """Pairs (p, 2) of triangles whose boxes, each widened by half of `reach` [m], meet; not those that share an edge.

    Triangles with one common vertex are among them.
    """
    corner = vertices[triangles]
    low, high = corner.min(axis=1), corner.max(axis=1)
    middle = np.ascontiguousarray(0.5 * (low + high))
    half = np.ascontiguousarray(0.5 * (high - low) + 0.5 * reach)
    count = len(triangles)
    pairs = close_pairs(
        Extents(
            middle, half, np.linalg.norm(half, axis=1), np.full(count, POLYTOPE, np.int64), np.arange(count),
            np.ones(count, np.bool_), np.zeros((count, 3)), np.zeros(count),
        )
    )  # fmt: skip
    common = np.sum(triangles[pairs[:, 0]][:, :, None] == triangles[pairs[:, 1]][:, None, :], axis=(1, 2))
    return np.ascontiguousarray(pairs[common < 2])
