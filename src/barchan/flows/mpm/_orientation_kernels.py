"""Kernels of the orientation tensor and of the metric it gives friction (seed B, 7.4.2).

Each particle, or stress, is one independent iteration; loops run over fixed blocks as in `_frame_kernels`.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.flows.mpm._frame_kernels import (
    CHUNK,
    chunk_bounds,
    congruence,
    eigen,
    exponential,
    extreme_eigenvalues,
    multiply,
)

# Eigenvalues below this are set right one by one; the closed form that looks for them is exact to 1e-15.
_NEARLY_ZERO = 1e-13


@njit(cache=True, parallel=True)
def evolve_orientations(
    orientations: NDArray[np.float64],
    gradients: NDArray[np.float64],
    dt: float,
    elongations: NDArray[np.float64],
    normals: bool,
    out: NDArray[np.float64],
) -> None:
    """nu -> pi = (I - nu) / (d - 1) -> E pi E^T / Tr -> nu, with E = exp(dt (W + l D)); all (P, d, d), l (P,).

    With `normals` nu -> E nu E^T / Tr, with E = exp(dt (W - l D)).
    """
    count, d, _ = orientations.shape
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, count)
        work = np.empty((8, d, d))
        for p in range(first, last):
            length = -elongations[p] if normals else elongations[p]
            for i in range(d):
                for j in range(d):
                    slope, mirrored = gradients[p, i, j], gradients[p, j, i]
                    work[5, i, j] = 0.5 * dt * ((1.0 + length) * slope - (1.0 - length) * mirrored)
                    one = 1.0 if i == j else 0.0
                    nu = 0.5 * (orientations[p, i, j] + orientations[p, j, i])
                    work[7, i, j] = nu if normals else (one - nu) / (d - 1.0)
            exponential(work[5], work, work[6])
            congruence(work[6], work[7], work[5], out[p])
            trace = 0.0
            for i in range(d):
                trace += out[p, i, i]
            for i in range(d):
                for j in range(d):
                    one = 1.0 if i == j else 0.0
                    share = out[p, i, j] / trace
                    out[p, i, j] = share if normals else one - (d - 1.0) * share
            _normalise(out[p], work[0], work[1])


@njit(cache=True)
def _normalise(nu: NDArray[np.float64], work: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Negative eigenvalues to zero, then trace one: eigenvalues in [0, 1]."""
    d = nu.shape[0]
    _, low = extreme_eigenvalues(nu)
    if low < _NEARLY_ZERO:
        for i in range(d):
            for j in range(d):
                work[i, j] = nu[i, j]
        eigen(work, vectors)
        for i in range(d):
            for j in range(d):
                total = 0.0
                for k in range(d):
                    total += max(work[k, k], 0.0) * (vectors[k, i] * vectors[k, j])
                nu[i, j] = total
    trace = 0.0
    for i in range(d):
        trace += nu[i, i]
    for i in range(d):
        for j in range(d):
            nu[i, j] /= trace


@njit(cache=True, parallel=True)
def decay(
    cohesions: NDArray[np.float64],
    gradients: NDArray[np.float64],
    rates: NDArray[np.float64],
    dt: float,
    out: NDArray[np.float64],
) -> None:
    """out = c exp(-xi |D| dt), |D|^2 = D:D / 2; all (P,), gradients (P, d, d)."""
    d = gradients.shape[1]
    for p in prange(len(cohesions)):
        total = 0.0
        for i in range(d):
            for j in range(d):
                strain = 0.5 * (gradients[p, i, j] + gradients[p, j, i])
                total += strain * strain
        out[p] = cohesions[p] * np.exp(-rates[p] * dt * np.sqrt(0.5 * total))


@njit(cache=True)
def _diagonal_map(n: NDArray[np.float64], inverse: bool) -> tuple[float, float, float]:
    """Entries (11, 12, 22) of the square root, or its inverse, of diag(n)^4 restricted to traceless diagonals.

    The basis is (1, -1, 0) / sqrt2 and (-1, -1, 2) / sqrt6; in the plane the first alone, (1, -1) / sqrt2.
    """
    q0, q1 = n[0, 0] ** 4, n[1, 1] ** 4
    k11 = 0.5 * (q0 + q1)
    if n.shape[0] == 2:
        root = np.sqrt(k11)
        return (1.0 / root if inverse else root), 0.0, 1.0
    q2 = n[2, 2] ** 4
    k12, k22 = (q1 - q0) / np.sqrt(12.0), (q0 + q1 + 4.0 * q2) / 6.0
    # det K = (q0 q1 + q1 q2 + q2 q0) / 3, a sum of positive terms
    root_determinant = np.sqrt((q0 * q1 + q1 * q2 + q2 * q0) / 3.0)
    scale = 1.0 / np.sqrt(k11 + k22 + 2.0 * root_determinant)
    s11, s12, s22 = (k11 + root_determinant) * scale, k12 * scale, (k22 + root_determinant) * scale
    if inverse:
        return s22 / root_determinant, -s12 / root_determinant, s11 / root_determinant
    return s11, s12, s22


@njit(cache=True)
def _apply_map(
    x: NDArray[np.float64], n: NDArray[np.float64], diagonal: tuple[float, float, float], inverse: bool
) -> None:
    """The metric, in the eigenframe of N = diag(n), applied in place to a traceless symmetric x."""
    d = x.shape[0]
    s11, s12, s22 = diagonal
    for i in range(d):
        for j in range(d):
            if i != j:
                factor = n[i, i] * n[j, j]
                x[i, j] *= 1.0 / factor if inverse else factor
    first = (x[0, 0] - x[1, 1]) / np.sqrt(2.0)
    if d == 2:
        mapped = s11 * first / np.sqrt(2.0)
        x[0, 0], x[1, 1] = mapped, -mapped
        return
    second = (2.0 * x[2, 2] - x[0, 0] - x[1, 1]) / np.sqrt(6.0)
    one, two = (s11 * first + s12 * second) / np.sqrt(2.0), (s12 * first + s22 * second) / np.sqrt(6.0)
    x[0, 0], x[1, 1], x[2, 2] = one - two, -one - two, 2.0 * two


@njit(cache=True, parallel=True)
def fill_metric_blocks(
    metrics: NDArray[np.float64], basis: NDArray[np.float64], inverse: bool, out: NDArray[np.float64]
) -> None:
    """Blocks (q, s, s) of the metrics N (q, d, d), in the chi coordinates of the `basis` (s, d, d)."""
    count, d, _ = metrics.shape
    s = len(basis)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        first, last = chunk_bounds(chunk, count)
        work = np.empty((5, d, d))
        n, vectors, turned, half, back = work[0], work[1], work[2], work[3], work[4]
        for q in range(first, last):
            for i in range(d):
                for j in range(d):
                    n[i, j] = 0.5 * (metrics[q, i, j] + metrics[q, j, i])
            eigen(n, vectors)
            diagonal = _diagonal_map(n, inverse)
            for column in range(1, s):
                congruence(vectors, basis[column], half, turned)
                _apply_map(turned, n, diagonal, inverse)
                multiply(turned, vectors, half)
                for i in range(d):
                    for j in range(d):
                        back[i, j] = 0.0
                        for k in range(d):
                            back[i, j] += vectors[k, i] * half[k, j]
                for row in range(1, column + 1):
                    total = 0.0
                    for i in range(d):
                        for j in range(d):
                            total += basis[row, i, j] * back[i, j]
                    out[q, row, column] = 0.5 * total
                    out[q, column, row] = 0.5 * total
            for k in range(s):
                out[q, 0, k] = 1.0 if k == 0 else 0.0
                out[q, k, 0] = out[q, 0, k]
