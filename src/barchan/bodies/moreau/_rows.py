"""Kernel of contact rows: blocks of H of the bodies that can move, and relative velocities of all (seed B, Eq. 2.6)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.int32]


@njit(cache=True)
def write_rows(
    turn: Array, points: Array, bodies: Numbers, centres: Array, axes: Array, movable: Array, starts: Numbers, given: Array,
    data: Array, indices: Numbers, rates: Array,
) -> None:  # fmt: skip
    """Blocks `data` (n, d, d) of the contacts and their columns `indices` (n,), and `rates` (q, k, d).

    turn (k, d, d): normal and tangents in rows.  points (k, d).  bodies (k, 2), the lower number first.  centres (b, d).
    axes (b, 3, 3): of the spins, unused in the plane.  movable (b, 2, d): 1 where forces change a component, else 0.
    starts (k + 1,): first block of each contact; a body without a movable component has none.
    given (q, b, 2, d): velocities whose relative ones at the contacts are wanted.
    """
    d = turn.shape[1]
    block = np.empty((2, d, d))
    rates[:] = 0.0
    for c in range(turn.shape[0]):
        place = starts[c]
        for side in range(2):
            b, sign = bodies[c, side], 1.0 - 2.0 * side
            _block(d, turn[c], points[c], centres[b], axes, b, sign, block)
            moves = False
            for part in range(2):
                for j in range(d):
                    moves = moves or movable[b, part, j] > 0.0
                    for i in range(d):
                        for q in range(given.shape[0]):
                            rates[q, c, i] += block[part, i, j] * given[q, b, part, j]
            if not moves:
                continue
            for part in range(2):
                indices[place] = 2 * b + part
                for j in range(d):
                    for i in range(d):
                        data[place, i, j] = block[part, i, j] * movable[b, part, j]
                place += 1


@njit(cache=True)
def _block(
    d: int, frame: Array, point: Array, centre: Array, axes: Array, b: int, sign: float, block: Array
) -> None:
    """block (2, d, d): what the velocity of a body and its spin do in the frame at a point, times the sign."""
    for i in range(d):
        for j in range(d):
            block[0, i, j] = sign * frame[i, j]
    if d == 2:
        x, y = point[0] - centre[0], point[1] - centre[1]
        for i in range(2):
            block[1, i, 0], block[1, i, 1] = sign * (x * frame[i, 1] - y * frame[i, 0]), 0.0
        return
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    for i in range(3):
        # (a x r) . f = a . (r x f)
        fx, fy, fz = frame[i, 0], frame[i, 1], frame[i, 2]
        mx, my, mz = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
        for j in range(3):
            block[1, i, j] = sign * (axes[b, 0, j] * mx + axes[b, 1, j] * my + axes[b, 2, j] * mz)
