"""Compiled loops of the geometric multigrid: element matrices of a coarse cell from its four children, turned at their nodes.

The velocity transfer of a child is one 9 x 9 table for both components, the pressure transfer a 3 x 3 matrix of its own.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

CHUNKS = 64


@njit(cache=True, error_model="numpy")
def _from_the_right(
    element: np.ndarray, table: np.ndarray, pressure: np.ndarray, rows: int, out: np.ndarray
) -> None:
    """out = element diag(table x I2, pressure), of `rows` rows."""
    k = table.shape[0]
    m = pressure.shape[0]
    for i in range(rows):
        for j in range(2 * k + m):
            out[i, j] = 0.0
        for f in range(k):
            first, second = element[i, 2 * f], element[i, 2 * f + 1]
            for c in range(k):
                out[i, 2 * c] += table[f, c] * first
                out[i, 2 * c + 1] += table[f, c] * second
        for f in range(m):
            value = element[i, 2 * k + f]
            for c in range(m):
                out[i, 2 * k + c] += pressure[f, c] * value


@njit(cache=True, error_model="numpy")
def _add_from_the_left(
    half: np.ndarray, table: np.ndarray, pressure: np.ndarray, columns: int, coarse: np.ndarray
) -> None:
    """coarse += diag(table x I2, pressure)^T half."""
    k = table.shape[0]
    m = pressure.shape[0]
    for f in range(k):
        for c in range(k):
            weight = table[f, c]
            if weight != 0.0:
                for j in range(columns):
                    coarse[2 * c, j] += weight * half[2 * f, j]
                    coarse[2 * c + 1, j] += weight * half[2 * f + 1, j]
    for f in range(m):
        for c in range(m):
            weight = pressure[f, c]
            if weight != 0.0:
                for j in range(columns):
                    coarse[2 * k + c, j] += weight * half[2 * k + f, j]


@njit(cache=True, error_model="numpy", parallel=True)
def coarse_elements(fine: np.ndarray, tables: np.ndarray, pressures: np.ndarray, coarse: np.ndarray) -> None:
    """coarse (C, n, n) = sum over the children j of T_j^T fine[4 C + j] T_j."""
    cells, n = coarse.shape[0], coarse.shape[1]
    for chunk in prange(CHUNKS):
        half = np.empty((n, n))
        for K in range(chunk * cells // CHUNKS, (chunk + 1) * cells // CHUNKS):
            coarse[K] = 0.0
            for j in range(4):
                _from_the_right(fine[4 * K + j], tables[j], pressures[4 * K + j], n, half)
                _add_from_the_left(half, tables[j], pressures[4 * K + j], n, coarse[K])


@njit(cache=True, error_model="numpy", parallel=True)
def rotate_elements(elements: np.ndarray, cell_nodes: np.ndarray, frames: np.ndarray) -> None:
    """elements <- F^T elements F, F the 2 x 2 `frames` (N, 2, 2) of the nodes of each cell and the identity on pressures."""
    cells, k = cell_nodes.shape
    n = elements.shape[1]
    for cell in prange(cells):
        for a in range(k):
            F = frames[cell_nodes[cell, a]]
            if F[0, 0] != 1.0 or F[1, 1] != 1.0:
                for i in range(n):
                    u, v = elements[cell, i, 2 * a], elements[cell, i, 2 * a + 1]
                    elements[cell, i, 2 * a] = u * F[0, 0] + v * F[1, 0]
                    elements[cell, i, 2 * a + 1] = u * F[0, 1] + v * F[1, 1]
                for j in range(n):
                    u, v = elements[cell, 2 * a, j], elements[cell, 2 * a + 1, j]
                    elements[cell, 2 * a, j] = u * F[0, 0] + v * F[1, 0]
                    elements[cell, 2 * a + 1, j] = u * F[0, 1] + v * F[1, 1]


@njit(cache=True, error_model="numpy", parallel=True)
def row_weights(
    indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, velocities: int, out: np.ndarray
) -> None:
    """out: 1/sqrt|A_ii| of momentum rows, 1/sqrt(sum_j B_ij^2 / |A_jj|) of continuity rows: residuals in one unit."""
    size = len(indptr) - 1
    diagonal = np.ones(size)
    for i in prange(size):
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] == i:
                diagonal[i] = abs(data[k])
    for i in prange(size):
        value = diagonal[i]
        if i >= velocities:
            value = 0.0
            for k in range(indptr[i], indptr[i + 1]):
                j = indices[k]
                if j < velocities and diagonal[j] > 0.0:
                    value += data[k] * data[k] / diagonal[j]
        out[i] = 1.0 / np.sqrt(value) if value > 0.0 else 1.0
