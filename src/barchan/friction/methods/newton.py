"""Global nonsmooth Newton with line search on a complementarity function: Alart-Curnier, De Saxce, Fischer-Burmeister.

Seed B 3.1.2: all blocks at once, J dr = -g with J an element of the generalised Jacobian, step length by backtracking on
|g|^2; a projected step of the fixed point where J is singular or gives no descent. One function for each entry of METHODS.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder
from barchan.linalg.factor import sparse_solver

DEFAULT_ITERATIONS = 300
LARGEST_DENSE = 300
HALVINGS = 12
SUFFICIENT = 1e-4
PROXIMAL = 1e-10


def _newton(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None,
    function: str,
    line_search: bool,
) -> None:
    if function == "fischer_burmeister" and problem.parameters[:, 1].any():
        raise InputError("law", "with a shear yield", "a cone for the Fischer-Burmeister function")
    system = _System(problem, function)
    r = r0.copy()
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    for iteration in range(limit + 1):
        u = system.rates(r)
        if recorder.record(iteration, law_residual(problem, r, u)[0], r) or iteration == limit:
            return
        direction = system.direction(u, r)
        r = system.advance(r, u, direction, line_search)


class _System:
    """g(r), its Newton direction and the line search, in forces scaled by 1 / sqrt(rho)."""

    def __init__(self, problem: Problem, function: str) -> None:
        self.problem = problem
        delassus = build_operator(problem, "explicit")
        assert isinstance(delassus, StoredDelassus)
        self.delassus = delassus
        self.value: Callable[..., np.ndarray] = getattr(problem.law, function)
        self.slopes: Callable[..., tuple[np.ndarray, np.ndarray]] = getattr(
            problem.law, function + "_jacobian"
        )
        self.root = np.sqrt(problem.rho)[:, None]
        matrix = sp.csr_array(delassus.rows.matrix())
        self.dense = matrix.shape[0] <= LARGEST_DENSE
        self.matrix = matrix.toarray() if self.dense else matrix

    def rates(self, r: np.ndarray) -> np.ndarray:
        """u = W r + b."""
        return np.asarray(self.delassus.apply(r) + self.delassus.b)

    def merit(self, r: np.ndarray, u: np.ndarray) -> float:
        """|g|, blocks scaled by 1 / sqrt(rho)."""
        return float(np.linalg.norm(self.value(u, r, self.problem.rho) / self.root))

    def direction(self, u: np.ndarray, r: np.ndarray) -> np.ndarray | None:
        """-J^-1 g (n, s), or None where J is singular."""
        n, s = r.shape
        value = self.value(u, r, self.problem.rho)
        by_u, by_r = self.slopes(u, r, self.problem.rho)
        by_r = by_r + np.sign(np.einsum("iaa->i", by_r) + 1e-300)[:, None, None] * PROXIMAL * np.eye(s)
        pointers = np.arange(n + 1)
        left = sp.csr_array(sp.bsr_array((by_u, pointers[:-1], pointers), shape=(n * s, n * s)))
        added = sp.csr_array(sp.bsr_array((by_r, pointers[:-1], pointers), shape=(n * s, n * s)))
        scale = np.repeat(self.root[:, 0], s)
        g = (value / self.root).reshape(-1)
        if self.dense:
            jacobian = (left @ self.matrix + added.toarray()) * scale[None, :] / scale[:, None]
            try:
                step = np.linalg.solve(jacobian, -g)
            except np.linalg.LinAlgError:
                return None
        else:
            sparse = sp.diags_array(1.0 / scale) @ (left @ self.matrix + added) @ sp.diags_array(scale)
            try:
                step = sparse_solver(sp.csr_array(sparse), "W", positive=False)(-g)
            except InputError:
                return None
        return (scale * step).reshape(n, s) if np.isfinite(step).all() else None

    def advance(
        self, r: np.ndarray, u: np.ndarray, direction: np.ndarray | None, line_search: bool
    ) -> np.ndarray:
        """The next forces: along the direction, or by the fixed point r <- P(r - rho (u + s(u))) where that fails."""
        fixed_point = self.problem.law.project(
            r - self.problem.rho[:, None] * (u + self.problem.law.shift(u))
        )
        if direction is None:
            return fixed_point
        if not line_search:
            return r + direction
        merit, length = self.merit(r, u), 1.0
        for _ in range(HALVINGS):
            trial = r + length * direction
            if self.merit(trial, self.rates(trial)) <= (1.0 - SUFFICIENT * length) * merit:
                return trial
            length *= 0.5
        return fixed_point


def _method(function: str, name: str) -> Callable[..., None]:
    def run(
        problem: Problem,
        recorder: Recorder,
        r0: np.ndarray,
        max_iterations: int | None = None,
        line_search: bool = True,
    ) -> None:
        _newton(problem, recorder, r0, max_iterations, function, line_search)

    run.__name__ = run.__qualname__ = name
    run.__doc__ = f"""Newton on `Law.{function}` from `r0` (n, s); W is stored.

    line_search : False takes full steps always.  Cost of an iteration: one factorisation of n s unknowns, dense up to
    LARGEST_DENSE of them, else sparse.
    """
    return run


newton_alart_curnier = _method("alart_curnier", "newton_alart_curnier")
newton_de_saxce = _method("natural_map", "newton_de_saxce")
newton_fischer_burmeister = _method("fischer_burmeister", "newton_fischer_burmeister")
