"""Sparse matrices as rows of small dense blocks, the storage of every sweep and product kernel.

A thin view on SciPy's BSR format with 64-bit-free index arrays and C-contiguous (nnz, rows, columns) data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class BlockRows:
    """Block rows: `indptr` (n+1,), `indices` (nnz,) block columns, `data` (nnz, s, q), `columns` block columns in all."""

    indptr: np.ndarray
    indices: np.ndarray
    data: np.ndarray
    columns: int

    @property
    def n(self) -> int:
        """Number of block rows."""
        return len(self.indptr) - 1

    def matrix(self) -> sp.bsr_array:
        """The same matrix for SciPy, sharing memory."""
        _, s, q = self.data.shape
        return sp.bsr_array((self.data, self.indices, self.indptr), shape=(self.n * s, self.columns * q))


def block_rows(matrix: sp.sparray | sp.spmatrix | np.ndarray, s: int, q: int) -> BlockRows:
    """Cut a (n s, c q) matrix into s x q blocks (zero blocks dropped), sorted by column. Cost O(entries)."""
    bsr = (
        sp.bsr_array(sp.csr_array(matrix), blocksize=(s, q))
        if not _is_bsr(matrix, s, q)
        else sp.bsr_array(matrix)
    )
    bsr.sort_indices()
    data = np.ascontiguousarray(bsr.data, dtype=float)
    return BlockRows(bsr.indptr.astype(np.int32), bsr.indices.astype(np.int32), data, bsr.shape[1] // q)


def _is_bsr(matrix: object, s: int, q: int) -> bool:
    return sp.issparse(matrix) and matrix.format == "bsr" and matrix.blocksize == (s, q)  # type: ignore[attr-defined]


def diagonal_blocks_of_square(rows: BlockRows) -> np.ndarray:
    """Diagonal blocks (n, s, s) of a square block matrix (zero where none is stored)."""
    n, s = rows.n, rows.data.shape[1]
    blocks = np.zeros((n, s, s))
    row_of = np.repeat(np.arange(n), np.diff(rows.indptr))
    on_diagonal = rows.indices == row_of
    blocks[row_of[on_diagonal]] = rows.data[on_diagonal]
    return blocks
