"""Continuation: a sequence of models, each solved from the solution of the one before (seed C 5.3, Table 13)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import ViscosityModel
from barchan.flows.quasi_newtonian.newton import (
    FlowSolution,
    LinearSolver,
    NonlinearOptions,
    Start,
    solve_flow,
)


def solve_continued(
    flow: QuasiNewtonianFlow,
    models: Sequence[ViscosityModel],
    linear: Callable[[QuasiNewtonianFlow], LinearSolver],
    options: NonlinearOptions,
    start: Start | None = None,
) -> list[FlowSolution]:
    """One solution for each model, in order; a solution that misses the tolerance is still the start of the next.

    flow : mesh, conditions and data; its own model is not used.  linear : flow -> linear solver.
    Raises InputError for no models.
    """
    if len(models) == 0:
        raise InputError("models", "none", "at least one model")
    solutions = []
    for model in models:
        current = flow.with_model(model)
        solution = solve_flow(current, linear(current), options, start)
        solutions.append(solution)
        start = solution.state
    return solutions
