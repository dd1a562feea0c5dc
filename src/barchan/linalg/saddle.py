"""Bilateral constraints: the saddle point M v - C^T l = load, C v = k, also where rows of C repeat each other.

A direct factorisation is tried first and proven on a known solution; where it fails, a rank-revealing QR finds independent rows
(seed B 2.3.1 assumes C of full rank). Rows that contradict each other have no solution and are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg.factor import sparse_solver

RANK = 1e-10
PROVEN = 1e-6
CONSISTENT = 1e-8
LARGEST_DENSE = 40_000_000

Solve = Callable[[np.ndarray, np.ndarray], np.ndarray]


def saddle_solver(M: sp.csr_array, C: sp.csr_array, k: np.ndarray) -> Solve:
    """Solver (load, k) -> v of M v = load + C^T l, C v = k.

    Parameters
    ----------
    M : (m, m) symmetric positive definite.  C : (c, m).  k : (c,), for the check only; the solver takes (c,) or (c, q).

    Raises
    ------
    InputError : no v has C v = k; or C has dependent rows and more than LARGEST_DENSE entries.
    """
    gap = np.zeros(0)
    for kept in _row_sets(C):
        velocities = _factored(M, C, kept)
        if velocities is not None:
            gap = np.abs(C @ velocities(np.zeros(M.shape[0]), k) - k)
            if (gap <= CONSISTENT * np.abs(k).max(initial=0.0)).all():
                return velocities
    if not gap.size or not np.isfinite(gap).all():
        raise InputError("C", "matrix too badly conditioned to be factorised with M", "well conditioned")
    worst = int(np.argmax(gap))
    found = f"rows that contradict each other (row {worst} is missed by {gap[worst]:.2g})"
    raise InputError("C, k", found, "consistent: some v has C v = k")


def _row_sets(C: sp.csr_array) -> Iterator[np.ndarray]:
    """All rows, then a largest independent set of them."""
    if C.shape[0] <= C.shape[1]:
        yield np.arange(C.shape[0])
    yield _independent_rows(C)


def _factored(M: sp.csr_array, C: sp.csr_array, kept: np.ndarray) -> Solve | None:
    """Solver with the rows `kept` of C, or None when it does not return velocities known beforehand."""
    size, rows = M.shape[0], C[kept]
    saddle = sp.csr_array(sp.block_array([[M, -rows.T], [rows, None]], format="csr"))
    try:
        direct = sparse_solver(saddle, "C", positive=False)
    except InputError:
        return None

    def velocities(load: np.ndarray, k: np.ndarray) -> np.ndarray:
        return np.asarray(direct(np.concatenate([load, k[kept]]))[:size])

    known = np.cos(np.arange(saddle.shape[0], dtype=float))
    right = saddle @ known
    spread = np.zeros(C.shape[0])
    spread[kept] = right[size:]
    with np.errstate(all="ignore"):
        wrong = np.linalg.norm(velocities(right[:size], spread) - known[:size])
    return velocities if wrong <= PROVEN * np.linalg.norm(known[:size]) else None


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
