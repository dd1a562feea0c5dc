"""Nested iteration: the flow on a coarser mesh as the start of that on a finer one, level by level (seed C 5.2, Tables 6-9).

Velocity and pressure are prolonged, and so is the auxiliary direction of the stress-velocity method: on the finer mesh that of
the rates inside plugs, which are all but zero, would be noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.newton import (
    FlowSolution,
    LinearSolver,
    NonlinearOptions,
    Start,
    solve_flow,
)
from barchan.spaces.quadratic import QuadraticSpace
from barchan.spaces.quadratic.transfers import point_transfer, prolongation


def solve_nested(
    flow: QuasiNewtonianFlow,
    spaces: Sequence[QuadraticSpace],
    linear: Callable[[QuasiNewtonianFlow, int], LinearSolver],
    options: NonlinearOptions,
) -> FlowSolution:
    """The solution of `flow`, the coarsest level started from rest and every finer one from the one before.

    Parameters
    ----------
    spaces : coarse to fine, each on the refined mesh of the one before (quadrilaterals); the last is that of the flow.
    linear : (flow on a level, number of the level) -> its linear solver.

    Raises InputError for spaces that are not nested.
    """
    start: Start | None = None
    coarser: QuadraticSpace | None = None
    for number, space in enumerate(spaces):
        level = flow if space is flow.space else flow.transferred(space)
        if coarser is not None and start is not None:
            start = prolonged(start, coarser, space)
        solution = solve_flow(level, linear(level, number), options, start)
        start, coarser = solution.state, space
    return solution


def prolonged(start: Start, coarse: QuadraticSpace, fine: QuadraticSpace) -> Start:
    """Velocity, pressure and auxiliary direction on the refined mesh."""
    velocity, pressure, direction = start
    x = prolongation(coarse, fine) @ np.concatenate([velocity.ravel(), pressure])
    if direction is not None:
        direction = np.einsum("jqr,cra->cjqa", point_transfer(coarse), direction, optimize=True)
        direction = np.ascontiguousarray(direction.reshape(fine.cells, -1, 3))
    return x[: 2 * fine.N].reshape(-1, 2), x[2 * fine.N :], direction
