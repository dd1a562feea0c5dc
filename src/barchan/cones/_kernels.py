"""Numba kernels of one block, for the inner loops of solvers: projection and natural-map residual.

Seed B, Eqs. (1.16)-(1.17) and (1.29): the formulas of projection.py and complementarity.py, explained there.
Symbols: mu, sigma = sigma_S (shear yield), tau = tau_c (tensile yield), zeta (dilatancy), n = N, t = |T|.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# IEEE division (error_model) lets NaN flow through instead of raising inside a compiled loop.
# From this aperture on, the conical face is the plane N = 0 to rounding and mu * mu would overflow.
_HALF_SPACE = 1e100


@njit(cache=True, error_model="numpy")
def project_half_plane(n: float, t: float, mu: float, sigma: float) -> tuple[float, float]:
    """Projection on the truncated cone in the (N, |T|) half-plane: new N, factor of T. NaN stays NaN."""
    if mu >= _HALF_SPACE:
        return (0.0 if n < 0.0 else n), 1.0
    excess = t - sigma
    if n >= 0.0 and excess <= mu * n:
        return n, 1.0
    if n < 0.0 and excess <= 0.0:
        return 0.0, 1.0
    # Here t > sigma >= 0.
    n_face = (n + mu * excess) / (1.0 + mu * mu)
    if n_face <= 0.0:
        return 0.0, sigma / t
    return n_face, (sigma + mu * n_face) / t


@njit(cache=True, error_model="numpy")
def project_block(x: np.ndarray, mu: float, sigma: float, tau: float, out: np.ndarray) -> None:
    """Nearest admissible force of one block x (s,) into out (s,), which may be x itself; s = len(x)."""
    t2 = 0.0
    for i in range(1, len(x)):
        t2 += x[i] * x[i]
    n, scale = project_half_plane(x[0] + tau, math.sqrt(t2), mu, sigma)
    out[0] = n - tau
    for i in range(1, len(x)):
        out[i] = scale * x[i]


@njit(cache=True, error_model="numpy")
def natural_map_residual_squared(
    r: np.ndarray, u: np.ndarray, mu: float, sigma: float, tau: float, zeta: float, rho: float
) -> float:
    """|r - P(r - rho (u + s(u)))|^2 of one block, r and u (s,). Seed B, Eq. (1.29)."""
    u2 = 0.0
    t2 = 0.0
    for i in range(1, len(r)):
        y = r[i] - rho * u[i]
        u2 += u[i] * u[i]
        t2 += y * y
    y_n = r[0] + tau - rho * (u[0] + (mu - zeta) * math.sqrt(u2))
    n, scale = project_half_plane(y_n, math.sqrt(t2), mu, sigma)
    total = (r[0] + tau - n) ** 2
    for i in range(1, len(r)):
        total += (r[i] - scale * (r[i] - rho * u[i])) ** 2
    return total
