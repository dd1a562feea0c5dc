"""One contact in space (s = 3) in scalars: local certificate and Fischer-Burmeister Newton, unrolled for the sweeps.

Seed B Eq. (1.29) and Algorithm B.1; the same as `local_error` and `solve_fischer_burmeister` do for any size, but everything
stays in registers, which makes them two to three times faster. W is symmetric, r is overwritten. No yield stress.
"""

from __future__ import annotations

import math

from numba import njit

from barchan.cones._kernels import project_half_plane

_CURVATURE = 1e-2
_BOUNDARY = 2e-14


@njit(cache=True, error_model="numpy")
def contact_error(w, b, mu, zeta, r):
    """Square of the local certificate of r (3,): see `local_error`."""
    r_n, r_1, r_2 = r[0], r[1], r[2]
    b_n, b_1, b_2 = b[0], b[1], b[2]
    w_n1, w_n2, w_12 = w[0, 1], w[0, 2], w[1, 2]
    rho = 3.0 / (w[0, 0] + w[1, 1] + w[2, 2])
    u_n = b_n + w[0, 0] * r_n + w_n1 * r_1 + w_n2 * r_2
    u_1 = b_1 + w_n1 * r_n + w[1, 1] * r_1 + w_12 * r_2
    u_2 = b_2 + w_n2 * r_n + w_12 * r_1 + w[2, 2] * r_2
    y_n = r_n - rho * (u_n + (mu - zeta) * math.sqrt(u_1 * u_1 + u_2 * u_2))
    y_1, y_2 = r_1 - rho * u_1, r_2 - rho * u_2
    normal, scale = project_half_plane(y_n, math.sqrt(y_1 * y_1 + y_2 * y_2), mu, 0.0)
    d_n, d_1, d_2 = r_n - normal, r_1 - scale * y_1, r_2 - scale * y_2
    violation = d_n * d_n + d_1 * d_1 + d_2 * d_2
    size = max(r_n * r_n + r_1 * r_1 + r_2 * r_2, rho * rho * (b_n * b_n + b_1 * b_1 + b_2 * b_2))
    return violation / size if violation > 0.0 else violation


@njit(cache=True, error_model="numpy")
def solve_3(a, b, c, d, e, f, g, h, i, x, y, z):
    """Solution of ((a, b, c), (d, e, f), (g, h, i)) v = (x, y, z) by Cramer's rule; NaN or inf when the matrix is singular."""
    p, q, r = e * i - f * h, f * g - d * i, d * h - e * g
    scale = 1.0 / (a * p + b * q + c * r)
    return (
        scale * (p * x + (c * h - b * i) * y + (b * f - c * e) * z),
        scale * (q * x + (a * i - c * g) * y + (c * d - a * f) * z),
        scale * (r * x + (b * g - a * h) * y + (a * e - b * d) * z),
    )


@njit(cache=True, error_model="numpy")
def _root(x_n, x_1, x_2, y_n, y_1, y_2):
    """z with z o z = x o x + y o y, as (z_N, z_1, z_2, 1 / z_N, det z); z_N^2 is the mean of |x|^2 + |y|^2 and det z.

    det z comes from a sum of squares; the seed's difference for lambda_1 loses half the digits.
    """
    heads, tails = x_n * x_n + y_n * y_n, x_1 * x_1 + x_2 * x_2 + y_1 * y_1 + y_2 * y_2
    cross_1, cross_2 = x_n * y_1 - y_n * x_1, x_n * y_2 - y_n * x_2
    lorentz = heads - tails
    det = math.sqrt(lorentz * lorentz + 4.0 * (cross_1 * cross_1 + cross_2 * cross_2))
    z_n = math.sqrt(0.5 * (heads + tails + det))
    share = 1.0 / z_n if z_n > 0.0 else 0.0
    return z_n, share * (x_n * x_1 + y_n * y_1), share * (x_n * x_2 + y_n * y_2), share, det


@njit(cache=True, error_model="numpy")
def _step(a, kappa, slip, x, y, z, f, steep):
    """Newton step of x from -L_z f = L_z J step, with L_z J = (L_x - L_z) + (L_y - L_z) dy/dx and J on the boundary as seed B.

    Halved when bad: <step, J' f> = -|f|^2, so that a bad direction is one in which the error hardly decreases. |J|^2 is
    below `steep`, which shows most directions to be good without J' f.
    """
    a_nn, a_n1, a_n2, a_11, a_12, a_22 = a
    z_n, z_1, z_2, share, det = z
    p, p_1, p_2, q, q_1, q_2 = x[0] - z_n, x[1] - z_1, x[2] - z_2, y[0] - z_n, y[1] - z_1, y[2] - z_2
    f_n, f_1, f_2 = f
    interior = det > _BOUNDARY * z_n * z_n
    along = z_1 * f_1 + z_2 * f_2
    b_n, b_1, b_2 = z_n * f_n + along, z_n * f_1 + z_1 * f_n, z_n * f_2 + z_2 * f_n
    if not interior:
        head = math.sqrt(x[0] * x[0] + y[0] * y[0])
        p, q = (x[0] / head - 1.0, y[0] / head - 1.0) if head > 0.0 else (-1.0, -1.0)
        p_1, p_2, q_1, q_2 = 0.0, 0.0, 0.0, 0.0
        b_n, b_1, b_2 = f
    tilt = kappa / slip if slip > 0.0 else 0.0
    t_1, t_2 = tilt * y[1], tilt * y[2]
    h_n = a_nn + t_1 * a_n1 + t_2 * a_n2
    h_1, h_2 = a_n1 + t_1 * a_11 + t_2 * a_12, a_n2 + t_1 * a_12 + t_2 * a_22
    m_nn = p + q * h_n + q_1 * a_n1 + q_2 * a_n2
    m_n1, m_n2 = p_1 + q * h_1 + q_1 * a_11 + q_2 * a_12, p_2 + q * h_2 + q_1 * a_12 + q_2 * a_22
    m_1n, m_2n = p_1 + q * a_n1 + q_1 * h_n, p_2 + q * a_n2 + q_2 * h_n
    m_11, m_12 = p + q * a_11 + q_1 * h_1, q * a_12 + q_1 * h_2
    m_21, m_22 = q * a_12 + q_2 * h_1, p + q * a_22 + q_2 * h_2
    s_n, s_1, s_2 = solve_3(m_nn, m_n1, m_n2, m_1n, m_11, m_12, m_2n, m_21, m_22, -b_n, -b_1, -b_2)
    error = f_n * f_n + f_1 * f_1 + f_2 * f_2
    length = s_n * s_n + s_1 * s_1 + s_2 * s_2
    bad = False
    if error < _CURVATURE * _CURVATURE * length * steep:
        g_n, g_1, g_2 = f
        if interior:
            g_n = (z_n * f_n - along) / det
            g_1, g_2 = (f_1 - z_1 * g_n) * share, (f_2 - z_2 * g_n) * share
        gradient = (m_nn * g_n + m_1n * g_1 + m_2n * g_2) ** 2 + (m_n1 * g_n + m_11 * g_1 + m_21 * g_2) ** 2
        gradient += (m_n2 * g_n + m_12 * g_1 + m_22 * g_2) ** 2
        bad = error * error < _CURVATURE * _CURVATURE * length * gradient
    damping = 0.5 if bad else 1.0
    return damping * s_n, damping * s_1, damping * s_2


@njit(cache=True, error_model="numpy")
def fischer_burmeister_contact(w, b, mu, zeta, r, tolerance, floor, max_steps):
    """`solve_fischer_burmeister` for s = 3; returns its error |f|.

    In the hat variables (4.2) mu disappears: y = A x + c + kappa |y_T| e_N with a symmetric A, kappa = 1 - zeta / mu and the
    cone of aperture 1. As |L_x| and |L_y| stay below |L_z|, the Jacobian of f(x) stays below 2 + 2 (1 + kappa) |A|.
    """
    rho = 3.0 / (w[0, 0] + w[1, 1] + w[2, 2])
    inverse = 1.0 / mu
    kappa = 1.0 - zeta * inverse
    tail = rho * mu
    a_nn, a_n1, a_n2 = rho * inverse * w[0, 0], rho * w[0, 1], rho * w[0, 2]
    a_11, a_12, a_22 = tail * w[1, 1], tail * w[1, 2], tail * w[2, 2]
    a = (a_nn, a_n1, a_n2, a_11, a_12, a_22)
    c_n, c_1, c_2 = rho * b[0], tail * b[1], tail * b[2]
    size = a_nn * a_nn + a_11 * a_11 + a_22 * a_22 + 2.0 * (a_n1 * a_n1 + a_n2 * a_n2 + a_12 * a_12)
    steep = 8.0 + 8.0 * (1.0 + abs(kappa)) ** 2 * size
    x_n, x_1, x_2 = mu * r[0], r[1], r[2]
    best_n, best_1, best_2, best_error = x_n, x_1, x_2, math.inf
    enough = floor * floor
    for _ in range(max_steps):
        y_1 = c_1 + a_n1 * x_n + a_11 * x_1 + a_12 * x_2
        y_2 = c_2 + a_n2 * x_n + a_12 * x_1 + a_22 * x_2
        slip = math.sqrt(y_1 * y_1 + y_2 * y_2)
        y_n = c_n + a_nn * x_n + a_n1 * x_1 + a_n2 * x_2 + kappa * slip
        z = _root(x_n, x_1, x_2, y_n, y_1, y_2)
        f_n, f_1, f_2 = z[0] - x_n - y_n, z[1] - x_1 - y_1, z[2] - x_2 - y_2
        error = f_n * f_n + f_1 * f_1 + f_2 * f_2
        if error < best_error:
            best_n, best_1, best_2, best_error = x_n, x_1, x_2, error
        if not error > enough:
            break
        enough = tolerance * tolerance
        s_n, s_1, s_2 = _step(a, kappa, slip, (x_n, x_1, x_2), (y_n, y_1, y_2), z, (f_n, f_1, f_2), steep)
        x_n, x_1, x_2 = x_n + s_n, x_1 + s_1, x_2 + s_2
    r[0], r[1], r[2] = best_n * inverse, best_1, best_2
    return math.sqrt(best_error)
