"""Alternating minimisation algorithm on the primal problem, plain or accelerated (seed B Algorithm 3.5).

Velocities are minimised exactly, v = M^-1 (f + H^T r) with C v = k, so that their rates are W r + b: one product with W
per iteration. Acceleration with restart after Goldstein et al. 2014. Equilibrated unknowns.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._inertia import nesterov_inertia
from barchan.friction.methods._options import check_counts, check_positive
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
PLAIN_FRACTION = 1.8


def ama(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    penalty: float | None = None,
    accelerated: bool = True,
    shift_rate: float = FIRST_RATE,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    penalty : gamma of the augmented Lagrangian, in equilibrated unknowns; converges on associated laws when it is below
    2 / L, at most 1 / L if accelerated, L the largest eigenvalue of the scaled W. None: 1.8 / L or 1 / L with the bound
    of `_norms`.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`).
    operator : see `barchan.friction.operators`.
    accelerated : inertia on the forces, dropped when it points uphill.

    The prox of the second line is Moreau's complement of the projection of forces, so that the update of r reads
    P(r - gamma (u + s(u))) for every law; s is that of the same rates (seed B: w becomes w + s(H v + w)).

    Raises
    ------
    InputError : unknown operator; penalty or check_every not positive; shift_rate not in (0, 1].
    """
    check_positive(penalty=penalty)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    fraction = 1.0 if accelerated else PLAIN_FRACTION
    gamma = fraction / scaled.lipschitz if penalty is None else penalty
    x = scaled.start(r0)
    u = scaled.rates(x)
    shift = LaggedShift(scaled, u, shift_rate)
    ahead, rates_ahead, theta = x, u, 1.0
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit, shift)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        shift.follow(rates_ahead)
        fresh = scaled.project(ahead - gamma * shift.added_to(rates_ahead))
        rates = scaled.rates(fresh)
        following, inertia = nesterov_inertia(theta)
        if not accelerated or np.vdot(ahead - fresh, fresh - x) > 0.0:
            following, inertia = 1.0, 0.0
        ahead = fresh + inertia * (fresh - x)
        rates_ahead = rates + inertia * (rates - u)
        x, u, theta = fresh, rates, following
