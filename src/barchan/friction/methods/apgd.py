"""Accelerated projected gradient descent: Nesterov's inertia, backtracking and restart (Heyn 2013; Mazhar et al. 2015).

Cited in seed B 3.3.2. O(1/k^2) on associated laws; on the DCFP with the shift of the last extrapolated rates.
Equilibrated unknowns. Cost of an iteration: one product with W (rates of extrapolated forces follow by linearity).
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
RELAXED = 0.9
START_FRACTION = 0.3


def apgd(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    curvature: float | None = None,
    restart: bool = True,
    shift_rate: float = FIRST_RATE,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    curvature : first estimate of the largest curvature, in equilibrated unknowns (None: START_FRACTION of its bound L);
    doubled until the quadratic model majorises the objective, lowered by RELAXED after each iteration.
    restart : drop the inertia when the step points uphill.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`).
    operator : see `barchan.friction.operators`.

    Raises
    ------
    InputError : unknown operator; curvature or check_every not positive; shift_rate not in (0, 1].
    """
    check_positive(curvature=curvature)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    bound = scaled.lipschitz
    estimate = START_FRACTION * bound if curvature is None else curvature
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
        gradient = shift.added_to(rates_ahead)
        while True:
            fresh = scaled.project(ahead - gradient / estimate)
            rates = scaled.rates(fresh)
            move = fresh - ahead
            if estimate >= bound or np.vdot(move, rates - rates_ahead) <= estimate * np.vdot(move, move):
                break
            estimate = min(2.0 * estimate, bound)
        following, inertia = nesterov_inertia(theta)
        if restart and np.vdot(gradient, fresh - x) > 0.0:
            following, inertia = 1.0, 0.0
        ahead = fresh + inertia * (fresh - x)
        rates_ahead = rates + inertia * (rates - u)
        x, u, theta = fresh, rates, following
        estimate *= RELAXED
