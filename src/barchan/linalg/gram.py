"""M + H^T D H again and again, with the same M and H and a new block diagonal D: what an interior point factorises.

The pattern is found once. Consecutive blocks of H that touch the same columns (the quadrature points of one cell) form a group
whose small dense product sum_q H_q^T D_q H_q is added up at once; rows gather from groups, so no two threads share a row.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg._kernels import gram_data, gram_pattern, rows_of_blocks, same_as_before, scatter_known
from barchan.linalg.blocks import block_rows


class GramPattern:
    """The fixed sparsity pattern of M + H^T D H and the fast computation of its entries.

    Parameters
    ----------
    M : (m, m) sparse symmetric matrix.
    H : (n s, m) sparse matrix (any format), blocks of s rows.
    s : rows of a block.
    upper : keep the upper triangle only (for symmetric D; what Pardiso wants of symmetric matrices).

    Attributes
    ----------
    indptr, indices : of the pattern, columns sorted, the whole diagonal stored. Shared by all matrices; not to be changed.
    n, s, m : blocks, rows of a block, unknowns.   groups : number of groups of blocks.

    Raises
    ------
    InputError : shapes that do not fit.
    """

    def __init__(self, M: Any, H: Any, s: int, upper: bool = False) -> None:
        M = sp.csr_array(M)
        if M.shape[0] != M.shape[1]:
            raise InputError("M", f"matrix of shape {M.shape}", "square")
        if H.shape[1] != M.shape[0]:
            raise InputError("H", f"matrix of shape {H.shape}", f"with {M.shape[0]} columns, as M")
        if s < 1 or H.shape[0] % s:
            raise InputError("s", s, f"a divisor of the {H.shape[0]} rows of H")
        self.m, self.n, self.s, self.upper = M.shape[0], H.shape[0] // s, s, upper
        self._group(H)
        self._find_pattern(M)
        self._base = np.zeros(len(self.indices))
        scatter_known(M.indptr, M.indices, M.data.astype(float), self.indptr, self.indices, upper, self._base)

    def _group(self, H: Any) -> None:
        """Groups of blocks, and for every column the groups that touch it with its place among their columns."""
        rows = block_rows(H, self.s, 1)
        pointers = rows.indptr.astype(np.int64)
        self._offsets = self.s * pointers
        self._rows = np.empty(rows.data.size)
        rows_of_blocks(pointers, rows.data.reshape(-1, self.s), self._rows)
        first = np.flatnonzero(~same_as_before(pointers, rows.indices))
        self.groups = len(first)
        self._first_block = np.concatenate([first, [self.n]]).astype(np.int64)
        width = pointers[first + 1] - pointers[first]
        self._pointers = np.concatenate([[0], np.cumsum(width)]).astype(np.int64)
        place = np.arange(self._pointers[-1]) - np.repeat(self._pointers[:-1], width)
        self._columns = rows.indices[np.repeat(pointers[first], width) + place]
        # CSC of the matrix (groups, m) that holds, where a group touches a column, the place of the column in the group.
        touch = sp.csr_array((place, self._columns, self._pointers), shape=(self.groups, self.m)).tocsc()
        self._inverse = touch.indptr.astype(np.int64)
        self._touching, self._local = touch.indices.astype(np.int32), touch.data.astype(np.int32)

    def _chunks(self) -> np.ndarray:
        """Limits of as many ranges of rows as there are threads, of about equal work."""
        count = numba.get_num_threads()
        work = self._inverse + np.arange(self.m + 1)
        limits = np.searchsorted(work, work[-1] * np.arange(1, count) / count)
        return np.concatenate([[0], limits, [self.m]]).astype(np.int64)

    def _find_pattern(self, M: sp.csr_array) -> None:
        chunks = self._chunks()
        known = (M.indptr, M.indices, self._inverse, self._touching, self._pointers, self._columns)
        indptr = np.zeros(self.m + 1, np.int64)
        gram_pattern(chunks, *known, self.upper, indptr, np.empty(0, np.int32))
        np.cumsum(indptr, out=indptr)
        self.indices = np.empty(indptr[-1], np.int32)
        gram_pattern(chunks, *known, self.upper, indptr, self.indices)
        # Index arrays of one type, as SciPy wants them; 64 bits only where the number of entries needs it.
        wide = np.int32 if indptr[-1] < 2**31 else np.int64
        self.indptr, self.indices = indptr.astype(wide), self.indices.astype(wide, copy=False)

    @property
    def nnz(self) -> int:
        """Stored entries."""
        return len(self.indices)

    def data(self, D: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """(nnz,) entries of M + H^T D H for D (n, s, s), in the order of `indices`. Cost O(s k) per entry of a group's block.

        D may be nonsymmetric unless `upper`. `out` (nnz,) is written to when given.
        """
        D = np.ascontiguousarray(D, dtype=float)
        if D.shape != (self.n, self.s, self.s):
            raise InputError("D", f"array of shape {D.shape}", f"of shape {(self.n, self.s, self.s)}")
        out = np.empty(self.nnz) if out is None else out
        gram_data(
            self._chunks(), self._base, self._inverse, self._touching, self._local, self._pointers, self._columns,
            self._first_block, self._offsets, self._rows, D, self.upper, self.indptr, self.indices, out,
        )  # fmt: skip
        return out

    def matrix(self, D: np.ndarray | None = None) -> sp.csr_array:
        """M + H^T D H (its upper triangle with `upper`); without D the pattern, with the entries of M. Shares the indices."""
        data = self._base.copy() if D is None else self.data(D)
        matrix = sp.csr_array((data, self.indices, self.indptr), shape=(self.m, self.m), copy=False)
        matrix.has_sorted_indices = matrix.has_canonical_format = True
        return matrix
