"""One call from a flow to its solution: nonlinear method, linear solver and start, chosen by name."""

from __future__ import annotations

from collections.abc import Sequence

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.direct import DirectSolver
from barchan.flows.quasi_newtonian.flow import Inertia, QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.multigrid import MultigridSolver
from barchan.flows.quasi_newtonian.nested import solve_nested
from barchan.flows.quasi_newtonian.newton import (
    FlowSolution,
    LinearSolver,
    NonlinearOptions,
    Start,
    solve_flow,
)
from barchan.linalg.multigrid import CycleOptions
from barchan.spaces.quadratic import QuadraticSpace

LINEAR_SOLVERS = ("direct", "multigrid")


def solve(
    flow: QuasiNewtonianFlow,
    options: NonlinearOptions | None = None,
    linear_solver: str = "direct",
    spaces: Sequence[QuadraticSpace] = (),
    nested: bool = False,
    start: Start | None = None,
    inertia: Inertia | None = None,
    gain: float = 0.25,
    max_cycles: int = 10,
    cycle: CycleOptions | None = None,
) -> FlowSolution:
    """The steady flow, or that at the end of an implicit time step.

    Parameters
    ----------
    options : nonlinear method and tolerance.   linear_solver : "direct" or "multigrid".
    spaces : coarse to fine, the last one that of the flow; for multigrid and nested iteration.
    nested : start from the solution on the next coarser space, and that one likewise.
    start : velocity, pressure, auxiliary direction; at rest when None. Not together with `nested`.
    inertia : time derivative, of an implicit time step; the flow is then that at its end.
    gain, max_cycles, cycle : of multigrid solves.

    Raises InputError for an unknown linear solver, or spaces that are missing or do not fit.
    """
    options = options or NonlinearOptions()
    if linear_solver not in LINEAR_SOLVERS:
        raise InputError("linear_solver", linear_solver, "one of " + ", ".join(LINEAR_SOLVERS))
    if (nested or linear_solver == "multigrid") and (len(spaces) == 0 or spaces[-1] is not flow.space):
        raise InputError("spaces", f"{len(spaces)} spaces", "coarse to fine, the last one that of the flow")
    if nested and start is not None:
        raise InputError("start", "given", "left out in nested iteration")

    def linear(level: QuasiNewtonianFlow, number: int) -> LinearSolver:
        # The coarsest level is solved directly in any case.
        if linear_solver == "direct" or number == 0:
            return DirectSolver(level)
        return MultigridSolver(level, spaces[: number + 1], gain, max_cycles, cycle)

    if nested:
        return solve_nested(flow, spaces, linear, options)
    return solve_flow(flow, linear(flow, max(len(spaces) - 1, 0)), options, start, inertia)
