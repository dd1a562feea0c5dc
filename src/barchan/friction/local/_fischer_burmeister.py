"""Optimistic nonsmooth Newton on the second-order-cone Fischer-Burmeister function (seed B 4.1.1, B.1, Algorithm B.1).

Works on one block u = W r + b of any size, without shear or tensile yield. Cost: O(s^3) per Newton step.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_CURVATURE = 1e-2


@njit(cache=True, error_model="numpy")
def _solve_dense(s, a, x):
    """Gaussian elimination with partial pivoting in place: a x = x; False when singular."""
    for k in range(s):
        pivot = k
        for i in range(k + 1, s):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if a[pivot, k] == 0.0:
            return False
        if pivot != k:
            for j in range(k, s):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            x[k], x[pivot] = x[pivot], x[k]
        for i in range(k + 1, s):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, s):
                a[i, j] -= factor * a[k, j]
            x[i] -= factor * x[k]
    for k in range(s - 1, -1, -1):
        for j in range(k + 1, s):
            x[k] -= a[k, j] * x[j]
        x[k] /= a[k, k]
    return True


@njit(cache=True, error_model="numpy")
def _arrow_solve(s, z, x):
    """x <- L_z^{-1} x for the arrow matrix L_z = [[z_N, z_T'], [z_T, z_N I]]."""
    square = 0.0
    dot = 0.0
    for j in range(1, s):
        square += z[j] * z[j]
        dot += z[j] * x[j]
    determinant = z[0] * z[0] - square
    first = (z[0] * x[0] - dot) / determinant
    for j in range(1, s):
        x[j] = (x[j] - z[j] * first) / z[0]
    x[0] = first


@njit(cache=True, error_model="numpy")
def _function(s, x, y, z, f):
    """f = z - x - y with z = (x o x + y o y)^(1/2); returns the smaller eigenvalue of x o x + y o y, to full precision.

    det z = sqrt(lambda_1 lambda_2) comes from a sum of squares; the seed's difference for lambda_1 loses half the digits.
    """
    square = 0.0
    length = 0.0
    lorentz = x[0] * x[0] + y[0] * y[0]
    cross = 0.0
    for j in range(s):
        square += x[j] * x[j] + y[j] * y[j]
    for j in range(1, s):
        z[j] = x[0] * x[j] + y[0] * y[j]
        length += z[j] * z[j]
        lorentz -= x[j] * x[j] + y[j] * y[j]
        cross += (x[0] * y[j] - y[0] * x[j]) ** 2
    high = math.sqrt(square + 2.0 * math.sqrt(length))
    low = math.sqrt(lorentz * lorentz + 4.0 * cross) / high if high > 0.0 else 0.0
    z[0] = 0.5 * (low + high)
    for j in range(1, s):
        z[j] = z[j] / z[0] if z[0] > 0.0 else 0.0
    for j in range(s):
        f[j] = z[j] - x[j] - y[j]
    return low * low


@njit(cache=True, error_model="numpy")
def solve_fischer_burmeister(s, w, b, mu, zeta, r, tolerance, max_steps, work, matrix):
    """Newton from the given `r` (s,), overwritten by the best iterate; returns its error |f|.

    Scratch `work` (9, s), `matrix` (s, s). The hat variables are (mu r_N; r_T) and rho (u_N + s(u); mu u_T), rho = s / Tr W.
    """
    trace = 0.0
    for j in range(s):
        trace += w[j, j]
    rho = s / trace
    x, y, z, f = work[0], work[1], work[2], work[3]
    u, best, column, other, gradient = work[4], work[5], work[6], work[7], work[8]
    best[:] = r
    best_error = math.inf
    for _ in range(max_steps):
        slip = 0.0
        for i in range(s):
            u[i] = b[i]
            for j in range(s):
                u[i] += w[i, j] * r[j]
            if i > 0:
                slip += u[i] * u[i]
        slip = math.sqrt(slip)
        x[0] = mu * r[0]
        y[0] = rho * (u[0] + (mu - zeta) * slip)
        for j in range(1, s):
            x[j] = r[j]
            y[j] = rho * mu * u[j]
        small = _function(s, x, y, z, f)
        error = 0.0
        for j in range(s):
            error += f[j] * f[j]
        error = math.sqrt(error)
        if error < best_error:
            best_error = error
            best[:] = r
        if error <= tolerance:
            break
        interior = small > 1e-28 * z[0] * z[0]
        boundary = math.sqrt(x[0] * x[0] + y[0] * y[0])
        for j in range(s):
            # Columns of d(hat r)/d r_j and d(hat u)/d r_j.
            for i in range(s):
                column[i] = 0.0
                other[i] = rho * (mu if i > 0 else 1.0) * w[i, j]
            column[j] = mu if j == 0 else 1.0
            if slip > 0.0:
                for i in range(1, s):
                    other[0] += rho * (mu - zeta) * u[i] / slip * w[i, j]
            if interior:
                gradient[0] = 0.0
                for i in range(s):
                    gradient[0] += x[i] * column[i] + y[i] * other[i]
                for i in range(1, s):
                    gradient[i] = x[0] * column[i] + x[i] * column[0] + y[0] * other[i] + y[i] * other[0]
                _arrow_solve(s, z, gradient)
                for i in range(s):
                    matrix[i, j] = gradient[i] - column[i] - other[i]
            else:
                for i in range(s):
                    matrix[i, j] = (
                        (x[0] / boundary - 1.0) * column[i] + (y[0] / boundary - 1.0) * other[i]
                        if boundary > 0.0
                        else -column[i]
                    )
        descent = 0.0
        gradient_norm = 0.0
        step_norm = 0.0
        for j in range(s):
            gradient[j] = 0.0
            for i in range(s):
                gradient[j] += matrix[i, j] * f[i]
            column[j] = -f[j]
            gradient_norm += gradient[j] * gradient[j]
        if not _solve_dense(s, matrix, column):
            break
        for j in range(s):
            descent += column[j] * gradient[j]
            step_norm += column[j] * column[j]
        damping = 0.5 if descent > -_CURVATURE * math.sqrt(step_norm * gradient_norm) else 1.0
        for j in range(s):
            r[j] += damping * column[j]
    r[:] = best
    return best_error


def fischer_burmeister_scratch(s: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch arrays of `solve_fischer_burmeister` for block size `s`."""
    return np.empty((9, s)), np.empty((s, s))
