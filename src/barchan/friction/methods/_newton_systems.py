"""The linear systems of the interior point, dense or sparse, in force or in velocity space.

Equilibrated unknowns: W' = root W root with root = sqrt(rho). Both forms answer W' dr + N Theta dr = g.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

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
SOFTENING = 1e-9


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
            factors = la.lu_factor(self.system, check_finite=False)
            self.back = lambda g: la.lu_solve(factors, g, check_finite=False)
            return True
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
    """M + H'^T D H' with D = (N Theta + delta I)^-1, bordered by C; dr = D (g - H' dv).

    delta keeps the compliance D of sticking blocks finite; the refinement of `solve` takes it out again.
    """

    def __init__(self, problem: Problem) -> None:
        root = np.repeat(np.sqrt(problem.rho), problem.s)
        self.m = problem.size
        saddle = None if problem.C is None else sp.block_array([[problem.M, -problem.C.T], [problem.C, None]])
        self.border = sp.csr_array(problem.M if saddle is None else saddle)
        self.H = sp.csr_array(sp.diags_array(root) @ sp.csr_array(problem.H))

    def factorise(self, blocks: Blocks) -> bool:
        stiffness = blocks.combined()
        held = blocks.shape[:, _barrier.CONE] == 0.0
        try:
            inverse = np.linalg.inv(stiffness + SOFTENING * np.eye(stiffness.shape[1]))
        except np.linalg.LinAlgError:
            return False
        if not np.isfinite(inverse).all():
            return False
        inverse[held, 1:, 1:] = 0.0
        self.D, self.stiffness = block_diagonal(inverse), block_diagonal(stiffness)
        added = sp.coo_array(self.H.T @ (self.D @ self.H))
        added.resize(self.border.shape)
        try:
            self.back = sparse_solver(sp.csr_array(self.border + added), "M", positive=False)
        except InputError:
            return False
        return True

    def solve(self, g: np.ndarray) -> np.ndarray:
        """Refined as the pair (dv, dr) of M dv = H'^T dr + C^T dl, H' dv + N Theta dr = g: dv alone would lose digits of dr."""
        rhs = g.reshape(-1)
        dr, unknowns = np.zeros_like(rhs), np.zeros(self.border.shape[0])
        for _ in range(REFINEMENTS + 1):
            miss = rhs - self.H @ unknowns[: self.m] - self.stiffness @ dr
            load = -(self.border @ unknowns)
            load[: self.m] += self.H.T @ (dr + self.D @ miss)
            step = self.back(load)
            unknowns = unknowns + step
            dr = dr + self.D @ (miss - self.H @ step[: self.m])
        return np.asarray(dr).reshape(g.shape)
