"""Equilibrated data of the primal problem, for methods that iterate on velocities (seed B 3.3.3).

M v = f + H^T x + C^T l, C v = k, u = H v + w with unit diagonal of M, unit rows of C, and forces as in `_scaled`. A reduced
problem gets M = I, f = 0 and H = L with L L^T = (W + W^T) / 2, by eigenvectors: v then has as many entries as W has rank.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction.methods._norms import eigenvalue_bound
from barchan.friction.operators import LARGEST_DENSE_DELASSUS
from barchan.friction.problem import Problem
from barchan.linalg import factorise
from barchan.linalg.factor import sparse_solver

ROUND_OFF = 1e-12
Solver = Callable[[np.ndarray], np.ndarray]


class PrimalOperators:
    """What does not depend on law, w and b: `M` (m, m), `H` (n s, m) sparse or dense, `C` (c, m) or None; factors kept.

    `velocity_scale` (m,) and `row_scale` (c,) are the scalings of velocities and of the rows of C.
    `exact` : H M^-1 H^T is the scaled W up to rounding (False for a W with noise: not symmetric, or not semi-definite).
    """

    def __init__(self, problem: Problem) -> None:
        self.root = np.repeat(np.sqrt(problem.rho), problem.s)
        self.C: sp.csr_array | None = None
        self.exact = True
        self.squares: np.ndarray | None = None
        if problem.is_reduced:
            self._decompose(problem)
        else:
            self._equilibrate(problem)
        self._solvers: dict[tuple[float, float, bool], Solver] = {}

    def _equilibrate(self, problem: Problem) -> None:
        self.velocity_scale = 1.0 / np.sqrt(problem.M.diagonal())
        scale = sp.diags_array(self.velocity_scale)
        self.M = sp.csr_array(scale @ problem.M @ scale)
        self.H = sp.csr_array(sp.diags_array(self.root) @ sp.csr_array(problem.H) @ scale)
        if problem.C is not None:
            rows = sp.csr_array(problem.C @ scale)
            length = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).ravel())
            self.row_scale = 1.0 / np.where(length > 0.0, length, 1.0)
            self.C = sp.csr_array(sp.diags_array(self.row_scale) @ rows)

    def _decompose(self, problem: Problem) -> None:
        rows = problem.n * problem.s
        if rows > LARGEST_DENSE_DELASSUS:
            raise InputError(
                "W",
                f"matrix with {rows} rows",
                f"at most {LARGEST_DENSE_DELASSUS} rows for methods on velocities",
            )
        W = self.root[:, None] * problem.W.toarray() * self.root
        values, vectors = np.linalg.eigh(0.5 * (W + W.T))
        kept = values > max(ROUND_OFF * values[-1], -values[0])
        kept[-1] = True
        self.squares = np.maximum(values[kept], 0.0)
        self.H = np.ascontiguousarray(vectors[:, kept] * np.sqrt(self.squares))
        self.M = sp.eye_array(len(self.squares), format="csr")
        self.velocity_scale = np.ones(len(self.squares))
        self.exact = bool(np.linalg.norm(W - self.H @ self.H.T) <= ROUND_OFF * np.linalg.norm(W))

    def solver(self, beta: float = 0.0, gamma: float = 0.0, constrained: bool = False) -> Solver:
        """Solver of (M + beta I + gamma H^T H) v = load [+ C^T l, C v = k]; takes load (m,), or (m + c,) with k below.

        Factorised once per (beta, gamma, constrained).
        """
        key = (beta, gamma, constrained)
        if key not in self._solvers:
            self._solvers[key] = self._factorise(beta, gamma, constrained and self.C is not None)
        return self._solvers[key]

    def _factorise(self, beta: float, gamma: float, constrained: bool) -> Solver:
        if self.squares is not None:
            inverse = 1.0 / (1.0 + beta + gamma * self.squares)
            return lambda load: inverse * load
        m = self.M.shape[0]
        matrix = sp.csr_array(self.M + beta * sp.eye_array(m))
        if gamma > 0.0:
            matrix = sp.csr_array(matrix + gamma * (self.H.T @ self.H))
        if not constrained:
            return factorise(matrix).solve
        assert self.C is not None
        saddle = sparse_solver(
            sp.block_array([[matrix, -self.C.T], [self.C, None]], format="csr"), "C", False
        )
        return lambda load: np.asarray(saddle(load)[:m])

    @cached_property
    def mass_bound(self) -> float:
        """Upper bound of the largest eigenvalue of M."""
        return eigenvalue_bound(lambda v: self.M @ v, (self.M.shape[0],))

    @cached_property
    def coupling_bound(self) -> float:
        """Upper bound of |[H; C]|^2 (1 when both vanish)."""

        def product(v: np.ndarray) -> np.ndarray:
            image = self.H.T @ (self.H @ v)
            return image if self.C is None else image + self.C.T @ (self.C @ v)

        bound = eigenvalue_bound(product, (self.M.shape[0],))
        return bound if bound > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class PrimalData:
    """Operators with the data of one problem: `f` (m,), `w` (n s,), `k` (c,), all equilibrated."""

    operators: PrimalOperators
    f: np.ndarray
    w: np.ndarray
    k: np.ndarray


def primal_data(problem: Problem) -> PrimalData:
    """Primal data of a problem, made once; operators shared by its variants.

    Raises
    ------
    InputError : reduced problem with more than LARGEST_DENSE_DELASSUS rows (its W would be decomposed densely).
    """
    operators: PrimalOperators = problem.origin.prepared(
        "primal operators", lambda: PrimalOperators(problem.origin)
    )
    if problem.is_reduced:
        return PrimalData(
            operators, np.zeros(len(operators.velocity_scale)), operators.root * problem.b, np.zeros(0)
        )
    k = operators.row_scale * problem.k if operators.C is not None else np.zeros(0)
    return PrimalData(operators, operators.velocity_scale * problem.f, operators.root * problem.w, k)
