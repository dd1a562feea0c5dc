"""Kernels of the regular grid: cell of each particle, counting sort, nodes of occupied cells (seed B, 7.3.3).

Sequential on purpose: they are memory bound and take a few nanoseconds a particle; the dimension is read at run time.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def flat_cells(
    positions: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Flat C-order id (P,) of the cell holding each of the positions (P, d), clamped to the grid."""
    count, dimension = positions.shape
    ids = np.empty(count, np.int64)
    for p in range(count):
        flat = 0
        for k in range(dimension):
            index = int(np.floor((positions[p, k] - origin[k]) / spacing[k]))
            index = min(max(index, 0), cells[k] - 1)
            flat = flat * cells[k] + index
        ids[p] = flat
    return ids


@njit(cache=True)
def counting_sort(keys: NDArray[np.int64], key_count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stable order (P,) of the keys (P,) and starts (key_count + 1,) of each key's run in that order."""
    starts = np.zeros(key_count + 1, np.int64)
    for p in range(keys.size):
        starts[keys[p] + 1] += 1
    for key in range(key_count):
        starts[key + 1] += starts[key]
    following = starts[:-1].copy()
    order = np.empty(keys.size, np.int64)
    for p in range(keys.size):
        order[following[keys[p]]] = p
        following[keys[p]] += 1
    return order, starts


@njit(cache=True)
def mark_nodes(occupied: NDArray[np.int64], cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(node_count,) True at the corners of the occupied cells (C,)."""
    dimension = cells.size
    node_count = 1
    for k in range(dimension):
        node_count *= cells[k] + 1
    marked = np.zeros(node_count, np.bool_)
    for c in range(occupied.size):
        for corner in range(1 << dimension):
            rest, flat, stride = occupied[c], 0, 1
            for axis in range(dimension):
                k = dimension - 1 - axis
                flat += (rest % cells[k] + ((corner >> k) & 1)) * stride
                rest //= cells[k]
                stride *= cells[k] + 1
            marked[flat] = True
    return marked
