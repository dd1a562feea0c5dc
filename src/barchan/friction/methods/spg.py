"""Spectral projected gradient with nonmonotone line search (Birgin, Martinez, Raydan 2000; on friction: Tasora 2013).

Steps of Barzilai and Borwein along P(r - alpha u) - r; the objective is quadratic, so that the line search costs nothing.
Cost of an iteration: one product with W. Cited in seed B 3.3.2 and B.2. Equilibrated unknowns.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from barchan.friction.methods._options import check_counts
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
SUFFICIENT = 1e-4
RANGE = 1e10
REFRESH_EVERY = 50


def spg(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    memory: int = 10,
    shift_rate: float = FIRST_RATE,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    memory : objective values the line search looks back on.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`); it moves once an iteration and is
    frozen in the line search. The values looked back on are differences with the current iterate and are kept.
    operator : see `barchan.friction.operators`.

    Associated laws have no shift: the classical method, which converges. With the shift it is Cadoux's fixed point with
    one inner iteration, without theorem.

    Raises
    ------
    InputError : unknown operator; a count below 1; shift_rate not in (0, 1].
    """
    check_counts(memory=memory, check_every=check_every)
    scaled = scaled_problem(problem, operator)
    x = scaled.start(r0)
    u = scaled.rates(x)
    shift = LaggedShift(scaled, u, shift_rate)
    spectral = 1.0 / scaled.lipschitz
    shortest, longest = spectral / RANGE, spectral * RANGE
    # Objective values relative to that of the current iterate: free of cancellation.
    past: deque[float] = deque([0.0], maxlen=memory)
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit, shift)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        shift.follow(u)
        gradient = shift.added_to(u)
        direction = scaled.project(x - spectral * gradient) - x
        image = scaled.product(direction)
        slope, curvature = float(np.vdot(gradient, direction)), float(np.vdot(direction, image))
        length = _line_search(slope, curvature, max(past))
        gain = length * slope + 0.5 * length * length * curvature
        past.append(gain)
        past = deque((value - gain for value in past), maxlen=memory)
        x = x + length * direction
        u = scaled.rates(x) if (iteration + 1) % REFRESH_EVERY == 0 else u + length * image
        square = float(np.vdot(direction, direction))
        spectral = min(longest, max(shortest, square / curvature)) if curvature > 0.0 else longest


def _line_search(slope: float, curvature: float, highest: float) -> float:
    """Length in (0, 1] with gain <= highest + SUFFICIENT * length * slope, by interpolation of the quadratic."""
    if 0.5 * curvature + slope <= highest + SUFFICIENT * slope:
        return 1.0
    return min(1.0, -slope / curvature)
