"""The sparsity pattern of matrices summed from dense element matrices, found once; assembly by known places.

Cost of the pattern: entries times the logarithm of a row; of an assembly: one addition for each entry of each element matrix.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg._cell_kernels import add_up, add_up_free, count_rows, fill_rows, find_positions, unit_rows


class CellPattern:
    """Pattern of the sum of element matrices.

    Parameters
    ----------
    cell_unknowns : (C, n) numbers of the unknowns of each cell, without repetition in a cell.
    size : number of unknowns; the pattern holds the whole diagonal.

    Attributes
    ----------
    indptr (size + 1,), indices (nnz,) : csr pattern, columns sorted, int32.
    positions : (C, n, n) int32 place of each element entry in the csr data.

    Raises
    ------
    InputError : numbers out of range, or more than 2^31 entries.
    """

    def __init__(self, cell_unknowns: np.ndarray, size: int) -> None:
        unknowns = np.ascontiguousarray(cell_unknowns, dtype=np.int32)
        wrong = unknowns[(unknowns < 0) | (unknowns >= size)]
        if wrong.size:
            raise InputError("cell_unknowns", int(wrong[0]), f"numbers between 0 and {size - 1}")
        self.size, self.cell_unknowns = int(size), unknowns
        cells, n = unknowns.shape
        order = np.argsort(unknowns.ravel(), kind="stable")
        owner = (order // n).astype(np.int32)
        pointers = np.concatenate([[0], np.cumsum(np.bincount(unknowns.ravel(), minlength=size))])
        counts = np.zeros(size, np.int64)
        scratch = np.empty(size, np.int32)
        count_rows(unknowns, owner, pointers, counts, np.full(size, -1, np.int64))
        total = int(counts.sum())
        if total >= 2**31:
            raise InputError("cell_unknowns", f"{total} entries", "fewer than 2^31")
        self.indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self.indices = np.empty(total, np.int32)
        fill_rows(unknowns, owner, pointers, self.indptr, self.indices, np.full(size, -1, np.int64), scratch)
        self.positions = np.empty((cells, n, n), np.int32)
        find_positions(unknowns, self.indptr, self.indices, self.positions)

    def assemble(self, elements: np.ndarray, fixed: np.ndarray | None = None) -> np.ndarray:
        """(nnz,) csr data of the sum of element matrices (C, n, n).

        fixed : (size,) bool unknowns whose rows and columns are replaced by those of the identity.
        """
        data = np.zeros(len(self.indices))
        if fixed is None:
            add_up(elements, self.positions, data)
        else:
            add_up_free(elements, self.positions, self.cell_unknowns, fixed, data)
            unit_rows(self.indptr, self.indices, fixed, data)
        return data

    def matrix(self, data: np.ndarray) -> sp.csr_array:
        """The csr matrix of these data (shared, not copied)."""
        matrix = sp.csr_array((data, self.indices, self.indptr), shape=(self.size, self.size))
        matrix.has_canonical_format = True
        return matrix
