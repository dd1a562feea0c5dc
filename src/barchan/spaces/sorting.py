"""Which cells hold particles and which nodes these cells touch: only those are stored (seed B, 7.3.3 and Table 7.1).

Particles are never moved in memory; a counting-sort permutation lists them cell by cell, in a fixed order, so that loops
over cells are deterministic whatever the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.spaces._kernels import counting_sort, flat_cells, mark_nodes
from barchan.spaces.grid import RegularGrid


@dataclass(frozen=True)
class ActiveCells:
    """Particles listed by cell, with the occupied cells and the active nodes (the nodes of occupied cells).

    order : (P,) int64 permutation listing the particles cell by cell, within a cell in stored order.
    occupied : (C,) int64 flat ids of the cells that hold particles, increasing.
    starts : (C + 1,) int64; the particles of occupied cell c are `order[starts[c]:starts[c + 1]]`.
    cell_numbers : (cells...) flat int32 map from cell id to its rank in `occupied`, -1 for empty cells.
    nodes : (n,) int64 flat ids of the active nodes, increasing: this order numbers the unknowns.
    node_numbers : (node_count,) int32 map from node id to active number, -1 for inactive nodes.
    """

    order: NDArray[np.int64]
    occupied: NDArray[np.int64]
    starts: NDArray[np.int64]
    cell_numbers: NDArray[np.int32]
    nodes: NDArray[np.int64]
    node_numbers: NDArray[np.int32]


def sort_particles(grid: RegularGrid, positions: NDArray[np.float64]) -> ActiveCells:
    """Sort particles at `positions` (P, d) [m] by cell and find the active nodes.

    A particle on a face between two cells belongs to the upper one, on the upper wall to the last cell.

    Raises
    ------
    InputError : for a wrong shape, no particles at all, or a particle that is not inside the closed box (or is NaN).
    """
    points = np.ascontiguousarray(positions, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != grid.dimension or len(points) == 0:
        raise InputError("positions", points.shape, f"an array of shape (P, {grid.dimension}) with P > 0")
    inside = grid.contains(points)
    if not np.all(inside):
        first = int(np.flatnonzero(~inside)[0])
        raise InputError(
            f"positions[{first}]",
            points[first].tolist(),
            f"inside the box {grid.origin.tolist()}..{grid.upper.tolist()}",
        )
    cells = flat_cells(points, grid.origin, grid.spacing, grid.cells)
    order, dense_starts = counting_sort(cells, grid.cell_count)
    occupied = np.flatnonzero(np.diff(dense_starts))
    cell_numbers = np.full(grid.cell_count, -1, dtype=np.int32)
    cell_numbers[occupied] = np.arange(len(occupied), dtype=np.int32)
    nodes = np.flatnonzero(mark_nodes(occupied, grid.cells))
    node_numbers = np.full(grid.node_count, -1, dtype=np.int32)
    node_numbers[nodes] = np.arange(len(nodes), dtype=np.int32)
    starts = np.append(dense_starts[occupied], len(points))
    return ActiveCells(order, occupied, starts, cell_numbers, nodes, node_numbers)
