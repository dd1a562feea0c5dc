"""Friction problems of a continuum: a lumped M, and blocks moved by the many nodes around them (seed B 7.3.5).

Sweeps and accelerated gradients are cheap and mostly enough for the tolerances of such steps. With strong friction they
may creep along the null space of W: then a central path in velocity space, which does not see it, and Newton from its end.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from barchan.friction.constrained import ConstrainedDelassus
from barchan.friction.methods._newton_systems import newton_system
from barchan.friction.methods._portfolio import DEFAULT_WORK, portfolio
from barchan.friction.methods._velocity_newton import VelocityNewton
from barchan.friction.methods.apgd import apgd
from barchan.friction.methods.aspg import aspg
from barchan.friction.methods.gauss_seidel import gauss_seidel, pressure_period, sor
from barchan.friction.methods.interior_point import CentralPath, follow
from barchan.friction.operators import build_operator, is_lumped
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

# Columns of H that a contact of two rigid bodies can fill.
LARGEST_CONTACT = 12
# Work, in sweeps, over the root of the number of velocities m: a step of the path costs m^1.5, a sweep m.
STEP_WORK = 8.0
FIRST_WORK = 40.0
POLISH_WORK = 3000
# Sweeps of the first turn: they remove what is local, after which a gradient method takes a quarter of the time to carry
# pressure (steps of collapsing columns of 1e3 to 6e3 nodes: 50 to 270 iterations after 30 sweeps, 400 sweeps and more alone).
FIRST_SWEEPS = 80
# The gradient method of the portfolio and its cost by block size: solving a block of 6 is dear, a sweep of blocks of 3 cheap.
PLANE: tuple[Callable[..., None], float] = (apgd, 2.0)
SPATIAL: tuple[Callable[..., None], float] = (aspg, 1.5)
PATH_STEPS, FEWEST_STEPS, NEWTON_STEPS = 32, 20, 40
# Of problems with constraints: sweeps at least, steps of the long run of gradients, its share of the work at most.
FEWEST_SWEEPS, LONG_RUN, LONG_SHARE = 5, 4000, 0.8


def is_continuum(problem: Problem) -> bool:
    """Whether M is diagonal (see `is_lumped`), and a block has on average more columns than a contact of two bodies.

    Constrained matter on a mesh of triangles has fewer columns, and strains with more components than a contact.
    """
    if not is_lumped(problem):
        return False
    if problem.C is not None and problem.s > problem.velocity_block > 1:
        return True
    return bool(problem.h_rows.data.size > LARGEST_CONTACT * problem.n * problem.s)


def solve_continuum(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None,
    operator: str,
    min_iterations: int,
    last: bool,
) -> float:
    """Portfolio, central path, Newton, portfolio, from `r0` (n, s); the sweeps that are left.

    max_iterations : bound on the work, in sweeps.  last : spend all of it on the second portfolio (else POLISH_WORK).
    """
    budget = float(DEFAULT_WORK if max_iterations is None else max_iterations)
    first, step = FIRST_WORK * math.sqrt(problem.size), STEP_WORK * math.sqrt(problem.size)
    helps = budget >= first + FEWEST_STEPS * step
    gradient, cost = PLANE if problem.s <= 3 else SPATIAL
    sweeper: Callable[..., None] = sor
    first_sweeps = FIRST_SWEEPS
    if problem.C is not None:
        gradient, sweeper, cost = apgd, gauss_seidel, _constrained_cost(problem, operator, PLANE[1])
        first_sweeps = int(FIRST_SWEEPS * max(1.0, cost / SPATIAL[1]))
        budget -= _tied(problem, recorder, r0, budget, operator, max(min_iterations, FEWEST_SWEEPS), cost)
        if recorder.ended or budget <= 0.0:
            return 0.0 if recorder.stopped else max(budget, 0.0)
        assert recorder.best is not None
        recorder.begin_next()
        r0, min_iterations = recorder.best, 0
        helps = budget >= first + FEWEST_STEPS * step
    sweeps = int(budget) if last and not helps else int(min(first, budget))
    portfolio(problem, recorder, r0, sweeps, operator, min_iterations, gradient, cost, first_sweeps, sweeper)
    budget -= sweeps
    if helps and not recorder.ended:
        budget -= step * _by_factorisations(problem, recorder, operator, int(budget / step))
    polish = int(budget if last else min(POLISH_WORK, budget))
    if not recorder.ended and polish > 0:
        assert recorder.best is not None
        recorder.begin_next()
        portfolio(problem, recorder, recorder.best, polish, operator, 0, gradient, cost, sweeps=sweeper)
        budget -= polish
    return 0.0 if recorder.stopped else max(budget, 0.0)


def _tied(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    budget: float,
    operator: str,
    sweeps: int,
    cost: float,
) -> float:
    """A few sweeps and one long run of accelerated gradients, for matter whose volume average is constrained; the work.

    Where drag ties grains to an incompressible fluid, contact pressures move little that the constraints do not take back, and
    gradients need their momentum over a thousand steps: in turns of a hundred they stall above 1e-4.
    """
    count = min(sweeps, int(budget))
    gauss_seidel(problem, recorder, r0, max_iterations=count, operator=operator, min_iterations=count)
    if recorder.ended or recorder.last is None:
        return float(count)
    recorder.begin_next()
    steps = min(LONG_RUN, int(LONG_SHARE * (budget - count) / cost))
    if steps > 0:
        apgd(problem, recorder, recorder.last.copy(), max_iterations=steps, operator=operator)
    return count + steps * cost


def _constrained_cost(problem: Problem, operator: str, cost: float) -> float:
    """Work of a gradient step that costs `cost` sweeps without constraints: sweeps solve for multipliers less often."""
    delassus = build_operator(problem, operator)
    if not isinstance(delassus, ConstrainedDelassus):
        return cost
    added = delassus.reaction_work
    return (cost + added) / (1.0 + added / pressure_period(delassus))


def _by_factorisations(problem: Problem, recorder: Recorder, operator: str, limit: int) -> int:
    """The central path, then Newton from its best point (not from the sweeps', which creep); how many factorisations."""
    delassus = build_operator(problem, operator)
    recorder.begin_next()
    path = CentralPath(problem, delassus, newton_system(problem, "velocities"))
    done, end = follow(problem, recorder, path, min(PATH_STEPS, limit), shortest_step=0.0)
    most = min(NEWTON_STEPS, limit - done)
    if recorder.ended or end is None or most <= 0:
        return done
    recorder.begin_next()
    return done + VelocityNewton(problem, delassus).finish(recorder, end, most)
