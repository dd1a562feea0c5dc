"""Enumerative solution of one block for s = 2, 3: take-off, stick, then the roots of a polynomial (seed B 4.1.2).

Sliding solves (W + a J) r = -b with J = diag(-mu zeta, 1, ..), |r_T| = mu r_N. Cramer's rule makes r(a) = -adj(W + a J) b / det
with a quadratic (s = 3) or linear (s = 2) adjugate, so that |adj_T|^2 = mu^2 adj_N^2 is the quartic (4.7)/(4.14) at once.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def _horner(p, degree, x):
    value = p[degree]
    for k in range(degree - 1, -1, -1):
        value = value * x + p[k]
    return value


@njit(cache=True, error_model="numpy")
def _bracketed_root(p, degree, low, high, low_value):
    """Root of a polynomial of which [low, high] holds exactly one sign change: bisection to round-off."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        value = _horner(p, degree, middle)
        if (value < 0.0) == (low_value < 0.0):
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(cache=True, error_model="numpy")
def positive_roots(p, degree, roots, knots, derived):
    """Real positive roots of p_0 + p_1 x + ... (degree <= 4), between the roots of its derivatives; returns their number."""
    bound = 0.0
    while degree > 0 and p[degree] == 0.0:
        degree -= 1
    if degree == 0:
        return 0
    for k in range(degree):
        bound = max(bound, abs(p[k] / p[degree]))
    bound += 1.0
    count = 0
    for order in range(degree - 1, -1, -1):
        for k in range(degree - order + 1):
            factor = 1.0
            for m in range(order):
                factor *= k + order - m
            derived[k] = p[k + order] * factor
        for k in range(count):
            knots[k + 1] = roots[k]
        knots[0] = 0.0
        knots[count + 1] = bound
        pieces = count + 1
        count = 0
        for k in range(pieces):
            low_value = _horner(derived, degree - order, knots[k])
            high_value = _horner(derived, degree - order, knots[k + 1])
            if (low_value < 0.0) != (high_value < 0.0):
                roots[count] = _bracketed_root(derived, degree - order, knots[k], knots[k + 1], low_value)
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _adjugate_times(s, w, b, coupling, q):
    """Coefficients (s, 3) in a of -adj(W + a J) b."""
    q[:] = 0.0
    if s == 2:
        q[0, 0] = -(w[1, 1] * b[0] - w[0, 1] * b[1])
        q[0, 1] = -b[0]
        q[1, 0] = w[0, 1] * b[0] - w[0, 0] * b[1]
        q[1, 1] = coupling * b[1]
        return
    n, x, y = w[0, 0], w[0, 1], w[0, 2]
    p, o, z = w[1, 1], w[1, 2], w[2, 2]
    q[0, 0] = -((p * z - o * o) * b[0] - (x * z - y * o) * b[1] + (x * o - y * p) * b[2])
    q[0, 1] = -((p + z) * b[0] - x * b[1] - y * b[2])
    q[0, 2] = -b[0]
    q[1, 0] = (x * z - y * o) * b[0] - (n * z - y * y) * b[1] + (n * o - x * y) * b[2]
    q[1, 1] = x * b[0] - (n - coupling * z) * b[1] - coupling * o * b[2]
    q[1, 2] = coupling * b[1]
    q[2, 0] = -(x * o - y * p) * b[0] + (n * o - x * y) * b[1] - (n * p - x * x) * b[2]
    q[2, 1] = y * b[0] - coupling * o * b[1] - (n - coupling * p) * b[2]
    q[2, 2] = coupling * b[2]


@njit(cache=True, error_model="numpy")
def _determinant(s, w, a, coupling):
    n = w[0, 0] - coupling * a
    if s == 2:
        return n * (w[1, 1] + a) - w[0, 1] ** 2
    p, z = w[1, 1] + a, w[2, 2] + a
    x, y, o = w[0, 1], w[0, 2], w[1, 2]
    return n * (p * z - o * o) - x * (x * z - y * o) + y * (x * o - y * p)


@njit(cache=True, error_model="numpy")
def solve_enumerative(s, w, b, mu, zeta, r, q, work):
    """Solve u = W r + b in the law (no shear or tensile yield) by enumeration of its cases.

    `w` (s, s), `b` (s,); writes `r` (s,); scratch `q` (s, 3), `work` (4, 8). Returns True when a case fits.
    """
    tangential = 0.0
    for j in range(1, s):
        tangential += b[j] * b[j]
    r[:] = 0.0
    if b[0] >= zeta * math.sqrt(tangential):
        return True
    coupling = mu * zeta
    _adjugate_times(s, w, b, coupling, q)
    determinant = _determinant(s, w, 0.0, coupling)
    square = 0.0
    for j in range(1, s):
        square += q[j, 0] * q[j, 0]
    if determinant > 0.0 and q[0, 0] >= 0.0 and square <= (mu * q[0, 0]) ** 2:
        for j in range(s):
            r[j] = q[j, 0] / determinant
        return True
    if mu == 0.0:
        r[0] = -b[0] / w[0, 0]
        return b[0] < 0.0
    scale = 0.0
    for j in range(s):
        scale += w[j, j]
    # The multiplier is measured in units of the trace, the polynomial then has comparable coefficients.
    polynomial, roots, knots, derived = work[0], work[1], work[2], work[3]
    polynomial[:] = 0.0
    for k in range(3):
        for m in range(3):
            value = -mu * mu * q[0, k] * q[0, m]
            for j in range(1, s):
                value += q[j, k] * q[j, m]
            polynomial[k + m] += value * scale ** (k + m)
    found = positive_roots(polynomial, 2 * (s - 1), roots, knots, derived)
    for index in range(found):
        a = roots[index] * scale
        determinant = _determinant(s, w, a, coupling)
        normal = (q[0, 0] + a * (q[0, 1] + a * q[0, 2])) / determinant if determinant != 0.0 else -1.0
        if normal > 0.0:
            for j in range(s):
                r[j] = (q[j, 0] + a * (q[j, 1] + a * q[j, 2])) / determinant
            return True
    return False
