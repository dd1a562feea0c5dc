"""Compiled loops of the block Vanka smoother: inverses of patch matrices, multiplicative sweeps over patches, residuals.

A patch holds the unknowns of one cell; its correction solves the cell's equations with all other unknowns held (seed C 4.3,
"local pressure Schur complement" smoothing). Blocks of patches that run together touch no unknown of one another.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

CHUNKS = 64
LANES = 8  # rows of an inverse are padded to whole vector registers
SINGULAR = 1e-13  # pivot of an equilibrated patch matrix taken for zero
FAST = {"reassoc", "contract", "nsz"}


@njit(cache=True, error_model="numpy")
def _equilibrate(a: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> None:
    """a <- diag(rows) a diag(columns) with largest entries of size one, by powers of two."""
    n = a.shape[0]
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(a[i, j]))
        rows[i] = 2.0 ** -np.round(np.log2(largest)) if largest > 0.0 else 1.0
        for j in range(n):
            a[i, j] *= rows[i]
    for j in range(n):
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(a[i, j]))
        columns[j] = 2.0 ** -np.round(np.log2(largest)) if largest > 0.0 else 1.0
    for i in range(n):
        for j in range(n):
            a[i, j] *= columns[j]


@njit(cache=True, error_model="numpy")
def _invert(a: np.ndarray, swaps: np.ndarray) -> None:
    """a <- a^-1 by Gauss-Jordan elimination, rows exchanged; a direction without a pivot gets one of size one."""
    n = a.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[p, k]):
                p = i
        swaps[k] = p
        if p != k:
            for j in range(n):
                a[k, j], a[p, j] = a[p, j], a[k, j]
        if abs(a[k, k]) < SINGULAR:
            a[k, k] = 1.0
        inverse = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] *= inverse
        for i in range(n):
            factor = a[i, k]
            if i != k and factor != 0.0:
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]
    for k in range(n - 1, -1, -1):
        p = swaps[k]
        if p != k:
            for i in range(n):
                a[i, k], a[i, p] = a[i, p], a[i, k]


@njit(cache=True, error_model="numpy", parallel=True)
def invert_patches(data: np.ndarray, positions: np.ndarray, inverses: np.ndarray) -> None:
    """inverses (C, n, padded), transposed, of the patch matrices data[positions] (C, n, n)."""
    count, n = positions.shape[0], positions.shape[1]
    for chunk in prange(CHUNKS):
        a = np.empty((n, n))
        rows, columns, swaps = np.empty(n), np.empty(n), np.empty(n, np.int64)
        for c in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            for i in range(n):
                for j in range(n):
                    a[i, j] = data[positions[c, i, j]]
            _equilibrate(a, rows, columns)
            _invert(a, swaps)
            for j in range(n):
                for i in range(n):
                    inverses[c, j, i] = a[i, j] * columns[i] * rows[j]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _correct(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, twins: np.ndarray, patch: np.ndarray,
    inverse: np.ndarray, x: np.ndarray, b: np.ndarray, damping: float, d: np.ndarray,
) -> None:  # fmt: skip
    """x[patch] += damping inverse (b - A x)[patch]; `d` is scratch of the padded length."""
    n, padded = len(patch), len(d)
    for i in range(padded):
        d[i] = 0.0
    a = 0
    while a < n:
        row = patch[a]
        begin, end = indptr[row], indptr[row + 1]
        if a + 1 < n and patch[a + 1] == row + 1 and twins[row]:
            first, second, shift = b[row], b[row + 1], end - begin
            for k in range(begin, end):
                value = x[indices[k]]
                first -= data[k] * value
                second -= data[k + shift] * value
            for i in range(padded):
                d[i] += inverse[a, i] * first + inverse[a + 1, i] * second
            a += 2
        else:
            first = b[row]
            for k in range(begin, end):
                first -= data[k] * x[indices[k]]
            for i in range(padded):
                d[i] += inverse[a, i] * first
            a += 1
    for i in range(n):
        x[patch[i]] += damping * d[i]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def sweep_in_order(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, twins: np.ndarray, patches: np.ndarray,
    inverses: np.ndarray, x: np.ndarray, b: np.ndarray, sweeps: int, backward: bool, damping: float,
) -> None:  # fmt: skip
    """Sweeps over all patches, one after the other."""
    count = len(patches)
    d = np.zeros(inverses.shape[2], x.dtype)
    for _ in range(sweeps):
        for step in range(count):
            c = count - 1 - step if backward else step
            _correct(indptr, indices, data, twins, patches[c], inverses[c], x, b, damping, d)


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True)
def sweep_by_colour(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, twins: np.ndarray, patches: np.ndarray,
    inverses: np.ndarray, x: np.ndarray, b: np.ndarray, sweeps: int, backward: bool, damping: float,
    colours: np.ndarray, blocks: np.ndarray, length: int, scratch: np.ndarray,
) -> None:  # fmt: skip
    """Sweeps colour after colour; `blocks` of `length` consecutive patches in the order of the colours (pointers `colours`).

    Blocks of a colour share nothing, so that the result is the same in any order; `scratch` is (widest colour, padded).
    """
    count, number = len(patches), len(colours) - 1
    for _ in range(sweeps):
        for turn in range(number):
            colour = number - 1 - turn if backward else turn
            start = colours[colour]
            for place in prange(colours[colour + 1] - start):
                first = blocks[start + place] * length
                last = min(first + length, count)
                for step in range(last - first):
                    c = last - 1 - step if backward else first + step
                    _correct(
                        indptr, indices, data, twins, patches[c], inverses[c], x, b, damping, scratch[place]
                    )


@njit(cache=True, error_model="numpy", fastmath=FAST, parallel=True)
def residual(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, x: np.ndarray, b: np.ndarray, out: np.ndarray
) -> None:
    """out = b - A x."""
    for i in prange(len(b)):
        value = b[i]
        for k in range(indptr[i], indptr[i + 1]):
            value -= data[k] * x[indices[k]]
        out[i] = value


@njit(cache=True, error_model="numpy", fastmath=FAST)
def residual_in_order(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, x: np.ndarray, b: np.ndarray, out: np.ndarray
) -> None:
    """`residual` on the calling thread: starting others costs more than a small matrix."""
    for i in range(len(b)):
        value = b[i]
        for k in range(indptr[i], indptr[i + 1]):
            value -= data[k] * x[indices[k]]
        out[i] = value


@njit(cache=True, error_model="numpy")
def twin_rows(indptr: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """(size,) true where the next row has the same columns: the two components of a velocity."""
    size = len(indptr) - 1
    twins = np.zeros(size, np.bool_)
    for i in range(size - 1):
        begin, middle, end = indptr[i], indptr[i + 1], indptr[i + 2]
        if end - middle == middle - begin:
            same = True
            for k in range(middle - begin):
                if indices[begin + k] != indices[middle + k]:
                    same = False
                    break
            twins[i] = same
    return twins


@njit(cache=True, error_model="numpy")
def visiting_order(patches: np.ndarray, size: int) -> np.ndarray:
    """(size,) unknowns in the order in which the patches first touch them, those of no patch last."""
    order, seen = np.empty(size, np.int32), np.zeros(size, np.bool_)
    count = 0
    for c in range(len(patches)):
        for i in patches[c]:
            if not seen[i]:
                seen[i] = True
                order[count] = i
                count += 1
    for i in range(size):
        if not seen[i]:
            order[count] = i
            count += 1
    return order


@njit(cache=True, error_model="numpy", parallel=True)
def permute_columns(
    indptr: np.ndarray,
    indices: np.ndarray,
    order: np.ndarray,
    place: np.ndarray,
    new: np.ndarray,
    out: np.ndarray,
) -> None:
    """out = column numbers of the rows `order`, renumbered by `place`; `new` are the row pointers."""
    for i in prange(len(order)):
        begin = indptr[order[i]]
        for k in range(new[i + 1] - new[i]):
            out[new[i] + k] = place[indices[begin + k]]


@njit(cache=True, error_model="numpy", parallel=True)
def permute_data(
    indptr: np.ndarray, data: np.ndarray, order: np.ndarray, new: np.ndarray, out: np.ndarray
) -> None:
    """out = entries of the rows `order`."""
    for i in prange(len(order)):
        begin = indptr[order[i]]
        for k in range(new[i + 1] - new[i]):
            out[new[i] + k] = data[begin + k]
