"""Alternating minimisation on the dual problem with bilateral constraints, linearised (seed B Algorithm 3.8).

No linear system is solved: M, H and C only multiply (recording an iterate takes one solve, as the certificate does).
With z = M v - f it is the predictor-corrector PAPC of Drori, Sabach, Teboulle 2015, whence its step sizes.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._inertia import nesterov_inertia
from barchan.friction.methods._options import check_counts, check_positive
from barchan.friction.methods._primal import PrimalData, primal_data
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000


def dual_ama(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    velocity_step: float | None = None,
    damping: float | None = None,
    accelerated: bool = True,
    shift_rate: float = FIRST_RATE,
    check_every: int = 10,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations (one product with W each).

    Parameters
    ----------
    velocity_step : gamma, in equilibrated unknowns (None: 1 / |M|; converges below 2 / |M| on associated laws).
    damping : beta of forces and multipliers (None: gamma |[H; C]|^2; converges from there on; rows are equilibrated, so
    that one number serves both).
    accelerated : inertia on forces, multipliers and velocities, dropped when the forces turn back.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`; seed B: w becomes w + s(H v + w)).

    Raises
    ------
    InputError : a step or check_every not positive; shift_rate not in (0, 1]; reduced problem too large (`_primal`).
    """
    check_positive(velocity_step=velocity_step, damping=damping)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, "auto" if problem.is_reduced else "matrix-free")
    data = primal_data(problem)
    gamma = 1.0 / data.operators.mass_bound if velocity_step is None else velocity_step
    beta = gamma * data.operators.coupling_bound if damping is None else damping
    iterate = _start(data, scaled.start(r0))
    shift = LaggedShift(scaled, scaled.rates(iterate[0]), shift_rate)
    w = data.w.reshape(iterate[0].shape)
    ahead, theta = iterate, 1.0
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    for iteration in range(limit + 1):
        last = iteration == limit
        if iteration % check_every == 0 or last:
            x = iterate[0]
            u = scaled.rates(x)
            residual = scaled.residual_at(x, u)
            if recorder.record(iteration, residual, scaled.root * x) or last:
                return
            shift.watch(iteration, residual)
            if not data.operators.exact:
                H = data.operators.H
                w = u - (H @ (H.T @ x.reshape(-1))).reshape(x.shape)
        fresh = list(_predict(data, ahead, gamma, beta, w, shift))
        fresh[0] = scaled.project(fresh[0])
        fresh[2] = ahead[2] + gamma * (_pull(data, fresh[0], fresh[1]) - data.operators.M @ ahead[2] + data.f)
        following, inertia = nesterov_inertia(theta)
        if not accelerated or np.vdot(ahead[0] - fresh[0], fresh[0] - iterate[0]) > 0.0:
            following, inertia = 1.0, 0.0
        ahead = [new + inertia * (new - old) for new, old in zip(fresh, iterate, strict=True)]
        iterate, theta = fresh, following


def _start(data: PrimalData, x: np.ndarray) -> list[np.ndarray]:
    """Forces, multipliers 0 and a first velocity, f + H^T x (that of a unit M)."""
    multipliers = np.zeros(len(data.k))
    return [x, multipliers, data.f + _pull(data, x, multipliers)]


def _pull(data: PrimalData, x: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """H^T x + C^T l (m,)."""
    pull = np.asarray(data.operators.H.T @ x.reshape(-1))
    return pull if data.operators.C is None else pull + data.operators.C.T @ multipliers


def _predict(
    data: PrimalData, ahead: list[np.ndarray], gamma: float, beta: float, w: np.ndarray, shift: LaggedShift
) -> list[np.ndarray]:
    """Forces before projection and multipliers, at the predicted velocity; the third entry is that velocity."""
    x, multipliers, v = ahead
    operators = data.operators
    predicted = v + gamma * (_pull(data, x, multipliers) - operators.M @ v + data.f)
    rates = (operators.H @ predicted).reshape(x.shape) + w
    shift.follow(rates)
    if operators.C is not None:
        multipliers = multipliers - (operators.C @ predicted - data.k) / beta
    return [x - shift.added_to(rates) / beta, multipliers, predicted]
