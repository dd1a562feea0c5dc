"""Kernels of the broad phase: pieces sorted into the cells of grids, and pairs whose boxes and balls meet.

Every level of size has a grid of its own with cells as wide as the widest piece in it, so what touches a piece lies in the cell
of its middle or beside it. Cells are numbered modulo the sides of the table, powers of two of at least four where the level is
wider than the table: the 27 cells about one are all different, and what is far away fails the test of the boxes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import Vec, dot, row, sub
from barchan.bodies.contact.arrays import PLANE

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
CELLS_PER_PIECE = 4


class Grids(NamedTuple):
    """Grids of l levels, finer ones first, and the pieces that are held against all others.

    level (g,) of each piece, -1 when apart; origin (l, 3), cell (l,) [m]; reach, sides (l, 3): numbers of cells across the
    level and of its table; cell_start: first entry of each cell in `order`, tables one after the other from
    `table_start` (l,) on; order: pieces by cell; apart (a,) : pieces without a grid.
    """

    level: Numbers
    origin: Array
    cell: Array
    reach: Numbers
    sides: Numbers
    table_start: Numbers
    cell_start: Numbers
    order: Numbers
    apart: Numbers


class Extents(NamedTuple):
    """Boxes and balls about pieces: middle, half (g, 3), radius (g,); kind, body (g,), movable (g,); planes (g, 3), (g,)."""

    middle: Array
    half: Array
    radius: Array
    kind: Numbers
    body: Numbers
    movable: NDArray[np.bool_]
    plane_normal: Array
    plane_offset: Array


def grids_over(extents: Extents, ratio: float = 4.0, fewest: int = 16) -> Grids:
    """Sort pieces into levels whose sizes differ by `ratio`; unbounded pieces and levels of less than `fewest` stay apart.

    The level with most pieces always has a grid.
    """
    widest = np.max(extents.half, axis=1)
    level = np.full(len(widest), -1, dtype=np.int64)
    bounded = np.flatnonzero(np.isfinite(widest))
    if len(bounded):
        least = max(float(np.min(widest[bounded])), 1e-300)
        size = np.floor(np.log(np.maximum(widest[bounded], least) / least) / np.log(ratio)).astype(np.int64)
        found, level[bounded], count = np.unique(size, return_inverse=True, return_counts=True)
        kept = (count >= fewest) | (np.arange(len(found)) == int(np.argmax(count)))
        numbers = np.where(kept, np.cumsum(kept) - 1, -1)
        level[bounded] = numbers[level[bounded]]
    levels = int(level.max()) + 1
    origin, cell = np.zeros((levels, 3)), np.ones(levels)
    reach, sides = np.ones((levels, 3), dtype=np.int64), np.ones((levels, 3), dtype=np.int64)
    for m in range(levels):
        members = level == m
        middle = extents.middle[members]
        origin[m] = np.min(middle, axis=0)
        cell[m] = 2.0 * float(np.max(widest[members])) * (1.0 + 1e-9) + 1e-300
        # numbers of cells that 64 bits hold; beyond, far apart cells share one
        reach[m] = np.minimum((np.max(middle, axis=0) - origin[m]) / cell[m], 2.0**40).astype(np.int64) + 1
        sides[m] = _table_sides(reach[m], int(np.sum(members)))
    table_start = np.concatenate([[0], np.cumsum(np.prod(sides, axis=1))]).astype(np.int64)
    cell_start = np.zeros(int(table_start[-1]) + 1, dtype=np.int64)
    order = np.empty(int(np.sum(level >= 0)), dtype=np.int64)
    grids = Grids(
        level,
        origin,
        cell,
        reach,
        sides,
        table_start,
        cell_start,
        order,
        np.flatnonzero(level < 0).astype(np.int64),
    )
    fill_cells(grids, extents.middle)
    return grids


def _table_sides(reach: Numbers, pieces: int) -> Numbers:
    """Powers of two that hold the level, halved until the table is not much larger than the number of pieces."""
    sides = 2.0 ** np.ceil(np.log2(reach))
    while np.prod(sides) > CELLS_PER_PIECE * pieces + 64 and np.max(sides) > 4.0:
        sides[int(np.argmax(sides))] /= 2.0
    return sides.astype(np.int64)


@njit(cache=True)
def _cell_of(grids: Grids, m: int, middle: Vec) -> tuple[int, int, int]:
    size = grids.cell[m]
    return (
        min(max(int((middle[0] - grids.origin[m, 0]) / size), -2), grids.reach[m, 0] + 1),
        min(max(int((middle[1] - grids.origin[m, 1]) / size), -2), grids.reach[m, 1] + 1),
        min(max(int((middle[2] - grids.origin[m, 2]) / size), -2), grids.reach[m, 2] + 1),
    )


@njit(cache=True)
def _entry(grids: Grids, m: int, i: int, j: int, k: int) -> int:
    """Number of a cell in the tables."""
    x, y, z = i & (grids.sides[m, 0] - 1), j & (grids.sides[m, 1] - 1), k & (grids.sides[m, 2] - 1)
    return grids.table_start[m] + (x * grids.sides[m, 1] + y) * grids.sides[m, 2] + z


@njit(cache=True)
def fill_cells(grids: Grids, middle: Array) -> None:
    """Sort the pieces by cell, counting; within a cell in the order of their numbers."""
    entries = np.full(middle.shape[0], -1, dtype=np.int64)
    start = grids.cell_start
    for g in range(middle.shape[0]):
        m = grids.level[g]
        if m >= 0:
            i, j, k = _cell_of(grids, m, row(middle, g))
            entries[g] = _entry(grids, m, i, j, k)
            start[entries[g] + 1] += 1
    for c in range(1, start.shape[0]):
        start[c] += start[c - 1]
    filled = start[:-1].copy()
    for g in range(middle.shape[0]):
        if entries[g] >= 0:
            grids.order[filled[entries[g]]] = g
            filled[entries[g]] += 1


@njit(cache=True)
def _meet(e: Extents, i: int, j: int) -> bool:
    """Whether two pieces may touch: boxes and balls overlap, one of them can move, and they are not of the same body."""
    if e.body[i] == e.body[j] or not (e.movable[i] or e.movable[j]):
        return False
    for k in range(3):
        if abs(e.middle[i, k] - e.middle[j, k]) > e.half[i, k] + e.half[j, k]:
            return False
    if e.kind[i] == PLANE or e.kind[j] == PLANE:
        if e.kind[i] == e.kind[j]:
            return False
        plane, other = (i, j) if e.kind[i] == PLANE else (j, i)
        height = dot(row(e.plane_normal, plane), row(e.middle, other)) - e.plane_offset[plane]
        return height <= e.radius[other] + e.radius[plane]
    way = sub(row(e.middle, i), row(e.middle, j))
    reach = e.radius[i] + e.radius[j]
    return dot(way, way) <= reach * reach


@njit(cache=True)
def _partners(grids: Grids, e: Extents, g: int, pairs: Numbers, at: int, write: bool) -> int:
    """Count, and write from row `at` on, the pairs of piece g with pieces apart, coarser ones, and later ones of its level."""
    found = 0
    own = grids.level[g]
    for a in range(grids.apart.shape[0]):
        other = grids.apart[a]
        if (own >= 0 or other > g) and _meet(e, g, other):
            if write:
                pairs[at + found, 0], pairs[at + found, 1] = min(g, other), max(g, other)
            found += 1
    if own < 0:
        return found
    for m in range(own, grids.cell.shape[0]):
        ci, cj, ck = _cell_of(grids, m, row(e.middle, g))
        for i in range(max(ci - 1, 0), min(ci + 2, grids.reach[m, 0])):
            for j in range(max(cj - 1, 0), min(cj + 2, grids.reach[m, 1])):
                for k in range(max(ck - 1, 0), min(ck + 2, grids.reach[m, 2])):
                    cell = _entry(grids, m, i, j, k)
                    for n in range(grids.cell_start[cell], grids.cell_start[cell + 1]):
                        other = grids.order[n]
                        if (m > own or other > g) and _meet(e, g, other):
                            if write:
                                pairs[at + found, 0], pairs[at + found, 1] = min(g, other), max(g, other)
                            found += 1
    return found


@njit(cache=True, parallel=True)
def count_partners(grids: Grids, e: Extents, counts: Numbers) -> None:
    """Number of pairs (g,) that each piece has to name."""
    nothing = np.empty((0, 2), dtype=np.int64)
    for n in prange(grids.order.shape[0] + grids.apart.shape[0]):
        g = grids.order[n] if n < grids.order.shape[0] else grids.apart[n - grids.order.shape[0]]
        counts[g] = _partners(grids, e, g, nothing, 0, False)


@njit(cache=True, parallel=True)
def write_partners(grids: Grids, e: Extents, starts: Numbers, pairs: Numbers) -> None:
    """Write the pairs (p, 2) of each piece from row starts[g] on."""
    for n in prange(grids.order.shape[0] + grids.apart.shape[0]):
        g = grids.order[n] if n < grids.order.shape[0] else grids.apart[n - grids.order.shape[0]]
        _partners(grids, e, g, pairs, starts[g], True)


def close_pairs(extents: Extents) -> Numbers:
    """Pairs (p, 2) of pieces, the lower number first, that may touch: each once, in an order that threads do not change."""
    grids = grids_over(extents)
    counts = np.zeros(len(extents.radius), dtype=np.int64)
    count_partners(grids, extents, counts)
    starts = np.concatenate([[0], np.cumsum(counts)])
    pairs = np.empty((int(starts[-1]), 2), dtype=np.int64)
    write_partners(grids, extents, starts, pairs)
    return pairs
