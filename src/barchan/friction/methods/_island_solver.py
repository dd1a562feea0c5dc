"""The islands of a stored Delassus operator, solved one by one: sweeps first, proximal Newton where sweeps are slow.

Every island gets its share of the squared residual allowed, so that together they meet the certificate's tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.sparse as sp

from barchan.friction._islands import find_islands, island_sweeps
from barchan.friction._proximal_newton import newton_islands
from barchan.friction.local import local_blocks
from barchan.friction.operators import StoredDelassus
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

FIRST_CHECK = 5
NEWTON_STEPS = 40
LARGEST_NEWTON = 1500
# Multiplications of a factorisation in the time of one of a sweep; factorisations that a Newton solve mostly takes.
FACTOR_SPEED = 100.0
WORTH = 5.0
# First proximal term and policy (few, shrink, grow, accuracy): first hasty, then patient. Where an active set has no solution
# the forces drift, at a pace of 1 / eps, until it changes: only small terms and exact steps get through.
HASTY = (1e-3, (10, 0.1, 5.0, 0.2))
PATIENT = (1e-3, (8, 0.7, 2.0, 1e-4))


class IslandSolver:
    """Forces r (n, s) and the squared law residual of each island.

    Sweeping costs O(blocks of W) per sweep of the islands asked for; a Newton step costs the cube of an island's size.
    """

    def __init__(self, problem: Problem, delassus: StoredDelassus, r0: np.ndarray) -> None:
        self.problem = problem
        self.rows = delassus.rows
        self.b = np.ascontiguousarray(delassus.b)
        self.laws, self.rho = problem.parameters, problem.rho
        origin = problem.origin
        self.diagonal, self.local = origin.prepared("blocks", lambda: local_blocks(delassus.diagonal_blocks))
        self.islands = origin.prepared("islands", lambda: find_islands(self.rows.indptr, self.rows.indices))
        count = len(self.islands[0]) - 1
        self.sizes = np.diff(self.islands[0])
        # Cost of a factorisation, in sweeps of its own island and in sweeps of the whole.
        cubes = (self.sizes * float(problem.s)) ** 3 / FACTOR_SPEED
        entries = np.add.reduceat(np.diff(self.rows.indptr)[self.islands[1]], self.islands[0][:-1])
        self.effort = 1.0 + cubes / np.maximum(entries * problem.s**2, 1)
        self.factorisation = cubes / max(self.rows.data.size, 1)
        self.r = np.array(r0, dtype=float, order="C")
        self.residual, self.spent = np.full(count, math.inf), np.zeros(count, np.int64)
        self.multiplier = np.zeros(problem.n)
        s = problem.s
        self.scratch = (np.empty(s), np.empty(s), np.empty(s))
        self.kernel = island_sweeps(s)

    @property
    def force_squared(self) -> float:
        """What the squared residual is relative to: max(|r|, r_ref)^2."""
        return max(float(np.vdot(self.r, self.r)), self.problem.reference_force**2)

    @property
    def law_residual(self) -> float:
        """Law residual of the whole."""
        total, size = float(self.residual.sum()), self.force_squared
        return 0.0 if total == 0.0 else math.sqrt(total / size) if size > 0.0 else math.inf

    def allowed(self, tolerance: float) -> np.ndarray:
        """Squared residual that each island may keep."""
        return tolerance**2 * self.force_squared * self.sizes / self.problem.n

    def unsolved(self, tolerance: float) -> np.ndarray:
        """Numbers of the islands that miss their share, smallest first."""
        hard = np.flatnonzero(self.residual > self.allowed(tolerance))
        return hard[np.argsort(self.sizes[hard], kind="stable")]

    def sweep_on(self, chosen: np.ndarray, tolerance: float, limit: int) -> float:
        """Like `sweep`, but islands that end worse than they began are put back."""
        forces, residual = self.r.copy(), self.residual.copy()
        work = self.sweep(chosen, tolerance, limit)
        for island in chosen[self.residual[chosen] > residual[chosen]]:
            self.accept(int(island), forces[self.blocks(island)], float(residual[island]))
        return work

    def sweep(self, chosen: np.ndarray, tolerance: float, limit: int, first: int = FIRST_CHECK) -> float:
        """Up to `limit` Gauss-Seidel sweeps of the islands `chosen`; the work done, in sweeps of the whole."""
        matrix = (self.rows.indptr, self.rows.indices, self.rows.data)
        work = self.kernel(
            chosen, self.islands, matrix, self.diagonal, self.b, self.local, self.laws, self.rho,
            tolerance**2 * self.force_squared, first, limit, WORTH * self.effort, self.r, self.multiplier,
            (self.residual, self.spent), self.scratch,
        )  # fmt: skip
        return float(work) / self.problem.n

    def newton(self, chosen: np.ndarray, tolerance: float, budget: int, attempt: int) -> np.ndarray:
        """Proximal Newton on the islands `chosen`, kept where it improves; the factorisations (k,) of each island."""
        matrix = (self.rows.indptr, self.rows.indices, self.rows.data)
        used = np.zeros(len(self.sizes), np.int64)
        term, policy = HASTY if attempt == 0 else PATIENT
        settings = (term, budget, NEWTON_STEPS, policy)
        # A singular matrix ends the attempt; what was gained on other islands is kept.
        with suppress(np.linalg.LinAlgError):
            newton_islands(
                chosen, self.islands, matrix, self.b, self.laws, self.rho, self.allowed(tolerance), settings,
                self.r, self.residual, used,
            )  # fmt: skip
        return used

    def ask(self, method: Callable[..., None], island: int, tolerance: float, limit: int) -> float:
        """Another method on one island from its forces, kept if it improves; its iterations."""
        blocks = self.blocks(island)
        part = self.problem.part(blocks, self._matrix(blocks), self.b[blocks])
        goal = math.sqrt(self.allowed(tolerance)[island])
        size = float(np.linalg.norm(self.r[blocks])) or 1.0
        recorder = Recorder(goal / size)
        method(part, recorder, self.r[blocks], max_iterations=limit)
        assert recorder.best is not None
        rates = part.W @ recorder.best.reshape(-1) + part.b
        residual, reference = law_residual(part, recorder.best, rates.reshape(recorder.best.shape))
        self.accept(island, recorder.best, (residual * reference) ** 2)
        return float(recorder.history[-1].iteration)

    def restart(self, island: int, tolerance: float, sweeps: int, budget: int, attempt: int) -> float:
        """Newton after a few sweeps from zero forces, kept if it improves; the work, in sweeps of the whole."""
        blocks = self.blocks(island)
        forces, residual = self.r[blocks].copy(), float(self.residual[island])
        self.r[blocks], self.multiplier[blocks] = 0.0, 0.0
        chosen = np.array([island])
        work = self.sweep(chosen, 0.0, sweeps, sweeps)
        work += float(self.newton(chosen, tolerance, budget, attempt) @ self.factorisation)
        self.accept(island, forces, residual)
        return work

    def blocks(self, island: int) -> np.ndarray:
        """Block numbers of an island."""
        return np.asarray(self.islands[1][self.islands[0][island] : self.islands[0][island + 1]])

    def accept(self, island: int, r: np.ndarray, residual: float) -> None:
        """Keep forces of an island if their squared residual is less."""
        if residual < self.residual[island]:
            self.residual[island] = residual
            self.r[self.blocks(island)] = r

    def _matrix(self, blocks: np.ndarray) -> sp.csr_array:
        """W of an island."""
        s = self.problem.s
        rows = (blocks[:, None] * s + np.arange(s)).ravel()
        return sp.csr_array(sp.csr_array(self.rows.matrix())[rows][:, rows])
