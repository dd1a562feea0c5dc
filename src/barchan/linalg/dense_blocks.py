"""A matrix of dense blocks along its diagonal (one a fibre): factors, inverse, and H M^-1 H^T without a sparse product.

With M = L L^T, block by block, the rows G = H L^-T of H give H M^-1 H^T = G G^T: its blocks are dot products of rows on the
same component (seed B, Algorithm 4.1 precomputes M^-1 H^T likewise). Cost: m_c^2 s a block of H on a component of order m_c.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.linalg import _dense_block_kernels as kernels
from barchan.linalg.blocks import BlockRows

Vector = NDArray[np.float64]
Numbers = NDArray[np.int64]

_CHUNKS = 32  # of rows that a thread takes at a time, each with an array as long as the rows


@dataclass(frozen=True, eq=False)
class DenseBlocks:
    """Cholesky factors of a block-diagonal matrix (m, m) of c blocks.

    order : (m,) unknowns, component by component.  place : (m,) where each unknown is in it.  label : (m,) its component.
    starts : (c + 1,) places.  offsets : (c + 1,) of the square blocks in `factors`, row by row.
    """

    order: Numbers
    place: Numbers
    label: Numbers
    starts: Numbers
    offsets: Numbers
    factors: Vector

    @classmethod
    def of(cls, M: sp.csr_array, label: NDArray[Any], name: str = "M") -> DenseBlocks:
        """Factorise M (m, m), whose unknowns i and j are only coupled where label[i] == label[j].

        Raises InputError when a block is not positive definite.
        """
        label = label.astype(np.int64)
        order = np.argsort(label, kind="stable").astype(np.int64)
        sizes = np.bincount(label).astype(np.int64)
        starts = np.concatenate([[0], np.cumsum(sizes)])
        offsets = np.concatenate([[0], np.cumsum(sizes**2)])
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        factors = np.zeros(int(offsets[-1]))
        kernels.gather_blocks(M.indptr, M.indices, M.data, label, place, starts, offsets, factors)
        return cls._factorised(order, place, label, starts, offsets, factors, name)

    @classmethod
    def of_blocks(cls, blocks: Vector, sizes: Numbers, name: str = "M") -> DenseBlocks:
        """Factorise a matrix whose dense blocks, of orders `sizes` (c,), lie one after the other, row by row.

        Raises InputError when a block is not positive definite.
        """
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        places = np.arange(int(starts[-1]), dtype=np.int64)
        label = np.repeat(np.arange(len(sizes), dtype=np.int64), sizes)
        offsets = np.concatenate([[0], np.cumsum(np.asarray(sizes, dtype=np.int64) ** 2)])
        return cls._factorised(places, places, label, starts, offsets, np.array(blocks, dtype=float), name)

    @classmethod
    def _factorised(
        cls, order: Numbers, place: Numbers, label: Numbers, starts: Numbers, offsets: Numbers, factors: Vector, name: str
    ) -> DenseBlocks:  # fmt: skip
        """From the blocks in `factors`, which are overwritten."""
        failed = np.zeros(len(starts) - 1, dtype=np.bool_)
        kernels.cholesky_blocks(starts, offsets, factors, failed)
        if failed.any():
            raise InputError(name, "matrix with a non-positive eigenvalue", "positive definite")
        return cls(order, place, label, starts, offsets, factors)

    def solve(self, rhs: Any) -> Vector:
        """M^-1 rhs for (m,) or (m, k)."""
        given = np.ascontiguousarray(rhs, dtype=float)
        out = np.empty((len(self.order), 1 if given.ndim == 1 else given.shape[1]))
        kernels.solve_blocks(
            self.starts, self.offsets, self.factors, self.order, given.reshape(out.shape), out
        )
        return out.reshape(given.shape)

    @cached_property
    def inverse(self) -> sp.csr_array:
        """M^-1."""
        dense = np.empty_like(self.factors)
        kernels.inverse_blocks(self.starts, self.offsets, self.factors, dense)
        sizes = np.diff(self.starts)
        width = sizes[self.label]  # of each row
        indptr = np.concatenate([[0], np.cumsum(width)])
        within = np.arange(indptr[-1]) - np.repeat(indptr[:-1], width)
        columns = self.order[np.repeat(self.starts[self.label], width) + within]
        row_start = self.offsets[self.label] + (self.place - self.starts[self.label]) * width
        data = dense[np.repeat(row_start, width) + within]
        return sp.csr_array((data, columns, indptr), shape=(len(width), len(width)))

    def whitened(self, H: Any, s: int) -> WhitenedRows:
        """G = H L^-T in block rows of s, for H (n s, m)."""
        H = sp.csr_array(H)
        n, count = H.shape[0] // s, len(self.starts) - 1
        pointers = np.zeros(n + 1, dtype=np.int64)
        nothing = np.empty(0, dtype=np.int64)
        asked = (H.indptr, H.indices, s, self.label, self.place, count, pointers)
        kernels.touched_components(*asked, nothing, nothing)
        component = np.empty(int(pointers[-1]), dtype=np.int64)
        first = np.empty_like(component)
        if len(component):
            kernels.touched_components(*asked, component, first)
        pieces = -(-np.diff(self.starts) // kernels.PIECE)
        piece_starts = np.concatenate([[0], np.cumsum(pieces)])
        skipped = (first - self.starts[component]) // kernels.PIECE
        piece = np.concatenate([[0], np.cumsum(pieces[component] - skipped)])
        data = np.zeros((int(piece[-1]), kernels.PIECE, s))
        kernels.whiten_rows(
            (H.indptr, H.indices, np.asarray(H.data, dtype=float)), self.label, self.place, self.starts, self.offsets,
            self.factors, pointers, component, piece, data,
        )  # fmt: skip
        column = np.repeat(piece_starts[component] + skipped - piece[:-1], np.diff(piece)) + np.arange(
            piece[-1]
        )
        return WhitenedRows(pointers, component, piece, column, data, int(piece_starts[-1]), count)


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """G (n s, m') with G G^T = H M^-1 H^T, in n block rows; m' is m with every component padded to whole pieces.

    pointers : (n + 1,) entries of each row.  component : (e,) of each entry.  piece : (e + 1,) its pieces.
    column : (p,) of each piece.  data : (p, PIECE, s).  columns : number of pieces in all.  count : number of components.
    """

    pointers: Numbers
    component: Numbers
    piece: Numbers
    column: Numbers
    data: Vector
    columns: int
    count: int

    @property
    def n(self) -> int:
        """Number of block rows."""
        return len(self.pointers) - 1

    @property
    def s(self) -> int:
        """Rows of a block."""
        return int(self.data.shape[2])

    @cached_property
    def product_blocks(self) -> int:
        """Blocks that are computed for G G^T: no less than it stores."""
        return int((np.bincount(self.component, minlength=1).astype(np.int64) ** 2).sum())

    def rows(self) -> BlockRows:
        """G as block rows, blocks transposed (PIECE, s), for sweeps that keep G^T r."""
        indptr = self.piece[self.pointers].astype(np.int32)
        return BlockRows(indptr, self.column.astype(np.int32), self.data, self.columns)

    def diagonal(self) -> Vector:
        """(n, s, s) diagonal blocks of G G^T."""
        out = np.empty((self.n, self.s, self.s))
        kernels.gram_diagonal(self.pointers, self.piece, self.data, out)
        return out

    def gram(self) -> BlockRows:
        """G G^T in s x s blocks, sorted, symmetric to the last bit; diagonal blocks are stored even where they are zero."""
        lists = np.zeros(self.count + 1, dtype=np.int64)
        entries, owners = np.empty_like(self.component), np.empty_like(self.component)
        kernels.entries_by_component(self.pointers, self.component, lists, entries, owners)
        chunks = np.linspace(0, self.n, min(_CHUNKS, max(self.n, 1)) + 1).astype(np.int64)
        indptr = np.zeros(self.n + 1, dtype=np.int64)
        known = (chunks, self.pointers, self.component, lists, owners)
        kernels.count_neighbours(*known, indptr, np.empty(0, dtype=np.int32))
        np.cumsum(indptr, out=indptr)
        indices = np.empty(int(indptr[-1]), dtype=np.int32)
        out = np.empty((len(indices), self.s, self.s))
        if len(indices):
            kernels.count_neighbours(*known, indptr, indices)
            kernels.gram_kernel(self.s)(
                chunks, self.pointers, self.component, self.piece, lists, entries, owners, self.data, indptr, indices, out
            )  # fmt: skip
        return BlockRows(indptr.astype(np.int32), indices, out, self.n)
