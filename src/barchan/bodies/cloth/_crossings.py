"""Where a surface of triangles cuts itself: edges against triangles that share no vertex, and against those that share one."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.cloth._broad import close_triangles
from barchan.bodies.contact._vectors import Vec, cross, dot, row, sub

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

ROUNDING = (
    1e-9  # distance of a point from a plane over the length of the segment it ends, that counts as none
)


def crossing_pair(vertices: Vector, triangles: Whole) -> tuple[int, int] | None:
    """Numbers of two triangles that cut each other, or None; neighbours across an edge are not looked at."""
    pairs = close_triangles(vertices, triangles, 0.0)
    found = int(_first_crossing(vertices, triangles, pairs))
    return None if found < 0 else (int(pairs[found, 0]), int(pairs[found, 1]))


@njit(cache=True)
def _first_crossing(vertices: Vector, triangles: Whole, pairs: Whole) -> int:
    for k in range(pairs.shape[0]):
        one, two = pairs[k, 0], pairs[k, 1]
        if _cuts(vertices, triangles, one, two) or _cuts(vertices, triangles, two, one):
            return k
    return -1


@njit(cache=True)
def _cuts(vertices: Vector, triangles: Whole, one: int, two: int) -> bool:
    """Whether an edge of triangle `one` without a vertex in common with `two` goes through `two`."""
    for side in range(3):
        a, b = triangles[one, side], triangles[one, (side + 1) % 3]
        apart = True
        for corner in range(3):
            if triangles[two, corner] == a or triangles[two, corner] == b:
                apart = False
        if apart and pierces(
            row(vertices, a),
            row(vertices, b),
            row(vertices, triangles[two, 0]),
            row(vertices, triangles[two, 1]),
            row(vertices, triangles[two, 2]),
        ):
            return True
    return False


@njit(cache=True)
def pierces(a: Vec, b: Vec, p: Vec, q: Vec, r: Vec) -> bool:
    """Whether the segment ab goes through the triangle pqr, its ends off the plane by more than rounding."""
    normal = cross(sub(q, p), sub(r, p))
    line = sub(b, a)
    start, end = dot(normal, sub(a, p)), dot(normal, sub(b, p))
    rounding = ROUNDING * np.sqrt(dot(normal, normal) * dot(line, line))
    if start * end > 0.0 or min(abs(start), abs(end)) <= rounding:
        return False
    u = dot(line, cross(sub(p, a), sub(q, a)))
    v = dot(line, cross(sub(q, a), sub(r, a)))
    w = dot(line, cross(sub(r, a), sub(p, a)))
    return (u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)
