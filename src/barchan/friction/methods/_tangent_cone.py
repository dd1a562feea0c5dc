"""Projection on the tangent cone of an admissible set {N >= 0, |T| <= sigma + mu N} at one of its points.

What Algorithm 3.2 of seed B needs, for Coulomb's cone and for cones truncated by yield stresses, block by block.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from barchan.cones._kernels import project_half_plane

ON_FACE = 1e-12


@njit(cache=True, error_model="numpy")
def project_wedge(a: float, b: float, mu: float) -> tuple[float, float]:
    """Projection of (a, b) on the plane wedge {a >= 0, b <= mu a}, tangent to the rim of a truncated cone."""
    if a >= 0.0 and b <= mu * a:
        return a, b
    if a < 0.0 and b <= 0.0:
        return 0.0, b
    along = (a + mu * b) / (1.0 + mu * mu)
    if along > 0.0:
        return along, mu * along
    return 0.0, 0.0


@njit(cache=True, error_model="numpy")
def project_tangent_block(
    x: np.ndarray, y: np.ndarray, mu: float, sigma: float, tau: float, out: np.ndarray
) -> None:
    """Projection of y (s,) on the tangent cone at x (s,), both counted from 0; x is admissible up to rounding."""
    n = x[0] + tau
    t = 0.0
    for k in range(1, len(x)):
        t += x[k] * x[k]
    t = math.sqrt(t)
    size = max(abs(n), t, sigma, tau)
    at_base = n <= ON_FACE * size
    at_side = t >= sigma + mu * n - ON_FACE * size
    for k in range(len(x)):
        out[k] = y[k]
    if at_side and t <= ON_FACE * size:
        # The axis itself: the tip of the cone, or any point of a half-line (mu = sigma = 0).
        tangential = 0.0
        for k in range(1, len(x)):
            tangential += y[k] * y[k]
        scale = 0.0
        if at_base:
            out[0], scale = project_half_plane(y[0], math.sqrt(tangential), mu, 0.0)
        for k in range(1, len(x)):
            out[k] = scale * y[k]
        return
    if not at_side:
        if at_base:
            out[0] = max(y[0], 0.0)
        return
    outward = 0.0
    for k in range(1, len(x)):
        outward += x[k] * y[k] / t
    if at_base:
        normal, along = project_wedge(y[0], outward, mu)
    else:
        excess = max(outward - mu * y[0], 0.0) / (1.0 + mu * mu)
        normal, along = y[0] + mu * excess, outward - excess
    out[0] = normal
    for k in range(1, len(x)):
        out[k] = y[k] + (along - outward) * x[k] / t


@njit(cache=True, error_model="numpy")
def project_tangent_blocks(x: np.ndarray, y: np.ndarray, laws: np.ndarray, out: np.ndarray) -> None:
    """out_i = projection of y_i on the tangent cone at x_i of the admissible set of law i, for (n, s) arrays."""
    for i in range(x.shape[0]):
        project_tangent_block(x[i], y[i], laws[i, 0], laws[i, 1], laws[i, 2], out[i])
