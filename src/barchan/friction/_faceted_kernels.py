"""Kernels of the faceted law on all blocks: projection, and the solvers' law residual (the law: `cones/faceted.py`)."""

from __future__ import annotations

import numpy as np
from numba import njit

from barchan.cones._faceted_kernels import faceted_normal_of, faceted_residual_squared


@njit(cache=True, error_model="numpy")
def project_faceted_blocks(x: np.ndarray, laws: np.ndarray, out: np.ndarray) -> None:
    """out_i = nearest point to x_i of the pyramid of its law; x, out (n, s), laws (n, 4)."""
    for i in range(x.shape[0]):
        normal = faceted_normal_of(x[i], laws[i, 0])
        bound = laws[i, 0] * normal
        out[i, 0] = normal
        for k in range(1, x.shape[1]):
            out[i, k] = min(max(x[i, k], -bound), bound)


@njit(cache=True, error_model="numpy")
def faceted_law_residual_squared(
    r: np.ndarray, u: np.ndarray, laws: np.ndarray, rho: np.ndarray
) -> tuple[float, float]:
    """Sum over blocks of the squared natural map of the faceted law, and of |r|^2; r, u (n, s), laws (n, 4), rho (n,)."""
    trial = np.empty(r.shape[1])
    residual = 0.0
    size = 0.0
    for i in range(r.shape[0]):
        residual += faceted_residual_squared(r[i], u[i], laws[i, 0], rho[i], trial)
        for k in range(r.shape[1]):
            size += r[i, k] * r[i, k]
    return residual, size
