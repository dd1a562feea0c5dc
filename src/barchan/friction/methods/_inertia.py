"""Nesterov's inertia, shared by the accelerated methods (seed B, procedure of Algorithm B.2; ERRATA 9)."""

from __future__ import annotations

import math


def nesterov_inertia(theta: float) -> tuple[float, float]:
    """(theta', beta) from theta, 1 at first: x is extrapolated by beta times its last move. With t = 1 / theta it is the
    sequence of FISTA, t' = (1 + sqrt(1 + 4 t^2)) / 2 and beta = (t - 1) / t'.
    """
    delta = theta * math.sqrt(theta * theta + 4.0)
    following = 0.5 * (delta - theta * theta)
    return following, theta * (1.0 - theta) / (theta * theta + following)
