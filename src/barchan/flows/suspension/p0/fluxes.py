"""Volumes that cross the sides of cells, and the velocity of the fluid carried with them (seed B, 8.3.4: upwind).

The fluid fills what the grains leave, so that (8.7) holds for the fluxes Q - G when the volumes Q of the mixture across the
sides of every cell sum up to nothing and G are the grains' own, those that moved phi. The weak divergence, which the momentum
step makes zero, sees gradients of continuous pressures only; so Q is the mean of the cells' u_v, corrected by differences of
one potential per cell (a Poisson problem of two-point differences, factorised once) until every cell is balanced.

The fluid's momentum is then carried by the implicit upwind form: with f_K = (1 - phi_K) |K| before and in_F what enters,

    (f_K + sum_F in_F) u_K = f_K u_K^k + sum_F in_F u_K'.

Because f + in = f^(k+1) + out, the momentum of the fluid is kept exactly; every u is a mean of those before, so that none
grows; and by Jensen's inequality, summed over the cells, neither does the kinetic energy, whatever the step:
sum (f^(k+1) + out) |u|^2 <= sum f |u^k|^2 + sum in |u'|^2, where what enters and leaves cancels. The same holds for the grains
with "conservative" inertia (`barchan.flows.dry.transport`). In the Darcy-like model only the mass average has inertia (8.21),
and is carried by the mass that crosses the sides: the momentum of the fluctuation, which that model drops, would bring energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from barchan.flows.dry._kernels import FREE
from barchan.flows.dry.cells import Cells
from barchan.flows.suspension.p0.boundaries import Sides
from barchan.linalg.factor import Solver, sparse_solver

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VolumeFluxes:
    """Fluxes of the volume average.

    conductances : (c, k) of the two-point differences, zero at walls.  walls : (c, k) what walls take out [m^d/s].
    unknown : (p,) cells with a potential: all, or all but one in a closed box.
    """

    cells: Cells
    conductances: Vector
    walls: Vector
    free: NDArray[np.bool_]
    unknown: NDArray[np.int64]
    solver: Solver

    @classmethod
    def of(cls, cells: Cells, sides: Sides) -> VolumeFluxes:
        """Factorises the Poisson problem of the mesh."""
        inner, free = cells.neighbours >= 0, sides.codes == FREE
        squares = np.sum(cells.faces**2, axis=2)
        distance = np.linalg.norm(cells.centres[:, None] - cells.centres[cells.neighbours], axis=2)
        between = np.sqrt(squares) / np.where(inner, distance, 1.0)
        outwards = squares / cells.volumes[:, None]
        conductances = np.where(inner, between, np.where(free, outwards, 0.0))
        own = np.broadcast_to(np.arange(cells.count)[:, None], inner.shape)
        matrix = sp.csr_array(
            (-conductances[inner], (own[inner], cells.neighbours[inner])), shape=(cells.count,) * 2
        ) + sp.diags_array(np.sum(conductances, axis=1))
        unknown = np.arange(cells.count if np.any(free) else cells.count - 1)
        solver = sparse_solver(sp.csr_array(sp.csr_array(matrix)[unknown][:, unknown]), "mesh", positive=True)
        return cls(cells, conductances, sides.wall_fluxes(cells), free, unknown, solver)

    def across(self, velocities: Vector) -> Vector:
        """(c, k) volumes that leave each cell [m^d/s], from u_v (c, d): opposite on both sides, balanced in every cell."""
        cells = self.cells
        inner = cells.neighbours >= 0
        mean = 0.5 * (velocities[:, None] + velocities[cells.neighbours])
        mean = np.where(inner[:, :, None], mean, velocities[:, None])
        fluxes = np.where(inner | self.free, np.sum(mean * cells.faces, axis=2), self.walls)
        potential = np.zeros(cells.count)
        potential[self.unknown] = self.solver(-np.sum(fluxes, axis=1)[self.unknown])
        there = np.where(inner, potential[cells.neighbours], 0.0)
        return np.asarray(fluxes + self.conductances * (potential[:, None] - there))


def carried_by(cells: Cells, sides: Sides, contents: Vector, crossing: Vector, velocities: Vector) -> Vector:
    """Velocities (c, d) that what is in each cell brings into the next step.

    contents : (c,) volume of fluid, or mass, before.  crossing : (c, k) how much leaves through the sides.
    What enters through walls has their velocity, through free parts that of the cell.
    """
    entering = np.maximum(-crossing, 0.0)
    inner = cells.neighbours >= 0
    walls = np.where(inner | (sides.codes == FREE), 0.0, entering)
    between = np.where(inner, entering, 0.0)
    if not np.any(between) and not np.any(walls):
        return velocities.copy()
    own = np.broadcast_to(np.arange(cells.count)[:, None], inner.shape)
    diagonal = contents + np.sum(between + walls, axis=1)
    coupled = between > 0.0
    # Rows are dominated by the diagonal; SuperLU is given the transpose, dominated by columns, and needs no exchange.
    matrix = sp.csc_array(
        (
            np.concatenate([diagonal, -between[coupled]]),
            (
                np.concatenate([own[:, 0], cells.neighbours[coupled]]),
                np.concatenate([own[:, 0], own[coupled]]),
            ),
        ),
        shape=(cells.count,) * 2,
    )
    factors = spla.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    load = contents[:, None] * velocities + np.einsum("ck,ckd->cd", walls, sides.velocities)
    return np.asarray(factors.solve(load, trans="T"))
