"""Rotations of many bodies at once: (k, 4) unit quaternions in space, (k, 1) angles in the plane (seed B, 2.1.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def matrices(rotations: Vector) -> Vector:
    """(k, d, d) matrices that take the frames of the shapes to the world."""
    if rotations.shape[1] == 1:
        c, s = np.cos(rotations[:, 0]), np.sin(rotations[:, 0])
        return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    w, x, y, z = (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def turned(rotations: Vector, spins: Vector, dt: float) -> Vector:
    """The rotations after `dt` seconds of constant world spins (k, 3) or (k, 1), by the exponential."""
    if rotations.shape[1] == 1:
        return rotations + dt * spins
    vectors = dt * spins
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    # np.sinc(x) = sin(pi x) / (pi x), which is well defined at rest
    turn = np.concatenate([np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * vectors], axis=1)
    aw, ax, ay, az = turn.T
    bw, bx, by, bz = rotations.T
    product = np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
        ],
        axis=1,
    )
    return product / np.linalg.norm(product, axis=1, keepdims=True)
