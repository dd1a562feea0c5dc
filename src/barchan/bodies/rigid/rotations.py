"""Rotations: unit quaternions (w, x, y, z) in space, angles in the plane (seed B, 2.1.1, Eq. 2.1).

A rotation is an array (4,) in 3D and (1,) in 2D; its matrix R (d, d) takes body coordinates to world coordinates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError

UNIT_TOLERANCE = 1e-6  # quaternions this close to unit length are accepted, and made unit


def identity(dimension: int) -> NDArray[np.float64]:
    """The rotation that does nothing: (1, 0, 0, 0) in 3D, (0,) in 2D."""
    return np.array([1.0, 0.0, 0.0, 0.0]) if dimension == 3 else np.zeros(1)


def as_rotation(field: str, value: ArrayLike | None, dimension: int) -> NDArray[np.float64]:
    """Rotation from a unit quaternion, a rotation matrix (3, 3) or, in the plane, an angle; None is the identity."""
    if value is None:
        return identity(dimension)
    allowed = "an angle [rad]" if dimension == 2 else "a unit quaternion (w, x, y, z) or a rotation matrix"
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if not np.all(np.isfinite(array)):
        raise InputError(field, value, allowed)
    if dimension == 2:
        if array.size != 1:
            raise InputError(field, value, allowed)
        return array.reshape(1)
    if array.shape == (3, 3):
        near = np.allclose(array @ array.T, np.eye(3), atol=UNIT_TOLERANCE)
        if not near or np.linalg.det(array) < 0.0:
            raise InputError(field, value, allowed)
        return quaternion_of(array)
    length = float(np.linalg.norm(array))
    if array.shape != (4,) or abs(length - 1.0) > UNIT_TOLERANCE:
        raise InputError(field, value, allowed)
    unit: NDArray[np.float64] = array / length
    return unit


def matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix R (d, d) of a rotation."""
    if rotation.size == 1:
        c, s = np.cos(rotation[0]), np.sin(rotation[0])
        return np.array([[c, -s], [s, c]])
    w, x, y, z = rotation / np.linalg.norm(rotation)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation_matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternion of a rotation matrix (3, 3), with w >= 0: the eigenvector of Bar-Itzhack's symmetric matrix."""
    r = rotation_matrix
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], 0.0, 0.0, 0.0],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0.0],
            [r[1, 0] - r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    unit: NDArray[np.float64] = np.linalg.eigh(k, UPLO="L")[1][:, -1]
    return -unit if unit[0] < 0.0 else unit


def product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation b followed by rotation a."""
    if a.size == 1:
        return a + b
    aw, ax, ay, az = a.tolist()
    bw, bx, by, bz = b.tolist()
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
        ]
    )


def inverse(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """The opposite rotation."""
    return -rotation if rotation.size == 1 else rotation * np.array([1.0, -1.0, -1.0, -1.0])


def exponential(rotation_vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation by |v| around v, world frame (3,) or (1,): exact for a spin that keeps its direction (seed B, 2.1.1)."""
    if rotation_vector.size == 1:
        return rotation_vector.copy()
    angle = float(np.linalg.norm(rotation_vector))
    # np.sinc(x) = sin(pi x) / (pi x), which is well defined at rest
    return np.concatenate([[np.cos(0.5 * angle)], 0.5 * np.sinc(0.5 * angle / np.pi) * rotation_vector])


def logarithm(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shortest rotation vector (3,) or (1,) whose exponential is `rotation`; angles in the plane are kept as they are."""
    if rotation.size == 1:
        return rotation.copy()
    q = -rotation if rotation[0] < 0.0 else rotation
    length = float(np.linalg.norm(q[1:]))
    if length == 0.0:
        return np.zeros(3)
    vector: NDArray[np.float64] = 2.0 * np.arctan2(length, q[0]) / length * q[1:]
    return vector


def turned(rotation: NDArray[np.float64], spin: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    """`rotation` after `dt` seconds of the constant world spin `spin`; quaternions stay of unit length."""
    turned_rotation = product(exponential(dt * spin), rotation)
    if turned_rotation.size == 4:
        turned_rotation /= np.linalg.norm(turned_rotation)
    return turned_rotation
