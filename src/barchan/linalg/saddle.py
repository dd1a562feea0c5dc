"""Bilateral constraints: the saddle point M v - C^T l = load, C v = k, also where rows of C repeat each other.

A diagonal M is eliminated, which leaves S = C M^-1 C^T (seed B 8.3.3: the system of the pressures). Any other M is factorised
together with C. Both are proven on a known solution; where that fails, independent rows are found by pivots (seed B 2.3.1
assumes C of full rank). Rows that contradict each other have no solution and are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg.factor import LARGEST_SERIAL, positive_solver, sparse_solver

RANK = 1e-10
SQUARED_RANK = 1e-13  # of pivots of S
PROVEN = 1e-6
CONSISTENT = 1e-8
LARGEST_DENSE = 40_000_000

Pair: TypeAlias = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Saddle:
    """The factorised saddle point.

    solve : (load, k) -> (v, l) of M v = load + C^T l, C v = k, for (m,) and (c,) or (m, q) and (c, q); l is zero in rows of C
        that follow from others. Without `schur` l is not proven, only v: where rows repeat it may be off by more than rounding.
    schur : g -> l of C M^-1 C^T l = g, (c,), where M is diagonal; l is zero and g is not read in rows that follow from others.
        None where M and C are factorised together.
    entries : numbers that `schur` reads.
    """

    solve: Callable[[np.ndarray, np.ndarray], Pair]
    schur: Callable[[np.ndarray], np.ndarray] | None = None
    entries: int = 0


def saddle_solver(
    M: sp.csr_array, C: sp.csr_array, k: np.ndarray, inverse_mass: np.ndarray | None = None
) -> Saddle:
    """Factorised saddle point of M (m, m), symmetric positive definite, and C (c, m).

    k : (c,), for the check only.  inverse_mass : (m,) diagonal of M^-1 where M is diagonal.

    Raises
    ------
    InputError : no v has C v = k; or C has dependent rows and more than LARGEST_DENSE entries.
    """
    gap = np.zeros(0)
    for saddle in _candidates(M, C, inverse_mass):
        if saddle is not None:
            gap = np.abs(C @ saddle.solve(np.zeros(M.shape[0]), k)[0] - k)
            if (gap <= CONSISTENT * np.abs(k).max(initial=0.0)).all():
                return saddle
    if not gap.size or not np.isfinite(gap).all():
        raise InputError("C", "matrix too badly conditioned to be factorised with M", "well conditioned")
    worst = int(np.argmax(gap))
    found = f"rows that contradict each other (row {worst} is missed by {gap[worst]:.2g})"
    raise InputError("C, k", found, "consistent: some v has C v = k")


def _candidates(M: sp.csr_array, C: sp.csr_array, inverse_mass: np.ndarray | None) -> Iterator[Saddle | None]:
    """By S, with all rows and then with independent ones; by M and C together, the same."""
    everything = np.arange(C.shape[0])
    if inverse_mass is not None:
        S = sp.csr_array(C @ (sp.diags_array(inverse_mass) @ C.T))
        if C.shape[0] <= C.shape[1]:
            yield _eliminated(inverse_mass, C, S, everything)
        if S.shape[0] ** 2 <= LARGEST_DENSE:
            yield _eliminated(inverse_mass, C, S, _rows_of_pivots(S))
    if C.shape[0] <= C.shape[1]:
        yield _factored(M, C, everything)
    yield _factored(M, C, _independent_rows(C))


def _eliminated(
    inverse_mass: np.ndarray, C: sp.csr_array, S: sp.csr_array, kept: np.ndarray
) -> Saddle | None:
    """Saddle point of a diagonal M by the rows `kept` of S, or None where it misses a solution known beforehand."""
    whole = len(kept) == S.shape[0]
    try:
        factor = positive_solver(S if whole else sp.csr_array(S[kept][:, kept]), "C", LARGEST_SERIAL)
    except InputError:
        return None
    transpose = sp.csr_array(C.T)

    def schur(g: np.ndarray) -> np.ndarray:
        if whole:
            return np.asarray(factor.solve(g))
        multipliers = np.zeros_like(g)
        multipliers[kept] = factor.solve(g[kept])
        return multipliers

    def solve(load: np.ndarray, k: np.ndarray) -> Pair:
        velocities = (load.T * inverse_mass).T
        multipliers = np.zeros((C.shape[0], *load.shape[1:]))
        for _ in range(2):  # the second time against rounding in the constraints
            change = schur(k - C @ velocities)
            multipliers += change
            velocities = ((load + transpose @ multipliers).T * inverse_mass).T
        return velocities, multipliers

    saddle = Saddle(solve, schur, factor.entries)
    return saddle if _is_proven(saddle, sp.diags_array(1.0 / inverse_mass), C, kept) else None


def _factored(M: sp.csr_array, C: sp.csr_array, kept: np.ndarray) -> Saddle | None:
    """Saddle point by the rows `kept` of C, or None when it does not return velocities known beforehand."""
    size, rows = M.shape[0], C[kept]
    saddle = sp.csr_array(sp.block_array([[M, -rows.T], [rows, None]], format="csr"))
    try:
        direct = sparse_solver(saddle, "C", positive=False)
    except InputError:
        return None

    def solve(load: np.ndarray, k: np.ndarray) -> Pair:
        unknowns = np.asarray(direct(np.concatenate([load, k[kept]])))
        multipliers = np.zeros((C.shape[0], *load.shape[1:]))
        multipliers[kept] = unknowns[size:]
        return unknowns[:size], multipliers

    found = Saddle(solve)
    return found if _is_proven(found, M, C, kept, only_velocities=True) else None


def _is_proven(
    saddle: Saddle, M: sp.sparray, C: sp.csr_array, kept: np.ndarray, only_velocities: bool = False
) -> bool:
    """Whether velocities cos(i) / sqrt(M_ii), and multipliers cos(m + i) in the rows `kept`, are found from what they balance.

    Multipliers tell a singular S, whose pivots may be positive by rounding. Both are measured as the inertia does: grains as
    light as dust beside a heavy fluid, 1e12 apart, would else hide behind each other.
    """
    weight = np.sqrt(M.diagonal())
    velocities = np.cos(np.arange(M.shape[0], dtype=float)) / weight
    multipliers = np.zeros(C.shape[0])
    multipliers[kept] = np.cos(M.shape[0] + np.arange(len(kept), dtype=float))
    pushed = float(np.linalg.norm((C.T @ multipliers) / weight))
    multipliers *= float(np.linalg.norm((M @ velocities) / weight)) / max(pushed, 1e-300)
    with np.errstate(all="ignore"):
        found, pressed = saddle.solve(M @ velocities - C.T @ multipliers, C @ velocities)
        wrong = np.linalg.norm(weight * (found - velocities)) / np.linalg.norm(weight * velocities)
        if not only_velocities and len(kept):
            wrong = max(wrong, np.linalg.norm(pressed - multipliers) / np.linalg.norm(multipliers))
    return bool(wrong <= PROVEN)


def _rows_of_pivots(S: sp.csr_array) -> np.ndarray:
    """Increasing numbers of a largest independent set of rows of C, by Cholesky's pivots in the equilibrated S = C M^-1 C^T."""
    diagonal = S.diagonal()
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    dense = scale[:, None] * S.toarray() * scale
    _, order, rank, _ = sl.lapack.dpstrf(dense, tol=SQUARED_RANK, lower=1)
    return np.sort(order[:rank] - 1)


def _independent_rows(C: sp.csr_array) -> np.ndarray:
    """Increasing numbers of a largest independent set of rows."""
    if C.shape[0] * C.shape[1] > LARGEST_DENSE:
        raise InputError(
            "C", f"matrix of shape {C.shape} with dependent rows", "of full row rank at this size"
        )
    dense = C.toarray()
    size = np.linalg.norm(dense, axis=1)
    dense /= np.where(size > 0.0, size, 1.0)[:, None]
    triangle, order = sl.qr(dense.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > RANK * diagonal.max(initial=0.0)).sum())
    return np.sort(order[:rank])
