"""Arrow-Hurwicz method: a projected step on the forces, then an implicit step on the velocities (seed B 3.3.3).

Velocities are damped in the energy norm of M (beta M in place of beta I), so that M alone is factorised and constraints
C v = k are met exactly. Equilibrated unknowns. Cost of an iteration: one product with W.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._options import check_counts, check_positive
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
FORCE_FRACTION = 1.8
DEFAULT_DAMPING = 0.1


def arrow_hurwicz(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    force_step: float | None = None,
    damping: float = DEFAULT_DAMPING,
    shift_rate: float = FIRST_RATE,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    force_step : gamma, in equilibrated unknowns (None: 1.8 / L, L the bound on the scaled W).
    damping : beta; tending to 0 gives the projected gradient method.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`).
    operator : see `barchan.friction.operators`.

    On associated laws it converges for every beta when gamma L < 2: with a = r - r*, b = v - v*,
    |a - gamma H b|^2 / (2 gamma) + beta |b|_M^2 / 2 decreases (add both prox inequalities; |H b|^2 <= L |b|_M^2).
    The new velocity solves M v' = (f + H^T r' + beta M v) / (1 + beta); its rates follow by linearity.

    Raises
    ------
    InputError : unknown operator; force_step, damping or check_every not positive; shift_rate not in (0, 1].
    """
    check_positive(force_step=force_step, damping=damping)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    gamma = FORCE_FRACTION / scaled.lipschitz if force_step is None else force_step
    x = scaled.start(r0)
    u = scaled.rates(x)
    shift = LaggedShift(scaled, u, shift_rate)
    rates = u
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit, shift)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        shift.follow(rates)
        x = scaled.project(x - gamma * shift.added_to(rates))
        u = scaled.rates(x)
        rates = (u + damping * rates) / (1.0 + damping)
