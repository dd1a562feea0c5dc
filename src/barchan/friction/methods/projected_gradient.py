"""Projected gradient descent on the dual problem, and as a fixed point on the DCFP (seed B Algorithm 3.1).

Associated laws: line search on the quadratic model, the objective never increases. Others: De Saxce's or Alart-Curnier's
fixed point, step held by Khobotov's rule. Equilibrated unknowns; one product with W per trial, about 1.2 an iteration.
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._options import check_choice, check_counts, check_positive
from barchan.friction.methods._rhythm import Rhythm
from barchan.friction.methods._scaled import ScaledProblem, scaled_problem
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

DEFAULT_ITERATIONS = 50_000
FUNCTIONS = ("de-saxce", "alart-curnier")
SUFFICIENT = 0.1
GROWTH, CUT = 1.25, 0.5
LARGEST_RATIO, SMALL_RATIO = 0.9, 0.5
SAFE_FRACTION = 0.05


def projected_gradient(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    function: str = "de-saxce",
    step: float | None = None,
    operator: str = "auto",
    check_every: int = 5,
) -> None:
    """Iterate from `r0` (n, s), recording iterates every `check_every` iterations.

    Parameters
    ----------
    function : "de-saxce" projects r - step (u + s(u)) on the admissible set; "alart-curnier" projects its normal part on
    the half-line and its tangential part on the disc of the last r_N (seed B (1.27); admissible only in the limit).
    step : first step in equilibrated unknowns (None: 1 / L, L the bound on the scaled W); adapted afterwards.
    operator : see `barchan.friction.operators`.

    For associated laws (with "de-saxce") a step is taken when the quadratic model decreases by SUFFICIENT of its slope,
    which every step <= 1.8 / L does. Else a step xi is taken when xi |F(x') - F(x)| <= LARGEST_RATIO |x' - x|, F the
    rates with their shift (Khobotov 1987), or when it has shrunk to SAFE_FRACTION / L.

    Raises
    ------
    InputError : unknown function or operator; step or check_every not positive.
    """
    check_choice("function", function, FUNCTIONS)
    check_positive(step=step)
    check_counts(check_every=check_every)
    scaled = scaled_problem(problem, operator)
    search = _quadratic_search if scaled.associated and function == "de-saxce" else _ratio_search
    x = scaled.start(r0)
    u = scaled.rates(x)
    length = 1.0 / scaled.lipschitz if step is None else step
    limit = DEFAULT_ITERATIONS if max_iterations is None else max_iterations
    rhythm = Rhythm(scaled, recorder, check_every, limit)
    for iteration in range(limit + 1):
        if rhythm.ends(iteration, x, u):
            return
        x, u, length = search(scaled, x, u, length, function)


def _quadratic_search(
    scaled: ScaledProblem, x: np.ndarray, u: np.ndarray, step: float, function: str
) -> tuple[np.ndarray, np.ndarray, float]:
    """Next x and u, and the step to try next; Armijo's rule along the projection arc, without cancellation."""
    safe = 1.0 / scaled.lipschitz
    cut = False
    while True:
        fresh = scaled.project(x - step * u)
        rates = scaled.rates(fresh)
        move = fresh - x
        if step <= safe or _decreases(u, move, rates - u):
            return fresh, rates, step if cut else GROWTH * step
        step, cut = max(CUT * step, safe), True


def _decreases(u: np.ndarray, move: np.ndarray, change: np.ndarray) -> bool:
    """Whether x . W x / 2 + x . b falls by SUFFICIENT of its slope over `move`, `change` = W move."""
    slope = np.vdot(u, move)
    return bool(slope + 0.5 * np.vdot(move, change) <= SUFFICIENT * slope)


def _ratio_search(
    scaled: ScaledProblem, x: np.ndarray, u: np.ndarray, step: float, function: str
) -> tuple[np.ndarray, np.ndarray, float]:
    """Next x and u, and the step to try next; Khobotov's rule."""
    image = _alart_curnier if function == "alart-curnier" else _de_saxce
    force = _generalised_rates(scaled, u, function)
    safe = SAFE_FRACTION / scaled.lipschitz
    while True:
        fresh = image(scaled, x, force, step)
        rates = scaled.rates(fresh)
        move = float(np.linalg.norm(fresh - x))
        change = float(np.linalg.norm(_generalised_rates(scaled, rates, function) - force))
        ratio = step * change / move if move > 0.0 else 0.0
        if ratio <= LARGEST_RATIO or step <= safe:
            return fresh, rates, GROWTH * step if 0.0 < ratio < SMALL_RATIO else step
        step = max(CUT * step, safe)


def _generalised_rates(scaled: ScaledProblem, u: np.ndarray, function: str) -> np.ndarray:
    """u + s(u), or for Alart-Curnier the opening u_N - zeta |u_T| in place of u_N."""
    if function == "de-saxce":
        return scaled.shifted(u)
    out = u.copy()
    out[:, 0] -= scaled.laws[:, 3] * np.linalg.norm(u[:, 1:], axis=1)
    return out


def _de_saxce(scaled: ScaledProblem, x: np.ndarray, force: np.ndarray, step: float) -> np.ndarray:
    return scaled.project(x - step * force)


def _alart_curnier(scaled: ScaledProblem, x: np.ndarray, force: np.ndarray, step: float) -> np.ndarray:
    """Projection on the product of a half-line and the disc of radius sigma_S + mu x_N."""
    mu, shear, tension = scaled.laws[:, 0], scaled.laws[:, 1], scaled.laws[:, 2]
    radius = np.maximum(shear + mu * (x[:, 0] + tension), 0.0)
    out = x - step * force
    out[:, 0] = np.maximum(out[:, 0], -tension)
    length = np.linalg.norm(out[:, 1:], axis=1)
    scale = np.divide(radius, length, out=np.ones_like(length), where=length > radius)
    out[:, 1:] *= scale[:, None]
    return out
