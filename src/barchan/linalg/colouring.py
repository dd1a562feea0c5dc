"""Order of the blocks in a Gauss-Seidel sweep: natural, or coloured groups for deterministic parallelism (seed B 3.4.3).

Two groups conflict when they touch a common unknown; a greedy colouring in index order gives groups that may run at once.
Unknowns that very many groups touch (a body among grains) would take a colour each: their blocks form one serial group.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numba import njit

# Blocks that touch a common unknown, beyond which they are swept one after the other in a group of their own.
HUB = 512
# Slabs that a problem is cut into, and how often slabs are cut: along each axis of a grid in space.
SLABS = 48
_CUTS = 3
_UNDECIDED, _SERIAL = -1, -2


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
def _rows_by_column(indptr: np.ndarray, indices: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    pointers = np.zeros(columns + 1, dtype=np.int64)
    for j in indices:
        pointers[j + 1] += 1
    for j in range(columns):
        pointers[j + 1] += pointers[j]
    place = pointers[:columns].copy()
    rows = np.empty(len(indices), dtype=np.int32)
    for i in range(len(indptr) - 1):
        for entry in range(indptr[i], indptr[i + 1]):
            rows[place[indices[entry]]] = i
            place[indices[entry]] += 1
    return pointers, rows


@njit(cache=True, error_model="numpy")
def _set_hubs_apart(pointers: np.ndarray, rows: np.ndarray, label: np.ndarray) -> None:
    for j in range(len(pointers) - 1):
        if pointers[j + 1] - pointers[j] > HUB:
            for place in range(pointers[j], pointers[j + 1]):
                label[rows[place]] = _SERIAL


@njit(cache=True, error_model="numpy")
def _breadth_first(
    start: int,
    part: int,
    pattern: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    label: np.ndarray,
    seen: tuple[np.ndarray, np.ndarray],
    stamp: int,
    queue: np.ndarray,
    levels: np.ndarray,
) -> int:
    """Blocks of `part` reached from `start` through common unknowns, into `queue` by levels; how many levels.

    `levels` gets the first place of each level and the end; `seen` blocks and unknowns are those marked with `stamp`.
    """
    indptr, indices, pointers, rows = pattern
    seen_rows, seen_columns = seen
    queue[0] = start
    seen_rows[start] = stamp
    head, tail, count = 0, 1, 0
    levels[0] = 0
    while head < tail:
        end = tail
        while head < end:
            i = queue[head]
            head += 1
            for entry in range(indptr[i], indptr[i + 1]):
                j = indices[entry]
                if seen_columns[j] == stamp:
                    continue
                seen_columns[j] = stamp
                for place in range(pointers[j], pointers[j + 1]):
                    other = rows[place]
                    if label[other] == part and seen_rows[other] != stamp:
                        seen_rows[other] = stamp
                        queue[tail] = other
                        tail += 1
        count += 1
        levels[count] = end
    return count


@njit(cache=True, error_model="numpy")
def _label_slabs(
    pattern: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], label: np.ndarray, target: int
) -> int:
    """Cut the blocks into slabs of whole levels of a breadth-first search, thick ones again across. How many slabs.

    Blocks interact within a level or with the next ones, so that every second slab may be swept at once. A search starts
    from the block that is farthest from the first one.
    """
    n, columns = len(label), len(pattern[2]) - 1
    seen = np.full(n, -1, dtype=np.int64), np.full(columns, -1, dtype=np.int64)
    queue, levels = np.empty(n, dtype=np.int32), np.empty(n + 2, dtype=np.int32)
    stamp, count = 0, 0
    for i in range(n):
        if label[i] == _UNDECIDED:
            label[i] = 0
            count = 1
    for _ in range(_CUTS):
        sizes = np.zeros(count, dtype=np.int64)
        for i in range(n):
            if label[i] >= 0:
                sizes[label[i]] += 1
        before = count
        for i in range(n):
            part = label[i]
            if part < 0 or part >= before or sizes[part] <= 2 * target:
                continue
            depth = _breadth_first(i, part, pattern, label, seen, stamp, queue, levels)
            last = queue[levels[depth] - 1]
            depth = _breadth_first(last, part, pattern, label, seen, stamp + 1, queue, levels)
            stamp += 2
            size = 0
            for level in range(depth):
                if size >= target:
                    count, size = count + 1, 0
                for place in range(levels[level], levels[level + 1]):
                    label[queue[place]] = count
                size += levels[level + 1] - levels[level]
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def _label_in_order(label: np.ndarray, group_size: int) -> int:
    """Groups of `group_size` consecutive blocks, those set apart left out. How many."""
    highest = -1
    for i in range(len(label)):
        if label[i] == _UNDECIDED:
            label[i] = i // group_size
            highest = max(highest, label[i])
    return highest + 1


@njit(cache=True, error_model="numpy")
def _colour_shared(
    indptr: np.ndarray, indices: np.ndarray, columns: int, group_ptr: np.ndarray, order: np.ndarray
) -> np.ndarray:
    """Smallest colour of each group that no earlier group with a common column has; colours taken are bits of a column."""
    groups = len(group_ptr) - 1
    words = 1
    taken = np.zeros((columns, words), dtype=np.uint64)
    colour = np.zeros(groups, dtype=np.int32)
    for group in range(groups):
        pick = -1
        word = 0
        while pick < 0:
            if word == words:
                wider = np.zeros((columns, 2 * words), dtype=np.uint64)
                wider[:, :words] = taken
                taken, words = wider, 2 * words
            used = np.uint64(0)
            for place in range(group_ptr[group], group_ptr[group + 1]):
                i = order[place]
                for entry in range(indptr[i], indptr[i + 1]):
                    used |= taken[indices[entry], word]
            for bit in range(64):
                if not (used >> np.uint64(bit)) & np.uint64(1):
                    pick = 64 * word + bit
                    break
            word += 1
        colour[group] = pick
        mark = np.uint64(1) << np.uint64(pick % 64)
        for place in range(group_ptr[group], group_ptr[group + 1]):
            i = order[place]
            for entry in range(indptr[i], indptr[i + 1]):
                taken[indices[entry], pick // 64] |= mark
    return colour


@njit(cache=True, error_model="numpy")
def _colour_linked(
    indptr: np.ndarray, indices: np.ndarray, label: np.ndarray, group_ptr: np.ndarray, order: np.ndarray
) -> np.ndarray:
    """Smallest colour of each group that no earlier group linked to it by an entry has."""
    groups = len(group_ptr) - 1
    colour = np.full(groups, -1, dtype=np.int32)
    used = np.full(groups + 1, -1, dtype=np.int32)
    for group in range(groups):
        for place in range(group_ptr[group], group_ptr[group + 1]):
            i = order[place]
            for entry in range(indptr[i], indptr[i + 1]):
                other = label[indices[entry]]
                if other >= 0 and colour[other] >= 0:
                    used[colour[other]] = group
        pick = 0
        while used[pick] == group:
            pick += 1
        colour[group] = pick
    return colour


def coloured_schedule(
    pattern: sp.csr_array, group_size: int, shared_columns: bool, slabs: bool = False
) -> Schedule:
    """Groups of blocks, coloured so that groups of one colour do not interact.

    Parameters
    ----------
    pattern : (n, columns) sparse matrix, one row per block.
    group_size : blocks per group, consecutive ones.
    shared_columns : True when blocks interact through common columns of `pattern` (matrix-free H), False when the
        entries of a square `pattern` are the interactions themselves (explicit W).
    slabs : groups are slabs of at least n / SLABS and `group_size` blocks instead, each swept in index order: on a grid two
        to four colours, and the unknowns of a slab stay in the cache.

    Cost O(entries).
    """
    n, columns = pattern.shape
    indptr, indices = pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32)
    label = np.full(n, _UNDECIDED, dtype=np.int32)
    if shared_columns:
        by_column = _rows_by_column(indptr, indices, columns)
        _set_hubs_apart(*by_column, label)
    if slabs and shared_columns:
        count = _label_slabs((indptr, indices, *by_column), label, max(group_size, n // SLABS))
    else:
        count = _label_in_order(label, group_size)
    serial = label == _SERIAL
    members = np.argsort(np.where(serial, count, label), kind="stable").astype(np.int32)
    sizes = np.bincount(label[~serial], minlength=count)
    group_ptr = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    if shared_columns:
        colour = _colour_shared(indptr, indices, columns, group_ptr, members)
    else:
        colour = _colour_linked(indptr, indices, label, group_ptr, members)
    return _in_colours(colour, group_ptr, members)


def _in_colours(colour: np.ndarray, group_ptr: np.ndarray, members: np.ndarray) -> Schedule:
    """Groups sorted by colour, empty ones dropped; blocks beyond the last group follow as one group of a last colour."""
    sizes = np.diff(group_ptr)
    filled = np.flatnonzero(sizes)
    by_colour = filled[np.argsort(colour[filled], kind="stable")]
    sizes = sizes[by_colour]
    counts = np.bincount(colour[by_colour])
    shift = np.concatenate([[0], np.cumsum(sizes)])
    place = np.arange(shift[-1]) + np.repeat(group_ptr[by_colour] - shift[:-1], sizes)
    order, last = members[place], members[group_ptr[-1] :]
    if len(last):
        order, sizes, counts = np.append(order, last), np.append(sizes, len(last)), np.append(counts, 1)
    colour_ptr = np.concatenate([[0], np.cumsum(counts)])
    group_ptr = np.concatenate([[0], np.cumsum(sizes)])
    return Schedule(colour_ptr.astype(np.int32), group_ptr.astype(np.int32), order.astype(np.int32))
