"""The choice of local solver inside a kernel, by a compile-time code: a primary solver and, if asked, a fail-safe after it.

Seed B 4.1.2 and Table 4.3: the primary solver answers, an independent check of its answer calls the fail-safe. One dispatch
serves every sweep kernel; only the secular solver, which does not fail, is called by the kernels themselves.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from barchan.cones._kernels import natural_map_residual_squared
from barchan.friction.local._alart_curnier import solve_alart_curnier
from barchan.friction.local._contact import contact_error, fischer_burmeister_contact
from barchan.friction.local._contact_alart_curnier import alart_curnier_contact
from barchan.friction.local._duriez import solve_duriez
from barchan.friction.local._enumerative import solve_enumerative
from barchan.friction.local._faceted import solve_faceted
from barchan.friction.local._fischer_burmeister import solve_fischer_burmeister
from barchan.friction.local._pyramid import solve_pyramid
from barchan.friction.local._secular import solve_secular

SECULAR, ENUMERATIVE, FISCHER_BURMEISTER, PYRAMID, DURIEZ, ALART_CURNIER, ALART_CURNIER_DAMPED = range(7)
FACETED = 7
THEN_ENUMERATIVE, THEN_SECULAR = 8, 16
FAILED, USED_FAILSAFE = 1, 2
LOCAL_TOLERANCE = 1e-8
_INNER_TOLERANCE = 0.1 * LOCAL_TOLERANCE
_ROUND_OFF = 1e-14
_FIXED_POINT_TOLERANCE = 1e-10
_NEWTON_STEPS = 50
_FIXED_POINT_STEPS = 200
_NO_FRICTION = 1e-14


def scratch(s: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch of `solve_block_kernel`: (11, s) rows and (2 s + 4, max(s, 8)) matrices, for block size `s`."""
    return np.zeros((11, s)), np.zeros((2 * s + 4, max(s, 8)))


@njit(cache=True, error_model="numpy")
def force_scale(s, w, b):
    """rho |b|, the force that b calls for, with rho = s / Tr W."""
    trace = 0.0
    square = 0.0
    for j in range(s):
        trace += w[j, j]
        square += b[j] * b[j]
    return s / trace * math.sqrt(square)


@njit(cache=True, error_model="numpy")
def _error_squared(s, w, b, law, r, u):
    """Square of `local_error`."""
    if s == 3 and law[1] == 0.0 and law[2] == 0.0:
        return contact_error(w, b, law[0], law[3], r)
    trace = 0.0
    given = 0.0
    size = 0.0
    for i in range(s):
        trace += w[i, i]
        value = b[i]
        for j in range(s):
            value += w[i, j] * r[j]
        u[i] = value
        given += b[i] * b[i]
        size += r[i] * r[i]
    rho = s / trace
    violation = natural_map_residual_squared(r, u, law[0], law[1], law[2], law[3], rho)
    size = max(size, rho * rho * given)
    return violation / size if violation > 0.0 else violation


@njit(cache=True, error_model="numpy")
def local_error(s, w, b, law, r, u):
    """Local certificate: natural map of (W r + b, r), relative to the larger of |r| and rho |b|. Scratch `u` (s,)."""
    return math.sqrt(_error_squared(s, w, b, law, r, u))


@njit(cache=True, error_model="numpy")
def _takes_off(s, b, zeta):
    """Whether no force solves the block: u = b is then admissible, exactly (seed B 4.1.2, first case)."""
    if not (b[0] >= 0.0 and zeta > 0.0):
        return b[0] >= 0.0
    slip = 0.0
    for j in range(1, s):
        slip += b[j] * b[j]
    return b[0] * b[0] >= zeta * zeta * slip


@njit(cache=True, error_model="numpy")
def _sticks(s, local, b, mu, r, t):
    """Whether -W^-1 b is in the cone (seed B 4.1.2, second case), or there is no friction; then written to `r` (s,).

    By the decomposition `local` of `prepare`; scratch `t` (s,).
    """
    q = s - 1
    normal = -b[0] / local[0]
    if mu < _NO_FRICTION:
        r[:] = 0.0
        r[0] = normal
        return True
    square = 0.0
    for j in range(q):
        value = -local[1 + j] * b[0]
        for k in range(q):
            value += local[s + q + k * q + j] * b[1 + k]
        value /= -local[s + j]
        t[j] = value
        normal -= local[1 + j] * value
        square += value * value
    if not (normal >= 0.0 and square <= mu * mu * normal * normal):
        return False
    r[0] = normal
    for k in range(q):
        value = 0.0
        for j in range(q):
            value += local[s + q + k * q + j] * t[j]
        r[1 + k] = value
    return True


@njit(cache=True, error_model="numpy")
def _iterate(s, primary, w, b, mu, zeta, r, rows, matrices):
    """Newton or fixed-point local solvers, from `r`; the contacts in space by kernels of their own."""
    scale = force_scale(s, w, b)
    tolerance, floor = _INNER_TOLERANCE * scale, _ROUND_OFF * scale
    damped = primary == ALART_CURNIER_DAMPED
    if primary == DURIEZ:
        tolerance = _FIXED_POINT_TOLERANCE * scale
        solve_duriez(s, w, b, mu, zeta, r, tolerance, _FIXED_POINT_STEPS, rows[1])
    elif primary == FISCHER_BURMEISTER:
        if s == 3:
            fischer_burmeister_contact(w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS)
        else:
            solve_fischer_burmeister(s, w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS, rows, matrices)
    elif s == 3:
        alart_curnier_contact(w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS, damped)
    else:
        solve_alart_curnier(s, w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS, damped, rows, matrices)


@njit(cache=True, error_model="numpy")
def _fail_safe(s, code, w, local, b, law, r, kept, error, matrices, row, other):
    """Answer of the fail-safe of `code` into `r`, or `kept` if that is no worse; returns the bits of `solve_certified`."""
    second = math.inf
    if code >= THEN_SECULAR:
        solve_secular(s, local, b, law[0], law[1], law[2], law[3], 0.0, r, row, other)
        second = _error_squared(s, w, b, law, r, row)
    elif solve_enumerative(s, w, b, law[0], law[3], r, matrices[:s, :3], matrices[s : s + 4]):
        second = _error_squared(s, w, b, law, r, row)
    if second <= LOCAL_TOLERANCE * LOCAL_TOLERANCE:
        return USED_FAILSAFE
    if not second < error:
        r[:] = kept
    return USED_FAILSAFE + FAILED


@njit(cache=True, error_model="numpy")
def solve_certified(s, code, w, local, b, guide, law, r, rows, matrices):
    """Solve one block with the local solver `code` (not the secular one alone), from `r`, which is overwritten.

    `guide` (s,) is the unconstrained velocity a pyramid is aligned with. Blocks that take off or stick need no iteration:
    every solver of Coulomb's law gets these two answers, the second one checked. Returns FAILED and USED_FAILSAFE as bits:
    failed is an answer whose local certificate exceeds LOCAL_TOLERANCE (of the pyramid alone: that is none of its own law;
    the faceted law has its own solver, whose answers are not checked by the certificate of the round ones).
    """
    if code == FACETED:
        solve_faceted(s, w, b, law[0], r)
        return 0
    primary = code % THEN_ENUMERATIVE
    mu, zeta = law[0], law[3]
    turned, matrix = matrices[:s, :s], matrices[s : 2 * s, :s]
    if code == PYRAMID:
        found = solve_pyramid(s, w, b, guide, mu, zeta, r, rows[1:4], turned, matrix)
        return 0 if found else FAILED
    if _takes_off(s, b, zeta):
        for j in range(s):
            r[j] = 0.0
        return 0
    kept, row = rows[0], rows[1]
    for j in range(s):
        kept[j] = r[j]
    limit = LOCAL_TOLERANCE * LOCAL_TOLERANCE
    if _sticks(s, local, b, mu, r, row):
        if _error_squared(s, w, b, law, r, row) <= limit:
            return 0
        r[:] = kept
    found = True
    if primary == ENUMERATIVE:
        found = solve_enumerative(s, w, b, mu, zeta, r, matrices[:s, :3], matrices[s : s + 4])
    elif primary == PYRAMID:
        found = solve_pyramid(s, w, b, guide, mu, zeta, r, rows[1:4], turned, matrix)
    elif mu >= _NO_FRICTION:
        _iterate(s, primary, w, b, mu, zeta, r, rows, matrices)
    if not found:
        r[:] = kept
    error = _error_squared(s, w, b, law, r, row)
    if error <= limit:
        return 0
    if code < THEN_ENUMERATIVE:
        return FAILED
    kept[:] = r
    return _fail_safe(s, code, w, local, b, law, r, kept, error, matrices, row, rows[2])


@njit(cache=True, error_model="numpy")
def solve_block_kernel(s, code, w, local, b, guide, law, r, rows, matrices):
    """Solve one block with any local solver, from `r`, which is overwritten; returns FAILED and USED_FAILSAFE as bits."""
    if code == SECULAR:
        solve_secular(s, local, b, law[0], law[1], law[2], law[3], 0.0, r, rows[0], rows[1])
        return FAILED if not local_error(s, w, b, law, r, rows[1]) <= LOCAL_TOLERANCE else 0
    return solve_certified(s, code, w, local, b, guide, law, r, rows, matrices)
