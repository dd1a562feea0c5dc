"""Implicit time stepping of quasi-Newtonian flows: backward Euler and the two-step backward difference of second order.

Every step is one nonlinear solve with du/dt = rate u - past, from the state at its start.
"""

from __future__ import annotations

import numpy as np

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.flow import Inertia

SCHEMES = ("backward-euler", "bdf2")


def backward_difference(scheme: str, dt: float, now: np.ndarray, before: np.ndarray | None = None) -> Inertia:
    """The time derivative at the end of a step of length dt.

    now : (N, 2) velocity at its start.  before : one equal step earlier, None at the first step (then backward Euler).

    Raises InputError for an unknown scheme or a step that is not positive.
    """
    if scheme not in SCHEMES:
        raise InputError("scheme", scheme, "one of " + ", ".join(SCHEMES))
    if not (np.isfinite(dt) and dt > 0.0):
        raise InputError("dt", dt, "a positive number")
    if scheme == "bdf2" and before is not None:
        return Inertia(1.5 / dt, (2.0 * now - 0.5 * before) / dt)
    return Inertia(1.0 / dt, now / dt)
