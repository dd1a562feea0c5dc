"""The Delassus operator W = H M^-1 H^T in the forms the solvers use: stored, factored by a lumped M, or by solves.

A lumped M comes in two forms: blocks of H as they are (`lumped`), and those of a continuum's strains by gradients
(`gradient_form`); bilateral constraints go around either (`constrained`).

Seed B 2.3.1 (reduced formulation, eliminated bilateral constraints) and 3.4.3 (which form pays).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction._kernels import block_rows_times
from barchan.friction.constrained import ConstrainedDelassus, constrained
from barchan.friction.gradient_form import GradientDelassus, gradient_form
from barchan.friction.lumped import LumpedDelassus
from barchan.friction.problem import Problem
from barchan.linalg import BlockRows, block_rows, diagonal_blocks_of_square

OPERATORS = ("auto", "explicit", "matrix-free")
LARGEST_DENSE_DELASSUS = 6000


class Delassus(Protocol):
    """u = W r + b: `b` (n, s), `diagonal_blocks` (n, s, s), `apply` r (n, s) -> W r (n, s)."""

    @property
    def b(self) -> np.ndarray: ...

    @property
    def diagonal_blocks(self) -> np.ndarray: ...

    def apply(self, r: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class StoredDelassus:
    """W as block rows."""

    rows: BlockRows
    b: np.ndarray

    @cached_property
    def diagonal_blocks(self) -> np.ndarray:
        """(n, s, s)."""
        return diagonal_blocks_of_square(self.rows)

    def apply(self, r: np.ndarray) -> np.ndarray:
        """W r, cost O(entries)."""
        out = np.empty_like(r)
        block_rows_times(self.rows.indptr, self.rows.indices, self.rows.data, r, out)
        return out


@dataclass(frozen=True, eq=False)
class SolvedDelassus:
    """W r by one solve with M (and C) per product, for sparse M whose inverse is dense."""

    problem: Problem
    b: np.ndarray

    @cached_property
    def diagonal_blocks(self) -> np.ndarray:
        """(n, s, s), of H M^-1 H^T."""
        return self.problem.diagonal_blocks

    def apply(self, r: np.ndarray) -> np.ndarray:
        """W r, cost of one solve."""
        pull = self.problem.H.T @ r.reshape(-1)
        return np.asarray(self.problem.H @ _velocity(self.problem, pull, homogeneous=True)).reshape(r.shape)


def _velocity(problem: Problem, load: np.ndarray, homogeneous: bool) -> np.ndarray:
    if problem.C is None:
        return np.asarray(problem.factor.solve(load))
    k = np.zeros((problem.C.shape[0], *load.shape[1:])) if homogeneous else problem.k
    return problem.saddle.solve(load, k)[0]


def build_operator(problem: Problem, kind: str = "auto") -> Delassus:
    """The Delassus operator of a problem.

    Parameters
    ----------
    kind : "explicit" stores W, "matrix-free" never does, "auto" stores it when that is the cheaper product.

    Raises
    ------
    InputError : unknown kind, or explicit W asked where it would be dense and larger than LARGEST_DENSE_DELASSUS rows.
    """
    if kind not in OPERATORS:
        raise InputError("operator", kind, "one of " + ", ".join(OPERATORS))
    operator: Delassus = problem.prepared(("operator", kind), lambda: _build(problem, kind))
    return operator


def _of_variant(problem: Problem, kind: str) -> Delassus:
    """The origin's operator with the variant's b."""
    operator = copy(build_operator(problem.origin, kind))
    object.__setattr__(operator, "b", operator.b + problem.drift.reshape(problem.n, problem.s))
    return operator


def _build(problem: Problem, kind: str) -> Delassus:
    if problem.origin is not problem:
        return _of_variant(problem, kind)
    shape = (problem.n, problem.s)
    if problem.is_reduced:
        return StoredDelassus(problem.w_rows, problem.b.reshape(shape))
    free = _velocity(problem, problem.f, homogeneous=False)
    b = np.asarray(problem.H @ free + problem.w).reshape(shape)
    if is_lumped(problem) and (kind == "matrix-free" or (kind == "auto" and _lumped_is_cheaper(problem))):
        return _lumped(problem, b)
    if problem.factor.blocks is not None and problem.C is None:
        if kind == "matrix-free" or (kind == "auto" and _whitened_is_cheaper(problem)):
            return LumpedDelassus(problem.whitened.rows(), b, problem.diagonal_blocks)
        return StoredDelassus(problem.whitened.gram(), b)
    if problem.factor.has_sparse_inverse and problem.C is None and kind != "matrix-free":
        return StoredDelassus(block_rows(_product(problem), problem.s, problem.s), b)
    if kind == "explicit" or (kind == "auto" and problem.n * problem.s <= LARGEST_DENSE_DELASSUS):
        return _dense(problem, b)
    return SolvedDelassus(problem, b)


def is_lumped(problem: Problem) -> bool:
    """Whether M is diagonal and bilateral constraints, if any, are eliminated by way of S = C M^-1 C^T."""
    if problem.is_reduced or problem.factor.diagonal is None:
        return False
    return problem.C is None or problem.saddle.schur is not None


def _product(problem: Problem) -> sp.sparray:
    """H M^-1 H^T with sparse M^-1, in whole blocks where H is stored so (several times faster)."""
    s, q = problem.s, problem.velocity_block
    inverse = problem.factor.inverse
    if q > 1:
        H = problem.H
        return H @ sp.bsr_array(inverse, blocksize=(q, q)) @ sp.bsr_array(H.T, blocksize=(q, s))
    H = sp.csr_array(problem.H)
    return H @ inverse @ H.T


def _lumped(problem: Problem, b: np.ndarray) -> LumpedDelassus | GradientDelassus | ConstrainedDelassus:
    free = _unconstrained(problem, b)
    if problem.C is None:
        return free
    return constrained(free, problem, b)


def _unconstrained(problem: Problem, b: np.ndarray) -> LumpedDelassus | GradientDelassus:
    rows, inverse_mass = problem.h_rows, problem.factor.diagonal
    assert inverse_mass is not None
    gradients = gradient_form(rows, inverse_mass, b, lambda: problem.diagonal_blocks)
    if gradients is not None:
        return gradients
    root = np.sqrt(inverse_mass).reshape(-1, problem.velocity_block)
    data = np.ascontiguousarray(rows.data.transpose(0, 2, 1) * root[rows.indices][:, :, None])
    return LumpedDelassus(
        BlockRows(rows.indptr, rows.indices, data, rows.columns), b, problem.diagonal_blocks
    )


def _lumped_is_cheaper(problem: Problem) -> bool:
    """Compare 2 nnz(H) with nnz(W), the latter from the sum of squared column counts (an upper bound).

    With C a product also takes what `ConstrainedDelassus.reaction` reads, and W is full.
    """
    rows = problem.h_rows
    if problem.C is not None:
        size = problem.n * problem.s
        read = 2 * rows.data.size + 2 * problem.C.nnz + problem.saddle.entries
        return size > LARGEST_DENSE_DELASSUS or read <= size**2
    sharing = np.bincount(rows.indices, minlength=rows.columns).astype(float)
    stored = (sharing**2).sum() * problem.s**2
    return bool(2 * rows.data.size <= stored)


def _whitened_is_cheaper(problem: Problem) -> bool:
    """Compare 2 nnz(G), all that a product without W reads, with nnz(W)."""
    rows = problem.whitened
    return bool(2 * rows.data.size <= rows.product_blocks * rows.s**2)


def _dense(problem: Problem, b: np.ndarray) -> StoredDelassus:
    size = problem.n * problem.s
    if size > LARGEST_DENSE_DELASSUS:
        raise InputError("operator", "explicit", f"'matrix-free': W would be dense with {size} rows")
    H = sp.csr_array(problem.H)
    W = H @ _velocity(problem, H.T.toarray(), homogeneous=True)
    return StoredDelassus(block_rows(0.5 * (W + W.T), problem.s, problem.s), b)
