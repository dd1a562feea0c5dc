"""The convexified problem as a second-order cone program, solved by Clarabel's interior point: in forces or in velocities.

Dual (seed B Eq. 2.21): min r^T W r / 2 + b^T r over admissible r. Primal (seed B Eq. 2.24): min v^T M v / 2 - f^T v over
C v = k, H v + w in the dual cones. The quadratic objective goes in as it is: the rotated cones of (3.2)-(3.4) are not needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction._kernels import project_blocks
from barchan.friction.conic import (
    SECOND_ORDER,
    TIGHTEST,
    ZERO,
    ConicProgram,
    force_cones,
    opening_cones,
    tangent_cones,
)
from barchan.friction.operators import build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 400
FIRST_TOLERANCE = 1e-5
TIGHTEN = 1e-3
RANK = 1e-14
MAX_PROGRAMS, PATIENCE = 12, 2


def clarabel_dual(
    problem: Problem, recorder: Recorder, r0: np.ndarray, max_iterations: int | None = None
) -> None:
    """Solve the dual program (2.21) for the forces; the law must be associated (dilatancy = mu).

    Interior points take no start: `r0` (n, s) is only recorded. Clarabel tells nothing of its iterates, so the history has the
    start and one entry per program; more than one is solved when the tolerance is missed or W as stored is not symmetric.

    Raises
    ------
    InputError : the law is not associated.
    """
    _iterate(problem, recorder, r0, max_iterations, primal=False)


def clarabel_primal(
    problem: Problem, recorder: Recorder, r0: np.ndarray, max_iterations: int | None = None
) -> None:
    """Solve the primal program (2.24) for the velocities, forces being its multipliers; see `clarabel_dual`.

    A reduced problem takes v = L^T x with W = L L^T and x free, hence M = H = W: sparse, and nothing is decomposed.
    """
    _iterate(problem, recorder, r0, max_iterations, primal=True)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """The problem in the unknowns x_i = r_i / (F sqrt(rho_i)) and v_j sqrt(M_jj) / F, of order one.

    M, f, H, w, C, k as in `Problem` (reduced: M = H = W, f = 0, no C); `law` (n, 4) with scaled yields; `root` (n, 1).
    """

    M: sp.csr_array
    f: np.ndarray
    H: sp.csr_array | None
    w: np.ndarray
    C: sp.csr_array
    k: np.ndarray
    law: np.ndarray
    root: np.ndarray
    force: float


def _iterate(
    problem: Problem, recorder: Recorder, r0: np.ndarray, max_iterations: int | None, primal: bool
) -> None:
    """Solve, check with the true operator, and correct: tighter tolerance, and what a program cannot hold of W put in b."""
    _require_associated(problem)
    budget = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    delassus = build_operator(problem)

    def residual(r: np.ndarray) -> float:
        return law_residual(problem, r, delassus.apply(r) + delassus.b)[0]

    if recorder.record(0, residual(r0), r0) or budget == 0:
        return
    asked, done, before, size = FIRST_TOLERANCE * recorder.tolerance, 0, np.inf, None
    drift, disappointed = np.zeros(problem.n * problem.s), 0
    for _ in range(MAX_PROGRAMS):
        data = _scaled(problem, drift, size, primal)
        r, count = (_primal_forces if primal else _dual_forces)(problem, data, asked, budget - done)
        done += count
        if r is None:
            return
        admissible = np.empty_like(r)
        project_blocks(r, problem.parameters, admissible)
        now = residual(admissible)
        if recorder.record(done, now, admissible) or done >= budget or count == 0:
            return
        if problem.is_reduced:
            drift = _left_out(problem, data, admissible)
        disappointed += now > 0.5 * before and asked <= TIGHTEST
        if disappointed >= PATIENCE:
            return
        asked, before = max(TIGHTEN * asked, TIGHTEST), min(now, before)
        size = float(np.abs(admissible / data.root).max()) or None


def _require_associated(problem: Problem) -> None:
    mu, dilatancy = problem.parameters[:, 0], problem.parameters[:, 3]
    if (dilatancy < mu).any():
        allowed = (
            "associated (its dilatancy equal to mu) for a conic program; use 'cadoux' with an inner method"
        )
        raise InputError("law", type(problem.law).__name__, allowed)


def _scaled(problem: Problem, drift: np.ndarray, force: float | None, primal: bool) -> _Scaled:
    """The data of both programs, w and b with `drift` (n s,) added; `force` is the unit F (None: the largest datum)."""
    root = np.sqrt(problem.rho)
    rows = sp.diags_array(np.repeat(root, problem.s))
    H: sp.csr_array | None
    if problem.is_reduced:
        W = problem.origin.prepared("scaled W", lambda: _scaled_delassus(problem))
        H = problem.origin.prepared("square root of W", lambda: _square_root(W)) if primal else None
        M = W if H is None else sp.eye_array(H.shape[1])
        columns, f, w = np.ones(M.shape[0]), np.zeros(M.shape[0]), problem.b + drift
    else:
        columns = 1.0 / np.sqrt(problem.M.diagonal())
        M, f, H, w = problem.M, problem.f, rows @ sp.csr_array(problem.H), problem.w + drift
    none = problem.is_reduced or problem.C is None
    C = sp.csr_array((0, len(columns))) if none else problem.C
    k = np.zeros(0) if none else problem.k
    scale = sp.diags_array(columns)
    f, w = columns * f, rows @ w
    law = problem.parameters.copy()
    law[:, 1:3] /= root[:, None]
    if force is None:
        force = max(float(np.abs(part).max(initial=0.0)) for part in (f, w, law[:, 1:3], k)) or 1.0
    law[:, 1:3] /= force
    return _Scaled(
        sp.csr_array(scale @ M @ scale),
        f / force,
        None if H is None else sp.csr_array(H @ scale),
        w / force,
        sp.csr_array(C @ scale),
        k / force,
        law,
        root[:, None],
        force,
    )


def _square_root(W: sp.csr_array) -> sp.csr_array:
    """(n s, rank) L with L L^T = W, negative eigenvalues left out."""
    values, vectors = np.linalg.eigh(W.toarray())
    kept = values > RANK * values.max(initial=0.0)
    return sp.csr_array(vectors[:, kept] * np.sqrt(values[kept]))


def _scaled_delassus(problem: Problem) -> sp.csr_array:
    """The symmetric part of W, scaled by sqrt(rho) on both sides."""
    rows = sp.diags_array(np.repeat(np.sqrt(problem.rho), problem.s))
    W = sp.csr_array(problem.W)
    return sp.csr_array(rows @ (0.5 * (W + W.T)) @ rows)


def _left_out(problem: Problem, data: _Scaled, r: np.ndarray) -> np.ndarray:
    """(n s,) W r less what the program takes for it: the skew part of W, and negative eigenvalues in the primal."""
    x = (r / data.root).reshape(-1)
    held = data.M @ x if data.H is None else data.H @ (data.H.T @ x)
    return np.asarray(problem.W @ r.reshape(-1) - (held.reshape(r.shape) / data.root).reshape(-1))


def _dual_forces(
    problem: Problem, data: _Scaled, tolerance: float, budget: int
) -> tuple[np.ndarray | None, int]:
    """Forces (n, s) of min r.W r / 2 + b.r; of a full problem as min v.M v / 2 + w.r - k.l with M v = f + H^T r + C^T l."""
    size = problem.n * problem.s
    if problem.is_reduced:
        program = ConicProgram(data.M, data.w, problem.s)
        first = 0
    else:
        assert data.H is not None
        first, bilateral = len(data.f), len(data.k)
        P = sp.block_diag([data.M, sp.csr_array((size + bilateral, size + bilateral))])
        program = ConicProgram(P, np.concatenate([np.zeros(first), data.w, -data.k]), problem.s)
        program.require(ZERO, sp.hstack([data.M, -data.H.T, -data.C.T]), -data.f)
    after = len(program.q) - first - size
    for group in force_cones(data.law, problem.s):
        height = group.select.shape[0]
        empty = sp.csr_array((height, first)), sp.csr_array((height, after))
        program.require(group.kind, sp.hstack([empty[0], group.select, empty[1]]), group.offset)
    answer = program.solve(tolerance, budget)
    if not answer.usable:
        return None, answer.iterations
    x = answer.x[first : first + size].reshape(problem.n, problem.s)
    return data.force * data.root * x, answer.iterations


def _primal_forces(
    problem: Problem, data: _Scaled, tolerance: float, budget: int
) -> tuple[np.ndarray | None, int]:
    """Forces (n, s), the multipliers of min v.M v / 2 - f.v + sum_i (sigma_i |u_T| + tau_i u_N) over the dual cones."""
    assert data.H is not None
    s = problem.s
    mu, shear, tension = data.law[:, 0], data.law[:, 1], data.law[:, 2]
    yielding = shear > 0.0
    bounds = int(yielding.sum())
    pull = np.zeros((problem.n, s))
    pull[:, 0] = tension
    P = sp.block_diag([data.M, sp.csr_array((bounds, bounds))])
    linear = np.concatenate([data.H.T @ pull.reshape(-1) - data.f, shear[yielding]])
    program = ConicProgram(P, linear, s)
    if len(data.k):
        program.require(ZERO, sp.hstack([data.C, sp.csr_array((len(data.k), bounds))]), -data.k)
    groups = opening_cones(mu, s)
    for group in groups:
        wide = sp.hstack([group.select @ data.H, sp.csr_array((group.select.shape[0], bounds))])
        program.require(group.kind, wide, group.select @ data.w)
    if bounds:
        groups.append(tangent_cones(yielding, s))
        heads = sp.csr_array(
            (np.ones(bounds), (s * np.arange(bounds), np.arange(bounds))), (s * bounds, bounds)
        )
        program.require(
            SECOND_ORDER, sp.hstack([groups[-1].select @ data.H, heads]), groups[-1].select @ data.w
        )
    answer = program.solve(tolerance, budget)
    if not answer.usable:
        return None, answer.iterations
    multipliers = answer.multipliers[1:] if len(data.k) else answer.multipliers
    x = -pull.reshape(-1)
    for group, values in zip(groups, multipliers, strict=True):
        x = x + group.select.T @ values
    return data.force * data.root * x.reshape(problem.n, s), answer.iterations
