"""Our own primal-dual interior point: Nesterov-Todd scaling, predictor and corrector, one factorisation an iteration.

Cone multipliers are eliminated block by block, which leaves W + N Theta in force space or M + H^T (N Theta)^-1 H in velocity
space (seed B 3.2; Heyn 2013 avoids the detour over an SOCP alike). The non-associated term -(mu - zeta) |u_T| e_N of the
flow rule is part of the Newton system (N), so that Coulomb's law needs no outer loop; for an associated law N = I.
"""

from __future__ import annotations

import math

import numpy as np

from barchan.friction import _barrier
from barchan.friction.methods._newton_systems import Blocks, NewtonSystem, newton_system
from barchan.friction.methods.newton import newton_de_saxce
from barchan.friction.operators import LARGEST_DENSE_DELASSUS, Delassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 60
BOUNDARY = 0.99
CENTRALITY = 1e-4
SMALLEST_CENTERING = 1e-4
STALL_STEP = 1e-3
STALLED_STEPS = 8
SLOW = 0.9
POLISHING_STEPS = 20


def interior_point(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    system: str = "auto",
    polish: bool = True,
) -> None:
    """Follow the central path from an interior start (`r0` only enters the record: interior points need no warm start).

    system : "auto", "forces" (factorise W + N Theta) or "velocities" (factorise M + H^T (N Theta)^-1 H with C bordering it).
    polish : where the path ends in rounding (without strict complementarity the residual falls as the root of the gap), go
    on from its best point by Newton's method on the natural map, if W can be stored; its factorisations count as iterations.
    Cost of an iteration: one factorisation, four solves, two products with W.
    """
    delassus = build_operator(problem, "auto")
    rates = delassus.apply(r0) + delassus.b
    if recorder.record(0, law_residual(problem, r0, rates)[0], r0):
        return
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    done, _ = follow(problem, recorder, CentralPath(problem, delassus, newton_system(problem, system)), limit)
    if polish and not recorder.ended and done < limit and problem.n * problem.s <= LARGEST_DENSE_DELASSUS:
        assert recorder.best is not None
        recorder.begin_next()
        newton_de_saxce(problem, recorder, recorder.best, max_iterations=min(limit - done, POLISHING_STEPS))


def follow(
    problem: Problem, recorder: Recorder, path: CentralPath, limit: int, shortest_step: float = STALL_STEP
) -> tuple[int, np.ndarray | None]:
    """Steps along the path, recorded, until solved, stalled or at the limit; how many, and the path's best forces (n, s).

    A step counts as stalled when it gains less than SLOW on the best residual of the path or is below `shortest_step`.
    """
    stalled, best, end = 0, math.inf, None
    for iteration in range(1, limit + 1):
        step = path.advance()
        if step is None:
            return iteration, end
        r = path.forces()
        residual = law_residual(problem, r, path.delassus.apply(r) + path.delassus.b)[0]
        if not math.isfinite(residual):
            return iteration, end
        stalled = 0 if residual < SLOW * best and step > shortest_step else stalled + 1
        if residual < best:
            best, end = residual, r
        if recorder.record(iteration, residual, r) or stalled >= STALLED_STEPS:
            return iteration, end
    return limit, end


class CentralPath:
    """The iterate: equilibrated forces x = r / root / unit inside their cones, and multipliers.

    root = sqrt(rho) evens out W; `unit` makes the rates without forces of order one.
    """

    def __init__(self, problem: Problem, delassus: Delassus, system: NewtonSystem) -> None:
        self.delassus = delassus
        self.system = system
        self.root = np.sqrt(problem.rho)[:, None]
        b = self.root * delassus.b
        self.unit = float(np.linalg.norm(b)) / math.sqrt(problem.n) or 1.0
        laws = problem.parameters.copy()
        laws[:, 1:3] /= self.root * self.unit
        self.laws = laws
        self.b = b / self.unit
        self.shape = _barrier.shape_table(laws)
        n, s = b.shape
        self.x = np.zeros((n, s))
        self.x[:, 0] = 1.0 - laws[:, 2]
        self.state = (np.zeros((n, s)), np.zeros((n, s)), np.ones(n), np.ones(n))
        self.state[1][:, 0] = 1.0
        self._hold()
        self.scaling = (np.zeros((n, s)), np.ones(n), np.zeros((n, s)))
        self.theta, self.slope = np.zeros((n, s, s)), np.zeros((n, s, s))
        self.constraints = float(self.shape[:, : _barrier.LINE + 1].sum())

    def _hold(self) -> None:
        """z and l from the forces, so that they stay exactly what the forces say."""
        z, _, line, _ = self.state
        height = self.x[:, 0] + self.laws[:, 2]
        z[:, 0] = self.shape[:, _barrier.NORMAL] * height + self.shape[:, _barrier.TANGENT] * self.laws[:, 1]
        z[:, 1:] = self.shape[:, _barrier.TANGENT, None] * self.x[:, 1:]
        line[:] = height

    def forces(self) -> np.ndarray:
        """Forces r (n, s) of the iterate."""
        return np.asarray(self.unit * self.root * self.x)

    def advance(self) -> float | None:
        """One predictor-corrector step; its length, or None when the Newton system could not be solved."""
        gap = _barrier.scale_blocks(self.shape, self.state, self.scaling, self.theta, self.slope)
        center = gap / self.constraints
        rates = self.root * self.delassus.apply(self.root * self.x) + self.b
        miss = np.empty_like(rates)
        _barrier.stationarity(self.shape, self.state[1], self.state[3], rates, miss)
        if not self.system.factorise(Blocks(self.shape, self.state, self.scaling, self.theta, self.slope)):
            return None
        predictor = self._pair()
        step = min(1.0, self._direction(miss, predictor, 0.0, False, predictor))
        after = _barrier.gap_after(self.shape, self.state, predictor, step)[0]
        centering = min(1.0, max((max(after, 0.0) / gap) ** 3, SMALLEST_CENTERING))
        direction = self._pair()
        for corrected, ratio in ((True, centering), (False, max(centering, 0.5)), (False, 1.0)):
            longest = self._direction(miss, predictor, ratio * center, corrected, direction)
            step = self._central_step(direction, min(1.0, BOUNDARY * longest))
            if step > 0.1:
                break
        self.x += step * self.dr
        for part, change in zip(self.state, direction, strict=True):
            part += step * change
        self._hold()
        return step

    def _pair(self) -> tuple[np.ndarray, ...]:
        return tuple(np.zeros_like(part) for part in self.state)

    def _direction(
        self,
        miss: np.ndarray,
        predictor: tuple[np.ndarray, ...],
        center: float,
        corrected: bool,
        pair: tuple[np.ndarray, ...],
    ) -> float:
        """Solve for a direction towards gap `center`, write it to `pair`; the longest feasible step."""
        target = (np.zeros_like(self.b), np.zeros(len(self.b)))
        _barrier.complementarity_target(self.shape, self.scaling, predictor, center, corrected, target)
        rhs = np.empty_like(self.b)
        _barrier.force_target(self.shape, self.state, self.scaling, target, self.slope, rhs)
        self.dr = self.system.solve(rhs - miss)
        return float(_barrier.expand_direction(self.shape, self.state, self.scaling, target, self.dr, pair))

    def _central_step(self, direction: tuple[np.ndarray, ...], step: float) -> float:
        """Shorten a step until no pair of eigenvalues is far below the mean (neighbourhood of the central path)."""
        for _ in range(12):
            gap, smallest = _barrier.gap_after(self.shape, self.state, direction, step)
            if smallest >= CENTRALITY * gap / self.constraints:
                break
            step *= 0.7
        return step
