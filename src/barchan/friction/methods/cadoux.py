"""Cadoux's fixed point: the convex problem at a frozen De Saxce shift s, then the shift of its solution (seed B, Property 2.1).

The map s -> F(s) depends on the velocities alone, which each convex problem determines uniquely. Anderson's acceleration,
island by island, long strides where an island drifts and short ones where it turns round, make up for a slow map.
"""

from __future__ import annotations

import numpy as np

from barchan.errors import InputError
from barchan.friction._islands import find_islands
from barchan.friction.methods._inner import check_inner, run_inner
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

DEFAULT_OUTER = 1000
INNER = {"dual": "interior_point", "primal": "clarabel_primal"}
CLEAR_GAIN = 0.7
DRIFT = 0.9
PATIENCE = 20
SHORTEST_STRIDE, LONGEST_STRIDE = 1.0 / 16.0, 256.0
RANK = 1e-8


def cadoux(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    formulation: str = "dual",
    inner: str | None = None,
    accuracy: float = 0.01,
    inner_iterations: int | None = None,
    memory: int = 5,
) -> None:
    """Iterate from the shift of `r0` (n, s), recording one iterate per outer iteration (they are what `max_iterations` bounds).

    Parameters
    ----------
    formulation : "dual" (seed B Eq. 2.21, forces) or "primal" (2.24, velocities); names the default inner method.
    inner : method for the convex problems, warm-started with the last forces.
    accuracy : inner residual asked for, over the residual of the true problem.  inner_iterations : at most, per problem.
    memory : differences that Anderson's acceleration combines; 0 is the plain fixed point.

    Raises
    ------
    InputError : unknown formulation or inner method, accuracy not between 0 and 1, memory < 0.
    """
    if formulation not in INNER:
        raise InputError("formulation", formulation, "one of " + ", ".join(INNER))
    method = INNER[formulation] if inner is None else inner
    check_inner(method, {})
    if not 0.0 < accuracy < 1.0:
        raise InputError("accuracy", accuracy, "between 0 and 1")
    if memory < 0:
        raise InputError("memory", memory, "at least 0")
    delassus = build_operator(problem, "auto")
    mu, _, _, zeta = problem.parameters.T
    convex = problem.law.convexified()
    islands = _islands(problem)
    r = r0
    limit = DEFAULT_OUTER if max_iterations is None else max_iterations
    mixers = [_Mixer(memory) for _ in islands]
    shift = np.zeros(problem.n)
    for iteration in range(limit + 1):
        rates = delassus.apply(r) + delassus.b
        residual = law_residual(problem, r, rates)[0]
        if recorder.record(iteration, residual, r) or iteration == limit:
            return
        image = (mu - zeta) * np.linalg.norm(rates[:, 1:], axis=1)
        for blocks, mixer in zip(islands, mixers, strict=True):
            shift[blocks] = mixer.following(shift[blocks] if iteration else None, image[blocks])
        drift = np.zeros((problem.n, problem.s))
        drift[:, 0] = shift
        tolerance = max(accuracy * min(residual, 1.0), 0.3 * recorder.tolerance)
        r, _ = run_inner(problem.variant(convex, drift), method, r, tolerance, inner_iterations)


def _islands(problem: Problem) -> list[np.ndarray]:
    """Blocks of each island where W is stored, else all blocks as one."""
    delassus = build_operator(problem, "auto")
    if not isinstance(delassus, StoredDelassus):
        return [np.arange(problem.n)]
    rows = delassus.rows
    pointers, members = problem.origin.prepared("islands", lambda: find_islands(rows.indptr, rows.indices))
    return list(np.split(members, pointers[1:-1]))


class _Mixer:
    """The next shift of one island from the pairs (s, F(s)) so far."""

    def __init__(self, memory: int) -> None:
        self.memory = memory
        self.points: list[np.ndarray] = []
        self.gaps: list[np.ndarray] = []
        self.stride = 1.0
        self.best = np.inf
        self.idle = 0

    def following(self, point: np.ndarray | None, image: np.ndarray) -> np.ndarray:
        """Anderson's combination of the last pairs, kept non-negative; `point` None before the first problem."""
        if point is None:
            return image
        gap = image - point
        self._watch(float(np.linalg.norm(gap)))
        self._pace(gap)
        self.points.append(point.copy())
        self.gaps.append(gap)
        del self.points[: -self.memory - 1], self.gaps[: -self.memory - 1]
        target = point + self.stride * gap
        if self.memory and self.stride <= 1.0 and len(self.points) > 1 and gap.any():
            points, gaps = np.array(self.points), np.array(self.gaps)
            misses = np.diff(gaps, axis=0).T
            weights = np.linalg.lstsq(misses, gap, rcond=RANK)[0]
            target = target - (np.diff(points, axis=0).T + self.stride * misses) @ weights
        return np.maximum(target, 0.0)

    def _watch(self, size: float) -> None:
        """Mix no more where that has not brought the gap down for a while: the bare map is slower and surer."""
        self.idle = 0 if size <= CLEAR_GAIN * self.best else self.idle + 1
        self.best = min(self.best, size)
        if self.idle > PATIENCE:
            self.memory = 0

    def _pace(self, gap: np.ndarray) -> None:
        """Longer strides while the gap F(s) - s hardly changes (a drift), shorter ones when it turns round (a cycle)."""
        if not self.gaps:
            return
        last = self.gaps[-1]
        size, before = float(np.linalg.norm(gap)), float(np.linalg.norm(last))
        along = float(gap @ last) / (size * before) if size * before > 0.0 else 0.0
        if along > DRIFT and size > DRIFT * before:
            self.stride = min(2.0 * max(self.stride, 1.0), LONGEST_STRIDE)
        elif along < 0.0 and size > CLEAR_GAIN * before:
            self.stride = max(0.5 * min(self.stride, 1.0), SHORTEST_STRIDE)
        elif self.stride > 1.0:
            self.stride = 1.0
        else:
            self.stride = min(1.0, 1.5 * self.stride)
