"""Loops over cells and their sides: strain operator, implicit upwind matrix, explicit transport, spreading of excess.

A side is seen from its cell: `neighbours` (c, k), outward area vectors `faces` (c, k, d). The velocity of a side between
cells of volume fractions a and b is (a u_a + b u_b) / (a + b), that of a boundary side the one of its cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

INNER, WALL, STICKY, FREE = 0, 1, 2, 3
"""Codes of sides (c, k): inside, wall that only stops matter, wall of no slip, free boundary."""


@njit(cache=True)
def fill_strain(
    active: Any, numbers: Any, neighbours: Any, faces: Any, sticky: Any, fractions: Any, tensor: Any,
    indptr: Any, indices: Any, data: Any,
) -> None:  # fmt: skip
    """Rows phi_K sum_F 2 chi^-1(sym(u_F (x) a_F)) of the active cells (n,), blocks (s, d); see `strain.py`.

    numbers : (c,) active number of a cell, -1 of an empty one.  indptr (n + 1,) given; indices, data are filled.
    """
    s, d, _ = tensor.shape
    k = neighbours.shape[1]
    for row in range(len(active)):
        cell = active[row]
        own = fractions[cell]
        place = indptr[row]
        indices[place] = row
        data[place] = 0.0
        last = place
        for side in range(k):
            other = neighbours[cell, side]
            share = 1.0
            if other >= 0 and numbers[other] >= 0:
                share = own / (own + fractions[other])
                last += 1
                indices[last] = numbers[other]
                for i in range(s):
                    for c in range(d):
                        total = 0.0
                        for j in range(d):
                            total += tensor[i, c, j] * faces[cell, side, j]
                        data[last, i, c] = own * (1.0 - share) * total
            squared = 0.0
            if sticky[cell, side]:
                for j in range(d):
                    squared += faces[cell, side, j] ** 2
            for i in range(s):
                for c in range(d):
                    total = 0.0
                    if squared > 0.0:  # only the normal component of the cell's velocity reaches the wall
                        for b in range(d):
                            for j in range(d):
                                total += tensor[i, b, j] * faces[cell, side, j] * faces[cell, side, b]
                        total *= faces[cell, side, c] / squared
                    else:
                        for j in range(d):
                            total += tensor[i, c, j] * faces[cell, side, j]
                    data[place, i, c] += own * share * total


@njit(cache=True)
def side_fluxes(
    fractions: Any, least: float, velocities: Any, neighbours: Any, faces: Any, codes: Any, fluxes: Any
) -> None:
    """Volume u_F . a_F (c, k) [m^d/s] that flows out of each cell through each side; none through walls, none in from outside.

    Cells with a fraction of at most `least` are empty and have no velocity.
    """
    count, k = neighbours.shape
    d = faces.shape[2]
    for cell in range(count):
        own = fractions[cell] if fractions[cell] > least else 0.0
        for side in range(k):
            other = neighbours[cell, side]
            flux = 0.0
            if other >= 0:
                theirs = fractions[other] if fractions[other] > least else 0.0
                if own + theirs > 0.0:
                    for j in range(d):
                        mean = (own * velocities[cell, j] + theirs * velocities[other, j]) / (own + theirs)
                        flux += mean * faces[cell, side, j]
            elif codes[cell, side] == FREE and own > 0.0:
                for j in range(d):
                    flux += velocities[cell, j] * faces[cell, side, j]
                flux = max(flux, 0.0)
            fluxes[cell, side] = flux


@njit(cache=True)
def fill_upwind(volumes: Any, neighbours: Any, fluxes: Any, dt: float, indices: Any, data: Any) -> None:
    """Columns (c, k + 1) of the implicit upwind matrix |K| + dt sum_F (u_F.a_F)^+: entries of row numbers and values.

    What leaves cell K through a side enters the row of the neighbour, so that a column sums up to |K| plus what leaves the
    domain. Entries of boundary sides stand on the diagonal with value 0.
    """
    count, k = neighbours.shape
    for cell in range(count):
        leaving = 0.0
        for side in range(k):
            out = dt * max(fluxes[cell, side], 0.0)
            leaving += out
            other = neighbours[cell, side]
            indices[cell, side] = other if other >= 0 else cell
            data[cell, side] = -out if other >= 0 else 0.0
        indices[cell, k] = cell
        data[cell, k] = volumes[cell] + leaving


@njit(cache=True)
def advect(
    matter: Any, fractions: Any, neighbours: Any, fluxes: Any, dt: float, before: Any, after: Any
) -> None:
    """Explicit upwind step of (u . grad) u: u_K + (1 / matter_K) sum_F dt phi_K' (u_F.a_F)^- (u_K' - u_K), velocities (c, d).

    matter : (c,) and fractions : (c,) at the end of the step. Where more flows in than is there at the end, because as much
    flows through, the mean of what flows in.
    """
    count, k = neighbours.shape
    d = before.shape[1]
    for cell in range(count):
        coming = 0.0
        for side in range(k):
            other = neighbours[cell, side]
            if other >= 0 and fluxes[cell, side] < 0.0:
                coming -= dt * fluxes[cell, side] * fractions[other]
        present = max(matter[cell], coming)
        for j in range(d):
            inflow = 0.0
            for side in range(k):
                other = neighbours[cell, side]
                if other >= 0 and fluxes[cell, side] < 0.0:
                    inflow -= dt * fluxes[cell, side] * fractions[other] * before[other, j]
            if present > 0.0:
                after[cell, j] = ((present - coming) * before[cell, j] + inflow) / present
            else:
                after[cell, j] = 0.0


@njit(cache=True)
def spread_excess(amounts: Any, capacities: Any, neighbours: Any, queue: Any, seen: Any) -> float:
    """Move what cells hold above their capacity to the nearest cells with room, in place; what finds no room at all.

    amounts, capacities : (c,) volumes of matter [m^d].  queue, seen : (c,) scratch, seen zero at first.
    Cells are visited ring by ring from each overfull one, in the order of sides, so that the result is deterministic.
    """
    count, k = neighbours.shape
    homeless = 0.0
    mark = 0
    for start in range(count):
        if amounts[start] <= capacities[start]:
            continue
        excess = amounts[start] - capacities[start]
        amounts[start] = capacities[start]
        mark += 1
        seen[start] = mark
        queue[0] = start
        head, tail = 0, 1
        while head < tail and excess > 0.0:
            cell = queue[head]
            head += 1
            for side in range(k):
                other = neighbours[cell, side]
                if other < 0 or seen[other] == mark:
                    continue
                seen[other] = mark
                queue[tail] = other
                tail += 1
                room = capacities[other] - amounts[other]
                if room > 0.0 and excess > 0.0:
                    given = min(room, excess)
                    amounts[other] = min(amounts[other] + given, capacities[other])
                    excess -= given
        homeless += excess
    return homeless


@njit(cache=True)
def overlap(filled: Any, neighbours: Any, indptr: Any) -> None:
    """Number of blocks (self and filled neighbours) in the row of each filled cell, summed up into indptr (n + 1,)."""
    row = 0
    for cell in range(len(filled)):
        if not filled[cell]:
            continue
        entries = 1
        for side in range(neighbours.shape[1]):
            other = neighbours[cell, side]
            if other >= 0 and filled[other]:
                entries += 1
        indptr[row + 1] = indptr[row] + entries
        row += 1


def scratch(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Arrays for `spread_excess`."""
    return np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
