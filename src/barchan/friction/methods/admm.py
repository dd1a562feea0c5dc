"""Alternating direction method of multipliers on the primal problem, exact or linearised (seed B Algorithms 3.3, 3.4, 3.6).

Accelerated with restart (Goldstein et al. 2014), penalty balanced between both residuals (Boyd et al. 2011, 3.4.1).
Equilibrated unknowns. Cost of an iteration: one solve with M + gamma H^T H (exact) or M + beta I, products with H and H^T.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from barchan.friction.methods._inertia import nesterov_inertia
from barchan.friction.methods._options import check_counts, check_positive
from barchan.friction.methods._primal import PrimalData, primal_data
from barchan.friction.methods._scaled import ScaledProblem, scaled_problem
from barchan.friction.methods._shift import FIRST_RATE, LaggedShift
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 20_000
FIRST_PENALTY = 2.0
BALANCE_EVERY = 20
IMBALANCE = 5.0
LARGEST_CHANGES = 30
LOSS = 0.999


def admm(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    linearised: bool = False,
    accelerated: bool = True,
    penalty: float | None = None,
    balanced: bool = True,
    shift_rate: float = FIRST_RATE,
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations (one product with W each).

    Parameters
    ----------
    linearised : Algorithms 3.4 and 3.6: M + beta I is factorised, beta = gamma |[H; C]|^2 (convergence needs no less), and
    C v = k holds in the limit through multipliers. Else Algorithm 3.3: M + gamma H^T H is factorised, C v = k exact.
    accelerated : predictor-corrector inertia on rates and forces, dropped when the combined residual does not fall.
    penalty : gamma, in equilibrated unknowns (None: FIRST_PENALTY).  balanced : (exact form) double or halve it every
    BALANCE_EVERY iterations while one residual exceeds IMBALANCE times the other; at most LARGEST_CHANGES times, so that
    the theorem for a fixed penalty applies.
    shift_rate : how fast the De Saxce shift follows the rates at first (see `_shift`; seed B: w becomes w + s(H v + w)).

    The u-update is Moreau's complement of a projection of forces: with y = H v + w, r' = P(r - gamma y) and
    u' = y + (r' - r) / gamma, for cones and truncated cones alike. Where W has noise that no H M^-1 H^T can have, the
    difference enters w each time an iterate is recorded.

    Raises
    ------
    InputError : penalty or check_every not positive; shift_rate not in (0, 1]; reduced problem too large (`_primal`).
    """
    check_positive(penalty=penalty)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, "auto" if problem.is_reduced else "matrix-free")
    form = _Linearised if linearised else _Exact
    state = form(primal_data(problem), scaled, r0, FIRST_PENALTY if penalty is None else penalty, accelerated)
    state.shift = LaggedShift(scaled, state.now[1], shift_rate)
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    changes = 0
    for iteration in range(limit + 1):
        last = iteration == limit
        if iteration % check_every == 0 or last:
            x = state.now[0]
            u = scaled.rates(x)
            residual = scaled.residual_at(x, u)
            if recorder.record(iteration, residual, scaled.root * x) or last:
                return
            state.shift.watch(iteration, residual)
            state.correct(u)
        state.advance()
        if balanced and not linearised and (iteration + 1) % BALANCE_EVERY == 0 and changes < LARGEST_CHANGES:
            changes += state.balance()


class _Exact:
    """State of ADMM: `now` holds the last forces and rates, both (n, s), `ahead` the extrapolated ones."""

    shift: LaggedShift

    def __init__(
        self, data: PrimalData, scaled: ScaledProblem, r0: np.ndarray, gamma: float, accelerated: bool
    ) -> None:
        self.data = data
        self.operators = data.operators
        self.scaled = scaled
        self.gamma = gamma
        self.accelerated = accelerated
        self.shape = r0.shape
        self.w = data.w.reshape(r0.shape)
        start = scaled.start(r0)
        self.now = [start, scaled.rates(start)]
        self.restart()

    def restart(self) -> None:
        """Drop the inertia."""
        self.ahead = self.now
        self.theta, self.combined = 1.0, math.inf

    def pull(self, x: np.ndarray) -> np.ndarray:
        """H^T x (m,)."""
        return np.asarray(self.operators.H.T @ x.reshape(-1))

    def push(self, v: np.ndarray) -> np.ndarray:
        """H v (n, s)."""
        return np.asarray(self.operators.H @ v).reshape(self.shape)

    def velocity(self, target: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Minimiser of the augmented Lagrangian, `target` (n, s) = r + gamma (u - w); and nothing to extrapolate."""
        load = np.concatenate([self.data.f + self.pull(target), self.data.k])
        return self.operators.solver(gamma=self.gamma, constrained=True)(load), []

    def extra_residual(self, fresh: list[np.ndarray]) -> float:
        """What a variant adds to the combined residual."""
        return 0.0

    def advance(self) -> None:
        """One iteration: velocities, rates, forces, then inertia."""
        gamma = self.gamma
        r, u = self.ahead[:2]
        offset = self.shift.added_to(self.w)
        v, others = self.velocity(r + gamma * (u - offset))
        plain = self.push(v)
        self.shift.follow(plain + self.w)
        y = plain + offset
        forces = self.scaled.project(r - gamma * y)
        fresh = [forces, y + (forces - r) / gamma, *others]
        self.primal = float(np.linalg.norm(y - fresh[1]))
        self.dual = gamma * float(np.linalg.norm(fresh[1] - u))
        combined = gamma * self.primal**2 + self.dual**2 / gamma + self.extra_residual(fresh)
        inertia = 0.0
        if self.accelerated and combined < LOSS * self.combined:
            self.theta, inertia = nesterov_inertia(self.theta)
            self.combined = combined
        else:
            self.theta, self.combined = 1.0, combined / LOSS
        self.ahead = [new + inertia * (new - old) for new, old in zip(fresh, self.now, strict=True)]
        self.now = fresh

    def correct(self, rates: np.ndarray) -> None:
        """Let w absorb the part of the scaled W that H M^-1 H^T misses, at the last forces of scaled rates `rates`."""
        if not self.operators.exact:
            self.w = rates - self.push(self.pull(self.now[0]))

    def balance(self) -> bool:
        """Change the penalty by a factor two if the residuals ask for it; True when it did."""
        if max(self.primal, self.dual) <= IMBALANCE * min(self.primal, self.dual):
            return False
        self.gamma *= 2.0 if self.primal > self.dual else 0.5
        self.restart()
        return True


class _Linearised(_Exact):
    """Also velocities (m,) and multipliers (c,) of the constraints, third and fourth in `now` and `ahead`."""

    def __init__(self, *start: Any) -> None:
        super().__init__(*start)
        load = np.concatenate([self.data.f + self.pull(self.now[0]), self.data.k])
        self.now = [*self.now, self.operators.solver(constrained=True)(load), np.zeros(len(self.data.k))]
        self.restart()

    def velocity(self, target: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Proximal step from the extrapolated velocity, and what it extrapolates next."""
        v, multipliers = self.ahead[2:]
        beta = self.gamma * self.operators.coupling_bound
        load = self.data.f + beta * v + self.pull(target - self.gamma * self.push(v))
        C = self.operators.C
        if C is None:
            v = self.operators.solver(beta=beta)(load)
        else:
            load += C.T @ (multipliers - self.gamma * (C @ v - self.data.k))
            v = self.operators.solver(beta=beta)(load)
            multipliers = multipliers - self.gamma * (C @ v - self.data.k)
        return v, [v, multipliers]

    def extra_residual(self, fresh: list[np.ndarray]) -> float:
        """Moves of velocities and multipliers in the norm of the proximal term."""
        moves = [float(np.sum((new - old) ** 2)) for new, old in zip(fresh[2:], self.ahead[2:], strict=True)]
        return self.gamma * self.operators.coupling_bound * moves[0] + moves[1] / self.gamma
