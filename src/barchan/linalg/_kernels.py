"""Cutting compressed rows into dense blocks, compiled: SciPy's own conversion costs more than solving a small problem."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


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
def add_transposed_product(indptr, indices, data, r, out):
    """out (columns, q) += transpose of the block rows times r (n, s)."""
    for i in range(len(indptr) - 1):
        for entry in range(indptr[i], indptr[i + 1]):
            j = indices[entry]
            for c in range(data.shape[2]):
                total = 0.0
                for k in range(data.shape[1]):
                    total += data[entry, k, c] * r[i, k]
                out[j, c] += total


@njit(cache=True)
def diagonal_of_blocks(indptr, indices, data, out):
    """out (n, s, s) = diagonal blocks (zero where none is stored)."""
    for i in range(len(indptr) - 1):
        out[i] = 0.0
        for entry in range(indptr[i], indptr[i + 1]):
            if indices[entry] == i:
                out[i] = data[entry]


@njit(cache=True)
def same_as_before(pointers, columns):
    """(n,) true where a row of blocks touches exactly the columns of the row before it."""
    n = len(pointers) - 1
    same = np.zeros(n, np.bool_)
    for i in range(1, n):
        k = pointers[i + 1] - pointers[i]
        if pointers[i] - pointers[i - 1] == k:
            same[i] = True
            for e in range(pointers[i], pointers[i + 1]):
                if columns[e] != columns[e - k]:
                    same[i] = False
                    break
    return same


@njit(cache=True)
def rows_of_blocks(pointers, data, out):
    """Entries (nnz, s) of block columns, laid out so that the s rows of each block lie one after the other in `out`."""
    s = data.shape[1]
    for i in range(len(pointers) - 1):
        first, k = pointers[i], pointers[i + 1] - pointers[i]
        for p in range(s):
            for e in range(k):
                out[s * first + p * k + e] = data[first + e, p]


@njit(cache=True, parallel=True)
def gram_pattern(chunks, known, known_columns, inverse, groups, pointers, columns, upper, indptr, indices):
    """Sorted columns of every row of M + H^T D H: those of M, of the groups that touch the row, and the diagonal.

    With an empty `indices` only the numbers of columns are found, in indptr[1:].
    """
    m = len(indptr) - 1
    for chunk in prange(len(chunks) - 1):
        seen = np.full(m, -1, np.int64)
        found = np.empty(m, indices.dtype)
        for a in range(chunks[chunk], chunks[chunk + 1]):
            seen[a] = a
            found[0] = a
            count = 1
            for e in range(known[a], known[a + 1]):
                j = known_columns[e]
                if seen[j] != a and (j > a or not upper):
                    seen[j] = a
                    found[count] = j
                    count += 1
            for t in range(inverse[a], inverse[a + 1]):
                for e in range(pointers[groups[t]], pointers[groups[t] + 1]):
                    j = columns[e]
                    if seen[j] != a and (j > a or not upper):
                        seen[j] = a
                        found[count] = j
                        count += 1
            if len(indices):
                row = found[:count]
                row.sort()
                indices[indptr[a] : indptr[a + 1]] = row
            else:
                indptr[a + 1] = count


@njit(cache=True)
def scatter_known(known, known_columns, values, indptr, indices, upper, out):
    """out (nnz,) += entries of M at their places in the pattern (which holds them all, sorted)."""
    for a in range(len(indptr) - 1):
        row = indices[indptr[a] : indptr[a + 1]]
        for e in range(known[a], known[a + 1]):
            if known_columns[e] >= a or not upper:
                out[indptr[a] + np.searchsorted(row, known_columns[e])] += values[e]


@njit(cache=True, parallel=True)
def gram_data(
    chunks,
    base,
    inverse,
    groups,
    local,
    pointers,
    columns,
    first_block,
    offsets,
    rows,
    D,
    upper,
    indptr,
    indices,
    out,
):
    """out (nnz,) = entries of M + H^T D H: every row gathers from the groups that touch it, in their order.

    No two threads write to the same row, so that sums do not depend on the number of threads. `rows` holds, at
    offsets[i], the s rows of H_i over the columns of its group; `local` says which of these columns the row is.
    """
    s, m = D.shape[1], len(indptr) - 1
    widest = 0
    for g in range(len(pointers) - 1):
        widest = max(widest, pointers[g + 1] - pointers[g])
    for chunk in prange(len(chunks) - 1):
        place = np.empty(m, np.int64)
        part = np.empty(widest)
        for a in range(chunks[chunk], chunks[chunk + 1]):
            for e in range(indptr[a], indptr[a + 1]):
                place[indices[e]] = e
                out[e] = base[e]
            for t in range(inverse[a], inverse[a + 1]):
                g, la = groups[t], local[t]
                k = pointers[g + 1] - pointers[g]
                begin = la if upper else 0
                part[begin:k] = 0.0
                for i in range(first_block[g], first_block[g + 1]):
                    block = rows[offsets[i] : offsets[i] + s * k]
                    for r in range(s):
                        factor = 0.0
                        for p in range(s):
                            factor += block[p * k + la] * D[i, p, r]
                        row = block[r * k : r * k + k]
                        for b in range(begin, k):
                            part[b] += factor * row[b]
                touched = columns[pointers[g] : pointers[g + 1]]
                for b in range(begin, k):
                    out[place[touched[b]]] += part[b]
