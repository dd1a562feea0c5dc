"""Linear complementarity problems 0 <= z, M z + q >= 0, z . (M z + q) = 0 by Lemke's pivoting, dense and compiled.

The direct method that seed B 3.1.1 names for the faceted friction cone (Klarbring 1987). Ties of the ratio test are broken
lexicographically, so that no basis comes twice: faceted friction is degenerate in every block.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from barchan.errors import InputError

SOLVED, RAY, LIMIT = "solved", "ray", "pivot limit"
_SOLVED, _RAY, _LIMIT = 0, 1, 2
_STATUS = {_SOLVED: SOLVED, _RAY: RAY, _LIMIT: LIMIT}
LARGEST_LCP = 3000
PIVOTS_PER_ROW = 20
SMALLEST_PIVOT = 1e-10
TIE = 1e-12


class LcpResult(NamedTuple):
    """z : (N,) the solution, zero when none was found.  status : "solved", "ray" or "pivot limit".  pivots : their number."""

    z: np.ndarray
    status: str
    pivots: int


def solve_lcp(M: Any, q: Any, max_pivots: int | None = None) -> LcpResult:
    """Find z >= 0 with w = M z + q >= 0 and z . w = 0.

    Lemke's path starts on the ray of the artificial variable z0 (covering vector of ones) and ends in a solution or on a
    second ray. For a copositive M (z . M z >= 0 for all z >= 0) a ray implies some z >= 0 with M z >= 0, z . M z = 0 and
    q . z < 0; if M is moreover copositive-plus, that means that no solution exists.

    Parameters
    ----------
    M : (N, N) matrix.  q : (N,).  max_pivots : None for PIVOTS_PER_ROW N.  Memory 8 N^2 bytes, cost of a pivot O(N^2).

    Raises
    ------
    InputError : sizes that do not fit, numbers that are not finite, N above LARGEST_LCP.
    """
    M, q = np.asarray(M, dtype=float), np.asarray(q, dtype=float)
    if q.ndim != 1 or M.shape != (len(q), len(q)):
        raise InputError("M, q", f"arrays of shapes {M.shape} and {q.shape}", "of shapes (N, N) and (N,)")
    if not (np.isfinite(M).all() and np.isfinite(q).all()):
        raise InputError("M, q", "arrays with NaN or infinite entries", "finite")
    require_lcp_size(len(q))
    size = len(q)
    if size == 0 or q.min() >= 0.0:
        return LcpResult(np.zeros(size), SOLVED, 0)
    limit = PIVOTS_PER_ROW * size if max_pivots is None else max_pivots
    if limit < 1:
        return LcpResult(np.zeros(size), LIMIT, 0)
    # In units that make the largest entries of M and q 1.
    stiffness, scale = float(np.abs(M).max()) or 1.0, float(np.abs(q).max())
    table = np.empty((size, size + 2))
    table[:, :size], table[:, size], table[:, size + 1] = M / stiffness, 1.0, q / scale
    basic, beside = np.arange(size), np.arange(size, 2 * size + 1)
    place = np.concatenate([np.arange(size), -1 - np.arange(size + 1)])
    code, pivots = _follow_path(table, basic, beside, place, limit, np.empty(size, dtype=np.int64))
    z = np.zeros(size)
    if code == _SOLVED:
        in_z = basic >= size
        z[basic[in_z] - size] = scale / stiffness * np.maximum(table[in_z, size + 1], 0.0)
        z = _refined(M, q, z, basic[in_z] - size)
    return LcpResult(z, _STATUS[int(code)], int(pivots))


def require_lcp_size(size: int) -> None:
    """InputError when an LCP of `size` rows is too large for dense pivoting."""
    if size > LARGEST_LCP:
        raise InputError("size of the LCP", size, f"at most {LARGEST_LCP} rows (Lemke's method is dense)")


def lcp_residual(M: np.ndarray, q: np.ndarray, z: np.ndarray) -> float:
    """max |min(z, M z + q)|, zero exactly on the solutions; in the unit of q and z (scale them alike)."""
    return float(np.abs(np.minimum(z, M @ z + q)).max(initial=0.0))


def _refined(M: np.ndarray, q: np.ndarray, z: np.ndarray, support: np.ndarray) -> np.ndarray:
    """The same basis solved afresh, which sheds the round-off of the pivots; the better of both."""
    fresh = np.zeros_like(z)
    fresh[support] = np.linalg.lstsq(M[np.ix_(support, support)], -q[support], rcond=None)[0]
    fresh = np.maximum(fresh, 0.0)
    return fresh if lcp_residual(M, q, fresh) < lcp_residual(M, q, z) else z


@njit(cache=True, error_model="numpy")
def _exchange(
    table: np.ndarray, basic: np.ndarray, beside: np.ndarray, place: np.ndarray, row: int, column: int
) -> None:
    """Basic variable of `row` and non-basic variable of `column` change places in the dictionary."""
    size, width = table.shape
    inverse = 1.0 / table[row, column]
    for j in range(width):
        table[row, j] *= -inverse
    table[row, column] = inverse
    for i in range(size):
        factor = table[i, column]
        if i != row and factor != 0.0:
            table[i, column] = 0.0
            for j in range(width):
                table[i, j] += factor * table[row, j]
    out, into = basic[row], beside[column]
    basic[row], beside[column] = into, out
    place[into], place[out] = row, -1 - column


@njit(cache=True, error_model="numpy")
def _perturbation(table: np.ndarray, place: np.ndarray, row: int, k: int) -> float:
    """Coefficient of epsilon^(k + 1) in the basic variable of `row` when q_k is perturbed by epsilon^(k + 1)."""
    if place[k] >= 0:
        return 1.0 if place[k] == row else 0.0
    return -table[row, -1 - place[k]]


@njit(cache=True, error_model="numpy")
def _leaving_row(
    table: np.ndarray, basic: np.ndarray, place: np.ndarray, column: int, ties: np.ndarray
) -> int:
    """Row of the basic variable that first falls to zero as that of `column` grows; -1 when none does."""
    size = len(basic)
    artificial = 2 * size
    best, largest = np.inf, 0.0
    for i in range(size):
        largest = max(largest, abs(table[i, column]))
    threshold = SMALLEST_PIVOT * max(largest, 1.0)
    for i in range(size):
        if table[i, column] < -threshold:
            best = min(best, max(table[i, size + 1], 0.0) / -table[i, column])
    if best == np.inf:
        return -1
    count = 0
    for i in range(size):
        pivot = -table[i, column]
        if pivot > threshold and max(table[i, size + 1], 0.0) / pivot <= best + TIE * (1.0 + best):
            if basic[i] == artificial:
                return i
            ties[count] = i
            count += 1
    for k in range(size):
        if count == 1:
            break
        smallest = np.inf
        for t in range(count):
            value = _perturbation(table, place, ties[t], k) / -table[ties[t], column]
            smallest = min(smallest, value)
        kept = 0
        for t in range(count):
            value = _perturbation(table, place, ties[t], k) / -table[ties[t], column]
            if value <= smallest + SMALLEST_PIVOT * (1.0 + abs(smallest)):
                ties[kept] = ties[t]
                kept += 1
        count = kept
    return ties[0]


@njit(cache=True, error_model="numpy")
def _follow_path(
    table: np.ndarray, basic: np.ndarray, beside: np.ndarray, place: np.ndarray, limit: int, ties: np.ndarray
) -> tuple[int, int]:
    """Lemke's path on the dictionary `basic = table (non-basic, 1)`; variables w_k = k, z_k = N + k, z0 = 2 N.

    `place` tells each variable's row, or -1 - column. Ends with a code and the number of pivots.
    """
    size = len(basic)
    row = 0
    for i in range(size):
        if table[i, size + 1] <= table[row, size + 1]:
            row = i
    left = basic[row]
    _exchange(table, basic, beside, place, row, size)
    for count in range(1, limit):
        entering = left + size if left < size else left - size
        column = -1 - place[entering]
        row = _leaving_row(table, basic, place, column, ties)
        if row < 0:
            return _RAY, count
        left = basic[row]
        _exchange(table, basic, beside, place, row, column)
        if left == 2 * size:
            return _SOLVED, count + 1
    return _LIMIT, limit
