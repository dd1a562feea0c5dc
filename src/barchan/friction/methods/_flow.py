"""Friction problems of a flow: a sparse M whose inverse is dense, and about as many forces as velocities (seed B, chapter 6).

W cannot be stored. Gradient methods pay where the start is near, as from one time step to the next; the split central path does
not need a start. Gradients end what it leaves, and it what they leave.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods.aspg import aspg
from barchan.friction.methods.split_interior_point import split_interior_point
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

SMALLEST_FLOW = 1500
FEWEST_FORCES = 0.25
# Work in solves with the factors of M: an iteration of the path costs about ten.
PATH_SOLVES, PATH_STEPS = 10, 80
# Gradients gain at once or never: where the flow is not elliptic they leave a solution they have come near to.
GRADIENT_SOLVES, FROZEN = 200, 10
DEFAULT_WORK = PATH_SOLVES * PATH_STEPS + 2 * GRADIENT_SOLVES


def is_flow(problem: Problem) -> bool:
    """Whether M is sparse with a dense inverse, nothing is bilateral, and forces are as many as a discretised stress has."""
    if problem.is_reduced or problem.C is not None or problem.factor.kind != "sparse":
        return False
    rows = problem.n * problem.s
    return rows >= max(SMALLEST_FLOW, FEWEST_FORCES * problem.size)


def solve_flow(problem: Problem, recorder: Recorder, r0: np.ndarray, max_iterations: int | None) -> None:
    """Gradients from a warm start `r0` (n, s), the central path, gradients from the best point.

    max_iterations : bound on the work, in solves with M.
    """
    budget = DEFAULT_WORK if max_iterations is None else max_iterations
    if r0.any():
        warm = min(GRADIENT_SOLVES, budget)
        _gradients(problem, recorder, r0, warm)
        budget -= warm
        if recorder.ended or budget <= 0:
            return
        recorder.begin_next()
    steps = min(PATH_STEPS, budget // PATH_SOLVES)
    if steps > 0:
        split_interior_point(problem, recorder, r0, max_iterations=steps)
        budget -= PATH_SOLVES * steps
    if recorder.ended or recorder.best is None or budget <= 0:
        return
    recorder.begin_next()
    _gradients(problem, recorder, recorder.best, min(GRADIENT_SOLVES, budget))


def _gradients(problem: Problem, recorder: Recorder, r0: np.ndarray, solves: int) -> None:
    """ASPG with a shift that rests for FROZEN iterations: one that follows every iterate leaves a near solution again."""
    aspg(problem, recorder, r0, max_iterations=solves, operator="matrix-free", shift_every=FROZEN)
