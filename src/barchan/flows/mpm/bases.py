"""Velocity bases on the background grid: multilinear, linear on simplices, quadratic splines (seed B, 7.3.3, Fig. 7.8).

All three are partitions of unity that reproduce affine fields, so transfers conserve momentum. The splines have open knots
at the box, hence a control point on each face that carries the wall's condition, and no jump of the gradient between cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm import _basis_kernels as kernels
from barchan.spaces import RegularGrid

VELOCITIES = ("Q1", "P1", "B2")
# As in `_kernels`: local coordinates are kept this far inside their cell.
MARGIN = 1e-9


@dataclass(frozen=True, eq=False)
class ShapeTable:
    """The basis functions at P points.

    weights : (P, m) values.  gradients : (P, m, d) [1/m].  cells : (P,) flat cells.  simplices : (P,) Kuhn simplex.
    """

    weights: NDArray[np.float64]
    gradients: NDArray[np.float64]
    cells: NDArray[np.int64]
    simplices: NDArray[np.int64]


@dataclass(frozen=True)
class VelocityBasis:
    """A basis on a grid; its functions are numbered by C-order flat indices into a lattice of cells + order points.

    name : "Q1" (multilinear), "P1" (linear on Kuhn's simplices) or "B2" (quadratic splines).
    """

    grid: RegularGrid
    name: str = "Q1"

    @property
    def dimension(self) -> int:
        """d."""
        return self.grid.dimension

    @property
    def order(self) -> int:
        """1 or 2: functions per axis that do not vanish in a cell, less one."""
        return 2 if self.name == "B2" else 1

    @cached_property
    def lattice(self) -> NDArray[np.int64]:
        """(d,) number of functions along each axis."""
        return np.asarray(self.grid.cells + self.order)

    @cached_property
    def strides(self) -> NDArray[np.int64]:
        """(d,) strides of the flat indices."""
        return np.append(np.cumprod(self.lattice[:0:-1])[::-1], 1).astype(np.int64)

    @cached_property
    def local(self) -> NDArray[np.int64]:
        """(m, d) offsets of a cell's functions from its own index."""
        return np.array(list(product(range(self.order + 1), repeat=self.grid.dimension)), dtype=np.int64)

    def evaluate(self, points: NDArray[np.float64]) -> ShapeTable:
        """Values and gradients at points (P, d) of the box."""
        grid, count = self.grid, len(points)
        weights = np.zeros((count, len(self.local)))
        gradients = np.zeros((count, len(self.local), grid.dimension))
        cells, simplices = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
        kind = VELOCITIES.index(self.name)
        kernels.evaluate(
            kind, np.ascontiguousarray(points), grid.origin, grid.spacing, grid.cells, MARGIN,
            weights, gradients, cells, simplices,
        )  # fmt: skip
        return ShapeTable(weights, gradients, cells, simplices)

    def of_cells(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """(C, m) flat indices of the functions of the cells with flat ids (C,)."""
        index = np.stack(np.unravel_index(cells, tuple(self.grid.cells)), axis=-1)
        return np.asarray((index @ self.strides)[:, None] + self.local @ self.strides)

    def active(self, occupied: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) flat indices, increasing, of the functions of the occupied cells."""
        marked = np.zeros(int(np.prod(self.lattice)), dtype=np.bool_)
        marked[self.of_cells(occupied)] = True
        return np.flatnonzero(marked)

    def indices(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, d) lattice coordinates of flat indices (n,)."""
        return np.stack(np.unravel_index(ids, tuple(self.lattice)), axis=-1)

    def positions(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, d) places y_i [m] with sum_i w_i(x) y_i = x: nodes, or the Greville points of the splines."""
        index = self.indices(ids).astype(np.float64)
        if self.order == 2:
            index = np.clip(index - 0.5, 0.0, self.grid.cells.astype(np.float64))
        return np.asarray(self.grid.origin + self.grid.spacing * index)

    def on_face(self, ids: NDArray[np.int64], axis: int, upper: bool) -> NDArray[np.bool_]:
        """(n,) whether each function carries the velocity on the lower or upper face normal to `axis`."""
        return np.asarray(self.indices(ids)[:, axis] == (self.lattice[axis] - 1 if upper else 0))


@lru_cache(maxsize=2)
def corner_shares(d: int) -> NDArray[np.float64]:
    """(2^d, 2^d) integrals of the multilinear functions of a cell (columns) over its halves, as shares of its volume."""
    halves = np.array(list(product((0, 1), repeat=d)))
    return np.asarray(np.prod(np.where(halves[:, None, :] == halves[None, :, :], 0.375, 0.125), axis=-1))


def simplex_weights(table: ShapeTable) -> NDArray[np.float64]:
    """(P, d + 1) barycentric coordinates in each point's simplex, from the values of "P1"."""
    d = table.gradients.shape[2]
    corners = kernels.simplex_corners(d)[table.simplices]
    return np.take_along_axis(table.weights, corners, axis=1)
