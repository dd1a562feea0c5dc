"""Proximal nonsmooth Newton with sparse systems in velocity space: finishes what a central path brought near.

An outer step solves the problem with W + eps I and b - eps x_k (seed B Eq. 3.14 on the whole) by Newton's method on the
natural map (seed B 3.1.2, Eq. 1.29), as `_proximal_newton` does densely; eliminating forces leaves M + H^T K^-1 B H, and C.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numba import njit

from barchan.errors import InputError
from barchan.friction._proximal_newton import natural_map_at, rate_derivative
from barchan.friction.methods._newton_systems import added_in_corner, block_diagonal, bordered_mass
from barchan.friction.operators import Delassus
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder
from barchan.linalg.factor import sparse_solver

FIRST_TERM, SMALLEST_TERM, LARGEST_TERM = 1e-2, 1e-13, 1.0
SHRINK, GROW, FEW = 0.2, 5.0, 10
ACCURACY = 1e-2
INNER_STEPS = 40
SHORTEST_STEP, SUFFICIENT = 0.02, 2e-3
CLEAR_GAIN = 0.8


@njit(cache=True, error_model="numpy")
def _rate_derivatives(u: np.ndarray, laws: np.ndarray, jacobians: np.ndarray, out: np.ndarray) -> None:
    """B = P' (I + s') of every block into out (n, s, s)."""
    for i in range(len(u)):
        rate_derivative(u[i], laws[i], jacobians[i], out[i])


class VelocityNewton:
    """Equilibrated forces x = r / root, root = sqrt(rho), and the Newton systems of `problem`, which has M (bordered by C)."""

    def __init__(self, problem: Problem, delassus: Delassus) -> None:
        self.problem, self.delassus = problem, delassus
        n, s = problem.n, problem.s
        self.root = np.sqrt(problem.rho)[:, None]
        self.laws = problem.parameters.copy()
        self.laws[:, 1:3] /= self.root
        scale = sp.diags_array(np.repeat(self.root[:, 0], s))
        self.H = sp.csr_array(scale @ sp.csr_array(problem.H))
        self.border = bordered_mass(problem)
        self.f, self.active = np.empty((n, s)), np.empty(n, np.bool_)
        self.jacobians, self.products = np.empty((n, s, s)), np.empty((n, s, s))

    def finish(self, recorder: Recorder, r0: np.ndarray, limit: int) -> int:
        """Outer steps from `r0` (n, s), recorded, until solved or `limit` factorisations; how many there were."""
        x, term, used = r0 / self.root, FIRST_TERM, 0
        residual = self._law_residual(x)
        if recorder.record(0, residual, r0):
            return 0
        while used < limit:
            square = self._measure(x, self._rates(x))
            goal = ACCURACY**2 * square
            trial, square, made = self._solve(x, term, goal, min(INNER_STEPS, limit - used))
            used += max(made, 1)
            if not math.isfinite(square):
                term = min(GROW * term, LARGEST_TERM)
                continue
            following = self._law_residual(trial)
            if recorder.record(used, following, self.root * trial):
                return used
            # A solved proximal step is taken even uphill: the residual is no merit function of the non-associated problem.
            if square <= goal or following < CLEAR_GAIN * residual:
                x, residual = trial, following
            if square > goal:
                term = min(GROW * term, LARGEST_TERM)
            elif made <= FEW:
                term = max(SHRINK * term, SMALLEST_TERM)
        return used

    def _rates(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(self.root * (self.delassus.apply(self.root * x) + self.delassus.b))

    def _law_residual(self, x: np.ndarray) -> float:
        return law_residual(self.problem, self.root * x, self._rates(x) / self.root)[0]

    def _measure(self, x: np.ndarray, u: np.ndarray) -> float:
        square = float(natural_map_at(u, self.laws, x, self.f, self.jacobians, self.active))
        _rate_derivatives(u, self.laws, self.jacobians, self.products)
        return square

    def _solve(
        self, center: np.ndarray, term: float, goal: float, limit: int
    ) -> tuple[np.ndarray, float, int]:
        """Newton on one proximal problem from its centre: (x, |F|^2, factorisations); |F|^2 infinite where it broke down."""
        x, rates = center, self._rates(center)
        square, made = self._measure(x, rates), 0
        while made < limit and square > goal:
            direction = self._direction(term)
            made += 1
            if direction is None:
                return center, math.inf, made
            slope = self._rates(x + direction) - rates
            length = 1.0
            while True:
                trial, after = x + length * direction, rates + length * slope
                following = self._measure(trial, after + term * (trial - center))
                if following <= (1.0 - SUFFICIENT * length) * square or length < SHORTEST_STEP:
                    break
                length *= 0.5
            if not math.isfinite(following):
                return center, math.inf, made
            x, rates, square = trial, after, following
        return x, square, made

    def _direction(self, term: float) -> np.ndarray | None:
        """dx of K dx + B H dv = -F, M dv = H^T dx + C^T l, C dv = 0, K = I - P' + term B; None where that is singular."""
        try:
            inverse = np.linalg.inv(np.eye(self.problem.s) - self.jacobians + term * self.products)
        except np.linalg.LinAlgError:
            return None
        moved = -np.einsum("iab,ib->ia", inverse, self.f)
        compliance = block_diagonal(inverse @ self.products)
        matrix = added_in_corner(self.border, self.H.T @ (compliance @ self.H))
        if not np.isfinite(matrix.data).all():
            return None
        try:
            load = np.zeros(matrix.shape[0])
            load[: self.problem.size] = self.H.T @ moved.reshape(-1)
            velocities = sparse_solver(matrix, "M", positive=False)(load)[: self.problem.size]
        except InputError:
            return None
        return np.asarray(moved - (compliance @ (self.H @ velocities)).reshape(moved.shape))
