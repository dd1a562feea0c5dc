"""Where the blocks of elements go in the block-sparse matrices of a cloth: found once for a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.cloth.mesh import ClothMesh

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Blocks of 3 x 3 between vertices that share a triangle or a hinge; columns increase along a row.

    starts (n + 1,), columns (nnz,) : int32, as in `scipy.sparse.bsr_array`.  diagonal : (n,) entries of diagonal blocks.
    triangles (m, 3, 3), hinges (h, 4, 4), edges (e, 4, 4) : entries of the blocks of an element, -1 where it has none.
    edge_stencils : (e, 4) ends of each edge and the vertices opposite, -1 beside a boundary.
    """

    starts: NDArray[np.int32]
    columns: NDArray[np.int32]
    diagonal: Whole
    triangles: Whole
    hinges: Whole
    edges: Whole
    edge_stencils: Whole

    def zeros(self) -> Vector:
        """(nnz, 3, 3) blocks to fill."""
        return np.zeros((len(self.columns), 3, 3))

    def matrix(self, data: Vector) -> sp.bsr_array:
        """The matrix with these blocks, which it keeps."""
        n = 3 * (len(self.starts) - 1)
        return sp.bsr_array((data, self.columns, self.starts), shape=(n, n))


def block_pattern(mesh: ClothMesh) -> BlockPattern:
    """The pattern of a mesh."""
    n = len(mesh.vertices)
    stencils = _edge_stencils(mesh)
    keys = [np.arange(n) * (n + 1)]
    for corners in (mesh.triangles, stencils):
        keys.append(_keys(corners, n).ravel())
    every = np.unique(np.concatenate(keys))
    every = every[every >= 0]
    rows, columns = np.divmod(every, n)
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])

    def entries(corners: Whole) -> Whole:
        wanted = _keys(corners, n)
        return np.where(wanted >= 0, np.searchsorted(every, wanted), -1)

    return BlockPattern(
        starts.astype(np.int32), columns.astype(np.int32), np.searchsorted(every, np.arange(n) * (n + 1)),
        entries(mesh.triangles), entries(mesh.hinges.stencils), entries(stencils), stencils,
    )  # fmt: skip


def _keys(corners: Whole, n: int) -> Whole:
    """(k, c, c) row n + column of the blocks between the corners (k, c); -1 where one is missing."""
    key = corners[:, :, None] * np.int64(n) + corners[:, None, :]
    there = (corners >= 0)[:, :, None] & (corners >= 0)[:, None, :]
    return np.where(there, key, -1)


def _edge_stencils(mesh: ClothMesh) -> Whole:
    hinges = mesh.hinges
    stencils = np.full((len(hinges.edges), 4), -1, dtype=np.int64)
    stencils[:, :2] = hinges.edges
    stencils[hinges.edge_of_hinge] = hinges.stencils
    lone = np.flatnonzero(hinges.beside[:, 1] < 0)
    owner = mesh.triangles[hinges.beside[lone, 0]]
    stencils[lone, 2] = owner.sum(axis=1) - hinges.edges[lone].sum(axis=1)
    return stencils
