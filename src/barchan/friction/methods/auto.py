"""The automatic method: sweeps, Newton and interior points where each pays, chosen by structure and progress (docs/solvers.md).

Choices depend on sizes, residuals and counts only, never on clocks: runs are reproducible.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._island_solver import LARGEST_NEWTON, IslandSolver
from barchan.friction.methods._portfolio import portfolio
from barchan.friction.methods.apgd import apgd
from barchan.friction.methods.gauss_seidel import PARALLEL_BLOCKS
from barchan.friction.methods.interior_point import interior_point
from barchan.friction.methods.newton import newton_fischer_burmeister
from barchan.friction.operators import LARGEST_DENSE_DELASSUS, StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_WORK = 3_000_000
FIRST_SWEEPS = 10
SWEEPS = 500
NEWTON_BUDGET = 60
ATTEMPTS = 7
INTERIOR_STEPS = 60
FIRST_STARTS = (5, 20)
STARTS = (150, 30, 70, 10)
INTERIOR_SIZE = 60_000


def auto(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    min_iterations: int = 0,
) -> None:
    """Solve from `r0` (n, s).

    max_iterations : bound on the work, in Gauss-Seidel sweeps.  min_iterations : sweeps made in any case.
    """
    budget = DEFAULT_WORK if max_iterations is None else max_iterations
    delassus = build_operator(problem, "explicit" if _small(problem, operator) else operator)
    if isinstance(delassus, StoredDelassus) and problem.n < PARALLEL_BLOCKS:
        _by_islands(problem, recorder, IslandSolver(problem, delassus, r0), budget, min_iterations)
        return
    portfolio(problem, recorder, r0, max_iterations, operator, min_iterations)
    if _finished(recorder) or recorder.best is None or max_iterations is not None:
        return
    if isinstance(delassus, StoredDelassus):
        recorder.begin_next()
        _by_islands(problem, recorder, IslandSolver(problem, delassus, recorder.best), budget, 0)
    elif problem.n * problem.s <= INTERIOR_SIZE:
        recorder.begin_next()
        interior_point(problem, recorder, recorder.best)


def _small(problem: Problem, operator: str) -> bool:
    """Whether W is as well stored, so that the problem falls into islands."""
    lumped = not problem.is_reduced and problem.C is None and problem.factor.diagonal is not None
    rows = problem.n * problem.s
    return operator == "auto" and rows <= (LARGEST_NEWTON if lumped else LARGEST_DENSE_DELASSUS)


def _finished(recorder: Recorder) -> bool:
    return recorder.best_residual <= recorder.tolerance or recorder.stopped


def _by_islands(
    problem: Problem, recorder: Recorder, solver: IslandSolver, budget: float, min_iterations: int
) -> None:
    """Sweep all islands, then Newton on the slow ones, then longer sweeps, interior points and more Newton in turn."""
    everything = np.arange(len(solver.sizes))
    first = int(min(max(FIRST_SWEEPS, min_iterations), budget))
    work = solver.sweep(everything, 0.0, first, first)
    if recorder.record(int(work), solver.law_residual, solver.r):
        return
    tolerance = recorder.tolerance
    work += solver.sweep(solver.unsolved(tolerance), tolerance, int(min(SWEEPS, max(budget - work, 0))))
    for attempt in range(ATTEMPTS):
        if recorder.record(int(work), solver.law_residual, solver.r) or work >= budget:
            return
        work += _attack(problem, solver, tolerance, attempt)
        if recorder.record(int(work), solver.law_residual, solver.r) or work >= budget:
            return
        sweeps = int(min(SWEEPS * 2 ** (attempt + 1), max(budget - work, 0)))
        work += solver.sweep_on(solver.unsolved(tolerance), tolerance, sweeps)
    recorder.record(int(work), solver.law_residual, solver.r)


def _attack(problem: Problem, solver: IslandSolver, tolerance: float, attempt: int) -> float:
    """One attempt at the islands that miss their share; the work, in sweeps of the whole."""
    unsolved = solver.unsolved(tolerance)
    large = solver.sizes[unsolved] * problem.s > LARGEST_NEWTON
    work = 0.0
    for island in unsolved[large]:
        work += solver.factorisation[island] * solver.ask(interior_point, island, tolerance, INTERIOR_STEPS)
    budget = NEWTON_BUDGET * 2**attempt
    work += solver.newton(unsolved[~large], tolerance, budget, attempt)
    if attempt == 0:
        for sweeps in FIRST_STARTS:
            for island in np.setdiff1d(solver.unsolved(tolerance), unsolved[large]):
                work += solver.restart(island, tolerance, sweeps, 2 * budget, attempt)
        return work
    # What the Newton does not finish: other starts, other functions, first-order patience.
    for island in np.setdiff1d(solver.unsolved(tolerance), unsolved[large]):
        work += solver.restart(island, tolerance, STARTS[attempt % len(STARTS)], budget, attempt)
        for method, limit, cost in (
            (interior_point, INTERIOR_STEPS, solver.factorisation[island]),
            (newton_fischer_burmeister, 2 * budget, solver.factorisation[island]),
            (apgd, 100 * budget, solver.sizes[island] / problem.n),
        ):
            if solver.residual[island] <= solver.allowed(tolerance)[island]:
                break
            if method is not interior_point or attempt == 1:
                work += cost * solver.ask(method, island, tolerance, limit)
    return work
