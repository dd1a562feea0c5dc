"""Whether a problem has a solution: criterion H(0) of Cadoux, and a proof of infeasibility where no motion avoids penetration.

H(0): some v with C v = k has H v + w strictly inside every dual cone (seed B 2.3.2, Theorem 2.1); one conic program.
It suffices for every law here: a yield adds a finite convex potential, dilatancy only shrinks the shift s(u) >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from barchan.cones import SecondOrderCone
from barchan.friction.conic import NONNEGATIVE, ZERO, ConicProgram, force_cones, opening_cones
from barchan.friction.problem import Problem

EXISTS, NONE, UNDECIDED = "exists", "none", "undecided"
SMALLEST_MARGIN = 1e-6
SMALLEST_REACH = 1e6
SMALLEST_DECREASE = 1e-9
CONSTRAINT_TOLERANCE = 1e-9
LARGEST_REDUCED = 6000
RANK = 1e-6
PENALTY = 1e-3
POLISH = 4
LARGEST_DENSE, ROUND_OFF = 4_000_000, 1e-10


@dataclass(frozen=True, eq=False)
class Existence:
    """Verdict "exists", "none" or "undecided", and its proof, checked in the user's data by code that no program shares.

    exists : `opening` (n s,) are rates u of some motion (reduced: of some r) strictly inside the dual cones; `margin` is the
        smallest distance of a u_i from the boundary over the largest |u_i| (blocks scaled by sqrt(rho_i)).
    none : `blame` (n s,) are forces y_i with |y_T| <= dilatancy y_N and, with multipliers `blame_bilateral` (c,),
        H^T y + C^T z = 0 and y.w - z.k < 0 (reduced: W^T y = 0, y.b < 0), whereas a solution has u_N >= dilatancy |u_T| and
        thus y.u >= 0. `reach`: a solution would have to be at least so many times larger than the data, where round-off ends.
    undecided : neither was found; the problem lies at the border, or is larger than LARGEST_REDUCED rows in reduced form.
    """

    verdict: str
    margin: float = 0.0
    reach: float = 0.0
    opening: np.ndarray | None = None
    blame: np.ndarray | None = None
    blame_bilateral: np.ndarray | None = None

    def __str__(self) -> str:
        if self.verdict == EXISTS:
            return f"a solution exists: criterion H(0) holds with relative margin {self.margin:.1e}"
        if self.verdict == NONE:
            assert self.blame is not None
            count = int(np.count_nonzero(self.blame))
            return (
                f"no solution exists: contact forces ({count} components) that do no work on any motion would have "
                f"to do negative work (but for motions {self.reach:.0e} times larger than the data)"
            )
        return "undecided: neither criterion H(0) nor a proof of infeasibility was found"


@dataclass(frozen=True, eq=False)
class _Motions:
    """Rates u = K y + w over C y = k, every block scaled by sqrt(rho_i), `unit` (the size of w, or 1) taken out.

    P : (N, N) penalty of y.  Full: y = v sqrt(M_jj).  Reduced: y = r / sqrt(rho_i), K = W, and directions in which W is
    singular up to the round-off of stored data cost so much that they are not used.
    """

    K: sp.csr_array
    w: np.ndarray
    C: sp.csr_array
    k: np.ndarray
    P: sp.csr_array
    unit: float


def existence_of(problem: Problem) -> Existence:
    """`existence`, asked once for a problem and kept with it."""
    verdict: Existence = problem.prepared("existence", lambda: existence(problem))
    return verdict


def existence(problem: Problem) -> Existence:
    """Decide whether a problem has a solution; the cost is that of one or two conic programs of its size."""
    if problem.n == 0:
        return Existence(EXISTS, margin=1.0, opening=np.zeros(0))
    motions = _motions(problem)
    opening = _opening(problem, motions)
    if opening is not None:
        return opening
    if _rests_exactly(problem):
        return Existence(EXISTS, opening=(problem.b if problem.is_reduced else problem.w).copy())
    return _infeasibility(problem, motions) or Existence(UNDECIDED)


def _motions(problem: Problem) -> _Motions:
    rows = sp.diags_array(np.repeat(np.sqrt(problem.rho), problem.s))
    if problem.is_reduced:
        K = sp.csr_array(rows @ sp.csr_array(problem.W) @ rows)
        w = rows @ problem.b
        largest = float(np.max(abs(K).sum(axis=1)))
        noise = 10.0 * RANK * largest * sp.eye_array(len(w))
        P = (0.5 * (K + K.T) + noise) / max(largest, np.finfo(float).tiny)
        C, k = sp.csr_array((0, len(w))), np.zeros(0)
    else:
        scale = sp.diags_array(1.0 / np.sqrt(problem.M.diagonal()))
        K, w = sp.csr_array(rows @ sp.csr_array(problem.H) @ scale), rows @ problem.w
        P = sp.eye_array(problem.size)
        bilateral = problem.C is not None
        C = sp.csr_array(problem.C @ scale) if bilateral else sp.csr_array((0, problem.size))
        k = problem.k if bilateral else np.zeros(0)
    unit = float(max(np.abs(w).max(initial=0.0), np.abs(k).max(initial=0.0))) or 1.0
    return _Motions(K, w / unit, C, k / unit, sp.csr_array(P * (PENALTY / K.shape[1])), unit)


def _opening(problem: Problem, motions: _Motions) -> Existence | None:
    """Maximise t <= 1 with u - t e_N in the dual cones, then measure the margin of the motion found."""
    mu, s = problem.parameters[:, 0], problem.s
    width = motions.K.shape[1]
    program = ConicProgram(
        sp.block_diag([motions.P, sp.csr_array((1, 1))]), np.append(np.zeros(width), -1.0), s
    )
    if len(motions.k):
        program.require(ZERO, sp.hstack([motions.C, sp.csr_array((len(motions.k), 1))]), -motions.k)
    normal = np.tile(np.eye(1, s)[0], problem.n)
    for group in opening_cones(mu, s):
        lift = sp.csr_array(-(group.select @ normal)[:, None])
        program.require(group.kind, sp.hstack([group.select @ motions.K, lift]), group.select @ motions.w)
    program.require(NONNEGATIVE, sp.csr_array(([-1.0], ([0], [width])), shape=(1, width + 1)), np.ones(1))
    answer = program.solve(1e-8)
    if not answer.usable:
        return None
    y = answer.x[:width]
    y = y + _least(motions.C, motions.k - motions.C @ y)
    gap = float(np.linalg.norm(motions.C @ y - motions.k))
    if gap > CONSTRAINT_TOLERANCE * max(float(np.linalg.norm(motions.k)), float(np.linalg.norm(y))):
        return None
    u = (motions.K @ y + motions.w).reshape(problem.n, s)
    clear = (u[:, 0] - mu * np.linalg.norm(u[:, 1:], axis=1)) / np.hypot(1.0, mu)
    largest = float(np.linalg.norm(u, axis=1).max())
    if largest == 0.0 or not clear.min() >= SMALLEST_MARGIN * largest:
        return None
    rates = motions.unit * u / np.sqrt(problem.rho)[:, None]
    return Existence(EXISTS, margin=float(clear.min() / largest), opening=rates.reshape(-1))


def _rests_exactly(problem: Problem) -> bool:
    """Whether v = 0 (r = 0) meets cones that all are polyhedral: linear constraints need no interior (Theorem A.6)."""
    mu = problem.parameters[:, 0]
    if problem.s > 2 and (mu > 0.0).any():
        return False
    w = (problem.b if problem.is_reduced else problem.w).reshape(problem.n, problem.s)
    at_rest = problem.C is None or not np.any(problem.k)
    return bool(at_rest and (w[:, 0] >= mu * np.linalg.norm(w[:, 1:], axis=1)).all())


def _infeasibility(problem: Problem, motions: _Motions) -> Existence | None:
    """Minimise y.w - z.k over y in the cones of slope `dilatancy`, K^T y + C^T z = 0, sum of y_N <= 1; polish and check."""
    size, s = problem.n * problem.s, problem.s
    if problem.is_reduced and size > LARGEST_REDUCED:
        return None
    bilateral = len(motions.k)
    if problem.is_reduced:
        equations = sp.csr_array(_range_of(motions.K).T)
    else:
        equations = sp.csr_array(sp.hstack([motions.K.T, motions.C.T]))
    law = np.zeros((problem.n, 4))
    law[:, 0] = problem.parameters[:, 3]
    program = ConicProgram(
        sp.csr_array((size + bilateral, size + bilateral)), np.concatenate([motions.w, -motions.k]), s
    )
    program.require(ZERO, equations, np.zeros(equations.shape[0]))
    for group in force_cones(law, s):
        beside = sp.csr_array((group.select.shape[0], bilateral))
        program.require(group.kind, sp.hstack([group.select, beside]), group.offset)
    total = np.concatenate([np.tile(np.eye(1, s)[0], problem.n), np.zeros(bilateral)])
    program.require(NONNEGATIVE, sp.csr_array(-total[None, :]), np.ones(1))
    answer = program.solve(1e-10)
    if not answer.usable:
        return None
    y, z = _polished(answer.x, equations, law[:, 0], s)
    return _judged(problem, motions, y, z)


def _range_of(K: sp.csr_array) -> np.ndarray:
    """(n s, rank) orthonormal basis of the range of K, by singular values above RANK of the largest."""
    left, values, _ = np.linalg.svd(K.toarray())
    return np.asarray(left[:, : int((values > RANK * values.max(initial=0.0)).sum())])


def _polished(
    x: np.ndarray, equations: sp.csr_array, slope: np.ndarray, s: int
) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers (y, z) with the small entries removed and the equations met to round-off, y in its cones."""
    n = len(slope)
    cone = SecondOrderCone(slope)
    y, z = x[: n * s].copy(), x[n * s :].copy()
    carries = y[::s] > 1e-6 * np.maximum(y[::s].max(), 0.0)
    used = np.repeat(carries, s)
    used &= np.tile(np.arange(s) == 0, n) | np.repeat(slope > 0.0, s)
    columns = np.flatnonzero(np.concatenate([used, np.ones(len(z), dtype=bool)]))
    A = sp.csc_array(equations)[:, columns]
    for _ in range(POLISH):
        y = cone.project(np.where(used, y, 0.0), s)
        values = np.concatenate([y, z])[columns]
        both = np.zeros(len(x))
        both[columns] = values - _least(A, A @ values)
        y, z = both[: n * s], both[n * s :]
    return cone.project(y, s), z


def _judged(problem: Problem, motions: _Motions, y: np.ndarray, z: np.ndarray) -> Existence | None:
    """The proof, if it holds beyond round-off: y in the cones exactly, so any solution x has slope.x >= decrease > 0."""
    decrease = float(motions.k @ z - motions.w @ y)
    terms = float(np.abs(motions.w * y).sum() + np.abs(motions.k * z).sum())
    if not decrease > SMALLEST_DECREASE * max(terms, float(np.linalg.norm(y)) * _size(motions.w)):
        return None
    slope = float(np.linalg.norm(motions.K.T @ y + motions.C.T @ z))
    slope = max(slope, float(np.finfo(float).eps * np.linalg.norm(abs(motions.K).T @ np.abs(y))))
    data = data_size(problem) / motions.unit
    reach = decrease / max(slope * data, np.finfo(float).eps * decrease)
    if reach < SMALLEST_REACH:
        return None
    blame = (y.reshape(problem.n, problem.s) * np.sqrt(problem.rho)[:, None]).reshape(-1)
    return Existence(NONE, reach=reach, blame=blame, blame_bilateral=z)


def data_size(problem: Problem) -> float:
    """Norm of the data in the unit of the unknowns: of M^-1 f (scaled by sqrt(M_jj)) and w, or of b."""
    root = np.repeat(np.sqrt(problem.rho), problem.s)
    if problem.is_reduced:
        return float(np.linalg.norm(root * problem.b))
    free = np.sqrt(problem.M.diagonal()) * problem.factor.solve(problem.f)
    return max(_size(free), _size(root * problem.w), _size(problem.k))


def _size(vector: np.ndarray | None) -> float:
    return 0.0 if vector is None else float(np.linalg.norm(vector))


def _least(A: sp.sparray, right: np.ndarray) -> np.ndarray:
    """Least-norm solution d of A d = right in the least-squares sense; nearly singular directions are left alone."""
    if A.shape[0] == 0 or A.shape[1] == 0 or not right.any():
        return np.zeros(A.shape[1])
    if A.shape[0] * A.shape[1] <= LARGEST_DENSE:
        return np.asarray(np.linalg.lstsq(A.toarray(), right, rcond=ROUND_OFF)[0])
    limit = 10 * sum(A.shape) + 100
    return np.asarray(spla.lsqr(A, right, atol=1e-15, btol=1e-15, conlim=1.0 / ROUND_OFF, iter_lim=limit)[0])
