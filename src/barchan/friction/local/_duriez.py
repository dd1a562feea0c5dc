"""Fixed point of Duriez for one block: normal force from the normal equation, tangential force by projection on its disc.

Seed B 4.2.3 (Duriez et al. 2006; iterated to a fixed point: Duriez 2008). A fixed point satisfies Coulomb's law exactly; with
dilatancy the normal equation sees u_N - zeta |u_T|. Linear convergence, not guaranteed. Cost: O(s^2) per iteration.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def solve_duriez(s, w, b, mu, zeta, r, tolerance, max_iterations, u):
    """Iterate from the given `r` (s,), overwritten; returns the length of the last change. Scratch `u` (s,)."""
    trace = 0.0
    for j in range(1, s):
        trace += w[j, j]
    rho_n, rho_t = 1.0 / w[0, 0], (s - 1) / trace
    change = math.inf
    for _ in range(max_iterations):
        slip = 0.0
        for i in range(s):
            value = b[i]
            for j in range(s):
                value += w[i, j] * r[j]
            u[i] = value
            if i > 0:
                slip += value * value
        normal = max(0.0, r[0] - rho_n * (u[0] - zeta * math.sqrt(slip)))
        moved = normal - r[0]
        change = moved * moved
        r[0] = normal
        length = 0.0
        for i in range(1, s):
            # The tangential velocity that goes with the new normal force.
            u[i] = r[i] - rho_t * (u[i] + w[i, 0] * moved)
            length += u[i] * u[i]
        length = math.sqrt(length)
        scale = 1.0 if length <= mu * normal else mu * normal / length
        for i in range(1, s):
            moved = scale * u[i] - r[i]
            change += moved * moved
            r[i] = scale * u[i]
        change = math.sqrt(change)
        if change <= tolerance:
            break
    return change
