"""The proof that (v, r) solves a problem, computed afresh by code that no solver shares (DESIGN: certificate).

law = |r - P(r - rho (u + s(u)))| / max(|r|, r_ref) with rho_i = s / Tr(W_ii); balance and bilateral are relative residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from barchan.errors import InputError
from barchan.friction.problem import Problem
from barchan.linalg import transposed_product

SMALLEST_REFERENCE = 1e-14


@dataclass(frozen=True)
class Certificate:
    """Relative residuals of a solution; `residual` is the largest.

    law : natural map of the friction law.  balance : M v = f + H^T r + C^T l.  bilateral : C v = k.
    """

    law: float
    balance: float
    bilateral: float

    @property
    def residual(self) -> float:
        """The largest of the three (NaN counts as infinite)."""
        worst = max(self.law, self.balance, self.bilateral)
        return float("inf") if np.isnan([self.law, self.balance, self.bilateral]).any() else worst


def certify(
    problem: Problem, r: np.ndarray, v: np.ndarray | None = None, multipliers: np.ndarray | None = None
) -> Certificate:
    """Certificate of a solution.

    Parameters
    ----------
    r : (n s,) or (n, s) forces.
    v : (m,) velocities; None takes those that balance r (ignored in reduced form).
    multipliers : (c,) of C v = k; None takes those that balance best (least squares, which costs more than a check).

    Raises
    ------
    InputError : r, v or multipliers of the wrong size.
    """
    r = np.asarray(r, dtype=float).reshape(-1)
    if len(r) != problem.n * problem.s:
        raise InputError("r", f"array of length {len(r)}", f"of length {problem.n * problem.s}")
    if problem.is_reduced:
        return Certificate(_law_residual(problem, r, problem.W @ r + problem.b), 0.0, 0.0)
    if v is None:
        v, multipliers = balanced(problem, r)
    v = np.asarray(v, dtype=float)
    if v.shape != (problem.size,):
        raise InputError("v", f"array of shape {v.shape}", f"of shape ({problem.size},)")
    count = 0 if problem.C is None else problem.C.shape[0]
    if multipliers is not None and np.shape(multipliers) != (count,):
        raise InputError("multipliers", f"array of shape {np.shape(multipliers)}", f"of shape ({count},)")
    law = _law_residual(problem, r, problem.H @ v + problem.w)
    balance = _balance_residual(problem, r, v, multipliers)
    return Certificate(law, balance, _bilateral_residual(problem, v))


def _law_residual(problem: Problem, r: np.ndarray, u: np.ndarray) -> float:
    if problem.n == 0:
        return 0.0
    blocks = r.reshape(problem.n, problem.s)
    rates = u.reshape(problem.n, problem.s)
    step = problem.rho[:, None]
    shifted = rates + problem.law.shift(rates)
    violation = np.linalg.norm(blocks - problem.law.project(blocks - step * shifted))
    floor = SMALLEST_REFERENCE * float(np.linalg.norm(step * rates))
    reference = max(float(np.linalg.norm(blocks)), problem.reference_force, floor)
    return float(violation / reference) if violation > 0.0 else 0.0


def _balance_residual(
    problem: Problem, r: np.ndarray, v: np.ndarray, multipliers: np.ndarray | None
) -> float:
    pull = transposed_product(problem.H, r)
    gap = problem.M @ v - problem.f - pull
    if problem.C is not None:
        gap = gap - problem.C.T @ (_multiplier(problem.C, gap) if multipliers is None else multipliers)
    scale = float(max(np.linalg.norm(problem.f), np.linalg.norm(pull)))
    size = float(np.linalg.norm(gap))
    return size / scale if scale > 0.0 else (0.0 if size == 0.0 else float("inf"))


def _bilateral_residual(problem: Problem, v: np.ndarray) -> float:
    if problem.C is None:
        return 0.0
    size = float(np.linalg.norm(problem.C @ v - problem.k))
    scale = float(max(np.linalg.norm(problem.k), np.linalg.norm(v)))
    return size / scale if scale > 0.0 else (0.0 if size == 0.0 else float("inf"))


def _multiplier(C: sp.csr_array, gap: np.ndarray) -> np.ndarray:
    """Least-squares multiplier l of C^T l = gap (the certificate asks for some l)."""
    return np.asarray(spla.lsqr(C.T, gap, atol=1e-15, btol=1e-15, iter_lim=10 * C.shape[0] + 100)[0])


def balanced(problem: Problem, r: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Velocities (m,) that satisfy balance and bilateral rows exactly for given forces r (n s,), and the multipliers (c,)."""
    load = problem.f + transposed_product(problem.H, r)
    if problem.C is None:
        return np.asarray(problem.factor.solve(load)), None
    v, multipliers = problem.saddle.solve(load, problem.k)
    if problem.saddle.schur is None:
        multipliers = _multiplier(problem.C, problem.M @ v - load)
    return v, multipliers
