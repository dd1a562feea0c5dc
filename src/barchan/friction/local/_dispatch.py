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
from barchan.friction.local._duriez import solve_duriez
from barchan.friction.local._enumerative import solve_enumerative
from barchan.friction.local._fischer_burmeister import solve_fischer_burmeister
from barchan.friction.local._pyramid import solve_pyramid
from barchan.friction.local._secular import solve_secular

SECULAR, ENUMERATIVE, FISCHER_BURMEISTER, PYRAMID, DURIEZ, ALART_CURNIER, ALART_CURNIER_DAMPED = range(7)
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
def local_error(s, w, b, law, r, u):
    """Local certificate: natural map of (W r + b, r), relative to the larger of |r| and rho |b|. Scratch `u` (s,)."""
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
    return math.sqrt(violation / size) if violation > 0.0 else violation


@njit(cache=True, error_model="numpy")
def _iterate(s, primary, w, b, mu, zeta, r, rows, matrices):
    """Newton or fixed-point local solvers, from `r`."""
    scale = force_scale(s, w, b)
    tolerance, floor = _INNER_TOLERANCE * scale, _ROUND_OFF * scale
    if mu < _NO_FRICTION:
        r[:] = 0.0
        r[0] = max(0.0, -b[0] / w[0, 0])
    elif primary == FISCHER_BURMEISTER:
        solve_fischer_burmeister(s, w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS, rows, matrices)
    elif primary == DURIEZ:
        tolerance = _FIXED_POINT_TOLERANCE * scale
        solve_duriez(s, w, b, mu, zeta, r, tolerance, _FIXED_POINT_STEPS, rows[1])
    else:
        damped = primary == ALART_CURNIER_DAMPED
        solve_alart_curnier(s, w, b, mu, zeta, r, tolerance, floor, _NEWTON_STEPS, damped, rows, matrices)


@njit(cache=True, error_model="numpy")
def solve_certified(s, code, w, local, b, guide, law, r, rows, matrices):
    """Solve one block with the local solver `code` (not the secular one alone), from `r`, which is overwritten.

    `guide` (s,) is the unconstrained velocity a pyramid is aligned with. Returns FAILED and USED_FAILSAFE as bits: failed
    is an answer whose local certificate exceeds LOCAL_TOLERANCE (of the pyramid alone: that is none of its own law).
    """
    primary = code % THEN_ENUMERATIVE
    mu, zeta = law[0], law[3]
    kept = rows[0]
    for j in range(s):
        kept[j] = r[j]
    found = True
    if primary == ENUMERATIVE:
        found = solve_enumerative(s, w, b, mu, zeta, r, matrices[:s, :3], matrices[s : s + 4])
    elif primary == PYRAMID:
        found = solve_pyramid(
            s, w, b, guide, mu, zeta, r, rows[1:4], matrices[:s, :s], matrices[s : 2 * s, :s]
        )
        if code == PYRAMID:
            return 0 if found else FAILED
    else:
        _iterate(s, primary, w, b, mu, zeta, r, rows, matrices)
    if not found:
        r[:] = kept
    error = local_error(s, w, b, law, r, rows[1])
    if error <= LOCAL_TOLERANCE:
        return 0
    if code < THEN_ENUMERATIVE:
        return FAILED
    kept[:] = r
    if code < THEN_SECULAR:
        found = solve_enumerative(s, w, b, mu, zeta, r, matrices[:s, :3], matrices[s : s + 4])
    else:
        solve_secular(s, local, b, mu, law[1], law[2], zeta, 0.0, r, rows[1], rows[2])
        found = True
    second = local_error(s, w, b, law, r, rows[1]) if found else math.inf
    if second <= LOCAL_TOLERANCE:
        return USED_FAILSAFE
    if not second < error:
        r[:] = kept
    return USED_FAILSAFE + FAILED


@njit(cache=True, error_model="numpy")
def solve_block_kernel(s, code, w, local, b, guide, law, r, rows, matrices):
    """Solve one block with any local solver, from `r`, which is overwritten; returns FAILED and USED_FAILSAFE as bits."""
    if code == SECULAR:
        solve_secular(s, local, b, law[0], law[1], law[2], law[3], 0.0, r, rows[0], rows[1])
        return FAILED if not local_error(s, w, b, law, r, rows[1]) <= LOCAL_TOLERANCE else 0
    return solve_certified(s, code, w, local, b, guide, law, r, rows, matrices)
