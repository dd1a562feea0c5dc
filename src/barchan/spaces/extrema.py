"""Where a field given at points is extreme, to second order: a parabola through the points around the greatest value."""

from __future__ import annotations

import numpy as np

NEAR = 9
"""Points through which the parabola goes."""


def greatest(places: np.ndarray, values: np.ndarray) -> tuple[tuple[float, float], float]:
    """Place and value of the greatest |value| of values (n,) at places (n, 2) of the plane."""
    best = int(np.argmax(np.abs(values)))
    near = np.argsort(np.sum((places - places[best]) ** 2, axis=1))[:NEAR]
    x, y = (places[near] - places[best]).T
    columns = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    c = np.linalg.lstsq(columns, values[near], rcond=None)[0]
    curvature = np.array([[2.0 * c[3], c[4]], [c[4], 2.0 * c[5]]])
    if abs(np.linalg.det(curvature)) < 1e-12 * max(abs(values[best]), 1e-300):
        return (float(places[best, 0]), float(places[best, 1])), float(values[best])
    shift = np.linalg.solve(curvature, -c[1:3])
    if np.linalg.norm(shift) > float(np.sqrt(x * x + y * y).max()):  # a flat top: the parabola says nothing
        shift = np.zeros(2)
    place = places[best] + shift
    value = c[0] + c[1:3] @ shift + 0.5 * shift @ curvature @ shift
    return (float(place[0]), float(place[1])), float(value)
