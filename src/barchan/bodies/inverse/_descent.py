"""L-BFGS with a line search (Nocedal and Wright 2006, Alg. 7.4 and 7.5): for costly functions that may refuse a point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
MEMORY = 12
SUFFICIENT, SHORTEST, CURVED = 1e-4, 2.0**-12, 1e-10


def descend(
    value: Callable[[Vector], float],
    gradient: Callable[[], Vector],
    x: Vector,
    first: float,
    watch: Callable[[int, float, Vector], bool],
    most: int,
) -> Vector:
    """The best x (n,) found from `x` in at most `most` steps.

    value : of a point, infinite where there is none.  gradient : at the point whose value was asked last.
    first : length of the first step over the gradient.  watch : (step, value, x) after each; True ends.
    """
    before = value(x)
    if not np.isfinite(before) or watch(0, before, x):
        return x
    slope = gradient()
    pairs: list[tuple[Vector, Vector]] = []
    for step in range(1, most + 1):
        direction = _direction(slope, pairs, first)
        along = float(slope @ direction)
        if along >= 0.0:
            pairs.clear()
            direction = -first * slope
            along = float(slope @ direction)
        length, found = 1.0, value(x + direction)
        while not found <= before + SUFFICIENT * length * along:
            length *= 0.5
            if length < SHORTEST:
                return x
            found = value(x + length * direction)
        following = gradient()
        moved, turned = length * direction, following - slope
        if float(moved @ turned) > CURVED * float(moved @ moved) / first:
            pairs = [*pairs, (moved, turned)][-MEMORY:]
        x, before, slope = x + moved, found, following
        if watch(step, before, x):
            return x
    return x


def _direction(slope: Vector, pairs: list[tuple[Vector, Vector]], first: float) -> Vector:
    """Minus the inverse Hessian of the pairs times the slope, by two loops."""
    q, weights = slope.copy(), []
    for moved, turned in reversed(pairs):
        weight = float(moved @ q) / float(moved @ turned)
        weights.append(weight)
        q -= weight * turned
    if pairs:
        moved, turned = pairs[-1]
        q *= float(moved @ turned) / float(turned @ turned)
    else:
        q *= first
    for (moved, turned), weight in zip(pairs, reversed(weights), strict=True):
        q += (weight - float(turned @ q) / float(moved @ turned)) * moved
    return -q
