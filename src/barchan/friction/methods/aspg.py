"""Accelerated spectral projected gradient, on the DCFP (d = -u - s(u)) or its convexification (seed B Algorithm B.2).

Forces are scaled block by block by sqrt(rho_i), which keeps the cones and equilibrates W. Cost of an iteration: one
product with W. Inertia by ERRATA 9.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._inertia import nesterov_inertia
from barchan.friction.methods._options import check_counts
from barchan.friction.methods._scaled import ScaledProblem, scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 20_000
SMALLEST_STEP, LARGEST_STEP = 1e-6, 1e6


def aspg(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    check_every: int = 5,
    shift_every: int = 1,
    shift_rate: float = FIRST_RATE,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    operator : "auto", "explicit" or "matrix-free" (see `barchan.friction.operators`).
    shift_every : iterations between updates of the De Saxce shift s(u); 1 is Algorithm B.2, more freezes a convex
    problem in between (Cadoux's fixed point, seed B 2.3.2, with inexact inner solves) and restarts the inertia.
    shift_rate : how far an update moves it towards s(u) at first; less when the method stagnates (see `_shift`).

    Raises
    ------
    InputError : unknown operator; a count below 1; shift_rate not in (0, 1].
    """
    check_counts(check_every=check_every, shift_every=shift_every)
    scaled = scaled_problem(problem, operator)
    x = scaled.start(r0)
    u = scaled.rates(x)
    shift = LaggedShift(scaled, u, shift_rate)
    projected = x
    inertia = 1.0
    step = _first_step(scaled, -shift.added_to(u))
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    for iteration in range(limit + 1):
        last = iteration == limit
        if iteration % check_every == 0 or last:
            candidate = scaled.root * scaled.project(x)
            residual = scaled.residual(candidate)
            if recorder.record(iteration, residual, candidate) or last:
                return
            shift.watch(iteration, residual)
        if iteration % shift_every == 0:
            shift.follow(u)
            if shift_every > 1:
                inertia = 1.0
        direction = -shift.added_to(u)
        fresh = scaled.project(x + step * direction)
        if np.vdot(fresh - projected, direction) > 0.0:
            inertia, beta = nesterov_inertia(inertia)
            following = fresh + beta * (fresh - projected)
        else:
            inertia, following = 1.0, fresh
        projected = fresh
        rates = scaled.rates(following)
        change = rates - u
        square = np.vdot(change, change)
        spectral = np.vdot(following - x, change) / square if square > 0.0 else step
        step = min(LARGEST_STEP, max(SMALLEST_STEP, spectral)) if spectral > 0.0 else SMALLEST_STEP
        x, u = following, rates


def _first_step(scaled: ScaledProblem, direction: np.ndarray) -> float:
    """The step of steepest descent along the first direction: later steps are spectral, a bound of W would cost 25 products."""
    curvature = float(np.vdot(direction, scaled.product(direction)))
    if curvature <= 0.0:
        return SMALLEST_STEP
    return min(LARGEST_STEP, max(SMALLEST_STEP, float(np.vdot(direction, direction)) / curvature))
