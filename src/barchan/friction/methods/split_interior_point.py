"""Interior point for flows: pressure and friction kept apart, one sparse factorisation with the pattern of M an iteration.

The central path r_N u_N = tau, (mu r_N + sigma, r_T) o (t, u_T) = tau e (see `_split_barrier`) is smooth where De Saxce's shift
is not, and Newton's method on it is exact for Coulomb's law: no outer loop. Eliminating forces block by block leaves
M + H^T K^-1 H (seed B 3.2 and 6.4.3 solve the conic programs; Heyn 2013). Where friction yields slowly the flow equations lose
ellipticity (Schaeffer 1987) and that matrix turns singular: a fictitious dilatancy between the law's and mu, which only enters
the matrix, then makes it symmetric and positive definite by degrees. It is more at each short step and less at each long one.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction import _split_barrier as barrier
from barchan.friction.operators import build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder
from barchan.linalg.gram import GramPattern
from barchan.linalg.krylov import KrylovSolver, solver_for
from barchan.linalg.pattern_solver import PatternSolver

DEFAULT_ITERATIONS = 100
BOUNDARY = 0.99
SMALLEST_CENTERING = 1e-4
CORRECTIONS = 4
COMPLIANCE = 1e-6
BALANCE, LARGEST_PATIENCE = 0.1, 0.5
SHORT, LONG = 0.2, 0.5
MORE, LESS, LEAST_LAG = 3.0, 0.4, 0.02
BLOCKED, STALLED_STEPS = 1e-3, 12
Pair = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def split_interior_point(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    corrections: int = CORRECTIONS,
) -> None:
    """Follow the central path from an interior start (`r0` only enters the record: interior points need no warm start).

    corrections : centrality correctors an iteration may try (Gondzio 1996), each one more solve with the same factors.
    Cost of an iteration: one factorisation, three to seven solves with it, one with M. Where the factors would not fit and the
    problem says where its velocities are (`places`), Krylov solves preconditioned by overlapping parts take their place.

    Raises
    ------
    InputError : a reduced problem (no M), bilateral constraints, corrections < 0.
    """
    if problem.is_reduced or problem.C is not None:
        raise InputError("method", "split_interior_point", "another one: it needs M and H, and takes no C")
    if corrections < 0:
        raise InputError("corrections", corrections, "at least 0")
    delassus = build_operator(problem, "matrix-free")
    rates = delassus.apply(r0) + delassus.b
    if recorder.record(0, law_residual(problem, r0, rates)[0], r0) or problem.n == 0:
        return
    path = SplitPath(problem, delassus.b, corrections)
    blocked = 0
    for iteration in range(1, (DEFAULT_ITERATIONS if max_iterations is None else max_iterations) + 1):
        step = path.advance()
        if step is None:
            return
        r = path.forces()
        residual = law_residual(problem, r, delassus.apply(r) + delassus.b)[0]
        if not math.isfinite(residual) or recorder.record(iteration, residual, r):
            return
        blocked = blocked + 1 if step < BLOCKED else 0
        if blocked >= STALLED_STEPS:
            return


class _Shared:
    """What variants of a problem share: equilibrated H, the pattern of Newton's matrix, its order of elimination."""

    def __init__(self, problem: Problem, symmetric: bool) -> None:
        root = np.repeat(np.sqrt(problem.rho), problem.s)
        self.H = sp.csr_array(sp.diags_array(root) @ sp.csr_array(problem.H))
        self.pull = sp.csr_array(self.H.T)
        self.gram = GramPattern(problem.M, self.H, problem.s, upper=symmetric)
        kind = "positive" if symmetric else "structural"
        self.solver: PatternSolver | KrylovSolver
        if problem.places is None:
            self.solver = PatternSolver(self.gram.matrix(), kind)
        else:
            self.solver = solver_for(self.gram.matrix(), kind, *problem.places)


class SplitPath:
    """The iterate of the split central path: forces, multipliers and velocities, equilibrated and made of order one."""

    def __init__(self, problem: Problem, b: np.ndarray, corrections: int) -> None:
        n, s = problem.n, problem.s
        self.corrections = corrections
        self.chunks = numba.get_num_threads()
        self.root = np.sqrt(problem.rho)[:, None]
        self.unit = float(np.linalg.norm(self.root * b)) / math.sqrt(n) or 1.0
        self.laws = problem.parameters.copy()
        self.laws[:, 1:3] /= self.root * self.unit
        self.excess = self.laws[:, barrier.MU] - self.laws[:, barrier.ZETA]
        self.symmetric = not self.excess.any()
        self.lag = 0.0 if self.symmetric else 1.0
        shared = problem.origin.prepared(
            ("split interior point", self.symmetric), lambda: _Shared(problem, self.symmetric)
        )
        self.M, self.H, self.pull, self.gram = problem.M, shared.H, shared.pull, shared.gram
        self.solver = shared.solver
        self.drift = self.root * problem.w.reshape(n, s) / self.unit
        self.f = problem.f / self.unit
        self.v = np.asarray(problem.factor.solve(self.f))
        x, y = np.zeros((n, s)), np.zeros((n, s))
        x[:, 0], y[:, 0] = 1.0 - self.laws[:, barrier.TENSILE], 1.0
        self.state = (x, y, np.ones(n))
        self.scaling = (np.zeros((n, s)), np.zeros(n), np.zeros((n, s)))
        cones = np.count_nonzero(self.laws[:, : barrier.TENSILE].any(axis=1))
        self.constraints = n + cones
        # The path's gap in proportion to the size of a block: the weight of a quadrature point, for a flow.
        self.weights = (1.0 / problem.rho) / np.mean(1.0 / problem.rho)
        self.stiffness = np.empty((n, s, s))
        self.target, self.right = (np.empty((n, s)), np.empty(n)), (np.empty((n, s)), np.empty(n))

    def forces(self) -> np.ndarray:
        """Forces r (n, s) of the iterate."""
        return np.asarray(self.unit * self.root * self.state[0])

    def advance(self) -> float | None:
        """One predictor-corrector step; its length, or None when the Newton system could not be solved."""
        gap = barrier.scale_blocks(self.chunks, self.laws, self.state, self.scaling)
        if not self._factorise():
            return None
        self._miss()
        center, predictor = gap / self.constraints, self._pair()
        dx, dv, longest = self._direction(0.0, predictor, predictor)
        after = barrier.gap_after(self.laws, self.state, predictor, min(1.0, longest))
        patience = min(BALANCE * self.mismatch / center, LARGEST_PATIENCE)
        share = min(1.0, max((max(after, 0.0) / gap) ** 3, SMALLEST_CENTERING, patience))
        pair = self._pair()
        dx, dv, longest = self._direction(share * center, predictor, pair)
        if longest < 0.5 * SHORT:
            dx, dv, longest, pair = self._cautious(dx, dv, longest, pair, max(share, 0.5) * center)
        else:
            dx, dv, longest, pair = self._corrected(dx, dv, longest, pair, share * center)
        step = min(1.0, BOUNDARY * longest)
        x, y, w = self.state
        x += step * dx
        y += step * pair[1]
        w += step * pair[3]
        self.v = self.v + step * dv
        self._pace(step)
        return step

    def _factorise(self) -> bool:
        dilatancy = self.laws[:, barrier.ZETA] + self.lag * self.excess
        self.dilatancy = dilatancy
        barrier.stiffness(self.laws, self.state, self.scaling, dilatancy, COMPLIANCE, self.stiffness)
        if not np.isfinite(self.stiffness).all():
            return False
        return self.solver.factorise(self.gram.data(self.stiffness))

    def _miss(self) -> None:
        """How far the iterate is from M v = f + H^T x and from u = H v + w."""
        x = self.state[0]
        self.imbalance = self.M @ self.v - self.f - self.pull @ x.reshape(-1)
        self.gaps = np.empty_like(x)
        rates = (self.H @ self.v).reshape(x.shape) + self.drift
        barrier.misfit(self.laws, self.state, rates, self.gaps)
        self.mismatch = float(np.abs(np.einsum("ia,ia->i", x, self.gaps)).mean())

    def _pair(self) -> Pair:
        shape = self.state[0].shape
        return np.zeros(shape), np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[0])

    def _direction(
        self, center: float, moved: Pair, pair: Pair, step: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Direction towards the gap `center` (dx, dv, longest step), its pairs into `pair`; `moved`, `step`: see `target`."""
        known = (self.chunks, self.laws, self.state, self.scaling)
        barrier.target(*known, center, self.weights, moved, step, self.target, self.right)
        cone, line = self.target
        load = cone - self.gaps
        load[:, 0] = line + self.dilatancy * cone[:, 0] - self.gaps[:, 0]
        pushed = np.einsum("iab,ib->ia", self.stiffness, load)
        dv = self.solver.solve(self.pull @ pushed.reshape(-1) - self.imbalance)
        dx = pushed - np.einsum("iab,ib->ia", self.stiffness, (self.H @ dv).reshape(load.shape))
        return dx, dv, float(barrier.expand(*known, self.target, dx, pair))

    def _cautious(
        self, dx: np.ndarray, dv: np.ndarray, longest: float, pair: Pair, goal: float
    ) -> tuple[np.ndarray, np.ndarray, float, Pair]:
        """A more central direction without second-order terms, where the corrected one is blocked."""
        other = self._pair()
        ox, ov, reach = self._direction(goal, self._pair(), other)
        return (ox, ov, reach, other) if reach > longest else (dx, dv, longest, pair)

    def _corrected(
        self, dx: np.ndarray, dv: np.ndarray, longest: float, pair: Pair, goal: float
    ) -> tuple[np.ndarray, np.ndarray, float, Pair]:
        """Pull back what a longer step would leave far from the centre, as long as that lengthens the step."""
        for _ in range(self.corrections):
            if longest > 0.9:
                break
            other = self._pair()
            ox, ov, reach = self._direction(goal, pair, other, min(1.0, max(1.5 * longest, longest + 0.1)))
            if reach < 1.05 * longest:
                break
            dx, dv, longest, pair = ox, ov, reach, other
        return dx, dv, longest, pair

    def _pace(self, step: float) -> None:
        """Less fictitious dilatancy after a long step, more after a short one."""
        if self.symmetric:
            return
        if step > LONG:
            self.lag *= LESS
        elif step < SHORT:
            self.lag = min(1.0, MORE * self.lag + LEAST_LAG)
