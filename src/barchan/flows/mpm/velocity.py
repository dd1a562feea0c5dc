"""The velocity field of a step: its nodes, masses and velocities, and the ways between it and the particles (seed B, 7.3.2).

Multilinear velocities go by the cell sums of `transfer`, which are faster; the other bases by tables of shape functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm import _basis_kernels as kernels
from barchan.flows.mpm import transfer
from barchan.flows.mpm._kernels import AFFINE_MARGIN
from barchan.flows.mpm.bases import MARGIN, ShapeTable, VelocityBasis
from barchan.flows.mpm.state import State
from barchan.flows.mpm.transfer import GridMatter

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VelocityField:
    """The n basis functions of the occupied cells.

    ids : (n,) flat indices into the lattice of the basis, increasing.  numbers : lattice index -> 0..n-1, or -1.
    masses : (n,) lumped masses [kg] (seed B, Eq. 7.16).  velocities : (n, d) u^{p->g} [m/s] (7.17).
    table : the shape functions at the particles; None for multilinear velocities.
    """

    basis: VelocityBasis
    matter: GridMatter
    ids: NDArray[np.int64]
    numbers: NDArray[np.int32]
    masses: Vector
    velocities: Vector
    table: ShapeTable | None = None

    @cached_property
    def rows(self) -> NDArray[np.int32]:
        """(P, m) numbers of each particle's functions."""
        return self.numbers[self.basis.of_cells(self.shapes.cells)]

    @cached_property
    def cell_rows(self) -> NDArray[np.int32]:
        """(C, m) numbers of the functions of the occupied cells."""
        return self.numbers[self.basis.of_cells(self.matter.active.occupied)]

    @cached_property
    def places(self) -> Vector:
        """(n, d) places of the functions [m]."""
        return self.basis.positions(self.ids)

    @cached_property
    def shapes(self) -> ShapeTable:
        """The shape functions at the particles, evaluated when they are asked for."""
        return self.table if self.table is not None else self.basis.evaluate(self.matter.positions)

    def to_particles(self, values: Vector) -> tuple[Vector, Vector]:
        """Values (P, d) and gradients (P, d, d) at the particles of the field with `values` (n, d)."""
        if self.table is None:
            return transfer.grid_to_particles(self.matter, values, self.matter.positions)
        found = np.empty_like(self.matter.positions)
        slopes = np.empty((*found.shape, found.shape[1]))
        kernels.gather(self.rows, self.table.weights, values, found)
        kernels.gradients_at(self.rows, self.table.gradients, values, slopes)
        return found, slopes

    def affine(self, values: Vector, gradients: Vector) -> Vector:
        """(P, d, d) affine field c_p around each particle of the field with `values` (n, d) and `gradients` there.

        c_p = (sum_i w_i u_i (x) (y_i - x_p)) D_p^-1 with D_p = sum_i w_i (y_i - x_p) (x) (y_i - x_p) keeps angular momentum.
        For functions that are linear along the axes this is the gradient (seed B, Eq. 7.19); for splines it is not.
        """
        if self.table is None or self.basis.order == 1:
            return gradients
        arms = self.places[self.rows] - self.matter.positions[:, None, :]
        weighted = self.table.weights[:, :, None] * arms
        fits = weighted / np.sum(weighted * arms, axis=1, keepdims=True)
        found = np.empty_like(gradients)
        kernels.gradients_at(self.rows, fits, values, found)
        return found

    def at_nodes(self, values: Vector) -> Vector:
        """(n', d) values at the active nodes of the grid of a field with `values` (n, d) of the basis."""
        grid = self.basis.grid
        places = grid.node_positions(self.matter.active.nodes)
        return self._sampled(values, places, np.zeros_like(places))

    def moved(
        self, values: Vector, velocities: Vector, dt: float, cfl: float, shift: Vector | None = None
    ) -> tuple[Vector, int]:
        """Positions (P, d) after `dt` seconds in the frozen field `values` (n, d), and the number of substeps made.

        `velocities` (P, d) is the field at the particles; `shift` (n, d) [m], of multilinear fields, see `transfer`.
        """
        substeps = transfer.substeps_needed(self.matter, values, dt, cfl)
        if self.table is None:
            moved = transfer.move_particles(
                self.matter, values, self.matter.positions, velocities, dt, substeps, shift
            )
            return moved, substeps
        grid = self.basis.grid
        clearance = transfer.WALL_CLEARANCE * grid.spacing
        low, high = grid.origin + clearance, grid.upper - clearance
        place, last, step = self.matter.positions, velocities, dt / substeps
        for number in range(substeps):
            here = last if number == 0 else self._sampled(values, place, last)
            last = self._sampled(values, np.clip(place + 0.5 * step * here, low, high), here)
            place = np.clip(place + step * last, low, high)
        return place, substeps

    def _sampled(self, values: Vector, points: Vector, fallback: Vector) -> Vector:
        """Velocities (P, d) at any points: weights renormalised over active functions, `fallback` where there is none."""
        table = self.basis.evaluate(points)
        rows = self.numbers[self.basis.of_cells(table.cells)]
        known = np.sum(np.where(rows >= 0, table.weights, 0.0), axis=1)
        found = np.empty_like(points)
        kernels.gather(rows, table.weights, values, found)
        inside = known > 0.0
        found[inside] /= known[inside, None]
        found[~inside] = fallback[~inside]
        return found


def velocity_field(
    matter: GridMatter, state: State, basis: VelocityBasis, densities: Vector | float, affine: bool
) -> VelocityField:
    """Masses and velocities of the particles of `state` in a basis.

    densities : of the matter [kg/m^3], one number or one for each particle.
    affine : whether the functions see the affine velocity field of each particle (APIC) or its velocity only.
    """
    if basis.name == "Q1":
        if np.ndim(densities) == 0:
            masses, velocities = float(densities) * matter.volumes, matter.velocities
        else:
            heavy = transfer.particles_to_grid(basis.grid, state, affine, weights=densities * state.volumes)
            masses, velocities = heavy.volumes, heavy.velocities
        return VelocityField(
            basis, matter, matter.active.nodes, matter.active.node_numbers, masses, velocities
        )
    table = basis.evaluate(state.positions)
    ids = basis.active(matter.active.occupied)
    numbers = np.full(int(np.prod(basis.lattice)), -1, dtype=np.int32)
    numbers[ids] = np.arange(len(ids), dtype=np.int32)
    masses, momenta = np.zeros(len(ids)), np.zeros((len(ids), basis.grid.dimension))
    field = VelocityField(basis, matter, ids, numbers, masses, momenta, table)
    gradients = shown_gradients(basis, state) if affine else np.zeros_like(state.affine)
    kernels.scatter_affine(
        field.rows, table.weights, densities * state.volumes, field.places, state.positions,
        state.velocities, gradients, masses, momenta,
    )  # fmt: skip
    there = masses > 0.0
    momenta[there] /= masses[there, None]
    return field


def shown_gradients(basis: VelocityBasis, state: State) -> Vector:
    """(P, d, d) affine fields of the particles as the functions see them.

    Near a face of its cell a particle hides its gradient across this face, as with multilinear velocities, lest nodes that
    carry almost nothing fall freely for ever (see `_kernels.AFFINE_MARGIN`). Splines vanish to second order there: such
    nodes have no part in the affine field of the particle.
    """
    if basis.order == 2:
        return state.affine
    grid = basis.grid
    local = (state.positions - grid.origin) / grid.spacing
    local = np.clip(local - np.clip(np.floor(local), 0, grid.cells - 1), MARGIN, 1.0 - MARGIN)
    return np.asarray(state.affine * np.minimum(1.0, local * (1.0 - local) / AFFINE_MARGIN)[:, None, :])
