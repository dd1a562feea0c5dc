"""Chambolle and Pock's primal-dual method, accelerated by the strong convexity of the kinetic energy (2011, Alg. 1 and 2).

Arrow-Hurwicz with extrapolated velocities (seed B 3.3.3). Velocities are measured in the energy norm of M, where the
modulus is 1 and |H|^2 = L: M alone is factorised though the steps vary. Cost of an iteration: one product with W.
"""

from __future__ import annotations

import math

import numpy as np

from barchan.friction.methods._options import check_counts, check_positive
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
FIRST_STEP = 0.2
SMALLEST_STEP = 0.03


def chambolle_pock(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    velocity_step: float = FIRST_STEP,
    force_step: float | None = None,
    accelerated: bool = True,
    smallest_step: float = SMALLEST_STEP,
    shift_rate: float = FIRST_RATE,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    velocity_step : first tau.  force_step : first sigma, in equilibrated unknowns (None: 1 / (tau L)); converges on
    associated laws when sigma tau L <= 1, L the largest eigenvalue of the scaled W.
    accelerated : tau falls and sigma grows as theta = (1 + 2 tau)^(-1/2) has it (O(1/k^2)), until tau <= smallest_step:
    from then on Algorithm 1, whose rate is linear near most solutions while that of Algorithm 2 is not.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`).
    operator : see `barchan.friction.operators`.

    Raises
    ------
    InputError : unknown operator; a step or check_every not positive; shift_rate not in (0, 1].
    """
    check_positive(velocity_step=velocity_step, force_step=force_step, smallest_step=smallest_step)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    tau = velocity_step
    sigma = force_step or 1.0 / (tau * scaled.lipschitz)
    x = scaled.start(r0)
    u = scaled.rates(x)
    shift = LaggedShift(scaled, u, shift_rate)
    rates = ahead = u
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit, shift)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        shift.follow(ahead)
        x = scaled.project(x - sigma * shift.added_to(ahead))
        u = scaled.rates(x)
        damped = (tau * u + rates) / (1.0 + tau)
        theta = 1.0
        if accelerated and tau > smallest_step:
            theta = 1.0 / math.sqrt(1.0 + 2.0 * tau)
            tau, sigma = theta * tau, sigma / theta
        ahead = damped + theta * (damped - rates)
        rates = damped
