"""Sparse matrices as rows of small dense blocks, the storage of every sweep and product kernel.

A thin view on SciPy's BSR format with 64-bit-free index arrays and C-contiguous (nnz, rows, columns) data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from barchan.linalg._kernels import add_transposed_product, count_blocks, diagonal_of_blocks, fill_blocks


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
    """Cut a (n s, c q) matrix into s x q blocks (blocks without entries dropped), sorted by column. Cost O(entries).

    A BSR matrix of such blocks, sorted and without duplicates, shares its memory with the result.
    """
    if _is_bsr(matrix, s, q):
        bsr = sp.bsr_array(matrix)
        if not bsr.has_canonical_format:
            bsr = bsr.copy()
            bsr.sum_duplicates()
        data = np.ascontiguousarray(bsr.data, dtype=float)
        indptr, indices = bsr.indptr.astype(np.int32, copy=False), bsr.indices.astype(np.int32, copy=False)
        return BlockRows(indptr, indices, data, bsr.shape[1] // q)
    csr: Any = matrix if sp.issparse(matrix) and matrix.format == "csr" else sp.csr_array(matrix)  # type: ignore[union-attr]
    columns = csr.shape[1] // q
    pointers = count_blocks(csr.indptr, csr.indices, s, q, columns)
    values = np.asarray(csr.data, dtype=float)
    indices, data = fill_blocks(csr.indptr, csr.indices, values, s, q, columns, pointers)
    return BlockRows(pointers, indices, data, columns)


def _is_bsr(matrix: object, s: int, q: int) -> bool:
    return sp.issparse(matrix) and matrix.format == "bsr" and matrix.blocksize == (s, q)  # type: ignore[attr-defined]


def diagonal_blocks_of_square(rows: BlockRows) -> np.ndarray:
    """Diagonal blocks (n, s, s) of a square block matrix (zero where none is stored)."""
    blocks = np.empty((rows.n, rows.data.shape[1], rows.data.shape[1]))
    diagonal_of_blocks(rows.indptr, rows.indices, rows.data, blocks)
    return blocks


def transposed_product(matrix: sp.sparray, r: np.ndarray) -> np.ndarray:
    """matrix^T r (m,) for r (rows,): without the copy of a BSR matrix that SciPy makes to transpose it."""
    if matrix.format != "bsr":
        return np.asarray(matrix.T @ r)
    s, q = matrix.blocksize
    out = np.zeros((matrix.shape[1] // q, q))
    data, blocks = np.ascontiguousarray(matrix.data, dtype=float), np.ascontiguousarray(r, dtype=float)
    add_transposed_product(matrix.indptr, matrix.indices, data, blocks.reshape(-1, s), out)
    return out.reshape(-1)
