"""Continuous piecewise linear pressures against piecewise constant velocities (seed B, 8.3.4 and the forms b, c of 8.3.2).

The volume average has no divergence, weakly: -int v . grad q = -int_walls q v_w . n for every continuous piecewise linear q.
Walls need no unknowns of their own (what does not enter the right side does not cross them), and grad q being constant in each
cell, the force on a cell is exactly its volume times the gradient: a hydrostatic pressure is balanced to round-off. Constant
velocities contain those gradients, so that the Schur complement is the matrix of a Poisson problem: the pair is stable. On
quadrilaterals the checkerboard pressure has no mean gradient in any cell and the pair is not: simplices only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.dry._kernels import FREE
from barchan.flows.dry.cells import Cells
from barchan.flows.suspension.p0.boundaries import Sides
from barchan.linalg.factor import Solver, sparse_solver

Vector = NDArray[np.float64]

BALANCED = 1e-10
"""Share of the fluxes through the walls of a closed box up to which their sum counts as zero."""


@dataclass(frozen=True, eq=False)
class Pressures:
    """Pressures at the p kept of the v vertices: not those of free parts (zero), nor one of a closed box (redundant).

    divergence : C (p, c d) with r . (C v) = -int v . grad q.  sources : k (p,) of C v = k [m^d/s].
    kept : (p,) vertices.  volumes : (v,) [m^d], shares of the cells around.  closed : whether there is no free part.
    """

    divergence: sp.csr_array
    transposed: sp.csr_array
    sources: Vector
    kept: NDArray[np.int64]
    volumes: Vector
    closed: bool

    @classmethod
    def of(cls, cells: Cells, sides: Sides) -> Pressures:
        """Raises InputError for a mesh not of simplices, and for a closed box into which walls let a net volume."""
        corners = np.asarray(cells.mesh.t.T)
        d, count = cells.dimension, int(cells.mesh.p.shape[1])
        if corners.shape[1] != d + 1:
            raise InputError("mesh", "quadrilaterals", "triangles or tetrahedra in the two-phase model")
        gradients = _gradients(np.asarray(cells.mesh.p.T, dtype=float)[corners])
        columns = np.arange(cells.count * d).reshape(cells.count, 1, d)
        rows = np.broadcast_to(corners[:, :, None], gradients.shape)
        values = -cells.volumes[:, None, None] * gradients
        whole = sp.csr_array(
            (values.ravel(), (rows.ravel(), np.broadcast_to(columns, gradients.shape).ravel())),
            shape=(count, cells.count * d),
        )
        sources = -_spread_to_corners(cells, sides.wall_fluxes(cells), count)
        open_parts = _spread_to_corners(cells, (sides.codes == FREE).astype(float), count) > 0.0
        closed = not np.any(open_parts)
        kept = np.flatnonzero(~open_parts)
        if closed:
            _check_fluxes(sides.wall_fluxes(cells))
            kept = kept[:-1]
        volumes = np.asarray(
            np.bincount(corners.ravel(), np.repeat(cells.volumes / (d + 1), d + 1), count), dtype=float
        )
        divergence = sp.csr_array(whole[kept])
        return cls(divergence, sp.csr_array(divergence.T), sources[kept], kept, volumes, closed)

    def schur(self, compliance: Vector) -> Solver:
        """Solver of C diag(compliance) C^T, compliance (c, d) > 0."""
        scaled = self.transposed.copy()
        scaled.data *= np.repeat(compliance.reshape(-1), np.diff(scaled.indptr))
        return sparse_solver(sp.csr_array(self.divergence @ scaled), "pressures", positive=True)

    def field(self, values: Vector) -> Vector:
        """(v,) pressures at all vertices from (p,): zero on free parts, of zero mean in a closed box."""
        found = np.zeros(len(self.volumes))
        found[self.kept] = values
        return found - (self.volumes @ found) / np.sum(self.volumes) if self.closed else found

    def imbalance(self, velocities: Vector) -> float:
        """|C v - k| over the size of what is added up in it, of velocities (c, d): round-off where the volume is kept."""
        flat = velocities.reshape(-1)
        gap = np.linalg.norm(self.divergence @ flat - self.sources)
        size = np.linalg.norm(abs(self.divergence) @ np.abs(flat) + np.abs(self.sources))
        return float(gap / size) if size > 0.0 else 0.0


def _gradients(places: Vector) -> Vector:
    """(c, d + 1, d) gradients of the barycentric coordinates of simplices with corners (c, d + 1, d)."""
    inverse = np.linalg.inv(places[:, 1:] - places[:, :1])
    others = np.swapaxes(inverse, 1, 2)
    return np.concatenate([-np.sum(others, axis=1, keepdims=True), others], axis=1)


def _spread_to_corners(cells: Cells, amounts: Vector, count: int) -> Vector:
    """(count,) amounts (c, k) of boundary sides, shared equally by the corners of each."""
    found, sides = np.nonzero((cells.parts >= 0) & (amounts != 0.0))
    facets = np.asarray(cells.mesh.t2f)[sides, found]
    nodes = np.asarray(cells.mesh.facets)[:, facets]
    share = np.broadcast_to(amounts[found, sides] / cells.dimension, nodes.shape)
    return np.asarray(np.bincount(nodes.ravel(), share.ravel(), count), dtype=float)


def _check_fluxes(fluxes: Vector) -> None:
    net = float(np.sum(fluxes))
    if abs(net) > BALANCED * float(np.sum(np.abs(fluxes))):
        raise InputError(
            "boundaries",
            f"walls that take {net:.4g} m^d/s out of a closed box",
            "no net flux, or a free part",
        )
