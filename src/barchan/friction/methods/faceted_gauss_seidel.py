"""Projected Gauss-Seidel for the faceted law, component by component within each block (seed B, 7.1.1 and 7.5.1).

The sweeps of `gauss_seidel` (any form of W, coloured groups in parallel) around a local solver of the law's own. Cost of a
sweep: linear in the stored entries. `faceted` lets them take turns with accelerated gradients, which carry pressure faster.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.local import FACETED_SOLVER
from barchan.friction.methods._portfolio import portfolio
from barchan.friction.methods.apgd import apgd
from barchan.friction.methods.gauss_seidel import DEFAULT_SWEEPS, prepare_sweeper, run_sweeps
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

GRADIENT_COST = 2.0
FIRST_SWEEPS = 30


def faceted(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    min_iterations: int = 0,
) -> None:
    """Solve from `r0` (n, s) with sweeps and accelerated gradients in turns; the law must be `FacetedCoulomb`.

    max_iterations : bound on the work, in sweeps.  min_iterations : sweeps made in any case.

    The law is not associated and its effective friction is up to sqrt(s - 1) times mu: where much slides at once, residuals
    may stop falling between 1e-4 and 2e-3 (collapsing columns with mu_hat = 0.6; docs/solvers.md).
    """
    portfolio(
        problem,
        recorder,
        r0,
        max_iterations,
        operator,
        min_iterations,
        gradient=apgd,
        gradient_cost=GRADIENT_COST,
        first_sweeps=FIRST_SWEEPS,
        sweeps=faceted_gauss_seidel,
    )


def faceted_gauss_seidel(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    parallel: bool | None = None,
    check_every: int = 25,
    min_iterations: int = 0,
) -> None:
    """Sweep from `r0` (n, s), in alternating directions, recording iterates; the law must be `FacetedCoulomb`.

    operator : "auto", "explicit" or "matrix-free".  parallel : coloured sweeps on all threads (None: for large problems).
    check_every : sweeps between residual evaluations.  min_iterations : sweeps made even from a start that will do.

    Raises InputError for an operator that is neither stored nor factored by a diagonal M.
    """
    sweeper = prepare_sweeper(problem, operator, FACETED_SOLVER, parallel)
    sweeper.turning = True
    limit = DEFAULT_SWEEPS if max_iterations is None else max_iterations
    run_sweeps(sweeper, recorder, r0, limit, check_every=check_every, min_iterations=min_iterations)
