"""Cutting compressed rows into dense blocks, compiled: SciPy's own conversion costs more than solving a small problem."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def count_blocks(indptr, indices, s, q, columns):
    """Pointers (n+1,) of the block rows of a compressed-row matrix cut into s x q blocks. Cost O(entries)."""
    n = (len(indptr) - 1) // s
    pointers = np.zeros(n + 1, np.int32)
    seen = np.full(columns, -1)
    for i in range(n):
        count = 0
        for entry in range(indptr[i * s], indptr[(i + 1) * s]):
            j = indices[entry] // q
            if seen[j] != i:
                seen[j] = i
                count += 1
        pointers[i + 1] = pointers[i] + count
    return pointers


@njit(cache=True)
def fill_blocks(indptr, indices, values, s, q, columns, pointers):
    """Block columns (nnz,), increasing in each row, and blocks (nnz, s, q); entries given twice are added up."""
    n = len(pointers) - 1
    chosen = np.empty(pointers[n], np.int32)
    data = np.zeros((pointers[n], s, q))
    place = np.full(columns, -1)
    for i in range(n):
        first, last = pointers[i], pointers[i]
        for entry in range(indptr[i * s], indptr[(i + 1) * s]):
            j = indices[entry] // q
            if place[j] < first:
                place[j] = first
                chosen[last] = j
                last += 1
        row = chosen[first:last]
        row.sort()
        for k in range(last - first):
            place[row[k]] = first + k
        for a in range(s):
            for entry in range(indptr[i * s + a], indptr[i * s + a + 1]):
                j = indices[entry] // q
                data[place[j], a, indices[entry] - q * j] += values[entry]
        for k in range(last - first):
            place[row[k]] = -1
    return chosen, data


@njit(cache=True)
def diagonal_of_blocks(indptr, indices, data, out):
    """out (n, s, s) = diagonal blocks (zero where none is stored)."""
    for i in range(len(indptr) - 1):
        out[i] = 0.0
        for entry in range(indptr[i], indptr[i + 1]):
            if indices[entry] == i:
                out[i] = data[entry]
