"""Accelerated spectral projected gradient, on the DCFP (d = -u - s(u)) or its convexification (seed B Algorithm B.2).

Forces are scaled block by block by sqrt(rho_i), which keeps the cones and equilibrates W. Cost of an iteration: one
product with W. Inertia by ERRATA 9.
"""

from __future__ import annotations

import math

import numpy as np

from barchan.friction._kernels import project_blocks
from barchan.friction.operators import Delassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 20_000
SMALLEST_STEP, LARGEST_STEP = 1e-6, 1e6
POWER_ITERATIONS = 12


def aspg(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    operator: str = "auto",
    check_every: int = 5,
    shift_every: int = 1,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    operator : "auto", "explicit" or "matrix-free" (see `barchan.friction.operators`).
    shift_every : iterations between updates of the De Saxce shift s(u); 1 is Algorithm B.2, more freezes a convex
    problem in between (Cadoux's fixed point, seed B 2.3.2, with inexact inner solves) and restarts the inertia.
    """
    scaled = _Scaled(problem, build_operator(problem, operator))
    x = scaled.project(r0 / scaled.root)
    u = scaled.rates(x)
    projected = x
    inertia = 1.0
    step = 1.0 / max(scaled.largest_eigenvalue(), 1e-300)
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    for iteration in range(limit + 1):
        last = iteration == limit
        if iteration % check_every == 0 or last:
            candidate = scaled.root * scaled.project(x)
            if recorder.record(iteration, scaled.residual(candidate), candidate) or last:
                return
        if iteration % shift_every == 0:
            shift = scaled.shift(u)
            if shift_every > 1:
                inertia = 1.0
        direction = -u
        direction[:, 0] -= shift
        fresh = scaled.project(x + step * direction)
        if np.vdot(fresh - projected, direction) > 0.0:
            inertia, beta = nesterov_inertia(inertia)
            following = fresh + beta * (fresh - projected)
        else:
            inertia, following = 1.0, fresh
        projected = fresh
        rates = scaled.rates(following)
        change = rates - u
        square = np.vdot(change, change)
        spectral = np.vdot(following - x, change) / square if square > 0.0 else step
        step = min(LARGEST_STEP, max(SMALLEST_STEP, spectral)) if spectral > 0.0 else SMALLEST_STEP
        x, u = following, rates


def nesterov_inertia(theta: float) -> tuple[float, float]:
    """(theta', beta) of ERRATA 9."""
    delta = theta * math.sqrt(theta * theta + 4.0)
    following = 0.5 * (delta - theta * theta)
    return following, theta * (1.0 - theta) / (theta * theta + following)


class _Scaled:
    """The problem in the unknowns x_i = r_i / sqrt(rho_i): rates sqrt(rho_i) u_i, admissible sets scaled alike."""

    def __init__(self, problem: Problem, delassus: Delassus) -> None:
        self.problem = problem
        self.delassus = delassus
        self.root = np.sqrt(problem.rho)[:, None]
        self.laws = problem.parameters.copy()
        self.laws[:, 1:3] /= self.root

    def rates(self, x: np.ndarray) -> np.ndarray:
        """sqrt(rho) (W r + b)."""
        return self.root * (self.delassus.apply(self.root * x) + self.delassus.b)

    def project(self, x: np.ndarray) -> np.ndarray:
        out = np.empty_like(x)
        project_blocks(x, self.laws, out)
        return out

    def shift(self, u: np.ndarray) -> np.ndarray:
        """Normal part (n,) of s(u)."""
        return np.asarray((self.laws[:, 0] - self.laws[:, 3]) * np.linalg.norm(u[:, 1:], axis=1))

    def residual(self, r: np.ndarray) -> float:
        """Law residual of forces r (n, s), in the certificate's definition."""
        return law_residual(self.problem, r, self.delassus.apply(r) + self.delassus.b)[0]

    def largest_eigenvalue(self) -> float:
        """Power-iteration estimate of the largest eigenvalue of the scaled W (deterministic start)."""
        x = np.cos(np.arange(self.problem.n * self.problem.s, dtype=float)).reshape(self.delassus.b.shape)
        value = 0.0
        for _ in range(POWER_ITERATIONS):
            value = float(np.linalg.norm(x))
            if value == 0.0:
                return 0.0
            x = self.root * self.delassus.apply(self.root * (x / value))
        return float(np.linalg.norm(x))
