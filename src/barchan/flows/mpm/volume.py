"""Correction of excess volume by a small shift of the particles, within the energy the step dissipates.

Seed B clamps beta >= 0 (7.1.4) and warns that volume is lost over time (7.5.4): where particles sample a node's cell badly,
its volume fraction drifts above phi_max and nothing brings it back. Here positions, never velocities, are corrected: the
shift of least mass-weighted norm such that the volume fractions predicted for the end of the step stay below phi_max,

    N_i + dt C_i u + C_i delta <= phi_max |w_i|,   C_i delta = sum_p V_p grad w_i(x_p) . delta(x_p).

Excesses are reduced by a share per step and shifts are bounded. What the shift adds to the potential energy may use at
most half of what friction dissipated in the step, so the total energy decreases still, and matter at rest is left alone.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.flows.mpm.transfer import GridMatter

ITERATIONS = 20
LARGEST_SHIFT = 0.05  # cells a step
ENERGY_SHARE = 0.5
_POWER_ITERATIONS = 8
_SAFETY = 1.2


def volume_shift(
    matter: GridMatter,
    node_velocities: NDArray[np.float64],
    dt: float,
    max_volume_fraction: float,
    share: float,
) -> NDArray[np.float64]:
    """Shift (n, d) [m] of the active nodes that removes the `share` of the excess volume predicted after `dt` seconds.

    `node_velocities` (n, d) is the solution of the step. A shift never points through a wall.
    """
    grid = matter.grid
    inner = np.ones(node_velocities.shape, dtype=np.bool_)
    index = grid.node_indices(matter.active.nodes)
    inner[(index == 0) | (index == grid.cells)] = False
    change = _volume_change(matter, inner)
    excess = (
        matter.volumes
        - max_volume_fraction * matter.open_capacities
        + change @ (dt * node_velocities.reshape(-1))
    )
    if np.all(excess <= 0.0):
        return np.zeros(node_velocities.shape)
    target = np.where(excess > 0.0, share * excess, excess)
    shift = _least_shift(change, np.repeat(matter.volumes, grid.dimension), target)
    limit = LARGEST_SHIFT * grid.spacing
    return np.clip(shift.reshape(node_velocities.shape), -limit, limit)


def within_energy(
    shift: NDArray[np.float64], masses: NDArray[np.float64], gravity: NDArray[np.float64], dissipated: float
) -> NDArray[np.float64]:
    """The shift (n, d), scaled down where it would raise the potential energy by more than half of `dissipated` [J]."""
    raised = -float(np.sum(masses * (shift @ gravity)))
    allowed = ENERGY_SHARE * max(dissipated, 0.0)
    return shift if raised <= allowed else shift * (allowed / raised)


def _volume_change(matter: GridMatter, inner: NDArray[np.bool_]) -> sp.csr_array:
    """C (n, n d): change of the nodes' volumes N_i with the positions; C_ij = g_ji, zero for components not `inner`."""
    linked, d = matter.stencil.linked, matter.grid.dimension
    rows, slots = np.nonzero(linked)
    columns = matter.stencil.neighbours[rows, slots].astype(np.int64)
    data = matter.gradients[columns, linked.shape[1] - 1 - slots] * inner[columns]
    indices = (columns[:, None] * d + np.arange(d)).reshape(-1)
    indptr = np.append(0, np.cumsum(d * np.count_nonzero(linked, axis=1)))
    return sp.csr_array((data.reshape(-1), indices, indptr), shape=(len(linked), len(linked) * d))


def _least_shift(
    change: sp.csr_array, mass: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """delta minimising sum mass delta^2 / 2 with C delta <= -target: accelerated projected gradient on the dual.

    A fixed number of iterations from zero multipliers, invariant under relabelling of nodes: mirror-symmetric matter is
    shifted symmetrically even where the iterations are far from converged.
    """
    compliance = change.copy()
    compliance.data *= (1.0 / np.sqrt(mass))[change.indices]
    diagonal = np.sqrt(np.add.reduceat(compliance.data**2, compliance.indptr[:-1]))
    scale = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
    compliance.data *= np.repeat(scale, np.diff(compliance.indptr))
    transposed = compliance.T
    power = np.ones(len(target))
    largest = 1.0
    for _ in range(_POWER_ITERATIONS):
        power = compliance @ (transposed @ power)
        largest = float(np.sqrt(np.sum(power**2)))
        if largest == 0.0:
            return np.zeros(len(mass))
        power /= largest
    bound = _SAFETY * largest
    wanted = scale * target
    multipliers, ahead, inertia = np.zeros(len(target)), np.zeros(len(target)), 1.0
    for _ in range(ITERATIONS):
        following = np.maximum(ahead + (wanted - compliance @ (transposed @ ahead)) / bound, 0.0)
        next_inertia = 0.5 * (1.0 + float(np.sqrt(1.0 + 4.0 * inertia**2)))
        ahead = following + (inertia - 1.0) / next_inertia * (following - multipliers)
        multipliers, inertia = following, next_inertia
    return -(transposed @ multipliers) / np.sqrt(mass)
