"""Kernels that put the pieces of bodies where the bodies are, and take the boxes about them."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import along, dot, put, row, sub, turn
from barchan.bodies.contact.arrays import PLANE, Cores

Array = NDArray[np.float64]


@njit(cache=True)
def turns_of(rotations: Array, turns: Array) -> None:
    """Matrices (b, 3, 3) of quaternions (b, 4) or of angles (b, 1) about the third axis."""
    for b in range(rotations.shape[0]):
        if rotations.shape[1] == 1:
            c, s = np.cos(rotations[b, 0]), np.sin(rotations[b, 0])
            turns[b, 0, 0], turns[b, 0, 1], turns[b, 0, 2] = c, -s, 0.0
            turns[b, 1, 0], turns[b, 1, 1], turns[b, 1, 2] = s, c, 0.0
            turns[b, 2, 0], turns[b, 2, 1], turns[b, 2, 2] = 0.0, 0.0, 1.0
            continue
        w, x, y, z = rotations[b, 0], rotations[b, 1], rotations[b, 2], rotations[b, 3]
        f = 2.0 / (w * w + x * x + y * y + z * z)
        turns[b, 0, 0], turns[b, 0, 1], turns[b, 0, 2] = (
            1.0 - f * (y * y + z * z),
            f * (x * y - w * z),
            f * (x * z + w * y),
        )
        turns[b, 1, 0], turns[b, 1, 1], turns[b, 1, 2] = (
            f * (x * y + w * z),
            1.0 - f * (x * x + z * z),
            f * (y * z - w * x),
        )
        turns[b, 2, 0], turns[b, 2, 1], turns[b, 2, 2] = (
            f * (x * z - w * y),
            f * (y * z + w * x),
            1.0 - f * (x * x + y * y),
        )


@njit(cache=True, parallel=True)
def place_cores(here: Cores, there: Cores, body: NDArray[np.int64], turns: Array, places: Array) -> None:
    """Write the corners, face normals and centres of the cores `here`, in the frames of their bodies, to the world `there`."""
    for g in prange(body.shape[0]):
        matrix, place = turns[body[g]], row(places, body[g])
        put(there.centre, g, along(place, 1.0, turn(matrix, row(here.centre, g))))
        for v in range(here.vertex_start[g], here.vertex_start[g + 1]):
            put(there.vertices, v, along(place, 1.0, turn(matrix, row(here.vertices, v))))
        for f in range(here.face_start[g], here.face_start[g + 1]):
            put(there.normals, f, turn(matrix, row(here.normals, f)))


@njit(cache=True, parallel=True)
def boxes(
    cores: Cores, kind: NDArray[np.int64], body: NDArray[np.int64], turns: Array, places: Array, lower: Array, upper: Array,
    margins: Array, drift: Array, swing: Array, middle: Array, half: Array, radius: Array,
) -> None:  # fmt: skip
    """Middle and half sides (g, 3) of the box about each piece in the world, and the radius of a ball about that middle.

    All are wider by the `margins` (b,) of the bodies. `drift` (b, 3) [m] is the way a body goes, `swing` (b,) [rad] the angle
    it turns meanwhile: box and ball hold the piece all along. `lower`, `upper` (g, 3) are boxes in the frames of the bodies.
    The radius of a plane is what its boundary moves by.
    """
    for g in prange(body.shape[0]):
        b, margin = body[g], margins[body[g]]
        first, last = cores.vertex_start[g], cores.vertex_start[g + 1]
        if last > first:
            for k in range(3):
                low = high = cores.vertices[first, k]
                for v in range(first + 1, last):
                    low, high = min(low, cores.vertices[v, k]), max(high, cores.vertices[v, k])
                middle[g, k], half[g, k] = 0.5 * (low + high), 0.5 * (high - low) + cores.radius[g]
            square = 0.0
            for v in range(first, last):
                way = sub(row(cores.vertices, v), row(middle, g))
                square = max(square, dot(way, way))
            radius[g] = np.sqrt(square) + cores.radius[g]
        else:
            for k in range(3):
                middle[g, k], half[g, k] = places[b, k], 0.0
                for j in range(3):
                    share = turns[b, k, j]
                    if abs(share) > 1e-12 and half[g, k] < np.inf:
                        if upper[g, j] - lower[g, j] < np.inf:
                            middle[g, k] += 0.5 * share * (lower[g, j] + upper[g, j])
                            half[g, k] += 0.5 * abs(share) * (upper[g, j] - lower[g, j])
                        else:
                            half[g, k] = np.inf
            radius[g] = np.sqrt(half[g, 0] ** 2 + half[g, 1] ** 2 + half[g, 2] ** 2)
        if kind[g] == PLANE:
            radius[g] = margin + np.sqrt(dot(row(drift, b), row(drift, b))) if swing[b] == 0.0 else np.inf
            continue
        arm = sub(row(middle, g), row(places, b))
        turned_way = swing[b] * (radius[g] + np.sqrt(dot(arm, arm))) if swing[b] > 0.0 else 0.0
        gone = row(drift, b)
        radius[g] += margin + 0.5 * np.sqrt(dot(gone, gone)) + turned_way
        for k in range(3):
            half[g, k] += margin + 0.5 * abs(drift[b, k]) + turned_way
            middle[g, k] += 0.5 * drift[b, k]
