"""Projected-gradient method: the gradient is projected on the tangent cone before the step (seed B Algorithm 3.2).

Exact line search on the quadratic model along the projected gradient, then projection; falls back on a plain projected
step where the set bends too much. Equilibrated unknowns. Two products with W per iteration, one when nothing bends.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._options import check_choice, check_counts, check_positive
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import ScaledProblem, scaled_problem
from barchan.friction.methods._tangent_cone import project_tangent_blocks
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
TANGENTS = ("exact", "two-projections")
SUFFICIENT = 0.1
TRIALS = 3


def tangent_gradient(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    tangent: str = "exact",
    probe: float | None = None,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    tangent : "exact" projects on the tangent cone; "two-projections" takes P(r - probe u) - r in its place (seed B).
    probe : that step, in equilibrated unknowns (None: 1 / L).
    operator : see `barchan.friction.operators`.

    The De Saxce shift is that of the last rates, frozen during a line search. With associated laws the objective never
    increases and cluster points are solutions: either a step at least 1 / (4 L) long gains a fraction of the squared
    projected gradient, or a projected gradient step 1 / L is taken.

    Raises
    ------
    InputError : unknown tangent or operator; probe or check_every not positive.
    """
    check_choice("tangent", tangent, TANGENTS)
    check_positive(probe=probe)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    x = scaled.start(r0)
    u = scaled.rates(x)
    reach = None if tangent == "exact" else (probe or 1.0 / scaled.lipschitz)
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        x, u = _advance(scaled, x, u, reach)


def _advance(
    scaled: ScaledProblem, x: np.ndarray, u: np.ndarray, reach: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Next x and its rates."""
    gradient = scaled.shifted(u)
    safe = 1.0 / scaled.lipschitz
    if reach is None:
        direction = np.empty_like(x)
        project_tangent_blocks(x, -gradient, scaled.laws, direction)
    else:
        direction = scaled.project(x - reach * gradient) - x
    slope = float(np.vdot(gradient, direction))
    if slope < 0.0:
        curvature = float(np.vdot(direction, scaled.product(direction)))
        step = -slope / curvature if curvature > 0.0 else safe
        shortest = 0.25 * safe
        for _ in range(TRIALS):
            fresh = scaled.project(x + step * direction)
            rates = scaled.rates(fresh)
            move = fresh - x
            gain = np.vdot(gradient, move) + 0.5 * np.vdot(move, rates - u)
            if gain <= SUFFICIENT * step * slope:
                return fresh, rates
            step *= 0.5
            if step < shortest:
                break
    fresh = scaled.project(x - safe * gradient)
    return fresh, scaled.rates(fresh)
