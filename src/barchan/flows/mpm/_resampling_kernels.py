"""Kernel that pairs close particles of a cell for merging (seed B, 7.3.2).

Each cell is one independent iteration and looks at its particles in a fixed order: results do not depend on the threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.flows.mpm._frame_kernels import CHUNK, chunk_bounds, extreme_eigenvalues

# A particle is compared with at most this many others of its cell.
MOST_CANDIDATES = 64
# Bricks side by side are exactly this close, up to rounding.
_TOUCHING = 1.0 + 1e-9


@njit(cache=True)
def _touch(
    p: int, q: int, distance: float, arm: NDArray[np.float64], frames: NDArray[np.float64], reach: float
) -> bool:
    """Whether the frames' half-widths along the line of centres bridge it: |arm| <= reach (h_p + h_q)."""
    if distance == 0.0:
        return True
    d = arm.size
    first, second = 0.0, 0.0
    for i in range(d):
        for j in range(d):
            first += arm[i] * frames[p, i, j] * arm[j]
            second += arm[i] * frames[q, i, j] * arm[j]
    return distance * distance <= reach * _TOUCHING * (np.sqrt(first) + np.sqrt(second))


@njit(cache=True)
def _union(
    p: int,
    q: int,
    arm: NDArray[np.float64],
    volumes: NDArray[np.float64],
    frames: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Frame with the second moments of both: the average of the frames + 3 w_p w_q arm (x) arm."""
    d = arm.size
    share = volumes[p] / (volumes[p] + volumes[q])
    for i in range(d):
        for j in range(d):
            mean = share * frames[p, i, j] + (1.0 - share) * frames[q, i, j]
            out[i, j] = mean + 3.0 * share * (1.0 - share) * arm[i] * arm[j]


@njit(cache=True)
def _partner(
    i: int,
    end: int,
    crowded: bool,
    order: NDArray[np.int64],
    free: NDArray[np.bool_],
    kinds: NDArray[np.int64],
    positions: NDArray[np.float64],
    volumes: NDArray[np.float64],
    frames: NDArray[np.float64],
    extremes: NDArray[np.float64],
    rules: tuple[float, float, float],
    work: NDArray[np.float64],
) -> int:
    """The nearest particle that the i-th of `order` may be merged with among those after it, or -1."""
    merge_ratio, reach, largest_semi_axis = rules
    p, d = order[i], positions.shape[1]
    arm, best, found = work[d], np.inf, -1
    for k in range(i + 1, min(end, i + 1 + MOST_CANDIDATES)):
        q = order[k]
        if not free[q] or kinds[q] != kinds[p]:
            continue
        squared = 0.0
        for e in range(d):
            arm[e] = positions[q, e] - positions[p, e]
            squared += arm[e] * arm[e]
        if squared >= best or not _touch(p, q, np.sqrt(squared), arm, frames, reach):
            continue
        _union(p, q, arm, volumes, frames, work[:d])
        high, low = extreme_eigenvalues(work[:d])
        # Eigenvalues are squares of semi-axes. The more isotropic of the two must still be less so than their union.
        rounder = (
            high * extremes[p, 1] < low * extremes[p, 0] and high * extremes[q, 1] < low * extremes[q, 0]
        )
        if high <= merge_ratio**2 * low and high <= largest_semi_axis**2 and (crowded or rounder):
            best, found = squared, q
    return found


@njit(cache=True, parallel=True)
def pair_particles(
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    fewest: int,
    most: int,
    kinds: NDArray[np.int64],
    positions: NDArray[np.float64],
    volumes: NDArray[np.float64],
    frames: NDArray[np.float64],
    extremes: NDArray[np.float64],
    rules: tuple[float, float, float],
    free: NDArray[np.bool_],
    partners: NDArray[np.int64],
) -> None:
    """Fill `partners` (P,), -1 before: the partner each particle is merged with; `free` (P,) marks those that may be.

    `order` (P,) sorts the particles by cell, those of cell c being starts[c]:starts[c + 1]. `kinds` (P,) must agree.
    `rules`: largest ratio of semi-axes, reach, and largest semi-axis [m] of a union. `extremes` (P, 2) eigenvalues.
    """
    cells, d = starts.size - 1, positions.shape[1]
    for chunk in prange((cells + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, cells)
        work = np.empty((d + 1, d))
        for c in range(first, last):
            count, end = starts[c + 1] - starts[c], starts[c + 1]
            for i in range(starts[c], end):
                if count <= fewest:
                    break
                p = order[i]
                if not free[p]:
                    continue
                q = _partner(
                    i, end, count > most, order, free, kinds, positions, volumes, frames, extremes, rules, work
                )  # fmt: skip
                if q >= 0:
                    partners[p], partners[q] = q, p
                    free[p] = free[q] = False
                    count -= 1
