"""Characteristics of the fluid: nodal values found at the feet of the paths that lead to the nodes (seed B, 5.2.3 and 8.3.4).

u(t + dt, x) ~ u(t, X(x)): paths by the midpoint rule in the field frozen at t, values by the cubic of Lagrange along every
axis, held between the values at the corners of the foot's cell, so that no new extremum appears.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm.threads import threads_for
from barchan.flows.suspension import _fluid_kernels as kernels
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]

# Paths are cut into substeps in which no component crosses more than this many cells.
CELLS_A_SUBSTEP = 1.0
LARGEST_SUBSTEPS = 10_000


def advected(grid: RegularGrid, velocities: Vector, dt: float, carried: Vector | None = None) -> Vector:
    """Values (n, k) after `dt` seconds of a field that the flow carries, at all nodes of the grid.

    velocities : (n, d) of the flow [m/s].   carried : (n, k), the velocities themselves when None.

    Exact for fields that are linear where the velocity is uniform; third order in space where the limiter is idle (fourth in
    the interpolation), second in time. Feet outside of the box are moved to its nearest face.
    Raises InputError for a time step that is negative or not finite, arrays of another shape, velocities that are not finite,
    or a step in which matter crosses more than 10,000 cells.
    """
    n, d = grid.node_count, grid.dimension
    flow = np.ascontiguousarray(velocities, dtype=np.float64)
    if flow.shape != (n, d):
        raise InputError("velocities", flow.shape, f"an array of shape {(n, d)}")
    if not (np.isfinite(dt) and dt >= 0.0):
        raise InputError("dt", dt, "a finite time >= 0")
    field = flow if carried is None else np.ascontiguousarray(carried, dtype=np.float64)
    if field.ndim != 2 or len(field) != n:
        raise InputError("carried", field.shape, f"an array with {n} rows")
    if not np.all(np.isfinite(flow)):
        raise InputError("velocities", "values that are not finite", "finite")
    crossed = float(dt * np.max(np.abs(flow) / grid.spacing))
    if crossed > CELLS_A_SUBSTEP * LARGEST_SUBSTEPS:
        raise InputError("dt", dt, f"small enough: the fluid would cross {crossed:.3g} cells in a step")
    substeps = max(int(np.ceil(crossed / CELLS_A_SUBSTEP)), 1)
    absent = 3 - d
    nodes = np.append(grid.nodes, np.ones(absent, dtype=np.int64))
    steps = np.append(dt / substeps / grid.spacing, np.zeros(absent))
    out = np.empty_like(field)
    # A node reads 4^d values a point: it weighs as much as 4^(d-2) particles of the plane.
    with threads_for(n * 4 ** (d - 2)):
        kernels.advect(nodes, flow, steps, substeps, field, out)
    return out
