"""Small dense linear systems inside a block solve: Gaussian elimination with partial pivoting, any size, in place.

Shared by the Newton local solvers (seed B 4.1.1) and by the four-sided pyramid. Cost: O(s^3).
"""

from __future__ import annotations

from numba import njit


@njit(cache=True, error_model="numpy")
def solve_dense(s, a, x):
    """x <- a^{-1} x for `a` (s, s) and `x` (s,), both overwritten; False when `a` is singular."""
    for k in range(s):
        pivot = k
        for i in range(k + 1, s):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if a[pivot, k] == 0.0:
            return False
        if pivot != k:
            for j in range(k, s):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            x[k], x[pivot] = x[pivot], x[k]
        inverse = 1.0 / a[k, k]
        a[k, k] = inverse
        for i in range(k + 1, s):
            factor = a[i, k] * inverse
            for j in range(k + 1, s):
                a[i, j] -= factor * a[k, j]
            x[i] -= factor * x[k]
    for k in range(s - 1, -1, -1):
        for j in range(k + 1, s):
            x[k] -= a[k, j] * x[j]
        x[k] *= a[k, k]
    return True
