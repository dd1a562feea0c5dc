"""Flexible GMRES (Saad 1993): the preconditioner may change from one application to the next, as multigrid cycles do.

The norm that is minimised may be weighted row by row, for systems whose equations have different units.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

Map: TypeAlias = Callable[[np.ndarray], np.ndarray]
EXHAUSTED = 1e-14
"""Part of a new direction outside of the span of the old ones, below which there is none."""


class KrylovResult(NamedTuple):
    """`x` (m,), `iterations` (applications of the preconditioner), `residual` relative to that of x = 0 (weighted norm)."""

    x: np.ndarray
    iterations: int
    residual: float


def flexible_gmres(
    apply: Map,
    precondition: Map,
    b: np.ndarray,
    gain: float,
    max_iterations: int,
    weights: np.ndarray | None = None,
    restart: int = 30,
) -> KrylovResult:
    """Solve A x = b (m,) from x = 0 until |W (b - A x)| <= gain |W b|, with W = diag(weights) or the identity.

    `apply` is x -> A x, `precondition` a guess at its inverse. Stops after `max_iterations` applications of the latter, or with
    the best x so far where the preconditioner returns numbers that are not finite.
    """

    def weigh(v: np.ndarray) -> np.ndarray:
        return v if weights is None else weights * v

    x, r = np.zeros_like(b), weigh(b)
    start = float(np.linalg.norm(r))
    if start == 0.0:
        return KrylovResult(x, 0, 0.0)
    total, norm = 0, start
    while total < max_iterations and norm > gain * start:
        steps = min(restart, max_iterations - total)
        guesses, coefficients, exhausted = _arnoldi(
            apply, precondition, weigh, weights, r, norm, gain * start, steps
        )
        total += len(guesses)
        for guess, coefficient in zip(guesses, coefficients, strict=True):
            x += coefficient * guess
        r = weigh(b - apply(x))
        norm = float(np.linalg.norm(r))
        if exhausted:
            break
    return KrylovResult(x, total, norm / start)


def _arnoldi(
    apply: Map, precondition: Map, weigh: Map, weights: np.ndarray | None, r: np.ndarray, norm: float, target: float,
    steps: int,
) -> tuple[list[np.ndarray], np.ndarray, bool]:  # fmt: skip
    """Preconditioned directions, their coefficients in the solution, and whether no further direction is of use.

    Stops where the (weighted) residual, `r` of size `norm` at first, falls to `target`, and where a direction is not finite.
    """
    basis, guesses = [r / norm], list[np.ndarray]()
    hessenberg, right = np.zeros((steps + 1, steps)), np.zeros(steps + 1)
    right[0] = norm
    coefficients: np.ndarray = np.zeros(0)
    for k in range(steps):
        guess = precondition(basis[k] if weights is None else basis[k] / weights)
        with np.errstate(invalid="ignore"):
            w = weigh(apply(guess))
        column, before = np.zeros(k + 2), float(np.linalg.norm(w))
        if not np.isfinite(before):
            return guesses, coefficients, True
        for _ in range(2):  # twice is enough (Kahan): the basis stays orthogonal
            for i in range(k + 1):
                h = float(basis[i] @ w)
                column[i] += h
                w -= h * basis[i]
        column[-1] = np.linalg.norm(w)
        guesses.append(guess)
        hessenberg[: k + 2, k] = column
        square = hessenberg[: k + 2, : k + 1]
        coefficients = np.asarray(np.linalg.lstsq(square, right[: k + 2], rcond=None)[0])
        if column[-1] <= EXHAUSTED * before:
            return guesses, coefficients, True
        if np.linalg.norm(right[: k + 2] - square @ coefficients) <= target:
            break
        basis.append(w / column[-1])
    return guesses, coefficients, False
