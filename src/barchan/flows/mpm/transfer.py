"""Transfers between particles and grid, and the particle move (seed B, 5.2.4 and 7.3.2).

Particles to grid: lumped mass (7.16) and APIC momentum (7.17-7.18, ERRATA 10). Grid to particles: (5.17) and (7.19).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm._kernels import gather_gradients, gather_nodes, sum_cells
from barchan.flows.mpm._motion import grid_to_particles as _grid_to_particles
from barchan.flows.mpm._motion import move_particles as _move_particles
from barchan.flows.mpm.bases import corner_shares
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stencil import NodeStencil, moment_tables, node_stencil
from barchan.spaces import ActiveCells, RegularGrid, sort_particles

# Particles stay this far (in cells) from the faces of the box.
WALL_CLEARANCE = 1e-9


@dataclass(frozen=True, eq=False)
class GridMatter:
    """The matter as the grid sees it, at the n active nodes.

    grid, active, stencil : the grid, the sorted particles and the neighbourhoods of the active nodes.
    moments : (C, 3^d) moments of the particle volumes in the occupied cells (see `_kernels`).
    halves : (C, 2^d) which parts of each occupied cell, cut in two along each axis, hold a particle.
    volumes : (n,) sum_p V_p w_i(x_p) [m^d], or of other weights in the place of V_p.
    velocities : (n, d) u^{p->g} [m/s], particle velocities averaged as the nodes see them (seed B, Eq. 7.17).
    positions : (P, d) of the particles [m].
    free : (C, 2^d) shares of these parts that lie outside all bodies; None without bodies.
    """

    grid: RegularGrid
    active: ActiveCells
    stencil: NodeStencil
    moments: NDArray[np.float64]
    halves: NDArray[np.bool_]
    volumes: NDArray[np.float64]
    velocities: NDArray[np.float64]
    positions: NDArray[np.float64]
    free: NDArray[np.float64] | None = None

    @cached_property
    def capacities(self) -> NDArray[np.float64]:
        """(n,) integrals of the shape functions over the box [m^d]."""
        return self.grid.node_volumes(self.active.nodes)

    @cached_property
    def half_rooms(self) -> NDArray[np.float64]:
        """(C, 2^d) which share of each half-cell is room for matter: none where there is no particle or a body."""
        held = self.halves.astype(np.float64)
        return held if self.free is None else held * self.free

    @cached_property
    def occupied_capacities(self) -> NDArray[np.float64]:
        """(n,) integrals of the shape functions over the occupied half-cells [m^d]: the room that matter shares.

        At a free surface the empty part of a node's support does not count, so that packed matter is packed up to its
        surface; with whole supports the uppermost cells would carry no stress and creep (seed B, Figure 7.3).
        """
        share = corner_shares(self.grid.dimension)
        in_cells = self.grid.cell_volume * (self.half_rooms @ share)
        cells = self.stencil.cells
        around = in_cells[cells, np.arange(cells.shape[1])]
        return np.asarray(np.sum(np.where(cells >= 0, around, 0.0), axis=1))

    @cached_property
    def open_capacities(self) -> NDArray[np.float64]:
        """(n,) `capacities` without what bodies take of the occupied cells [m^d]."""
        if self.free is None:
            return self.capacities
        taken = self.grid.cell_volume * ((1.0 - self.free) @ corner_shares(self.grid.dimension))
        cells = self.stencil.cells
        around = taken[cells, np.arange(cells.shape[1])]
        return np.asarray(self.capacities - np.sum(np.where(cells >= 0, around, 0.0), axis=1))

    @cached_property
    def volume_fractions(self) -> NDArray[np.float64]:
        """(n,) volume fractions: matter over capacity."""
        return self.volumes / self.capacities

    def gradients(self) -> NDArray[np.float64]:
        """(n, 3^d, d) stencil g_ij = sum_p V_p w_i(x_p) grad w_j(x_p) [m^(d-1)], zero at neighbours not `linked`.

        Made anew by each call: it is as large as the particles' share of a state, and quickly made.
        """
        tables, d = moment_tables(self.grid.dimension), self.grid.dimension
        gradients = np.zeros((len(self.volumes), 3**d, d))
        gather_gradients(
            self.stencil.cells, tables.slots, tables.gradient, self.stencil.slopes, self.moments, gradients
        )
        return gradients


def particles_to_grid(
    grid: RegularGrid, state: State, affine: bool = True, weights: NDArray[np.float64] | None = None
) -> GridMatter:
    """Sum the particles of `state` up on the active nodes of `grid`.

    affine : whether nodes see the affine velocity field of each particle (APIC) or its velocity only (PIC).
    weights : (P,) masses, for instance, in the place of the particle volumes.

    No node is without mass: local coordinates of particles are kept 1e-9 inside (0, 1) wherever shape functions are
    evaluated, so weights are positive and the averaged velocities always defined.

    Raises InputError for particles outside the grid.
    """
    d = grid.dimension
    active = sort_particles(grid, state.positions)
    stencil, tables = node_stencil(grid, active), moment_tables(d)
    moments = np.zeros((len(active.occupied), 3**d))
    halves = np.zeros((len(active.occupied), 2**d), dtype=np.bool_)
    momenta = np.zeros((len(active.occupied), 2**d, d))
    origin, spacing, cells, _ = _padded(grid)
    gradients = state.affine if affine else np.zeros_like(state.affine)
    sum_cells(
        active.order, active.starts, active.occupied, origin, spacing, cells,
        state.positions, state.velocities, gradients, state.volumes if weights is None else weights, moments, momenta, halves,
    )  # fmt: skip
    volumes = np.zeros(len(active.nodes))
    node_momenta = np.zeros((len(active.nodes), d))
    gather_nodes(stencil.cells, tables.value, moments, momenta, volumes, node_momenta)
    return GridMatter(
        grid, active, stencil, moments, halves, volumes, node_momenta / volumes[:, None], state.positions
    )


def grid_to_particles(
    matter: GridMatter, node_velocities: NDArray[np.float64], positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocities (P, d) and velocity gradients (P, d, d) of the field `node_velocities` (n, d) at `positions` (P, d).

    `positions` are those from which `matter` was made, so that every particle lies in a cell with active nodes only.
    """
    velocities = np.zeros_like(positions)
    affine = np.zeros((*positions.shape, positions.shape[1]))
    _grid_to_particles(
        positions, *_padded(matter.grid), matter.active.node_numbers, node_velocities, velocities, affine
    )
    return velocities, affine


def substeps_needed(matter: GridMatter, node_velocities: NDArray[np.float64], dt: float, cfl: float) -> int:
    """Number of substeps such that no node's velocity crosses more than `cfl` cells along any axis in a substep."""
    crossed = float(np.max(np.abs(node_velocities) / matter.grid.spacing)) * dt
    return max(1, int(np.ceil(crossed / cfl)))


def move_particles(
    matter: GridMatter,
    node_velocities: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    dt: float,
    substeps: int,
    shift: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """New positions (P, d) after `dt` seconds in the frozen field `node_velocities` (n, d).

    Departs from seed B's semi-implicit Euler step (5.18), x += dt v_p: each substep is a midpoint step through the field,
    which preserves volumes to third order where the field is divergence-free; one Euler step inflates a rotating patch
    by (dt |grad u|)^2. In a cell that was empty when the step began, some corners carry no velocity: the field there is
    the average over the corners that do, with their shape functions renormalised (continuous from the neighbouring
    cell); where none does the particle keeps its last velocity. Positions are clamped to 1e-9 cell inside the box, so no
    particle ever leaves. `velocities` (P, d) is the field at `positions`, as `grid_to_particles` returns it. A `shift`
    (n, d) [m] of the nodes, interpolated at the old positions, is added to the displacement.
    """
    grid = matter.grid
    lowest, highest = np.zeros(3), np.zeros(3)
    lowest[: grid.dimension] = grid.origin + WALL_CLEARANCE * grid.spacing
    highest[: grid.dimension] = grid.upper - WALL_CLEARANCE * grid.spacing
    moved = np.empty_like(positions)
    _move_particles(
        positions, velocities, *_padded(grid), matter.active.node_numbers, node_velocities,
        lowest, highest, dt / substeps, substeps, moved,
    )  # fmt: skip
    if shift is not None and np.any(shift):
        displacement = np.zeros_like(positions)
        no_slopes = np.empty((0, grid.dimension, grid.dimension))
        _grid_to_particles(
            positions, *_padded(grid), matter.active.node_numbers, shift, displacement, no_slopes
        )
        moved += displacement
        np.clip(moved, lowest[: grid.dimension], highest[: grid.dimension], out=moved)
    return moved


def _padded(
    grid: RegularGrid,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Origin, spacing, cells and node strides of length 3; the third axis of a plane grid is one cell without extent."""
    origin, spacing, cells, strides = np.zeros(3), np.ones(3), np.ones(3, np.int64), np.zeros(3, np.int64)
    d = grid.dimension
    origin[:d], spacing[:d], cells[:d] = grid.origin, grid.spacing, grid.cells
    strides[:d] = np.append(np.cumprod(grid.nodes[:0:-1])[::-1], 1)
    return origin, spacing, cells, strides
