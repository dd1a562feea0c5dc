"""Numba kernels of one block of the faceted law, for solvers: projection and natural-map residual.

The formulas of faceted.py, explained there. Symbols: mu, n = N.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from barchan.cones.faceted import _WIDEST


@njit(cache=True, error_model="numpy")
def faceted_normal_of(x: np.ndarray, mu: float) -> float:
    """Normal component of the nearest point of {x_N >= 0, max_k |x_Tk| <= mu x_N} to one block x (s,).

    Newton's method on n - x_N - mu sum_k (|x_Tk| - mu n)_+, which is concave and piecewise linear: from the left it climbs to
    the root in at most s steps.
    """
    mu = min(mu, _WIDEST)
    n = 0.0
    for _ in range(len(x)):
        total, count = x[0], 1.0
        for k in range(1, len(x)):
            length = abs(x[k])
            if length > mu * n:
                total += mu * length
                count += mu * mu
        following = total / count
        if not following > n:
            return n if following <= n else following
        n = following
    return n


@njit(cache=True, error_model="numpy")
def faceted_residual_squared(r: np.ndarray, u: np.ndarray, mu: float, rho: float, trial: np.ndarray) -> float:
    """|r - P(r - rho (u + s(u)))|^2 of one block, r and u (s,); scratch `trial` (s,)."""
    shift = 0.0
    for k in range(1, len(r)):
        trial[k] = r[k] - rho * u[k]
        shift += abs(u[k])
    trial[0] = r[0] - rho * (u[0] + mu * shift)
    n = faceted_normal_of(trial, mu)
    total = (r[0] - n) ** 2
    for k in range(1, len(r)):
        total += (r[k] - min(max(trial[k], -mu * n), mu * n)) ** 2
    return total
