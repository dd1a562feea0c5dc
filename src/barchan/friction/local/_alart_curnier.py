"""Nonsmooth Newton on the function of Alart and Curnier for one block, pure (PAC) or damped by a line search (DAC).

Seed B Eqs. (1.26)-(1.27) and 4.2.3, after Bertails-Descoubes et al. 2011; any block size, no yield stress, any dilatancy
(the normal part then sees u_N - zeta |u_T|). Steps rho_N = 1 / W_NN, rho_T = (s - 1) / Tr W_TT. Cost: O(s^3) per step.
"""

from __future__ import annotations

import math

from numba import njit

from barchan.friction.local._dense import solve_dense

_HALVINGS = 12
_SUFFICIENT = 1e-4


@njit(cache=True, error_model="numpy")
def _function(s, w, b, mu, zeta, rho_n, rho_t, r, u, y, f):
    """f(r), with u = W r + b and y_T = r_T - rho_T u_T kept; y_N > 0 tells contact. Returns |f|^2."""
    slip = 0.0
    length = 0.0
    for i in range(s):
        value = b[i]
        for j in range(s):
            value += w[i, j] * r[j]
        u[i] = value
        if i > 0:
            slip += value * value
            y[i] = r[i] - rho_t * value
            length += y[i] * y[i]
    y[0] = r[0] - rho_n * (u[0] - zeta * math.sqrt(slip))
    f[0] = r[0] - max(0.0, y[0])
    radius = max(0.0, mu * r[0])
    length = math.sqrt(length)
    scale = 1.0 if length <= radius else radius / length
    square = f[0] * f[0]
    for i in range(1, s):
        f[i] = r[i] - scale * y[i]
        square += f[i] * f[i]
    return square


@njit(cache=True, error_model="numpy")
def _jacobian(s, w, mu, zeta, rho_n, rho_t, r, u, y, matrix):
    """An element of the generalised Jacobian of f at r, by the cases contact or not and stick or slip."""
    length = 0.0
    slip = 0.0
    for i in range(1, s):
        length += y[i] * y[i]
        slip += u[i] * u[i]
    length, slip = math.sqrt(length), math.sqrt(slip)
    tilt = zeta / slip if slip > 0.0 else 0.0
    radius = max(0.0, mu * r[0])
    inverse = 1.0 / length if length > radius else 0.0
    scale = radius * inverse
    for j in range(s):
        head = w[0, j]
        along = 0.0
        for i in range(1, s):
            head -= tilt * u[i] * w[i, j]
            along += y[i] * ((1.0 if i == j else 0.0) - rho_t * w[i, j])
        matrix[0, j] = rho_n * head if y[0] > 0.0 else (1.0 if j == 0 else 0.0)
        for i in range(1, s):
            own = 1.0 if i == j else 0.0
            if length <= radius:
                matrix[i, j] = rho_t * w[i, j]
                continue
            matrix[i, j] = own - scale * (own - rho_t * w[i, j] - y[i] * along * inverse * inverse)
            if j == 0 and radius > 0.0:
                matrix[i, j] -= mu * y[i] * inverse


@njit(cache=True, error_model="numpy")
def solve_alart_curnier(s, w, b, mu, zeta, r, tolerance, floor, max_steps, damped, rows, matrix):
    """Newton from the given `r` (s,), overwritten by the best iterate; returns its error |f|.

    One step is made unless |f| <= `floor`, more until |f| <= `tolerance`; both in the unit of r. `damped`: halve each step
    until |f|^2 decreases sufficiently (Armijo). Scratch rows 1 to 6 of `rows`, `matrix` (s, s).
    """
    trace = 0.0
    for j in range(1, s):
        trace += w[j, j]
    rho_n, rho_t = 1.0 / w[0, 0], (s - 1) / trace
    u, y, f, best, step, trial = rows[1], rows[2], rows[3], rows[4], rows[5], rows[6]
    square = _function(s, w, b, mu, zeta, rho_n, rho_t, r, u, y, f)
    best_square = square
    for j in range(s):
        best[j] = r[j]
    enough = floor * floor
    for _ in range(max_steps):
        if not square > enough:
            break
        enough = tolerance * tolerance
        _jacobian(s, w, mu, zeta, rho_n, rho_t, r, u, y, matrix)
        for j in range(s):
            step[j] = -f[j]
            trial[j] = r[j]
        if not solve_dense(s, matrix, step):
            break
        start, length = square, 1.0
        for _ in range(_HALVINGS if damped else 1):
            for j in range(s):
                r[j] = trial[j] + length * step[j]
            square = _function(s, w, b, mu, zeta, rho_n, rho_t, r, u, y, f)
            if square <= (1.0 - 2.0 * _SUFFICIENT * length) * start:
                break
            length *= 0.5
        if square < best_square:
            best_square = square
            for j in range(s):
                best[j] = r[j]
    for j in range(s):
        r[j] = best[j]
    return math.sqrt(best_square)
