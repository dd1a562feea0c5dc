"""Kernels of the passive grains: one independent iteration per grain (seed B, 7.3.2)."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.flows.mpm._frame_kernels import determinant


@njit(cache=True, inline="always")
def _within(f: NDArray[np.float64], y0: float, y1: float, y2: float) -> float:
    """y^T F^-1 y: below the square of its radius inside the ellipsoid of F; infinite for a flat F."""
    whole = determinant(f)
    if not whole > 0.0:
        return np.inf
    if f.shape[0] == 2:
        return (f[1, 1] * y0 * y0 - 2.0 * f[0, 1] * y0 * y1 + f[0, 0] * y1 * y1) / whole
    a00 = f[1, 1] * f[2, 2] - f[1, 2] * f[1, 2]
    a11 = f[0, 0] * f[2, 2] - f[0, 2] * f[0, 2]
    a22 = f[0, 0] * f[1, 1] - f[0, 1] * f[0, 1]
    a01 = f[0, 2] * f[1, 2] - f[0, 1] * f[2, 2]
    a02 = f[0, 1] * f[1, 2] - f[0, 2] * f[1, 1]
    a12 = f[0, 1] * f[0, 2] - f[0, 0] * f[1, 2]
    squares = a00 * y0 * y0 + a11 * y1 * y1 + a22 * y2 * y2
    return (squares + 2.0 * (a01 * y0 * y1 + a02 * y0 * y2 + a12 * y1 * y2)) / whole


@njit(cache=True, parallel=True)
def place_grains(
    grains: NDArray[np.float64],
    owners: NDArray[np.int64],
    old_positions: NDArray[np.float64],
    maps: NDArray[np.float64],
    positions: NDArray[np.float64],
    frames: NDArray[np.float64],
    radius: float,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """out (G, d) = positions + maps (grains - old positions) of the owners, pulled back into their ellipsoids and the box.

    `maps` (P, d, d), or without rows for the identity.
    """
    d, mapped = grains.shape[1], len(maps) > 0
    for g in prange(len(grains)):
        p = owners[g]
        y0, y1 = grains[g, 0] - old_positions[p, 0], grains[g, 1] - old_positions[p, 1]
        y2 = grains[g, 2] - old_positions[p, 2] if d == 3 else 0.0
        if mapped:
            e = maps[p]
            z0, z1, z2 = e[0, 0] * y0 + e[0, 1] * y1, e[1, 0] * y0 + e[1, 1] * y1, 0.0
            if d == 3:
                z0 += e[0, 2] * y2
                z1 += e[1, 2] * y2
                z2 = e[2, 0] * y0 + e[2, 1] * y1 + e[2, 2] * y2
            y0, y1, y2 = z0, z1, z2
        distance = np.sqrt(max(_within(frames[p], y0, y1, y2), 0.0))
        share = radius / distance if distance > radius else 1.0
        out[g, 0] = min(max(positions[p, 0] + share * y0, lower[0]), upper[0])
        out[g, 1] = min(max(positions[p, 1] + share * y1, lower[1]), upper[1])
        if d == 3:
            out[g, 2] = min(max(positions[p, 2] + share * y2, lower[2]), upper[2])


@njit(cache=True, parallel=True)
def hand_over(
    grains: NDArray[np.float64],
    owners: NDArray[np.int64],
    parents: NDArray[np.int64],
    heirs: NDArray[np.int64],
    positions: NDArray[np.float64],
    frames: NDArray[np.float64],
    out: NDArray[np.int64],
) -> None:
    """New owners (G,): the heir, or of two children the one in whose ellipsoid the grain lies deeper."""
    d = grains.shape[1]
    for g in prange(len(grains)):
        p = owners[g]
        heir = heirs[p]
        if parents[heir] == p and heir + 1 < len(parents) and parents[heir + 1] == p:
            first, second = 0.0, 0.0
            for side in range(2):
                c = heir + side
                y2 = grains[g, 2] - positions[c, 2] if d == 3 else 0.0
                depth = _within(frames[c], grains[g, 0] - positions[c, 0], grains[g, 1] - positions[c, 1], y2)
                if side == 0:
                    first = depth
                else:
                    second = depth
            if second < first:
                heir += 1
        out[g] = heir
