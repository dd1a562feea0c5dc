"""Kernels of the neighbour list: grains sorted into the cells of a grid that shears with the periodic cell.

Fractions s of the triclinic cell with edges e_k make Lees-Edwards images ordinary: a grain and its images share s but
for integers.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def bin_grains(
    x: Array, lower: Array, edges: Array, tilt: float, upright: int, counts: Whole
) -> tuple[Whole, Whole, Whole]:
    """Cell numbers (n, 3), the grains in the order of their cells (n,), and where each cell starts (cells + 1,).

    lower, edges (3,) : corner and lengths of the grid. tilt : of axis 0 along axis `upright`.
    """
    n = len(x)
    cells = np.empty((n, 3), dtype=np.int64)
    starts = np.zeros(counts[0] * counts[1] * counts[2] + 1, dtype=np.int64)
    for i in range(n):
        for a in range(3):
            place = x[i, a] - lower[a]
            if a == 0:
                place -= tilt * (x[i, upright] - lower[upright])
            cells[i, a] = min(max(int(place / edges[a] * counts[a]), 0), counts[a] - 1)
        starts[(cells[i, 0] * counts[1] + cells[i, 1]) * counts[2] + cells[i, 2] + 1] += 1
    for c in range(1, len(starts)):
        starts[c] += starts[c - 1]
    order = np.empty(n, dtype=np.int64)
    filled = starts[:-1].copy()
    for i in range(n):
        c = (cells[i, 0] * counts[1] + cells[i, 1]) * counts[2] + cells[i, 2]
        order[filled[c]] = i
        filled[c] += 1
    return cells, order, starts


@njit(cache=True)
def scan(
    i: int,
    x: Array,
    grains: Array,
    skin: float,
    cell: Array,
    counts: Whole,
    periodic: NDArray[np.bool_],
    cells: Whole,
    order: Whole,
    starts: Whole,
    at: int,
    pairs: Whole,
    shifts: NDArray[np.int8],
) -> int:
    """Number of neighbours j > i of grain i, two held grains being none.

    With rows to fill (`at` >= 0) writes them from row `at`, in increasing order.
    """
    found = 0
    for dx in range(-1, 2):
        cx = cells[i, 0] + dx
        if not periodic[0] and (cx < 0 or cx >= counts[0]):
            continue
        sx = 1 if cx >= counts[0] else (-1 if cx < 0 else 0)
        for dy in range(-1, 2):
            cy = cells[i, 1] + dy
            if not periodic[1] and (cy < 0 or cy >= counts[1]):
                continue
            sy = 1 if cy >= counts[1] else (-1 if cy < 0 else 0)
            for dz in range(-1, 2):
                cz = cells[i, 2] + dz
                if not periodic[2] and (cz < 0 or cz >= counts[2]):
                    continue
                sz = 1 if cz >= counts[2] else (-1 if cz < 0 else 0)
                ox = sx * cell[0, 0] + sy * cell[1, 0] + sz * cell[2, 0]
                oy = sx * cell[0, 1] + sy * cell[1, 1] + sz * cell[2, 1]
                oz = sx * cell[0, 2] + sy * cell[1, 2] + sz * cell[2, 2]
                bx, by, bz = cx - sx * counts[0], cy - sy * counts[1], cz - sz * counts[2]
                c = (bx * counts[1] + by) * counts[2] + bz
                for k in range(starts[c], starts[c + 1]):
                    j = order[k]
                    if j <= i or (grains[i, 1] == 0.0 and grains[j, 1] == 0.0):
                        continue
                    rx, ry, rz = x[i, 0] - x[j, 0] - ox, x[i, 1] - x[j, 1] - oy, x[i, 2] - x[j, 2] - oz
                    reach = grains[i, 0] + grains[j, 0] + skin
                    if rx * rx + ry * ry + rz * rz >= reach * reach:
                        continue
                    if at >= 0:
                        row = at + found
                        while row > at and pairs[row - 1, 1] > j:
                            pairs[row, 0], pairs[row, 1] = pairs[row - 1, 0], pairs[row - 1, 1]
                            for a in range(3):
                                shifts[row, a] = shifts[row - 1, a]
                            row -= 1
                        pairs[row, 0], pairs[row, 1] = i, j
                        shifts[row, 0], shifts[row, 1], shifts[row, 2] = sx, sy, sz
                    found += 1
    return found


@njit(cache=True, parallel=True)
def count_neighbours(
    x: Array,
    grains: Array,
    skin: float,
    cell: Array,
    counts: Whole,
    periodic: NDArray[np.bool_],
    cells: Whole,
    order: Whole,
    starts: Whole,
    rows: Whole,
) -> None:
    """rows (n + 1,) : after this, rows[i + 1] is the number of neighbours j > i of grain i."""
    nothing = np.empty((0, 2), dtype=np.int64)
    no_shift = np.empty((0, 3), dtype=np.int8)
    for i in prange(len(x)):
        rows[i + 1] = scan(
            i, x, grains, skin, cell, counts, periodic, cells, order, starts, -1, nothing, no_shift
        )


@njit(cache=True, parallel=True)
def fill_neighbours(
    x: Array,
    grains: Array,
    skin: float,
    cell: Array,
    counts: Whole,
    periodic: NDArray[np.bool_],
    cells: Whole,
    order: Whole,
    starts: Whole,
    rows: Whole,
    pairs: Whole,
    shifts: NDArray[np.int8],
) -> None:
    """pairs (k, 2) and shifts (k, 3), rows[i] .. rows[i + 1] being those of grain i: r = x_i - x_j - shifts . edges."""
    for i in prange(len(x)):
        scan(i, x, grains, skin, cell, counts, periodic, cells, order, starts, rows[i], pairs, shifts)


@njit(cache=True)
def incident_pairs(pairs: Whole, grains: int) -> tuple[Whole, Whole]:
    """Of each grain j, the rows of the pairs it is second in, by increasing first: starts (n + 1,) and rows (k,)."""
    starts = np.zeros(grains + 1, dtype=np.int64)
    for p in range(len(pairs)):
        starts[pairs[p, 1] + 1] += 1
    for i in range(grains):
        starts[i + 1] += starts[i]
    filled = starts[:-1].copy()
    rows = np.empty(len(pairs), dtype=np.int64)
    for p in range(len(pairs)):
        j = pairs[p, 1]
        rows[filled[j]] = p
        filled[j] += 1
    return starts, rows


@njit(cache=True, parallel=True)
def carry_memory(
    rows: Whole, pairs: Whole, old_pairs: Whole, old_rows: Whole, old_memory: Array, memory: Array
) -> None:
    """Give pairs (k, 2) the memory of the same pair among `old_pairs`; the rest is zero."""
    for p in prange(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        for q in range(old_rows[i], old_rows[i + 1]):
            if old_pairs[q, 1] == j:
                for c in range(memory.shape[1]):
                    memory[p, c] = old_memory[q, c]
                break
