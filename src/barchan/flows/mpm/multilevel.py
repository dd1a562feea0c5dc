"""A coarse-to-fine start: the stresses of a first step from those of the same matter on coarser and coarser grids.

Sweeps carry information over one cell each, so a bed of L cells takes of the order of L^2 sweeps from zero stresses; on a grid
of half the resolution both their number and their cost are a fraction. Cost: a geometric series in 2^-d, on top of the sweeps
that the coarse problems take.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm.coupling import Coupling
from barchan.flows.mpm.momentum import StepProblem, build_step_problem
from barchan.flows.mpm.setting import Setting
from barchan.flows.mpm.state import State
from barchan.friction import solve
from barchan.spaces import RegularGrid, shape_functions

FEWEST_CELLS = 3  # along the shortest axis with more than one cell
FEWEST_ROWS = 300
TOLERANCE_SHARE = 3.0


def coarse_start(setting: Setting, state: State, dt: float, step: StepProblem) -> None:
    """Replace the start of `step` by the stresses of the same step on a grid with half the cells, itself so started."""
    below = _coarser(setting)
    if below is None or len(step.rows.ids) < FEWEST_ROWS:
        return
    first = replace(state, particle_stresses=state.particle_stresses[:0])
    coarse = build_step_problem(below, first, dt, affine=False)
    coarse_start(below, first, dt, coarse)
    options = setting.options
    solution = solve(
        coarse.problem,
        method=options.method,
        tol=TOLERANCE_SHARE * options.tolerance,
        r0=coarse.start,
        max_iterations=options.max_sweeps,
    )
    coarse.problem.release()
    r = solution.r.reshape(len(coarse.start), -1)
    found = _interpolated(below.grid, coarse.rows.ids, coarse.stresses(r), step.rows.places)
    count = len(step.rows.ids)
    if step.rheology.metric is not None:
        found = np.einsum("qst,qt->qs", step.rheology.metric, found)
    step.start[:count] = found


def _coarser(setting: Setting) -> Setting | None:
    """The setting on half the cells along each axis, with multilinear spaces; None when these would be too few."""
    grid = setting.grid
    if int(np.min(grid.cells[grid.cells > 1], initial=2**30)) < 2 * FEWEST_CELLS:
        return None
    cells = np.maximum((grid.cells + 1) // 2, 1)
    coarse = RegularGrid(grid.origin, grid.spacing * grid.cells / cells, cells)
    options = replace(setting.options, velocity="Q1", stress="Q1", warm_start="grid")
    coupling = Coupling(coarse, setting.bodies) if setting.bodies else None
    return replace(setting, grid=coarse, options=options, coupling=coupling)


def _interpolated(
    grid: RegularGrid, nodes: NDArray[np.int64], values: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(q, s) multilinear interpolation of `values` (n, s) at some nodes, over those of a cell that have one."""
    number = np.full(grid.node_count, -1, dtype=np.int64)
    number[nodes] = np.arange(len(nodes))
    shapes = shape_functions(grid, np.clip(places, grid.origin, grid.upper))
    rows = number[shapes.nodes]
    weights = np.where(rows >= 0, shapes.weights, 0.0)
    total = np.sum(weights, axis=1)
    weights /= np.where(total > 0.0, total, 1.0)[:, None]
    return np.asarray(np.einsum("pj,pjs->ps", weights, values[np.maximum(rows, 0)]))
