"""Alart-Curnier Newton of one contact in space (s = 3) in scalars, pure or damped, unrolled for the sweeps.

Seed B Eqs. (1.26)-(1.27) and 4.2.3; the same as `solve_alart_curnier` does for any size. W is symmetric, r is overwritten.
"""

from __future__ import annotations

import math

from numba import njit

from barchan.friction.local._contact import solve_3

_HALVINGS = 12
_SUFFICIENT = 1e-4


@njit(cache=True, error_model="numpy")
def _step(w, mu, zeta, rho_n, rho_t, u, slip, y, radius, inverse, f):
    """Newton step with an element of the generalised Jacobian, by the cases contact or not and stick (inverse = 0) or slip."""
    w_nn, w_n1, w_n2, w_11, w_12, w_22 = w
    m_nn, m_n1, m_n2 = 1.0, 0.0, 0.0
    if y[0] > 0.0:
        tilt = zeta / slip if slip > 0.0 else 0.0
        t_1, t_2 = tilt * u[0], tilt * u[1]
        m_nn = rho_n * (w_nn - t_1 * w_n1 - t_2 * w_n2)
        m_n1 = rho_n * (w_n1 - t_1 * w_11 - t_2 * w_12)
        m_n2 = rho_n * (w_n2 - t_1 * w_12 - t_2 * w_22)
    m_1n, m_2n, m_11, m_12, m_22 = rho_t * w_n1, rho_t * w_n2, rho_t * w_11, rho_t * w_12, rho_t * w_22
    m_21 = m_12
    if inverse > 0.0:
        scale = radius * inverse
        e_1, e_2 = inverse * y[1], inverse * y[2]
        along_n = -e_1 * m_1n - e_2 * m_2n
        along_1, along_2 = e_1 * (1.0 - m_11) - e_2 * m_12, e_2 * (1.0 - m_22) - e_1 * m_12
        push = mu if radius > 0.0 else 0.0
        m_1n = scale * (m_1n + e_1 * along_n) - push * e_1
        m_2n = scale * (m_2n + e_2 * along_n) - push * e_2
        m_21 = scale * (m_12 + e_2 * along_1)
        m_12 = scale * (m_12 + e_1 * along_2)
        m_11 = 1.0 - scale * (1.0 - m_11 - e_1 * along_1)
        m_22 = 1.0 - scale * (1.0 - m_22 - e_2 * along_2)
    s_n, s_1, s_2 = solve_3(m_nn, m_n1, m_n2, m_1n, m_11, m_12, m_2n, m_21, m_22, -f[0], -f[1], -f[2])
    # Without contact the normal force becomes zero, free from the rounding that would decide the sign of the next radius.
    return s_n if y[0] > 0.0 else -f[0], s_1, s_2


@njit(cache=True, error_model="numpy")
def alart_curnier_contact(matrix, b, mu, zeta, r, tolerance, floor, max_steps, damped):
    """`solve_alart_curnier` for s = 3; returns its error |f|."""
    w_nn, w_n1, w_n2, w_11 = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1]
    w_12, w_22 = matrix[1, 2], matrix[2, 2]
    w = (w_nn, w_n1, w_n2, w_11, w_12, w_22)
    b_n, b_1, b_2 = b[0], b[1], b[2]
    rho_n, rho_t = 1.0 / w_nn, 2.0 / (w_11 + w_22)
    r_n, r_1, r_2 = r[0], r[1], r[2]
    best_n, best_1, best_2, best_square = r_n, r_1, r_2, math.inf
    start_n, start_1, start_2, start = r_n, r_1, r_2, math.inf
    s_n, s_1, s_2, length = 0.0, 0.0, 0.0, 1.0
    halvings = _HALVINGS if damped else 1
    steps, tried = 0, halvings
    enough = floor * floor
    while True:
        u_1 = b_1 + w_n1 * r_n + w_11 * r_1 + w_12 * r_2
        u_2 = b_2 + w_n2 * r_n + w_12 * r_1 + w_22 * r_2
        u_n = b_n + w_nn * r_n + w_n1 * r_1 + w_n2 * r_2
        slip = math.sqrt(u_1 * u_1 + u_2 * u_2) if zeta > 0.0 else 0.0
        y_n, y_1, y_2 = r_n - rho_n * (u_n - zeta * slip), r_1 - rho_t * u_1, r_2 - rho_t * u_2
        radius = max(0.0, mu * r_n)
        reach = y_1 * y_1 + y_2 * y_2
        slides = reach > radius * radius
        inverse = 1.0 / math.sqrt(reach) if slides else 0.0
        scale = radius * inverse if slides else 1.0
        f_n, f_1, f_2 = r_n - max(0.0, y_n), r_1 - scale * y_1, r_2 - scale * y_2
        square = f_n * f_n + f_1 * f_1 + f_2 * f_2
        tried += 1
        if tried < halvings and not square <= (1.0 - 2.0 * _SUFFICIENT * length) * start:
            length *= 0.5
            r_n, r_1, r_2 = start_n + length * s_n, start_1 + length * s_1, start_2 + length * s_2
            continue
        if square < best_square:
            best_n, best_1, best_2, best_square = r_n, r_1, r_2, square
        if not square > enough or steps == max_steps:
            break
        enough = tolerance * tolerance
        s_n, s_1, s_2 = _step(
            w, mu, zeta, rho_n, rho_t, (u_1, u_2), slip, (y_n, y_1, y_2), radius, inverse, (f_n, f_1, f_2)
        )
        steps, tried, length = steps + 1, 0, 1.0
        start_n, start_1, start_2, start = r_n, r_1, r_2, square
        r_n, r_1, r_2 = r_n + s_n, r_1 + s_1, r_2 + s_2
    r[0], r[1], r[2] = best_n, best_1, best_2
    return math.sqrt(best_square)
