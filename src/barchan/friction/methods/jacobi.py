"""Damped block Jacobi: every block solved against the forces of the last sweep (seed B 3.4.1), then moved part of the way.

With W <= lambda D, D the block diagonal, a step of omega < 2 / lambda decreases the energy of the convexified problem; by
default omega is a safe fraction of that, lambda estimated by power iterations. The result depends on no order of the blocks.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.local import LocalCounts
from barchan.friction.methods.gauss_seidel import (
    DEFAULT_SWEEPS,
    Sweeper,
    checked_relaxation,
    prepare_sweeper,
    run_sweeps,
)
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

POWER_ITERATIONS = 20
SAFE_STEP = 1.6


def jacobi(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    local_solver: str = "secular",
    operator: str = "auto",
    parallel: bool | None = None,
    damping: float | None = None,
    check_every: int = 25,
    counts: LocalCounts | None = None,
) -> None:
    """Sweep from `r0` (n, s), recording iterates.

    Parameters
    ----------
    damping : omega, between 0 and 2; each block moves omega times as far as its solution and is projected. None: the
    smaller of 1 and SAFE_STEP / lambda_max(D^-1 W).
    Others, and errors, as `gauss_seidel`.
    """
    sweeper = prepare_sweeper(problem, operator, local_solver, parallel, jacobi=True, counts=counts)
    omega = _safe_damping(sweeper) if damping is None else damping
    sweeper.relaxation = checked_relaxation(omega)
    limit = DEFAULT_SWEEPS if max_iterations is None else max_iterations
    run_sweeps(sweeper, recorder, r0, limit, check_every=check_every)


def _safe_damping(sweeper: Sweeper) -> float:
    """min(1, SAFE_STEP / lambda_max(D^-1 W)), from POWER_ITERATIONS products with the W that sweeps see."""
    problem = sweeper.problem
    inverse = np.linalg.inv(sweeper.diagonal)
    x = np.random.default_rng(0).standard_normal((problem.n, problem.s))
    largest = 0.0
    for _ in range(POWER_ITERATIONS):
        y = np.einsum("iab,ib->ia", inverse, sweeper.swept.apply(x))
        largest = float(np.linalg.norm(y) / np.linalg.norm(x))
        if not largest > 0.0:
            return 1.0
        x = y / np.linalg.norm(y)
    return min(1.0, SAFE_STEP / largest)
