"""The linear systems of the interior point, dense or sparse, in force or in velocity space.

Equilibrated unknowns: W' = root W root with root = sqrt(rho). Both forms answer W' dr + N Theta dr = g.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import lapack

from barchan.errors import InputError
from barchan.friction import _barrier
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.linalg.factor import sparse_solver

SYSTEMS = ("auto", "forces", "velocities")
LARGEST_DENSE = 300
LARGEST_STORED = 1500
DENSE_FILL = 0.2
REFINEMENTS = 2
LARGEST_ENTRY = 1e6


class Blocks(NamedTuple):
    """The cone blocks of an iteration: shape table (n, 5), state, scaling, Theta (n, s, s) and N (n, s, s) of `_barrier`."""

    shape: np.ndarray
    state: tuple[np.ndarray, ...]
    scaling: tuple[np.ndarray, ...]
    theta: np.ndarray
    slope: np.ndarray

    def combined(self) -> np.ndarray:
        """N Theta (n, s, s)."""
        return np.einsum("iab,ibc->iac", self.slope, self.theta)


class NewtonSystem(Protocol):
    """`factorise` takes the blocks of this iteration (False: singular); `solve` answers for g (n, s)."""

    def factorise(self, blocks: Blocks) -> bool: ...

    def solve(self, g: np.ndarray) -> np.ndarray: ...


def newton_system(problem: Problem, kind: str) -> NewtonSystem:
    """The cheaper form, or the one asked for.

    Raises
    ------
    InputError : unknown kind, or a form that the problem does not have (W too large to store, no M).
    """
    if kind not in SYSTEMS:
        raise InputError("system", kind, "one of " + ", ".join(SYSTEMS))
    if kind == "velocities" and problem.is_reduced:
        raise InputError("system", kind, "'forces': a reduced problem has no M and H")
    if kind == "auto":
        small = problem.n * problem.s <= LARGEST_STORED
        kind = "forces" if problem.is_reduced or small else "velocities"
    return _ForceSystem(problem) if kind == "forces" else _VelocitySystem(problem)


def block_diagonal(blocks: np.ndarray) -> sp.csr_array:
    """Sparse matrix (n s, n s) of diagonal blocks (n, s, s)."""
    n, s, _ = blocks.shape
    return sp.csr_array(sp.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(n * s, n * s)))


class _ForceSystem:
    """W' + N Theta, dense when small or well filled, else sparse."""

    def __init__(self, problem: Problem) -> None:
        n, s = problem.n, problem.s
        delassus = build_operator(problem, "explicit")
        assert isinstance(delassus, StoredDelassus)
        root = np.sqrt(problem.rho)
        row_of = np.repeat(np.arange(n), np.diff(delassus.rows.indptr))
        data = delassus.rows.data * (root[row_of] * root[delassus.rows.indices])[:, None, None]
        matrix = sp.bsr_array((data, delassus.rows.indices, delassus.rows.indptr), shape=(n * s, n * s))
        self.dense = n * s <= LARGEST_DENSE or data.size > DENSE_FILL * (n * s) ** 2
        self.index = np.arange(n * s).reshape(n, s)
        self.matrix = matrix.toarray() if self.dense else sp.csr_array(matrix)

    def factorise(self, blocks: Blocks) -> bool:
        added = blocks.combined()
        fixed = self.index[blocks.shape[:, _barrier.CONE] == 0.0, 1:].ravel()
        if not np.isfinite(added).all():
            return False
        if self.dense:
            self.system = self.matrix.copy()
            self.system[self.index[:, :, None], self.index[:, None, :]] += added
            self.system[fixed], self.system[:, fixed] = 0.0, 0.0
            self.system[fixed, fixed] = 1.0
            factors, pivots, singular = lapack.dgetrf(self.system)
            self.back = lambda g: lapack.dgetrs(factors, pivots, g)[0]
            return not singular
        keep = np.ones(self.index.size)
        keep[fixed] = 0.0
        mask = sp.diags_array(keep)
        self.system = sp.csr_array(
            mask @ (self.matrix + block_diagonal(added)) @ mask + sp.diags_array(1.0 - keep)
        )
        return self._sparse()

    def _sparse(self) -> bool:
        try:
            self.back = sparse_solver(self.system, "W", positive=False)
        except InputError:
            return False
        return True

    def solve(self, g: np.ndarray) -> np.ndarray:
        rhs = g.reshape(-1)
        x = self.back(rhs)
        for _ in range(REFINEMENTS):
            x = x + self.back(rhs - self.system @ x)
        return np.asarray(x).reshape(g.shape)


class _VelocitySystem:
    """M + H'^T D H' with D = (N Theta)^-1, bordered by C; dr = D (g - H' dv).

    Towards the end of the path Theta or D grows beyond LARGEST_ENTRY and elimination would lose M or dr in rounding: the
    forces then stay in the system, [[M, -H'^T], [H', N Theta]], which costs more and loses nothing.
    """

    def __init__(self, problem: Problem) -> None:
        root = np.repeat(np.sqrt(problem.rho), problem.s)
        self.m = problem.size
        self.border = bordered_mass(problem)
        self.H = sp.csr_array(sp.diags_array(root) @ sp.csr_array(problem.H))

    def factorise(self, blocks: Blocks) -> bool:
        stiffness = blocks.combined()
        if not np.isfinite(stiffness).all():
            return False
        # Tangential forces of blocks without a cone are held at zero, here by a unit stiffness that nothing loads.
        held = blocks.shape[:, _barrier.CONE] == 0.0
        stiffness[held, 1:, 1:] = np.eye(stiffness.shape[1] - 1)
        loaded = np.ones(stiffness.shape[:2])
        loaded[held, 1:] = 0.0
        self.coupling = sp.csr_array(sp.diags_array(loaded.ravel()) @ self.H)
        inverse = _inverse(stiffness)
        self.eliminated = inverse is not None
        if inverse is not None:
            self.D = block_diagonal(inverse)
            self.system = added_in_corner(self.border, self.coupling.T @ (self.D @ self.coupling))
        else:
            pull = sp.csr_array(-self.coupling.T)
            pull.resize(self.border.shape[0], pull.shape[1])
            push = self.coupling.copy()
            push.resize(push.shape[0], self.border.shape[1])
            self.system = sp.csr_array(
                sp.block_array([[self.border, pull], [push, block_diagonal(stiffness)]])
            )
        try:
            self.back = sparse_solver(self.system, "M", positive=False)
        except InputError:
            return False
        return True

    def solve(self, g: np.ndarray) -> np.ndarray:
        load = np.zeros(self.system.shape[0])
        if self.eliminated:
            load[: self.m] = self.coupling.T @ (self.D @ g.reshape(-1))
        else:
            load[self.border.shape[0] :] = g.reshape(-1)
        unknowns = self.back(load)
        for _ in range(REFINEMENTS):
            unknowns = unknowns + self.back(load - self.system @ unknowns)
        if not self.eliminated:
            return np.asarray(unknowns[self.border.shape[0] :]).reshape(g.shape)
        return np.asarray(self.D @ (g.reshape(-1) - self.coupling @ unknowns[: self.m])).reshape(g.shape)


def _inverse(stiffness: np.ndarray) -> np.ndarray | None:
    """Inverse blocks (n, s, s); None where they or the blocks are too large to be eliminated."""
    if np.abs(stiffness).max() > LARGEST_ENTRY:
        return None
    try:
        inverse = np.linalg.inv(stiffness)
    except np.linalg.LinAlgError:
        return None
    return inverse if np.abs(inverse).max() <= LARGEST_ENTRY else None


def bordered_mass(problem: Problem) -> sp.csr_array:
    """M, or [[M, -C^T], [C, 0]] where there are bilateral constraints."""
    if problem.C is None:
        return problem.M
    return sp.csr_array(sp.block_array([[problem.M, -problem.C.T], [problem.C, None]]))


def added_in_corner(border: sp.csr_array, block: sp.sparray) -> sp.csr_array:
    """border plus `block` in its upper left corner."""
    corner = sp.coo_array(block)
    corner.resize(border.shape)
    return sp.csr_array(border + corner)
