"""Compiled loops of `barchan.linalg.cell_pattern`: rows of a pattern from cells, places of element entries, sums."""

from __future__ import annotations

from numba import njit, prange


@njit(cache=True, error_model="numpy")
def count_rows(unknowns, owner, pointers, counts, seen):
    """Lengths (size,) of the csr rows, diagonal included; `owner`, `pointers`: the cells of each unknown."""
    for i in range(len(counts)):
        seen[i] = i
        count = 1
        for a in range(pointers[i], pointers[i + 1]):
            cell = unknowns[owner[a]]
            for j in cell:
                if seen[j] != i:
                    seen[j] = i
                    count += 1
        counts[i] = count


@njit(cache=True, error_model="numpy")
def fill_rows(unknowns, owner, pointers, indptr, indices, seen, scratch):
    """Sorted columns of the csr rows."""
    for i in range(len(indptr) - 1):
        seen[i] = i
        scratch[0] = i
        count = 1
        for a in range(pointers[i], pointers[i + 1]):
            cell = unknowns[owner[a]]
            for j in cell:
                if seen[j] != i:
                    seen[j] = i
                    scratch[count] = j
                    count += 1
        # Cells of a row list their unknowns in runs: insertion sort is short.
        for k in range(1, count):
            value, m = scratch[k], k
            while m > 0 and scratch[m - 1] > value:
                scratch[m] = scratch[m - 1]
                m -= 1
            scratch[m] = value
        start = indptr[i]
        for k in range(count):
            indices[start + k] = scratch[k]


@njit(cache=True, parallel=True, error_model="numpy")
def find_positions(unknowns, indptr, indices, positions):
    """Place of each element entry in the csr data, by bisection."""
    cells, n = unknowns.shape
    for c in prange(cells):
        for a in range(n):
            row = unknowns[c, a]
            for b in range(n):
                column = unknowns[c, b]
                low, high = indptr[row], indptr[row + 1] - 1
                while low < high:
                    middle = (low + high) >> 1
                    if indices[middle] < column:
                        low = middle + 1
                    else:
                        high = middle
                positions[c, a, b] = low


@njit(cache=True, error_model="numpy")
def add_up(elements, positions, data):
    """data += elements at their places."""
    flat, place = elements.ravel(), positions.ravel()
    for k in range(len(flat)):
        data[place[k]] += flat[k]


@njit(cache=True, error_model="numpy")
def add_up_free(elements, positions, unknowns, fixed, data):
    """The same without the entries of fixed unknowns."""
    cells, n = unknowns.shape
    for c in range(cells):
        for a in range(n):
            if fixed[unknowns[c, a]]:
                continue
            for b in range(n):
                if not fixed[unknowns[c, b]]:
                    data[positions[c, a, b]] += elements[c, a, b]


@njit(cache=True, error_model="numpy")
def unit_rows(indptr, indices, fixed, data):
    """One on the diagonal of fixed unknowns."""
    for i in range(len(indptr) - 1):
        if fixed[i]:
            for k in range(indptr[i], indptr[i + 1]):
                if indices[k] == i:
                    data[k] = 1.0
