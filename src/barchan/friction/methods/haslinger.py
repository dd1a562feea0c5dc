"""Haslinger's fixed point: friction with frozen sliding thresholds s_i, a convex problem over cylinders, then new thresholds.

Seed B 2.3.2, Eq. (2.20) (Haslinger 1983), around any method of the room. A dilatant law also freezes the opening
zeta |u_T|, which moves the free normal velocity (De Saxce's shift, seed B Property 1.6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barchan.cones import DruckerPrager
from barchan.errors import InputError
from barchan.friction.methods._inner import check_inner, run_inner
from barchan.friction.operators import build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 40_000
SMALLEST_RELAXATION = 1.0 / 32.0
GROWTH = 1.5


def haslinger(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    inner: str = "aspg",
    accuracy: float = 0.1,
    inner_iterations: int = 3000,
    operator: str = "auto",
) -> None:
    """Iterate from `r0` (n, s), recording one iterate per change of thresholds; iterations are those of the inner method.

    With s_i = shear_yield + mu (r_N + tensile_yield) the forces solve |r_T| <= s_i, r_N >= -tensile_yield without
    dilatancy, for the free velocity b - zeta |u_T| e_N; both frozen quantities then follow the solution. When the residual
    of the true problem grows, they move only a part of the way (half as much each time, down to SMALLEST_RELAXATION),
    and GROWTH times more each time it falls, up to the whole way.

    Parameters
    ----------
    inner : any other method, warm-started.  accuracy : inner residual asked for, over the residual of the true problem.
    inner_iterations : at most, for one set of thresholds.  max_iterations : in all.  operator : as for `aspg`.

    Raises
    ------
    InputError : unknown inner method, accuracy not between 0 and 1, inner_iterations < 1.
    """
    check_inner(inner, {})
    if not 0.0 < accuracy < 1.0:
        raise InputError("accuracy", accuracy, "between 0 and 1")
    if inner_iterations < 1:
        raise InputError("inner_iterations", inner_iterations, "at least 1")
    delassus = build_operator(problem, operator)
    r, done, relaxation, before = r0, 0, 1.0, np.inf
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    frozen = None
    while True:
        u = delassus.apply(r) + delassus.b
        residual = law_residual(problem, r, u)[0]
        if recorder.record(done, residual, r) or done >= limit:
            return
        relaxation = (
            min(1.0, GROWTH * relaxation)
            if residual <= before
            else max(SMALLEST_RELAXATION, 0.5 * relaxation)
        )
        before = residual
        frozen = _Frozen.at(problem, r, u).mixed(frozen, relaxation)
        tolerance = max(accuracy * min(residual, 1.0), 0.5 * recorder.tolerance)
        count = min(inner_iterations, limit - done)
        r, made = run_inner(frozen.problem(problem), inner, r, tolerance, count)
        done += max(1, made)


class _Frozen(NamedTuple):
    """What an outer iteration holds fixed: thresholds s_i of |r_T| and openings zeta |u_T|, each (n,)."""

    threshold: np.ndarray
    opening: np.ndarray

    @classmethod
    def at(cls, problem: Problem, r: np.ndarray, u: np.ndarray) -> _Frozen:
        """Those of forces r and velocities u (n, s)."""
        mu, shear, tension, zeta = problem.parameters.T
        return cls(shear + mu * np.maximum(r[:, 0] + tension, 0.0), zeta * np.linalg.norm(u[:, 1:], axis=1))

    def mixed(self, former: _Frozen | None, weight: float) -> _Frozen:
        """`weight` of the way from the former ones to these."""
        if former is None:
            return self
        return _Frozen(*(old + weight * (new - old) for old, new in zip(former, self, strict=True)))

    def problem(self, problem: Problem) -> Problem:
        """The convex problem with these fixed."""
        drift = np.zeros((problem.n, problem.s))
        drift[:, 0] = -self.opening
        law = DruckerPrager(np.zeros(problem.n), self.threshold, problem.parameters[:, 2])
        return problem.variant(law, drift)
