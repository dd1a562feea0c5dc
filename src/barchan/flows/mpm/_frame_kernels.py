"""Kernels on the small matrices that particles carry: exponentials, eigen-decompositions, products (seed B, Eq. 7.20).

Each particle is one independent iteration, so results do not depend on the thread count; the loops run over fixed blocks of
particles, so that the few small matrices each iteration needs are allocated once a block.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

CHUNK = 512
# Above this norm a matrix is halved before its exponential is approximated; the [6/6] fraction is then exact to 2e-17.
_PADE_NORM = 0.5
_JACOBI_SWEEPS = 30


@njit(cache=True, inline="always")
def chunk_bounds(chunk: int, count: int) -> tuple[int, int]:
    """First and last (excluded) particle of a block."""
    return chunk * CHUNK, min(count, (chunk + 1) * CHUNK)


@njit(cache=True)
def multiply(a: NDArray[np.float64], b: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """out = a b for (d, d) matrices; `out` is neither of them."""
    d = a.shape[0]
    for i in range(d):
        for j in range(d):
            total = 0.0
            for k in range(d):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@njit(cache=True)
def congruence(
    e: NDArray[np.float64], f: NDArray[np.float64], half: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """out = e f e^T, symmetric to the last bit, for a symmetric f; `half` is room for e f."""
    d = e.shape[0]
    multiply(e, f, half)
    for i in range(d):
        for j in range(i + 1):
            total = 0.0
            for k in range(d):
                total += half[i, k] * e[j, k]
            out[i, j] = total
            out[j, i] = total


@njit(cache=True)
def exponential(a: NDArray[np.float64], work: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """out = exp(a), a (d, d), by scaling and squaring of the [6/6] Pade fraction; `work` (5, d, d), `a` is kept."""
    d = a.shape[0]
    norm = 0.0
    for j in range(d):
        column = 0.0
        for i in range(d):
            column += abs(a[i, j])
        norm = max(norm, column)
    squarings, scale = 0, 1.0
    while norm * scale > _PADE_NORM:
        scale *= 0.5
        squarings += 1
    m, m2, m4, above, below = work[0], work[1], work[2], work[3], work[4]
    for i in range(d):
        for j in range(d):
            m[i, j] = a[i, j] * scale
    multiply(m, m, m2)
    multiply(m2, m2, m4)
    multiply(m4, m2, above)  # m^6, replaced below by the even part of the fraction
    for i in range(d):
        for j in range(d):
            one = 1.0 if i == j else 0.0
            below[i, j] = one / 2.0 + m2[i, j] / 66.0 + m4[i, j] / 15840.0
            above[i, j] = one + m2[i, j] * (5.0 / 44.0) + m4[i, j] / 792.0 + above[i, j] / 665280.0
    multiply(m, below, out)  # the odd part
    for i in range(d):
        for j in range(d):
            even, odd = above[i, j], out[i, j]
            below[i, j], out[i, j] = even - odd, even + odd
    _solve_in_place(below, out)
    for _ in range(squarings):
        multiply(out, out, m)
        for i in range(d):
            for j in range(d):
                out[i, j] = m[i, j]


@njit(cache=True)
def _solve_in_place(a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """b <- a^-1 b without pivoting: `a` is within 0.3 of the identity."""
    d = a.shape[0]
    for k in range(d):
        for i in range(k + 1, d):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, d):
                a[i, j] -= factor * a[k, j]
            for j in range(d):
                b[i, j] -= factor * b[k, j]
    for i in range(d - 1, -1, -1):
        for j in range(d):
            total = b[i, j]
            for k in range(i + 1, d):
                total -= a[i, k] * b[k, j]
            b[i, j] = total / a[i, i]


@njit(cache=True)
def eigen(a: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Cyclic Jacobi: the symmetric `a` (d, d) becomes diagonal, decreasing; row i of `vectors` belongs to a[i, i]."""
    d = a.shape[0]
    for i in range(d):
        for j in range(d):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_JACOBI_SWEEPS):
        turned = False
        for i in range(d - 1):
            for j in range(i + 1, d):
                size = np.sqrt(abs(a[i, i] * a[j, j]))
                if abs(a[i, j]) <= 1e-17 * size or abs(a[i, j]) < 1e-300:
                    a[i, j] = a[j, i] = 0.0
                    continue
                turned = True
                _rotate(a, vectors, i, j)
        if not turned:
            break
    for i in range(d - 1):
        for j in range(i + 1, d):
            if a[j, j] > a[i, i]:
                a[i, i], a[j, j] = a[j, j], a[i, i]
                for k in range(d):
                    vectors[i, k], vectors[j, k] = vectors[j, k], vectors[i, k]


@njit(cache=True)
def _rotate(a: NDArray[np.float64], vectors: NDArray[np.float64], i: int, j: int) -> None:
    """One Jacobi rotation, which makes a[i, j] vanish."""
    d = a.shape[0]
    theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    shift = t * a[i, j]
    a[i, i] -= shift
    a[j, j] += shift
    a[i, j] = a[j, i] = 0.0
    for k in range(d):
        if k != i and k != j:
            first, second = a[k, i], a[k, j]
            a[k, i] = a[i, k] = c * first - s * second
            a[k, j] = a[j, k] = s * first + c * second
        first, second = vectors[i, k], vectors[j, k]
        vectors[i, k] = c * first - s * second
        vectors[j, k] = s * first + c * second


@njit(cache=True)
def extreme_eigenvalues(a: NDArray[np.float64]) -> tuple[float, float]:
    """Largest and smallest eigenvalue of a symmetric (d, d) matrix in closed form, to 1e-15 of the largest."""
    if a.shape[0] == 2:
        mean, half = 0.5 * (a[0, 0] + a[1, 1]), 0.5 * (a[0, 0] - a[1, 1])
        radius = np.sqrt(half * half + a[0, 1] * a[0, 1])
        return mean + radius, mean - radius
    mean = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    x, y, z = a[0, 0] - mean, a[1, 1] - mean, a[2, 2] - mean
    u, v, w = a[0, 1], a[0, 2], a[1, 2]
    p = np.sqrt((x * x + y * y + z * z + 2.0 * (u * u + v * v + w * w)) / 6.0)
    if p == 0.0:
        return mean, mean
    x, y, z, u, v, w = x / p, y / p, z / p, u / p, v / p, w / p
    half_determinant = 0.5 * (x * (y * z - w * w) - u * (u * z - w * v) + v * (u * w - y * v))
    angle = np.arccos(min(1.0, max(-1.0, half_determinant))) / 3.0
    return mean + 2.0 * p * np.cos(angle), mean + 2.0 * p * np.cos(angle + 2.0 * np.pi / 3.0)


@njit(cache=True, parallel=True)
def exponentials(gradients: NDArray[np.float64], dt: float, out: NDArray[np.float64]) -> None:
    """out = exp(dt L), (P, d, d)."""
    count, d, _ = gradients.shape
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, count)
        work = np.empty((6, d, d))
        for p in range(first, last):
            for i in range(d):
                for j in range(d):
                    work[5, i, j] = dt * gradients[p, i, j]
            exponential(work[5], work, out[p])


@njit(cache=True, parallel=True)
def advance_frames(
    frames: NDArray[np.float64], gradients: NDArray[np.float64], dt: float, out: NDArray[np.float64]
) -> None:
    """out = exp(dt L) F exp(dt L)^T, (P, d, d)."""
    count, d, _ = frames.shape
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, count)
        work = np.empty((7, d, d))
        for p in range(first, last):
            for i in range(d):
                for j in range(d):
                    work[5, i, j] = dt * gradients[p, i, j]
            exponential(work[5], work, work[6])
            congruence(work[6], frames[p], work[5], out[p])


@njit(cache=True, parallel=True)
def decompose_frames(
    frames: NDArray[np.float64], lengths: NDArray[np.float64], axes: NDArray[np.float64]
) -> None:
    """Semi-axis lengths (P, d), decreasing, and directions (P, d, d), one a row."""
    count, d, _ = frames.shape
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, count)
        work = np.empty((d, d))
        for p in range(first, last):
            for i in range(d):
                for j in range(d):
                    work[i, j] = 0.5 * (frames[p, i, j] + frames[p, j, i])
            eigen(work, axes[p])
            for i in range(d):
                lengths[p, i] = np.sqrt(max(work[i, i], 0.0))


@njit(cache=True, parallel=True)
def frame_extremes(frames: NDArray[np.float64], extremes: NDArray[np.float64]) -> None:
    """Largest and smallest eigenvalue of each frame, (P, 2) [m^2]."""
    for p in prange(frames.shape[0]):
        extremes[p, 0], extremes[p, 1] = extreme_eigenvalues(frames[p])


@njit(cache=True)
def determinant(a: NDArray[np.float64]) -> float:
    """Determinant of a (2, 2) or (3, 3) matrix."""
    if a.shape[0] == 2:
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return (
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


@njit(cache=True, parallel=True)
def determinants(frames: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Determinants (P,)."""
    for p in prange(frames.shape[0]):
        out[p] = determinant(frames[p])
