"""What block solves need to know about W_ii, worked out once: regular blocks, and the eigenbasis of their Schur complements.

Compiled, because a small problem is solved in less time than NumPy needs to start a batched decomposition.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit, prange

SINGULAR = 1e-10
PROXIMAL = 1e-3
_ROTATIONS = 60
CHUNK, PARALLEL_CHUNKS = 128, 12


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
def _is_regular(block, bound, pivots):
    """Whether all eigenvalues of a symmetric (s, s) exceed `bound`: no pivot of block - bound I is negative (Sylvester)."""
    s = len(block)
    for i in range(s):
        for j in range(i + 1):
            value = block[i, j] - (bound if i == j else 0.0)
            for k in range(j):
                value -= pivots[i, k] * pivots[j, k]
            if i == j:
                if not value > 0.0:
                    return False
                pivots[i, i] = math.sqrt(value)
            else:
                pivots[i, j] = value / pivots[j, j]
    return True


@njit(cache=True, error_model="numpy")
def typical_eigenvalue(blocks):
    """Mean over the blocks (n, s, s) that do not vanish of their mean eigenvalue; 1 if all vanish."""
    n, s, _ = blocks.shape
    typical, count = 0.0, 0
    for i in range(n):
        trace = 0.0
        for k in range(s):
            trace += blocks[i, k, k]
        if trace > 0.0:
            typical += trace / s
            count += 1
    return typical / count if count else 1.0


@njit(cache=True, error_model="numpy")
def _regularise(block, typical, work, out):
    """Symmetric part of a block (s, s), plus beta I where singular or nearly so (seed B Eq. 3.14).

    beta is a fraction PROXIMAL of the block's mean eigenvalue (of the `typical` one where the block vanishes).
    """
    s = len(block)
    mean = 0.0
    for k in range(s):
        mean += block[k, k] / s
        for m in range(s):
            out[k, m] = 0.5 * (block[k, m] + block[m, k])
    if mean <= 0.0:
        mean = typical
    if not _is_regular(out, SINGULAR * mean, work):
        for k in range(s):
            out[k, k] += PROXIMAL * mean


@njit(cache=True, error_model="numpy")
def _decompose(block, schur, vectors, row):
    """Row [W_NN, Q^T w / W_NN, eigenvalues of T, Q row by row] of a regular block (s, s); T = W_TT - w w^T / W_NN."""
    s = len(block)
    q = s - 1
    normal = block[0, 0]
    trace = normal
    for a in range(q):
        trace += block[1 + a, 1 + a]
        for b in range(q):
            schur[a, b] = block[1 + a, 1 + b] - block[1 + a, 0] * block[1 + b, 0] / normal
    _diagonalise(schur, vectors, 1e-30)
    row[0] = normal
    for a in range(q):
        value = 0.0
        for b in range(q):
            value += vectors[b, a] * block[1 + b, 0]
            row[2 * s - 1 + b * q + a] = vectors[b, a]
        row[1 + a] = value / normal
        row[s + a] = max(schur[a, a], 2.220446049250313e-16 * trace)


@cache
def _prepare(PARALLEL: bool) -> Callable[..., None]:
    """Kernel: regular blocks (n, s, s) and rows of their decomposition, in chunks of CHUNK blocks."""

    @njit(cache=True, error_model="numpy", parallel=PARALLEL)
    def kernel(blocks, typical, regular, rows):
        n, s, _ = blocks.shape
        for chunk in prange(-(-n // CHUNK)):
            work, schur, vectors = np.empty((s, s)), np.empty((s - 1, s - 1)), np.empty((s - 1, s - 1))
            for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
                _regularise(blocks[i], typical, work, regular[i])
                _decompose(regular[i], schur, vectors, rows[i])

    return kernel


def local_blocks(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Regular blocks (n, s, s) and their decomposition (n, 1 + 2 (s - 1) + (s - 1)^2) for the secular local solver."""
    n, s, _ = blocks.shape
    regular, rows = np.empty((n, s, s)), np.empty((n, 1 + 2 * (s - 1) + (s - 1) ** 2))
    blocks = np.ascontiguousarray(blocks, dtype=float)
    _prepare(n >= PARALLEL_CHUNKS * CHUNK)(blocks, typical_eigenvalue(blocks), regular, rows)
    return regular, rows
