"""Index tables of the multilinear grid stencil: which moments of a cell make up which integral (seed B, 7.3.1, 7.3.3).

A node meets the 2^d cells around it and, through them, its 3^d neighbours; both are listed here for all active nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from barchan.spaces import ActiveCells, RegularGrid


@dataclass(frozen=True)
class MomentTables:
    """For local corners i, j of a cell and axes k, l: indices into its 3^d moments (see `_kernels`).

    corners : (2^d, d) 0 or 1 along each axis, C order.
    slots : (2^d, 2^d) rank of neighbour j of node i among the 3^d offsets.
    value : (2^d, 2^d) moments whose sum is the integral of w_i.
    gradient : (2^d, 2^d, d, 2) moments whose sum is that of w_i |d_k w_j| h_k.
    product : (2^d, 2^d, d, d, 4) moments whose sum is that of |d_k w_i d_l w_j| h_k h_l.
    """

    corners: NDArray[np.int64]
    slots: NDArray[np.int64]
    value: NDArray[np.int64]
    gradient: NDArray[np.int64]
    product: NDArray[np.int64]


@lru_cache(maxsize=2)
def moment_tables(dimension: int) -> MomentTables:
    """Tables for d = 2 or 3. Along an axis w_i w_j is the moment i + j, w_i alone is i and i + 1, 1 is 0, 1, 1 and 2."""
    corners = np.array(list(product((0, 1), repeat=dimension)), dtype=np.int64)
    powers = 3 ** np.arange(dimension - 1, -1, -1)
    count = len(corners)
    slots = np.array([[int(np.dot(j - i + 1, powers)) for j in corners] for i in corners], dtype=np.int64)
    value = np.array([_indices([(i, i + 1) for i in corner], powers) for corner in corners], dtype=np.int64)
    gradient = np.empty((count, count, dimension, 2), dtype=np.int64)
    products = np.empty((count, count, dimension, dimension, 4), dtype=np.int64)
    for a, i in enumerate(corners):
        for b, j in enumerate(corners):
            both: list[tuple[int, ...]] = [(m + n,) for m, n in zip(i, j, strict=True)]
            for k in range(dimension):
                gradient[a, b, k] = _indices(_replaced(both, {k: (i[k], i[k] + 1)}), powers)
                for el in range(dimension):
                    if k == el:
                        factors = _replaced(both, {k: (0, 1, 1, 2)})
                    else:
                        factors = _replaced(both, {k: (j[k], j[k] + 1), el: (i[el], i[el] + 1)})
                    products[a, b, k, el] = _indices(factors, powers)
    return MomentTables(corners, slots, value, gradient, products)


def _replaced(factors: list[tuple[int, ...]], new: dict[int, tuple[int, ...]]) -> list[tuple[int, ...]]:
    return [new.get(axis, factor) for axis, factor in enumerate(factors)]


def _indices(factors: list[tuple[int, ...]], powers: NDArray[np.int64]) -> list[int]:
    return [int(np.dot(digits, powers)) for digits in product(*factors)]


@dataclass(frozen=True)
class NodeStencil:
    """Neighbourhood of the n active nodes.

    cells : (n, 2^d) int32 rank of the occupied cell in which the node is local corner i, -1 where it is empty or missing.
    neighbours : (n, 3^d) int32 active number of each neighbour, -1 where it is inactive. A neighbour outside the grid has
        some other node's number or -1: only `linked` neighbours may be used.
    linked : (n, 3^d) whether a neighbour shares an occupied cell with the node.
    slopes : (2^d, d) slope sign of shape function i along each axis divided by the spacing [1/m].
    """

    cells: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    linked: NDArray[np.bool_]
    slopes: NDArray[np.float64]


def node_stencil(grid: RegularGrid, active: ActiveCells) -> NodeStencil:
    """Tables of the active nodes for one sorting of the particles."""
    tables = moment_tables(grid.dimension)
    index = grid.node_indices(active.nodes)
    cell_index = index[:, None, :] - tables.corners[None, :, :]
    inside = np.all((cell_index >= 0) & (cell_index < grid.cells), axis=-1)
    flat_cell = np.ravel_multi_index(
        tuple(np.moveaxis(np.where(inside[..., None], cell_index, 0), -1, 0)), tuple(grid.cells)
    )
    cells = np.where(inside, active.cell_numbers[flat_cell], np.int32(-1)).astype(np.int32)
    offsets = np.array(list(product((-1, 0, 1), repeat=grid.dimension)))
    strides = np.append(np.cumprod(grid.nodes[:0:-1])[::-1], 1)
    flat = np.clip(active.nodes[:, None] + offsets @ strides, 0, grid.node_count - 1)
    neighbours = active.node_numbers[flat]
    slopes = (2.0 * tables.corners - 1.0) / grid.spacing
    linked = np.zeros(neighbours.shape, dtype=np.bool_)
    for corner, slots in enumerate(tables.slots):
        linked[:, slots] |= (cells[:, corner] >= 0)[:, None]
    return NodeStencil(cells, neighbours, linked, slopes)
