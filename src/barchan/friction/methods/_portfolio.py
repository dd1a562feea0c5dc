"""A portfolio of iterative solvers that share one iterate, work going to whichever reduces the residual fastest.

Gauss-Seidel removes local errors and copes with high friction; accelerated gradients (ASPG, APGD) carry pressure across the
whole system but may stall on the non-associated coupling. Choices depend on residuals and counts only, never on clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from barchan.friction.methods.aspg import aspg
from barchan.friction.methods.gauss_seidel import can_sweep, gauss_seidel
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_WORK = 40_000
CHUNK = 100
FIRST_RETRY = 4
NEARLY_BEST = 2.0


@dataclass
class _Member:
    """A solver of the portfolio and how well it did when last asked.

    cost : work of an iteration, in Gauss-Seidel sweeps.  rate : logarithm of the residual gained per unit of work.
    chunk : iterations it gets when asked (doubled each time they gain nothing, so that it does not repeat itself).
    idle : chunks since it was asked.  patience : chunks after which it is asked again (doubled each time it disappoints).
    """

    run: Callable[..., None]
    cost: float
    options: dict[str, Any]
    rate: float = math.inf
    chunk: int = CHUNK
    idle: int = 0
    patience: int = FIRST_RETRY

    @property
    def promise(self) -> float:
        """What to expect: the last rate, or a fresh chance after a while."""
        return math.inf if self.idle >= self.patience else self.rate


def portfolio(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    min_iterations: int = 0,
    gradient: Callable[..., None] = aspg,
    gradient_cost: float = 1.5,
    first_sweeps: int = CHUNK,
    sweeps: Callable[..., None] = gauss_seidel,
) -> None:
    """Solve from `r0` (n, s) with Gauss-Seidel and a gradient method in turns of CHUNK iterations or more.

    max_iterations : bound on the work, in Gauss-Seidel sweeps.  min_iterations : sweeps made in any case.
    gradient : a method with the option `operator`.  gradient_cost : work of its iteration.
    first_sweeps : Gauss-Seidel sweeps of the first turn.  sweeps : the method that makes them.
    """
    members = [_Member(gradient, gradient_cost, {"operator": operator})]
    if can_sweep(problem):
        members.insert(
            0,
            _Member(
                sweeps,
                1.0,
                {"operator": operator, "min_iterations": min_iterations},
                chunk=max(first_sweeps, min_iterations),
            ),
        )
    budget = float(DEFAULT_WORK if max_iterations is None else max_iterations)
    start = r0
    while True:
        member = max(members, key=lambda m: m.promise)
        before = recorder.best_residual
        count = max(0, min(member.chunk, int(budget / member.cost)))
        member.run(problem, recorder, start, max_iterations=count, **member.options)
        member.options.pop("min_iterations", None)
        recorder.begin_next()
        budget -= count * member.cost
        if recorder.ended or budget < members[-1].cost:
            return
        before = recorder.history[0].residual if before == math.inf else before
        _update(members, member, before, recorder.best_residual, count)
        start = _restart(recorder)


def _restart(recorder: Recorder) -> np.ndarray:
    """The last iterate while it is nearly the best (it carries progress that the residual does not show), else the best."""
    assert recorder.last is not None and recorder.best is not None
    near = recorder.history[-1].residual <= NEARLY_BEST * recorder.best_residual
    return (recorder.last if near else recorder.best).copy()


def _update(members: list[_Member], asked: _Member, before: float, after: float, count: int) -> None:
    if asked.idle >= asked.patience:
        asked.patience *= 2
    gained = math.log(before / after) if 0.0 < after < before < math.inf else 0.0
    asked.rate = math.inf if before == math.inf else gained / (max(count, 1) * asked.cost)
    asked.chunk = CHUNK if gained > 0.0 or before == math.inf else 2 * asked.chunk
    for member in members:
        member.idle = 0 if member is asked else member.idle + 1
    if asked.rate >= max(m.rate for m in members):
        asked.patience = FIRST_RETRY
