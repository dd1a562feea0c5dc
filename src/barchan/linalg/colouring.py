"""Order of the blocks in a Gauss-Seidel sweep: natural, or coloured groups for deterministic parallelism (seed B 3.4.3).

Two groups conflict when they touch a common unknown; a greedy colouring in index order gives groups that may run at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numba import njit


class Schedule(NamedTuple):
    """`colour_ptr` into groups, `group_ptr` into `order`, `order` the block numbers; all int32."""

    colour_ptr: np.ndarray
    group_ptr: np.ndarray
    order: np.ndarray

    @property
    def widest(self) -> int:
        """Largest number of groups of one colour."""
        return int(np.diff(self.colour_ptr).max(initial=1))


def natural_schedule(n: int) -> Schedule:
    """All `n` blocks in index order, one group."""
    return Schedule(
        np.array([0, 1], dtype=np.int32), np.array([0, n], dtype=np.int32), np.arange(n, dtype=np.int32)
    )


@njit(cache=True, error_model="numpy")
def _greedy(indptr: np.ndarray, indices: np.ndarray) -> np.ndarray:
    n = len(indptr) - 1
    colour = np.full(n, -1, dtype=np.int32)
    used = np.full(n + 1, -1, dtype=np.int32)
    for i in range(n):
        for entry in range(indptr[i], indptr[i + 1]):
            other = colour[indices[entry]]
            if other >= 0:
                used[other] = i
        pick = 0
        while used[pick] == i:
            pick += 1
        colour[i] = pick
    return colour


def coloured_schedule(pattern: sp.csr_array, group_size: int, shared_columns: bool) -> Schedule:
    """Groups of consecutive blocks, coloured so that groups of one colour do not interact.

    Parameters
    ----------
    pattern : (n, columns) sparse matrix, one row per block.
    group_size : blocks per group.
    shared_columns : True when blocks interact through common columns of `pattern` (matrix-free H), False when the
        entries of a square `pattern` are the interactions themselves (explicit W).

    Cost O(entries of the group interaction graph).
    """
    n = pattern.shape[0]
    groups = -(-n // group_size)
    ones = np.ones(n, dtype=np.int32)
    member = sp.csr_array((ones, (np.arange(n) // group_size, np.arange(n))), shape=(groups, n))
    links = sp.csr_array(
        (np.ones(pattern.nnz, np.int32), pattern.indices, pattern.indptr), shape=pattern.shape
    )
    reach = sp.csr_array(member @ links)
    conflict = sp.csr_array(reach @ (reach.T if shared_columns else member.T))
    colour = _greedy(conflict.indptr.astype(np.int32), conflict.indices.astype(np.int32))
    by_colour = np.argsort(colour, kind="stable")
    starts = by_colour * group_size
    sizes = np.minimum(group_size, n - starts)
    order = np.concatenate([np.arange(a, a + size) for a, size in zip(starts, sizes, strict=True)])
    colour_ptr = np.concatenate([[0], np.cumsum(np.bincount(colour))])
    group_ptr = np.concatenate([[0], np.cumsum(sizes)])
    return Schedule(colour_ptr.astype(np.int32), group_ptr.astype(np.int32), order.astype(np.int32))
