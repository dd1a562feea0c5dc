"""Stress spaces: multilinear, multilinear discontinuous, linear on simplices, and one stress for each particle (seed B, 7.3.3).

Each gives the same thing to a step: a row per stress, with the volume of matter it stands for, the room that matter has, and
the vectors g_j = sum_p V_p omega(x_p) grad w_j(x_p) from which the strain operator is made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm import _basis_kernels as kernels
from barchan.flows.mpm.bases import VelocityBasis, corner_shares, simplex_weights
from barchan.flows.mpm.frames import frame_volumes
from barchan.flows.mpm.state import State
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.transfer import GridMatter
from barchan.flows.mpm.velocity import VelocityField

Vector = NDArray[np.float64]
Sampling = tuple[NDArray[np.int32], Vector]

# Rows whose matter is less than this share of the most that any row has carry no stress.
NEGLIGIBLE = 1e-14


@dataclass(frozen=True, eq=False)
class StressRows:
    """The q stresses of a step.

    ids : (q,) int64 lasting names, by which the stresses of the last step are found again.
    places : (q, d) where each stress stands [m].
    volumes : (q,) sum_p V_p omega(x_p) [m^d].
    room : (q,) what the matter of each row may fill [m^d]: integrals of omega over the parts of occupied cells that hold matter
        and no body, or the volume of the particle's frame.
    indptr, indices, gradients : (q + 1,), (nnz,) velocity numbers and (nnz, d) vectors g [m^(d-1)], rows in order.
    """

    ids: NDArray[np.int64]
    places: Vector
    volumes: Vector
    room: Vector
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    gradients: Vector
    sample: Callable[[], Sampling]

    @cached_property
    def sampling(self) -> Sampling:
        """(P, a) rows in which each particle takes part, -1 for none, and (P, a) values omega(x_p)."""
        return self.sample()

    def averages(self, volumes: Vector, values: Vector) -> Vector:
        """(q, e) means of `values` (P, e) of the particles with `volumes` (P,), weighted by V_p omega(x_p)."""
        rows, weights = self.sampling
        sums = np.zeros((len(self.ids), values.shape[1]))
        shares = np.where(rows >= 0, weights, 0.0) * volumes[:, None]
        kernels.scatter(rows, shares, np.ascontiguousarray(values), sums)
        return np.asarray(sums / self.volumes[:, None])

    def at_particles(self, values: Vector) -> Vector:
        """(P, e) values of the field sum_q omega_q values_q (q, e) at the particles."""
        rows, weights = self.sampling
        found = np.empty((len(rows), values.shape[1]))
        kernels.gather(rows, weights, np.ascontiguousarray(values), found)
        return found

    def node_means(self, matter: GridMatter, values: Vector) -> Vector:
        """(n, e) means of `values` (q, e) around the active nodes: what the particles have of them, averaged again."""
        basis = VelocityBasis(matter.grid, "Q1")
        shapes = basis.evaluate(matter.positions)
        rows, shares = matter.active.node_numbers[basis.of_cells(shapes.cells)], shapes.weights
        sums, weights = (
            np.zeros((len(matter.active.nodes), values.shape[1])),
            np.zeros((len(matter.active.nodes), 1)),
        )
        kernels.scatter(rows, shares, self.at_particles(values), sums)
        kernels.scatter(rows, shares, np.ones((len(rows), 1)), weights)
        return np.asarray(sums / weights)


def stress_rows(name: str, matter: GridMatter, field: VelocityField, state: State) -> StressRows:
    """The rows of the stress space `name` (see `Options.stress`) over the velocities of `field`."""
    if name == "particles":
        return _of_particles(matter, field, state)
    if name in ("Q1", "P1"):
        return _continuous(name, matter, field, state)
    return _discontinuous(name, matter, field, state)


def _of_particles(matter: GridMatter, field: VelocityField, state: State) -> StressRows:
    rows = field.rows
    count, m = rows.shape
    gradients = field.shapes.gradients * state.volumes[:, None, None]
    numbers = np.arange(count, dtype=np.int32)[:, None]
    return StressRows(
        np.arange(count), state.positions, state.volumes, frame_volumes(state.frames),
        (np.arange(count + 1) * m).astype(np.int32), rows.reshape(-1), gradients.reshape(count * m, -1),
        lambda: (numbers, np.ones((count, 1))),
    )  # fmt: skip


def _continuous(name: str, matter: GridMatter, field: VelocityField, state: State) -> StressRows:
    """One row per active node."""
    grid, nodes = matter.grid, matter.active.nodes
    if name == "Q1" and field.basis.name == "Q1":
        volumes, linked, gradients = matter.volumes, matter.stencil.linked, matter.gradients()
        neighbours, room = matter.stencil.neighbours, matter.occupied_capacities
    else:
        table, sums = _cell_table(name, matter, field, state)
        volumes, room = _at_nodes(matter, sums), _at_nodes(matter, _room(name, matter, sums))
        neighbours, linked, slots = _neighbours(matter, field.basis, field.numbers)
        gradients = np.zeros((*neighbours.shape, grid.dimension))
        kernels.gather_table(matter.stencil.cells, slots, table, gradients)
    keep = volumes > NEGLIGIBLE * float(np.max(volumes))
    if not np.all(keep):
        linked = linked & keep[:, None]
    indptr = np.append(0, np.cumsum(np.count_nonzero(linked, axis=1)[keep])).astype(np.int32)
    numbers = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)

    def sample() -> Sampling:
        basis = VelocityBasis(grid, name)
        shapes = basis.evaluate(state.positions)
        return numbers[matter.active.node_numbers[basis.of_cells(shapes.cells)]], shapes.weights

    return StressRows(
        nodes[keep], grid.node_positions(nodes[keep]), volumes[keep], room[keep],
        indptr, neighbours[linked].astype(np.int32), gradients[linked], sample,
    )  # fmt: skip


def _discontinuous(name: str, matter: GridMatter, field: VelocityField, state: State) -> StressRows:
    """One row for each function of each occupied cell that has matter: ids are cell x functions + function."""
    grid, occupied = matter.grid, matter.active.occupied
    table, sums = _cell_table(name, matter, field, state)
    per_cell = sums.shape[1]
    corners = moment_tables(grid.dimension).corners
    if name == "P1d":
        corners = corners[kernels.simplex_corners(grid.dimension).reshape(-1)]
    keep = sums > NEGLIGIBLE * float(np.max(sums))
    numbers = np.where(keep.reshape(-1), np.cumsum(keep.reshape(-1)) - 1, -1).astype(np.int32)
    cell_index = np.stack(np.unravel_index(occupied, tuple(grid.cells)), axis=-1)
    places = grid.origin + grid.spacing * (cell_index[:, None, :] + corners[None, :, :])
    m = table.shape[2]
    indices = np.broadcast_to(field.cell_rows[:, None, :], (*keep.shape, m))[keep]

    def sample() -> Sampling:
        basis = VelocityBasis(grid, "Q1" if name == "Q1d" else "P1")
        shapes = basis.evaluate(state.positions)
        cell = matter.active.cell_numbers[shapes.cells].astype(np.int64) * per_cell
        if name == "Q1d":
            return numbers[cell[:, None] + np.arange(per_cell)], shapes.weights
        d = grid.dimension
        first = cell + shapes.simplices * (d + 1)
        return numbers[first[:, None] + np.arange(d + 1)], simplex_weights(shapes)

    return StressRows(
        (occupied[:, None] * per_cell + np.arange(per_cell))[keep], places[keep], sums[keep],
        _room(name, matter, sums)[keep], (np.arange(len(indices) + 1) * m).astype(np.int32),
        np.ascontiguousarray(indices).reshape(-1), table[keep].reshape(-1, grid.dimension), sample,
    )  # fmt: skip


def _cell_table(name: str, matter: GridMatter, field: VelocityField, state: State) -> tuple[Vector, Vector]:
    """sum_p V_p omega grad w_j (C, f, m, d) and sum_p V_p omega (C, f) of the occupied cells."""
    d, cells = matter.grid.dimension, len(matter.active.occupied)
    corners = name in ("Q1", "P1", "Q1d")
    count = 2**d if corners else factorial(d) * (d + 1)
    table, sums = np.zeros((cells, count, len(field.basis.local), d)), np.zeros((cells, count))
    if field.basis.name == "Q1" and name in ("Q1", "Q1d"):
        tables = moment_tables(d)
        kernels.table_from_moments(
            matter.moments, tables.value, tables.gradient, matter.stencil.slopes, table, sums
        )
        return table, sums
    shapes = VelocityBasis(matter.grid, "P1" if name in ("P1", "P1d") else "Q1").evaluate(state.positions)
    weights = shapes.weights if corners else simplex_weights(shapes)
    first = np.zeros(len(weights), dtype=np.int64) if corners else shapes.simplices * (d + 1)
    active = matter.active
    kernels.cell_table(
        active.order, active.starts, state.volumes, weights, first, field.shapes.gradients, table, sums
    )
    return table, sums


def _room(name: str, matter: GridMatter, sums: Vector) -> Vector:
    """(C, f) room [m^d] of the stress functions of each cell, whose matter is `sums` (C, f).

    Multilinear functions are integrated over the parts of the cell that are room. Few particles integrate functions on
    simplices badly, those on a diagonal count for one side only: there each function has the share of the cell's room that
    it has of its matter, and all of a cell is packed or none.
    """
    if name in ("Q1", "Q1d"):
        return matter.grid.cell_volume * (matter.half_rooms @ corner_shares(matter.grid.dimension))
    room = matter.grid.cell_volume * np.mean(matter.half_rooms, axis=1)
    return np.asarray(room[:, None] * sums / np.sum(sums, axis=1, keepdims=True))


def _neighbours(
    matter: GridMatter, basis: VelocityBasis, numbers: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.int64]]:
    """Velocity numbers (n, slots) around each active node, which of them share an occupied cell, and slots (2^d, m)."""
    d, width = matter.grid.dimension, basis.order + 2
    corners = moment_tables(d).corners
    powers = width ** np.arange(d - 1, -1, -1)
    slots = np.asarray((basis.local[None, :, :] - corners[:, None, :] + 1) @ powers)
    offsets = np.stack(np.unravel_index(np.arange(width**d), (width,) * d), axis=-1) - 1
    index = matter.grid.node_indices(matter.active.nodes)[:, None, :] + offsets
    inside = np.all((index >= 0) & (index < basis.lattice), axis=-1)
    flat = np.where(inside, index @ basis.strides, 0)
    linked = np.zeros(inside.shape, dtype=np.bool_)
    for corner in range(2**d):
        linked[:, slots[corner]] |= (matter.stencil.cells[:, corner] >= 0)[:, None]
    return np.where(inside, numbers[flat], -1).astype(np.int32), linked & inside, slots


def _at_nodes(matter: GridMatter, in_cells: Vector) -> Vector:
    """(n,) sums over the cells around each active node of what they hold (C, 2^d) for their corners."""
    cells = matter.stencil.cells
    around = in_cells[cells, np.arange(cells.shape[1])]
    return np.asarray(np.sum(np.where(cells >= 0, around, 0.0), axis=1))
