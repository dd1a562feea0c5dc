"""What block solves need to know about W_ii, worked out once: regular blocks, and the eigenbasis of their Schur complements.

Compiled, because a small problem is solved in less time than NumPy needs to start a batched decomposition.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SINGULAR = 1e-10
PROXIMAL = 1e-3
_ROTATIONS = 60


@njit(cache=True, error_model="numpy")
def _diagonalise(a, vectors, precision):
    """Jacobi rotations until the squares off the diagonal of a symmetric (q, q) are `precision` of those on it; columns of
    `vectors` become the eigenvectors."""
    q = len(a)
    for i in range(q):
        for j in range(q):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_ROTATIONS):
        off, size = 0.0, 0.0
        for i in range(q):
            size += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off <= precision * size:
            return
        for i in range(q - 1):
            for j in range(i + 1, q):
                if a[i, j] == 0.0:
                    continue
                angle = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
                tangent = math.copysign(1.0, angle) / (abs(angle) + math.sqrt(angle * angle + 1.0))
                cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for k in range(q):
                    x, y = a[k, i], a[k, j]
                    a[k, i], a[k, j] = cosine * x - sine * y, sine * x + cosine * y
                for k in range(q):
                    x, y = a[i, k], a[j, k]
                    a[i, k], a[j, k] = cosine * x - sine * y, sine * x + cosine * y
                for k in range(q):
                    x, y = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = cosine * x - sine * y, sine * x + cosine * y


@njit(cache=True, error_model="numpy")
def _smallest_eigenvalue(block, work, vectors):
    s = len(block)
    for i in range(s):
        for j in range(s):
            work[i, j] = block[i, j]
    _diagonalise(work, vectors, 1e-20)
    smallest = work[0, 0]
    for i in range(1, s):
        smallest = min(smallest, work[i, i])
    return smallest


@njit(cache=True, error_model="numpy")
def regular_blocks(blocks, out):
    """Symmetric parts of blocks (n, s, s), plus beta I where singular or nearly so (seed B Eq. 3.14).

    beta is a fraction PROXIMAL of the block's mean eigenvalue (of the mean over all blocks where the block vanishes).
    """
    n, s, _ = blocks.shape
    work, vectors = np.empty((s, s)), np.empty((s, s))
    typical, count = 0.0, 0
    for i in range(n):
        trace = 0.0
        for k in range(s):
            trace += blocks[i, k, k]
        if trace > 0.0:
            typical += trace / s
            count += 1
    typical = typical / count if count else 1.0
    for i in range(n):
        mean = 0.0
        for k in range(s):
            mean += blocks[i, k, k] / s
            for m in range(s):
                out[i, k, m] = 0.5 * (blocks[i, k, m] + blocks[i, m, k])
        smallest = _smallest_eigenvalue(out[i], work, vectors)
        if mean <= 0.0:
            mean = typical
        if smallest <= SINGULAR * mean:
            for k in range(s):
                out[i, k, k] += PROXIMAL * mean


@njit(cache=True, error_model="numpy")
def decompose(blocks, rows):
    """Rows [W_NN, Q^T w / W_NN, eigenvalues of T, Q row by row] of regular blocks (n, s, s); T = W_TT - w w^T / W_NN."""
    n, s, _ = blocks.shape
    q = s - 1
    schur, vectors = np.empty((q, q)), np.empty((q, q))
    for i in range(n):
        normal = blocks[i, 0, 0]
        trace = normal
        for a in range(q):
            trace += blocks[i, 1 + a, 1 + a]
            for b in range(q):
                schur[a, b] = blocks[i, 1 + a, 1 + b] - blocks[i, 1 + a, 0] * blocks[i, 1 + b, 0] / normal
        _diagonalise(schur, vectors, 1e-30)
        rows[i, 0] = normal
        for a in range(q):
            value = 0.0
            for b in range(q):
                value += vectors[b, a] * blocks[i, 1 + b, 0]
                rows[i, 2 * s - 1 + b * q + a] = vectors[b, a]
            rows[i, 1 + a] = value / normal
            rows[i, s + a] = max(schur[a, a], 2.220446049250313e-16 * trace)


def local_blocks(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Regular blocks (n, s, s) and their decomposition (n, 1 + 2 (s - 1) + (s - 1)^2) for the secular local solver."""
    n, s, _ = blocks.shape
    regular, rows = np.empty((n, s, s)), np.empty((n, 1 + 2 * (s - 1) + (s - 1) ** 2))
    regular_blocks(np.ascontiguousarray(blocks, dtype=float), regular)
    decompose(regular, rows)
    return regular, rows
