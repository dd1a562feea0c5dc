"""One block with the friction cone replaced by a four-sided pyramid (seed B 3.1.1 and 4.2.3, after Otaduy et al. 2009).

It solves ANOTHER law than Coulomb's: |r_Tj| <= mu r_N along each of s - 1 orthogonal directions, the first of them that of a
given unconstrained velocity; seed B's p-order cone with p = inf (end of chapter 1: with dilatancy u_N - zeta |u_T|_1 takes the
place of u_N). All 3^(s-1) states of sticking and sliding are tried, the one of the last force first. Cost: O(s^3) per state.
"""

from __future__ import annotations

import math

from numba import njit

from barchan.friction.local._dense import solve_dense

_MARGIN = 1e-9


@njit(cache=True, error_model="numpy")
def mirror_towards(s, guide, mirror):
    """Householder vector (scaled so that Q = I - v v') that takes the tangential part of `guide` (s,) to its first axis."""
    length = 0.0
    for j in range(1, s):
        mirror[j] = guide[j]
        length += guide[j] * guide[j]
    mirror[0] = 0.0
    length = math.sqrt(length)
    mirror[1] += length if guide[1] >= 0.0 else -length
    square = 0.0
    for j in range(1, s):
        square += mirror[j] * mirror[j]
    scale = math.sqrt(2.0 / square) if square > 0.0 else 0.0
    for j in range(1, s):
        mirror[j] *= scale


@njit(cache=True, error_model="numpy")
def reflect(s, mirror, x):
    """x <- (I - v v') x for `x` (s,), in place."""
    along = 0.0
    for j in range(1, s):
        along += mirror[j] * x[j]
    for j in range(1, s):
        x[j] -= along * mirror[j]


@njit(cache=True, error_model="numpy")
def _try_state(s, state, w, b, mu, zeta, x, matrix):
    """Solve the linear system of one state into `x` (s,) and check its inequalities.

    Digit j of `state` in base 3: 0 sticking, 1 force at +mu r_N, 2 force at -mu r_N, along direction j + 1.
    """
    for j in range(s):
        matrix[0, j] = w[0, j]
    x[0] = -b[0]
    digits = state
    for i in range(1, s):
        digit, digits = digits % 3, digits // 3
        x[i] = 0.0 if digit else -b[i]
        sign = 1.0 if digit == 1 else -1.0
        for j in range(s):
            matrix[i, j] = 0.0 if digit else w[i, j]
            if digit:
                matrix[0, j] += zeta * sign * w[i, j]
        if digit:
            matrix[i, i] = 1.0
            matrix[i, 0] = -sign * mu
            x[0] -= zeta * sign * b[i]
    if not solve_dense(s, matrix, x) or not x[0] >= 0.0:
        return False
    digits = state
    for i in range(1, s):
        digit, digits = digits % 3, digits // 3
        if digit == 0:
            if abs(x[i]) > mu * x[0] * (1.0 + _MARGIN):
                return False
            continue
        slip, size = b[i], abs(b[i])
        for j in range(s):
            slip += w[i, j] * x[j]
            size += abs(w[i, j] * x[j])
        if (slip if digit == 1 else -slip) > _MARGIN * size:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _state_of(s, mu, r):
    """The state a force suggests: sliding where it saturates a face."""
    state, weight = 0, 1
    for j in range(1, s):
        if abs(r[j]) >= mu * r[0] * (1.0 - _MARGIN):
            state += weight if r[j] > 0.0 else 2 * weight
        weight *= 3
    return state


@njit(cache=True, error_model="numpy")
def solve_pyramid(s, w, b, guide, mu, zeta, r, work, turned, matrix):
    """Solve the pyramid law aligned with the tangential part of `guide` (s,), into `r` (s,), whose value helps; True if found.

    Scratch `work` (3, s), `turned` (s, s), `matrix` (s, s).
    """
    mirror, x, c = work[0], work[1], work[2]
    mirror_towards(s, guide, mirror)
    c[:] = b
    reflect(s, mirror, c)
    reflect(s, mirror, r)
    opening = c[0]
    for j in range(1, s):
        opening -= zeta * abs(c[j])
    if opening >= 0.0:
        r[:] = 0.0
        return True
    turned[:] = w
    for i in range(s):
        reflect(s, mirror, turned[i])
    for j in range(s):
        reflect(s, mirror, turned[:, j])
    states = 3 ** (s - 1)
    first = _state_of(s, mu, r)
    for index in range(states):
        if _try_state(s, (first + index) % states, turned, c, mu, zeta, x, matrix):
            r[:] = x
            reflect(s, mirror, r)
            return True
    reflect(s, mirror, r)
    return False
