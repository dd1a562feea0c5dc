"""Proximal Newton as a method of its own: damped Newton steps under a shrinking proximal term on each island.

Seed B Eq. (3.14) on whole islands, 3.1.2 on the natural map; what `auto` uses where sweeps are slow.
"""

from __future__ import annotations

import numpy as np

from barchan.errors import InputError
from barchan.friction.methods._island_solver import LARGEST_NEWTON, IslandSolver
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 2000
FIRST_BUDGET = 60


def proximal_newton(
    problem: Problem, recorder: Recorder, r0: np.ndarray, max_iterations: int | None = None
) -> None:
    """Solve from `r0` (n, s); `max_iterations` bounds the factorisations of an island.

    Cost of an iteration: a dense factorisation of each island that is not solved yet.

    Raises
    ------
    InputError : an island of more than LARGEST_NEWTON rows.
    """
    delassus = build_operator(problem, "explicit")
    assert isinstance(delassus, StoredDelassus)
    solver = IslandSolver(problem, delassus, r0)
    largest = int(solver.sizes.max()) * problem.s
    if largest > LARGEST_NEWTON:
        allowed = f"another: an island has {largest} rows, over {LARGEST_NEWTON}"
        raise InputError("method", "proximal_newton", allowed)
    everything = np.arange(len(solver.sizes))
    solver.sweep(everything, 0.0, 0)
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    if recorder.record(0, solver.law_residual, solver.r) or limit == 0:
        return
    # One sweep tells the size of the forces, which the residual is relative to.
    solver.sweep(everything, 0.0, 1, 1)
    done = 0
    for attempt in range(limit):
        budget = min(FIRST_BUDGET * 2**attempt, limit - done)
        used = solver.newton(solver.unsolved(recorder.tolerance), recorder.tolerance, budget, attempt)
        done += max(1, int(used.max()))
        if recorder.record(done, solver.law_residual, solver.r) or done >= limit:
            return
