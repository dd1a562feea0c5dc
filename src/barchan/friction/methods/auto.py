"""The automatic method: sweeps, gradients, Newton, interior points: chosen by structure and progress (docs/solvers.md).

Choices depend on sizes, residuals and counts only, never on clocks: runs are reproducible.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from barchan.friction.existence import NONE, existence_of
from barchan.friction.methods._continuum import is_continuum, solve_continuum
from barchan.friction.methods._flow import is_flow, solve_flow
from barchan.friction.methods._island_solver import LARGEST_NEWTON, WORTH, IslandSolver
from barchan.friction.methods._portfolio import portfolio
from barchan.friction.methods.apgd import apgd
from barchan.friction.methods.gauss_seidel import PARALLEL_BLOCKS, sor
from barchan.friction.methods.interior_point import interior_point
from barchan.friction.methods.newton import newton_fischer_burmeister
from barchan.friction.operators import LARGEST_DENSE_DELASSUS, StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_WORK = 5_000_000
FIRST_SWEEPS = 10
SWEEPS = 500
NEWTON_BUDGETS = (60, 3000, 6000)
DOUBT = 1
INTERIOR_STEPS = 60
PROJECTED_STEPS = 40_000
STARTS = (5, 20)
INTERIOR_SIZE = 60_000
OVER_RELAXATION = {2: 1.5, 3: 1.3}  # of discs and of spheres, measured on packings


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
    if operator == "auto" and is_flow(problem):
        solve_flow(problem, recorder, r0, max_iterations)
        return
    if operator != "explicit" and is_continuum(problem):
        _continuum(problem, recorder, r0, max_iterations, operator, min_iterations)
        return
    budget = DEFAULT_WORK if max_iterations is None else max_iterations
    delassus = build_operator(problem, "explicit" if _small(problem, operator) else operator)
    if isinstance(delassus, StoredDelassus) and problem.n < PARALLEL_BLOCKS:
        _by_islands(problem, recorder, IslandSolver(problem, delassus, r0), budget, min_iterations)
        return
    run = over_relaxed_portfolio if problem.C is None else portfolio
    run(problem, recorder, r0, max_iterations, operator, min_iterations)
    if recorder.ended or recorder.best is None or max_iterations is not None:
        return
    if isinstance(delassus, StoredDelassus):
        recorder.begin_next()
        _by_islands(problem, recorder, IslandSolver(problem, delassus, recorder.best), budget, 0)
    elif problem.n * problem.s <= INTERIOR_SIZE:
        recorder.begin_next()
        interior_point(problem, recorder, recorder.best)


def _continuum(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None,
    operator: str,
    min_iterations: int,
) -> None:
    """Sweeps and a central path in velocity space; for what they leave of a small problem, islands and Newton."""
    small = operator == "auto" and problem.n * problem.s <= LARGEST_NEWTON
    left = solve_continuum(problem, recorder, r0, max_iterations, operator, min_iterations, last=not small)
    if small and left >= 1.0 and not recorder.ended:
        assert recorder.best is not None
        delassus = build_operator(problem, "explicit")
        assert isinstance(delassus, StoredDelassus)
        recorder.begin_next()
        _by_islands(problem, recorder, IslandSolver(problem, delassus, recorder.best), left, 0)


def over_relaxed_portfolio(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "explicit",
    min_iterations: int = 0,
) -> None:
    """The portfolio with over-relaxed sweeps: dense packings take a third of the sweeps, and fewer end in a cycle."""
    portfolio(problem, recorder, r0, max_iterations, operator, min_iterations, sweeps=_over_relaxed)


def _over_relaxed(problem: Problem, recorder: Recorder, r0: np.ndarray, **options: Any) -> None:
    sor(problem, recorder, r0, relaxation=OVER_RELAXATION.get(problem.s, 1.0), **options)


def _small(problem: Problem, operator: str) -> bool:
    """Whether W is as well stored, so that the problem falls into islands."""
    lumped = not problem.is_reduced and problem.C is None and problem.factor.diagonal is not None
    rows = problem.n * problem.s
    return operator == "auto" and rows <= (LARGEST_NEWTON if lumped else LARGEST_DENSE_DELASSUS)


def _by_islands(
    problem: Problem, recorder: Recorder, solver: IslandSolver, budget: float, min_iterations: int
) -> None:
    """Sweep all islands; on slow ones gradients where Newton is dear, Newton, longer sweeps, interior points in turn."""
    everything = np.arange(len(solver.sizes))
    tolerance = recorder.tolerance
    solver.sweep(everything, 0.0, 0)
    if recorder.record(0, solver.law_residual, solver.r) and (min_iterations == 0 or recorder.stopped):
        return
    first = int(min(max(FIRST_SWEEPS, min_iterations), budget))
    work = solver.sweep(everything, 0.0, first, first)
    if recorder.record(int(work), solver.law_residual, solver.r) or work >= budget:
        return
    work += solver.sweep(solver.unsolved(tolerance), tolerance, int(min(SWEEPS, budget - work)))
    for attempt in range(len(NEWTON_BUDGETS)):
        if recorder.record(int(work), solver.law_residual, solver.r) or work >= budget:
            return
        if attempt == DOUBT and existence_of(problem).verdict == NONE:
            return
        work += _Attack(problem, solver, tolerance, budget - work).run(attempt)
        if recorder.record(int(work), solver.law_residual, solver.r) or work >= budget:
            return
        sweeps = int(min(SWEEPS * 2 ** (attempt + 1), budget - work))
        work += solver.sweep_on(solver.unsolved(tolerance), tolerance, sweeps)
    recorder.record(int(work), solver.law_residual, solver.r)


class _Attack:
    """One attempt at the islands that miss their share; `work` counts sweeps of the whole and stays below `allowance`."""

    def __init__(self, problem: Problem, solver: IslandSolver, tolerance: float, allowance: float) -> None:
        self.problem, self.solver, self.tolerance = problem, solver, tolerance
        self.allowance = allowance
        self.work = 0.0

    def run(self, attempt: int) -> float:
        """Newton on all open islands, from better and better starts."""
        solver = self.solver
        for island in solver.unsolved(self.tolerance) if attempt == 0 else ():
            self._iterate(int(island))
        unsolved = solver.unsolved(self.tolerance)
        large = unsolved[solver.sizes[unsolved] * self.problem.s > LARGEST_NEWTON]
        for island in large:
            self._ask(interior_point, island, INTERIOR_STEPS, solver.factorisation[island])
        chosen = np.setdiff1d(unsolved, large)
        for island in chosen if attempt > 0 else ():
            self._prepare(int(island), attempt)
        chosen = np.setdiff1d(solver.unsolved(self.tolerance), large)
        budget = NEWTON_BUDGETS[attempt]
        if len(chosen):
            most = self._affordable(budget, float(solver.factorisation[chosen].sum()))
            used = solver.newton(chosen, self.tolerance, most, attempt)
            self.work += float(used @ solver.factorisation)
        for island in np.setdiff1d(solver.unsolved(self.tolerance), large):
            self._finish(int(island), budget, attempt)
        return self.work

    def _iterate(self, island: int) -> None:
        """Sweeps and gradients in turns where Newton's method costs more than SWEEPS sweeps, and as long as it would.

        Dense packings of discs take them about a thousand, and a factorisation costs hundreds.
        """
        worth = int(WORTH * self.solver.effort[island])
        if worth > SWEEPS:
            self._ask(
                over_relaxed_portfolio, island, worth, float(self.solver.sizes[island]) / self.problem.n
            )

    def _prepare(self, island: int, attempt: int) -> None:
        """Bring an island near its solution by methods that do not need to know which blocks stick."""
        if attempt == 1:
            self._ask(interior_point, island, INTERIOR_STEPS, float(self.solver.factorisation[island]))
        self._ask(apgd, island, PROJECTED_STEPS, self.solver.sizes[island] / self.problem.n)

    def _finish(self, island: int, budget: int, attempt: int) -> None:
        """After the first attempt other starts, after the later ones another function."""
        solver, cost = self.solver, float(self.solver.factorisation[island])
        if attempt > 0:
            self._ask(newton_fischer_burmeister, island, budget // 4, cost)
            return
        share = float(solver.sizes[island]) / self.problem.n
        for sweeps in STARTS:
            most = self._affordable(2 * budget, cost)
            if self._open(island) and most > 0 and self._affordable(sweeps, share) == sweeps:
                self.work += solver.restart(island, self.tolerance, sweeps, most, attempt)

    def _ask(self, method: Callable[..., None], island: int, limit: int, cost: float) -> None:
        most = self._affordable(limit, cost)
        if self._open(island) and most > 0 and self._serves(method, island):
            self.work += cost * self.solver.ask(method, island, self.tolerance, most)

    def _serves(self, method: Callable[..., None], island: int) -> bool:
        """Fischer and Burmeister's function knows no shear yield."""
        yields = self.solver.laws[self.solver.blocks(island), 1].any()
        return not (yields and method is newton_fischer_burmeister)

    def _open(self, island: int) -> bool:
        return bool(self.solver.residual[island] > self.solver.allowed(self.tolerance)[island])

    def _affordable(self, count: int, cost: float) -> int:
        """At most `count` steps of this cost within the allowance."""
        return int(max(0.0, min(count, (self.allowance - self.work) / max(cost, 1e-300))))
