"""Optimistic nonsmooth Newton on the second-order-cone Fischer-Burmeister function (seed B 4.1.1, B.1, Algorithm B.1).

Works on one block u = W r + b of any size (`_contact` does s = 3), without shear or tensile yield; MFB of Table 4.3. The Newton
system is multiplied by L_z, which spares its inverse. Cost: O(s^3) per Newton step.
"""

from __future__ import annotations

import math

from numba import njit

from barchan.friction.local._dense import solve_dense

_CURVATURE = 1e-2
_BOUNDARY = 2e-14


@njit(cache=True, error_model="numpy")
def _hat_variables(s, w, b, mu, zeta, rho, r, u, x, y):
    """x = (mu r_N; r_T), y = rho (u_N + (mu - zeta) |u_T|; mu u_T) of u = W r + b (4.2); returns |u_T|."""
    slip = 0.0
    for i in range(s):
        value = b[i]
        for j in range(s):
            value += w[i, j] * r[j]
        u[i] = value
        if i > 0:
            slip += value * value
            x[i] = r[i]
            y[i] = rho * mu * value
    slip = math.sqrt(slip)
    x[0] = mu * r[0]
    y[0] = rho * (u[0] + (mu - zeta) * slip)
    return slip


@njit(cache=True, error_model="numpy")
def _function(s, x, y, z, f):
    """f = z - x - y with z = (x o x + y o y)^(1/2); returns |f|^2 and det z.

    z_N^2 is the mean of |x|^2 + |y|^2 and det z, which comes from a sum of squares; the seed's difference for lambda_1 loses
    half the digits.
    """
    square = x[0] * x[0] + y[0] * y[0]
    lorentz = square
    cross = 0.0
    for j in range(1, s):
        z[j] = x[0] * x[j] + y[0] * y[j]
        parts = x[j] * x[j] + y[j] * y[j]
        square += parts
        lorentz -= parts
        cross += (x[0] * y[j] - y[0] * x[j]) ** 2
    det = math.sqrt(lorentz * lorentz + 4.0 * cross)
    z[0] = math.sqrt(0.5 * (square + det))
    inverse = 1.0 / z[0] if z[0] > 0.0 else 0.0
    f[0] = z[0] - x[0] - y[0]
    error = f[0] * f[0]
    for j in range(1, s):
        z[j] *= inverse
        f[j] = z[j] - x[j] - y[j]
        error += f[j] * f[j]
    return error, det


@njit(cache=True, error_model="numpy")
def _newton_matrix(s, w, mu, zeta, rho, u, slip, x, y, z, interior, matrix):
    """(L_x - L_z) dx/dr + (L_y - L_z) dy/dr, that is L_z times the Jacobian; on the boundary seed B's element, unscaled."""
    p, q = x[0] - z[0], y[0] - z[0]
    if not interior:
        boundary = math.sqrt(x[0] * x[0] + y[0] * y[0])
        p = x[0] / boundary - 1.0 if boundary > 0.0 else -1.0
        q = y[0] / boundary - 1.0 if boundary > 0.0 else 0.0
    tilt = (mu - zeta) / slip if slip > 0.0 else 0.0
    for j in range(s):
        head = w[0, j]
        for i in range(1, s):
            head += tilt * u[i] * w[i, j]
        head *= rho
        matrix[0, j] = q * head
        for i in range(1, s):
            tail = rho * mu * w[i, j]
            matrix[i, j] = q * tail
            if interior:
                arm = y[i] - z[i]
                matrix[0, j] += arm * tail
                matrix[i, j] += arm * head
        if j > 0:
            matrix[j, j] += p
            if interior:
                matrix[0, j] += x[j] - z[j]
    matrix[0, 0] += mu * p
    if interior:
        for i in range(1, s):
            matrix[i, 0] += mu * (x[i] - z[i])


@njit(cache=True, error_model="numpy")
def _right_hand_side(s, z, f, det, interior, matrix, step, g):
    """step = -L_z f (or -f on the boundary); returns |J' f|^2, J being the Jacobian itself. Scratch `g` (s,)."""
    for i in range(s):
        step[i] = -f[i]
        g[i] = f[i]
    if interior:
        cross = 0.0
        for i in range(1, s):
            cross += z[i] * f[i]
            step[i] = -z[0] * f[i] - z[i] * f[0]
        step[0] = -z[0] * f[0] - cross
        # g = L_z^-1 f, so that J' f = matrix' g.
        g[0] = (z[0] * f[0] - cross) / det
        inverse = 1.0 / z[0]
        for i in range(1, s):
            g[i] = (f[i] - z[i] * g[0]) * inverse
    gradient = 0.0
    for j in range(s):
        value = 0.0
        for i in range(s):
            value += matrix[i, j] * g[i]
        gradient += value * value
    return gradient


@njit(cache=True, error_model="numpy")
def solve_fischer_burmeister(s, w, b, mu, zeta, r, tolerance, floor, max_steps, rows, matrix):
    """Newton from the given `r` (s,), overwritten by the best iterate; returns its error |f|.

    `w` (s, s), `b` (s,), mu > 0; scratch rows 1 to 8 of `rows`, `matrix` (s, s) or larger. One step is made unless
    |f| <= `floor`, more until |f| <= `tolerance`; both in the unit of r.
    """
    trace = 0.0
    for j in range(s):
        trace += w[j, j]
    rho = s / trace
    x, y, z, f, u, best, step = rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7]
    best_error = math.inf
    enough = floor * floor
    for _ in range(max_steps):
        slip = _hat_variables(s, w, b, mu, zeta, rho, r, u, x, y)
        error, det = _function(s, x, y, z, f)
        if error < best_error:
            best_error = error
            for j in range(s):
                best[j] = r[j]
        if not error > enough:
            break
        enough = tolerance * tolerance
        interior = det > _BOUNDARY * z[0] * z[0]
        _newton_matrix(s, w, mu, zeta, rho, u, slip, x, y, z, interior, matrix)
        gradient = _right_hand_side(s, z, f, det, interior, matrix, step, rows[8])
        if not solve_dense(s, matrix, step):
            break
        length = 0.0
        for j in range(s):
            length += step[j] * step[j]
        # <step, J' f> = -|f|^2: a bad direction is one in which the error hardly decreases.
        damping = 0.5 if error * error < _CURVATURE * _CURVATURE * length * gradient else 1.0
        for j in range(s):
            r[j] += damping * step[j]
    for j in range(s):
        r[j] = best[j]
    return math.sqrt(best_error)
