"""Kernels of matrices of dense blocks along the diagonal, one a component: Cholesky factors, rows of H times their inverse.

Block c has order m_c = starts[c + 1] - starts[c] and lies row by row from offsets[c] on. Whitened rows G_i = H_i L^-T are kept
in pieces of PIECE unknowns, laid out (PIECE, s); a component is padded to whole pieces, and the rows of a block on a component
reach from their first unknown to its end.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[Any]

PIECE = 4


@njit(cache=True)
def largest_asymmetry(indptr: Numbers, indices: Numbers, data: Array) -> float:
    """Largest |a_ij - a_ji| of a square matrix in sorted compressed rows without duplicates. Cost O(entries)."""
    m = len(indptr) - 1
    ahead = indptr[:m].copy()  # first entry of each row that has not met its partner
    worst = 0.0
    for i in range(m):
        for e in range(indptr[i], indptr[i + 1]):
            j = indices[e]
            while ahead[j] < indptr[j + 1] and indices[ahead[j]] < i:
                worst = max(worst, abs(data[ahead[j]]))
                ahead[j] += 1
            if ahead[j] < indptr[j + 1] and indices[ahead[j]] == i:
                worst = max(worst, abs(data[e] - data[ahead[j]]))
                ahead[j] += 1
            else:
                worst = max(worst, abs(data[e]))
    for j in range(m):
        for e in range(ahead[j], indptr[j + 1]):
            worst = max(worst, abs(data[e]))
    return worst


@njit(cache=True)
def gather_blocks(
    indptr: Numbers, indices: Numbers, data: Array, label: Numbers, place: Numbers, starts: Numbers, offsets: Numbers,
    out: Array,
) -> None:  # fmt: skip
    """Dense blocks of a matrix in compressed rows; `label` (m,) component and `place` (m,) place of each unknown."""
    for i in range(len(indptr) - 1):
        c = label[i]
        m = starts[c + 1] - starts[c]
        at = offsets[c] + (place[i] - starts[c]) * m - starts[c]
        for e in range(indptr[i], indptr[i + 1]):
            out[at + place[indices[e]]] += data[e]


@njit(cache=True, parallel=True, error_model="numpy")
def cholesky_blocks(starts: Numbers, offsets: Numbers, blocks: Array, failed: NDArray[np.bool_]) -> None:
    """Lower factors in place (what is above the diagonal stays); failed (c,): a pivot was not positive."""
    for c in prange(len(starts) - 1):
        m = starts[c + 1] - starts[c]
        a = blocks[offsets[c] : offsets[c] + m * m]
        for i in range(m):
            for j in range(i + 1):
                total = a[i * m + j]
                for k in range(j):
                    total -= a[i * m + k] * a[j * m + k]
                if i > j:
                    a[i * m + j] = total / a[j * m + j]
                elif total > 0.0:
                    a[i * m + i] = np.sqrt(total)
                else:
                    failed[c] = True
                    a[i * m + i] = 1.0


@njit(cache=True, parallel=True, error_model="numpy")
def solve_blocks(
    starts: Numbers, offsets: Numbers, factors: Array, order: Numbers, rhs: Array, out: Array
) -> None:
    """out (m, k) with M out = rhs (m, k); unknown order[p] stands at place p."""
    for c in prange(len(starts) - 1):
        first, m = starts[c], starts[c + 1] - starts[c]
        a = factors[offsets[c] : offsets[c] + m * m]
        for column in range(rhs.shape[1]):
            for i in range(m):
                total = rhs[order[first + i], column]
                for k in range(i):
                    total -= a[i * m + k] * out[order[first + k], column]
                out[order[first + i], column] = total / a[i * m + i]
            for i in range(m - 1, -1, -1):
                value = out[order[first + i], column] / a[i * m + i]
                out[order[first + i], column] = value
                for k in range(i):
                    out[order[first + k], column] -= a[i * m + k] * value


@njit(cache=True, parallel=True, error_model="numpy")
def inverse_blocks(starts: Numbers, offsets: Numbers, factors: Array, out: Array) -> None:
    """Dense inverses of the blocks from their lower factors, laid out like these."""
    for c in prange(len(starts) - 1):
        m = starts[c + 1] - starts[c]
        a = factors[offsets[c] : offsets[c] + m * m]
        x = out[offsets[c] : offsets[c] + m * m]
        for j in range(m):  # rows of x: columns of the inverse, which is symmetric
            for i in range(m):
                total = 1.0 if i == j else 0.0
                for k in range(i):
                    total -= a[i * m + k] * x[j * m + k]
                x[j * m + i] = total / a[i * m + i]
            for i in range(m - 1, -1, -1):
                value = x[j * m + i] / a[i * m + i]
                x[j * m + i] = value
                for k in range(i):
                    x[j * m + k] -= a[i * m + k] * value
        for i in range(m):
            for j in range(i):
                mean = 0.5 * (x[i * m + j] + x[j * m + i])
                x[i * m + j] = x[j * m + i] = mean


@njit(cache=True)
def touched_components(
    indptr: Numbers, indices: Numbers, s: int, label: Numbers, place: Numbers, count: int, pointers: Numbers, found: Numbers,
    first: Numbers,
) -> None:  # fmt: skip
    """Components that each block of s rows touches, in increasing order, and the first place touched in each.

    With an empty `found` only the numbers are counted, in pointers[1:].
    """
    seen = np.full(count, -1, np.int64)
    entry = np.zeros(count, np.int64)
    for i in range(len(pointers) - 1):
        at = pointers[i]
        for e in range(indptr[i * s], indptr[(i + 1) * s]):
            c = label[indices[e]]
            if seen[c] != i:
                seen[c] = i
                entry[c] = at
                if len(found):
                    found[at] = c
                    first[at] = place[indices[e]]
                at += 1
            elif len(found):
                first[entry[c]] = min(first[entry[c]], place[indices[e]])
        if not len(found):
            pointers[i + 1] = at
            continue
        for e in range(pointers[i] + 1, at):
            c, p = found[e], first[e]
            k = e
            while k > pointers[i] and found[k - 1] > c:
                found[k], first[k] = found[k - 1], first[k - 1]
                k -= 1
            found[k], first[k] = c, p


@njit(cache=True, parallel=True, error_model="numpy")
def whiten_rows(
    rows: tuple[Numbers, Numbers, Array], label: Numbers, place: Numbers, starts: Numbers, offsets: Numbers, factors: Array,
    pointers: Numbers, component: Numbers, piece: Numbers, data: Array,
) -> None:  # fmt: skip
    """data (p, PIECE, s): the pieces of L^-1 H_i^T of every entry e of every block row, from piece[e] to piece[e + 1].

    data has to be zero. The last piece of an entry is the last of its component.
    """
    indptr, indices, values = rows
    s = data.shape[2]
    for i in prange(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            c = component[e]
            m = starts[c + 1] - starts[c]
            padded = PIECE * ((m + PIECE - 1) // PIECE)
            begin = padded - PIECE * (piece[e + 1] - piece[e])  # first unknown that is kept
            base = PIECE * piece[e] - begin
            for a in range(s):
                for entry in range(indptr[i * s + a], indptr[i * s + a + 1]):
                    if label[indices[entry]] == c:
                        at = base + place[indices[entry]] - starts[c]
                        data[at // PIECE, at % PIECE, a] += values[entry]
            for p in range(begin, m):
                for k in range(begin, p):
                    factor = factors[offsets[c] + p * m + k]
                    for a in range(s):
                        data[(base + p) // PIECE, (base + p) % PIECE, a] -= (
                            factor * data[(base + k) // PIECE, (base + k) % PIECE, a]
                        )
                pivot = factors[offsets[c] + p * m + p]
                for a in range(s):
                    data[(base + p) // PIECE, (base + p) % PIECE, a] /= pivot


@njit(cache=True)
def entries_by_component(
    pointers: Numbers, component: Numbers, lists: Numbers, entries: Numbers, rows: Numbers
) -> None:
    """For each component the entries on it and their block rows, from lists[c] on, in the order of the rows."""
    for e in range(len(component)):
        lists[component[e] + 1] += 1
    for c in range(len(lists) - 1):
        lists[c + 1] += lists[c]
    place = lists[:-1].copy()
    for i in range(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            at = place[component[e]]
            entries[at], rows[at] = e, i
            place[component[e]] += 1


@njit(cache=True, parallel=True)
def count_neighbours(
    chunks: Numbers,
    pointers: Numbers,
    component: Numbers,
    lists: Numbers,
    rows: Numbers,
    indptr: Numbers,
    indices: Numbers,
) -> None:
    """Block rows that share a component with each one, itself included, sorted; with empty `indices` only their number."""
    n = len(pointers) - 1
    for chunk in prange(len(chunks) - 1):
        seen = np.full(n, -1, np.int64)
        for i in range(chunks[chunk], chunks[chunk + 1]):
            begin = indptr[i]  # read once: while rows are counted, another thread may be writing it
            at = begin
            seen[i] = i
            if len(indices):
                indices[at] = i
            at += 1
            for e in range(pointers[i], pointers[i + 1]):
                for t in range(lists[component[e]], lists[component[e] + 1]):
                    j = rows[t]
                    if seen[j] != i:
                        seen[j] = i
                        if len(indices):
                            indices[at] = j
                        at += 1
            if len(indices):
                indices[indptr[i] : at].sort()
            else:
                indptr[i + 1] = at - begin


@cache
def gram_kernel(S: int) -> Callable[..., None]:
    """Kernel of the blocks (nnz, S, S) of G G^T, symmetric to the last bit."""

    @njit(cache=True, parallel=True, fastmath={"contract"})
    def kernel(chunks, pointers, component, piece, lists, entries, rows, data, indptr, indices, out):  # type: ignore[no-untyped-def]
        n = len(pointers) - 1
        for chunk in prange(len(chunks) - 1):
            place = np.empty(n, np.int64)
            block = np.empty((S, S))
            for i in range(chunks[chunk], chunks[chunk + 1]):
                for t in range(indptr[i], indptr[i + 1]):
                    place[indices[t]] = t
                    out[t] = 0.0
                for e in range(pointers[i], pointers[i + 1]):
                    for t in range(lists[component[e]], lists[component[e] + 1]):
                        other = entries[t]
                        # pieces are aligned at the end of the component
                        shared = min(piece[e + 1] - piece[e], piece[other + 1] - piece[other])
                        one, two = piece[e + 1] - shared, piece[other + 1] - shared
                        block[:] = 0.0
                        for k in range(shared):
                            for c in range(PIECE):
                                for a in range(S):
                                    for b in range(S):
                                        block[a, b] += data[one + k, c, a] * data[two + k, c, b]
                        at = place[rows[t]]
                        for a in range(S):
                            for b in range(S):
                                out[at, a, b] += block[a, b]

    return kernel


@njit(cache=True, parallel=True)
def gram_diagonal(pointers: Numbers, piece: Numbers, data: Array, out: Array) -> None:
    """out (n, s, s) = diagonal blocks of G G^T."""
    s = data.shape[2]
    for i in prange(len(pointers) - 1):
        for a in range(s):
            for b in range(a + 1):
                total = 0.0
                for k in range(piece[pointers[i]], piece[pointers[i + 1]]):
                    for c in range(PIECE):
                        total += data[k, c, a] * data[k, c, b]
                out[i, a, b] = total
                out[i, b, a] = total
