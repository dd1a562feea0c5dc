"""One block of the faceted law by projected Gauss-Seidel on its components (seed B, 7.1.1; the law: `cones/faceted.py`)."""

from __future__ import annotations

from numba import njit

PASSES = 30
TOLERANCE = 1e-7


@njit(cache=True, error_model="numpy")
def solve_faceted(s, w, b, mu, r):
    """Improve r (s,) towards u = W r + b, u_N and r_N complementary, r_Tk on the box of half-width mu r_N against u_Tk.

    W (s, s) with a positive diagonal. At most PASSES passes over the components, fewer once a pass changes r by less than
    TOLERANCE: blocks need no more accuracy than the sweeps around them.
    """
    for _ in range(PASSES):
        change = 0.0
        size = 0.0
        for k in range(s):
            u = b[k]
            for j in range(s):
                u += w[k, j] * r[j]
            value = r[k] - u / w[k, k]
            if k == 0:
                value = max(value, 0.0)
            else:
                value = min(max(value, -mu * r[0]), mu * r[0])
            change += (value - r[k]) ** 2
            size += value * value
            r[k] = value
        if change <= TOLERANCE * TOLERANCE * size:
            return
