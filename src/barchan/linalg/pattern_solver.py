"""Direct solver of a sequence of matrices of one sparsity pattern: the order of elimination is found once.

Pardiso (extra `fast`) where present, else SuperLU, which keeps nothing from one matrix to the next but gives the same answers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from barchan.errors import InputError
from barchan.linalg.pardiso import Pardiso, available

KINDS = ("positive", "indefinite", "structural")
PROVEN = 1e-2


class PatternSolver:
    """Factorises and solves with matrices that share a pattern.

    Parameters
    ----------
    pattern : (m, m) csr, whole or (for the symmetric kinds) its upper triangle, with typical entries: `GramPattern.matrix(D)`.
    symmetric : "positive" (symmetric positive definite), "indefinite" (symmetric), "structural" (symmetric pattern only).
    threads : of Pardiso; as many as Numba's kernels may use when None.

    Raises
    ------
    InputError : an unknown kind, a matrix that is not square or lacks a diagonal entry.
    MemoryError : the factors do not fit.
    """

    def __init__(self, pattern: Any, symmetric: str, threads: int | None = None) -> None:
        if symmetric not in KINDS:
            raise InputError("symmetric", symmetric, f"one of {', '.join(KINDS)}")
        pattern = sp.csr_array(pattern)
        if pattern.shape[0] != pattern.shape[1]:
            raise InputError("pattern", f"matrix of shape {pattern.shape}", "square")
        if not pattern.has_sorted_indices:
            raise InputError("pattern", "columns in no order", "sorted columns")
        self.m, self.kind, self.nnz = pattern.shape[0], symmetric, pattern.nnz
        rows = np.repeat(np.arange(self.m), np.diff(pattern.indptr))
        if np.count_nonzero(rows == pattern.indices) != self.m:
            raise InputError("pattern", "without a whole diagonal", "every diagonal entry stored (zeros too)")
        # Of a whole symmetric pattern the upper triangle is taken.
        self._kept = None
        if symmetric != "structural" and (pattern.indices < rows).any():
            self._kept = np.flatnonzero(pattern.indices >= rows)
            pattern = sp.csr_array(
                (pattern.data[self._kept], (rows[self._kept], pattern.indices[self._kept])),
                shape=pattern.shape,
            )
        self._pattern = pattern
        self._pardiso = (
            Pardiso(pattern.indptr, pattern.indices, pattern.data, symmetric, threads)
            if available()
            else None
        )
        self._lu: Any = None

    def factorise(self, data: np.ndarray) -> bool:
        """Factorise the matrix of entries `data` (nnz,), in the order of the pattern given.

        False when it is singular, not finite, or, for "positive", not positive definite: no solve is possible then.
        """
        if data.shape != (self.nnz,):
            raise InputError(
                "data", f"array of shape {data.shape}", f"of shape {(self.nnz,)}, as the pattern"
            )
        data = data if self._kept is None else data[self._kept]
        if not np.isfinite(data).all():
            return False
        if self._pardiso is None:
            return self._factorise_by_superlu(data)
        if not self._pardiso.factorise(data):
            return False
        return self._pardiso.perturbed == 0 or self.kind == "positive" or self._is_proven(data)

    def solve(self, rhs: np.ndarray, refinements: int | None = None) -> np.ndarray:
        """x of the shape of `rhs`, (m,) or (m, k), by the last matrix factorised.

        `refinements` bounds Pardiso's steps of iterative refinement, each of which costs more than a solve: by default none for
        positive definite matrices, two for the others (their pivots are not searched for).
        """
        if self._pardiso is not None:
            default = 0 if self.kind == "positive" else 2
            return self._pardiso.solve(rhs, default if refinements is None else refinements)
        return np.asarray(self._lu.solve(np.asarray(rhs, dtype=float)))

    @property
    def megabytes(self) -> float | None:
        """Memory of the factors; None where it is not known."""
        return None if self._pardiso is None else self._pardiso.megabytes

    def _matrix(self, data: np.ndarray) -> sp.csr_array:
        matrix = sp.csr_array((data, self._pattern.indices, self._pattern.indptr), shape=self._pattern.shape)
        if self.kind == "structural":
            return matrix
        return sp.csr_array(matrix + sp.triu(matrix, 1).T)

    def _is_proven(self, data: np.ndarray) -> bool:
        """Whether a matrix with pivots too small to be used still gives a solution known beforehand.

        Signs at random have a part of size one along any null vector, which the solution of a singular matrix misses.
        """
        assert self._pardiso is not None
        known = np.random.default_rng(0).choice([-1.0, 1.0], self.m)
        with np.errstate(all="ignore"):
            missed = np.linalg.norm(self._pardiso.solve(self._matrix(data) @ known) - known)
        return bool(missed <= PROVEN)

    def _factorise_by_superlu(self, data: np.ndarray) -> bool:
        positive = self.kind == "positive"
        try:
            self._lu = spla.splu(
                sp.csc_array(self._matrix(data)),
                permc_spec="MMD_AT_PLUS_A" if positive else "COLAMD",
                diag_pivot_thresh=0.0 if positive else 1.0,
                options={"SymmetricMode": True} if positive else {},
            )
        except RuntimeError:
            return False
        # A vanishing pivot makes SuperLU exchange rows, after which the signs mean nothing.
        return not positive or bool(
            (self._lu.U.diagonal() > 0.0).all() and np.array_equal(self._lu.perm_r, self._lu.perm_c)
        )
