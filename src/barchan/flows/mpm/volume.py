"""Correction of excess volume by a small shift of the particles, within the energy the step dissipates.

Seed B clamps beta >= 0 (7.1.4) and warns that volume is lost over time (7.5.4): where particles sample a node's cell badly,
its volume fraction drifts above phi_max and nothing brings it back. Here positions, never velocities, are corrected: the
least displacement of the particles, weighted by volume, such that the volumes predicted for the end of the step stay below
phi_max,

    N_i + dt C_i u + sum_p V_p grad w_i(x_p) . delta_p <= phi_max |w_i|,   delta_p = -grad lambda(x_p),

with lambda >= 0 multilinear, so that K lambda >= excess, K_ij = sum_p V_p grad w_i . grad w_j being the stiffness of a Poisson
problem. The grid then moves the particles by the mean of delta_p at each node. Looking for the displacement among those of the
grid from the start leads to C M^-1 C^T in the place of K, which does not see multipliers that alternate from node to node:
these grow, and the particles are stirred until flowing matter is packed to 1.3 times its maximum.

Excesses are reduced by a share per step and shifts are bounded. What the shift adds to the potential energy may use at
most half of what friction dissipated in the step, so the total energy decreases still, and matter at rest is left alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm._volume_kernels import gather_poisson, least_potential, mean_slopes, volume_changes
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.transfer import GridMatter
from barchan.flows.mpm.walls import Walls

ITERATIONS = 20
LARGEST_SHIFT = 0.05  # cells a step
ENERGY_SHARE = 0.5


def volume_shift(
    matter: GridMatter,
    node_velocities: NDArray[np.float64],
    dt: float,
    max_volume_fraction: float,
    share: float,
    walls: Walls | None = None,
) -> NDArray[np.float64]:
    """Shift (n, d) [m] of the active nodes that removes the `share` of the excess volume predicted after `dt` seconds.

    `node_velocities` (n, d) is the solution of the step. A shift never points through a face of the box; at the open ones among
    `walls` matter has room outside.
    """
    grid, stencil = matter.grid, matter.stencil
    neighbours = np.where(stencil.linked, stencil.neighbours, -1).astype(np.int32)
    gradients = matter.gradients()
    predicted = volume_changes(gradients, neighbours, dt * node_velocities)
    excess = matter.volumes - max_volume_fraction * matter.open_capacities + predicted
    index = grid.node_indices(matter.active.nodes)
    for face, wall in enumerate(() if walls is None else walls.on(grid.dimension)):
        if wall.kind == "open":
            axis, upper = divmod(face, 2)
            excess[index[:, axis] == (grid.cells[axis] if upper else 0)] = 0.0
    if np.all(excess <= 0.0):
        return np.zeros(node_velocities.shape)
    target = np.where(excess > 0.0, share * excess, excess)
    stiffness = np.zeros(neighbours.shape)
    tables = moment_tables(grid.dimension)
    gather_poisson(stencil.cells, tables.slots, tables.product, stencil.slopes, matter.moments, stiffness)
    potential = least_potential(stiffness, neighbours, target, ITERATIONS)
    shift = -mean_slopes(gradients, neighbours, potential) / matter.volumes[:, None]
    shift[(index == 0) | (index == grid.cells)] = 0.0
    limit = LARGEST_SHIFT * grid.spacing
    return np.asarray(np.clip(shift, -limit, limit))


def within_energy(
    shift: NDArray[np.float64], masses: NDArray[np.float64], gravity: NDArray[np.float64], dissipated: float
) -> NDArray[np.float64]:
    """The shift (n, d), scaled down where it would raise the potential energy by more than half of `dissipated` [J]."""
    raised = -float(np.sum(masses * (shift @ gravity)))
    allowed = ENERGY_SHARE * max(dissipated, 0.0)
    return shift if raised <= allowed else shift * (allowed / raised)
