"""The choice of local solver inside a kernel, by a compile-time code; one dispatch serves every sweep kernel."""

from __future__ import annotations

import numpy as np
from numba import njit

from barchan.friction.local._enumerative import solve_enumerative
from barchan.friction.local._fischer_burmeister import solve_fischer_burmeister
from barchan.friction.local._secular import solve_secular

SECULAR, ENUMERATIVE, FISCHER_BURMEISTER, HYBRID = 0, 1, 2, 3
_NEWTON_STEPS = 50


def scratch(s: int) -> tuple[np.ndarray, np.ndarray]:
    """Scratch of `solve_with`: (11, s) rows and (2 s + 4, max(s, 8)) matrices, for block size `s`."""
    return np.zeros((11, s)), np.zeros((2 * s + 4, max(s, 8)))


@njit(cache=True, error_model="numpy")
def solve_with_newton(s, code, w, b, law, r, rows, matrices):
    """Enumeration, Newton or both (hybrid of seed B 4.1.2: enumerate, then polish from its answer)."""
    mu, zeta = law[0], law[3]
    found = False
    if code != FISCHER_BURMEISTER:
        kept = rows[0]
        kept[:] = r
        found = solve_enumerative(s, w, b, mu, zeta, r, matrices[:s, :3], matrices[s : s + 4])
        if not found:
            r[:] = kept
    if code == FISCHER_BURMEISTER or code == HYBRID:
        size = 0.0
        for j in range(s):
            size = max(size, abs(b[j]) / w[j, j])
        if mu > 0.0:
            tolerance = 1e-14 * size
            error = solve_fischer_burmeister(
                s, w, b, mu, zeta, r, tolerance, _NEWTON_STEPS, rows[1:10], matrices[s + 4 :, :s]
            )
            found = error <= 1e-8 * size
        else:
            r[:] = 0.0
            r[0] = max(0.0, -b[0] / w[0, 0])
            found = True
    return found


@njit(cache=True, error_model="numpy")
def solve_block_kernel(s, code, w, local, b, law, a0, r, rows, matrices):
    """Solve one block with the local solver `code`; returns the sliding multiplier (secular) or 0."""
    if code == SECULAR:
        return solve_secular(s, local, b, law[0], law[1], law[2], law[3], a0, r, rows[0], rows[1])
    solve_with_newton(s, code, w, b, law, r, rows, matrices)
    return 0.0
