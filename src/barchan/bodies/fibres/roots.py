"""How the ends of fibres are held, and how what holds them moves: for all models of fibres (seed B, 4.2).

An end has a position and a frame. The columns of a frame (3, 3) are the tangent of the fibre, from root to tip, and its two
material directions: a rotation matrix, so that a rigid rotation Q takes the frame F to Q F.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import Prescribed, rotations
from barchan.errors import InputError

Vector = NDArray[np.float64]
Hold = Literal["clamped", "ball", "free"]
RigidMotion = Prescribed | Callable[[float], tuple[ArrayLike, ArrayLike]]

_FRAME_TOLERANCE = 1e-6  # frames this close to orthonormal are accepted, and made orthonormal


class RootMotion(Protocol):
    """Given motion of one end of f fibres."""

    @property
    def hold(self) -> Hold:
        """ "clamped": position and frame are given; "ball": the position; "free": nothing, they only start there."""

    def __len__(self) -> int:
        """Number of fibres f."""

    def at(self, time: float) -> tuple[Vector, Vector]:
        """Positions (f, 3) [m] and frames (f, 3, 3) at `time` [s]."""

    def velocities(self, time: float, dt: float) -> tuple[Vector, Vector]:
        """Linear velocities (f, 3) [m/s] and spins (f, 3) [rad/s], constant, that lead from `time` to `time` + `dt`."""


@dataclass(frozen=True, eq=False)
class StillRoots:
    """Ends that stay where they are.

    positions : (f, 3) [m]; frames : (f, 3, 3), or one (3, 3) for all; see `frames_along`.
    hold : "clamped", "ball" or "free".
    """

    positions: Vector
    frames: Vector
    hold: Hold = "clamped"

    def __post_init__(self) -> None:
        positions, frames = _checked(self.positions, self.frames, self.hold)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "frames", frames)

    def __len__(self) -> int:
        return len(self.positions)

    def at(self, time: float) -> tuple[Vector, Vector]:
        """Positions (f, 3) [m] and frames (f, 3, 3): the same at all times."""
        return self.positions.copy(), self.frames.copy()

    def velocities(self, time: float, dt: float) -> tuple[Vector, Vector]:
        """Zeros (f, 3) and (f, 3)."""
        return np.zeros_like(self.positions), np.zeros_like(self.positions)


@dataclass(frozen=True, eq=False)
class MovingRoots:
    """Ends on one moving rigid body.

    positions, frames : where they are at the time `start`, as for `StillRoots`.
    motion : `bodies.rigid.Prescribed` in space, or a function of the time [s] that gives a position (3,) [m] and a rotation:
        a unit quaternion (w, x, y, z) or a matrix (3, 3). Only its changes since `start` matter; it turns about its position.
    """

    positions: Vector
    frames: Vector
    motion: RigidMotion
    hold: Hold = "clamped"
    start: float = 0.0
    _first: tuple[Vector, Vector] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions, frames = _checked(self.positions, self.frames, self.hold)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "frames", frames)
        if not callable(self.motion) and not isinstance(self.motion, Prescribed):
            raise InputError("roots.motion", self.motion, "a Prescribed motion, or a function of the time")
        if isinstance(self.motion, Prescribed) and self.motion.dimension != 3:
            raise InputError(
                "roots.motion", self.motion.positions.shape, "a motion in space, positions (m, 3)"
            )
        object.__setattr__(self, "_first", self.placement(self.start))

    def __len__(self) -> int:
        return len(self.positions)

    def placement(self, time: float) -> tuple[Vector, Vector]:
        """Position (3,) [m] and unit quaternion (4,) of the moving body."""
        if isinstance(self.motion, Prescribed):
            turn = self.motion.rotation_at(time)
            return self.motion.position_at(time), rotations.identity(3) if turn is None else turn
        given_position, given_turn = self.motion(time)
        position = np.array(given_position, dtype=np.float64)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise InputError(
                "roots.motion", position.tolist(), "a function whose position is three finite numbers"
            )
        return position, rotations.as_rotation("roots.motion", given_turn, 3)

    def at(self, time: float) -> tuple[Vector, Vector]:
        """Positions (f, 3) [m] and frames (f, 3, 3) at `time` [s]."""
        origin, first = self._first
        position, turn = self.placement(time)
        change = rotations.matrix(rotations.product(turn, rotations.inverse(first)))
        return position + (self.positions - origin) @ change.T, change @ self.frames

    def velocities(self, time: float, dt: float) -> tuple[Vector, Vector]:
        """Constant linear velocities (f, 3) [m/s] and spins (f, 3) [rad/s] over a step; less than half a turn in it."""
        before, after = self.placement(time)[1], self.placement(time + dt)[1]
        spin = rotations.logarithm(rotations.product(after, rotations.inverse(before))) / dt
        linear = (self.at(time + dt)[0] - self.at(time)[0]) / dt
        return linear, np.tile(spin, (len(self), 1))


def frames_along(tangents: ArrayLike, normal: ArrayLike | None = None) -> Vector:
    """Frames (f, 3, 3) with these tangents (f, 3), of any length, and the first material direction nearest to `normal`.

    normal : (3,) or (f, 3); default: for each tangent the axis least along it. Raises InputError when it is along a tangent.
    """
    along = np.atleast_2d(np.array(tangents, dtype=np.float64))
    if along.ndim != 2 or along.shape[1] != 3 or not np.all(np.isfinite(along)):
        raise InputError("tangents", along.shape, "finite vectors (f, 3)")
    lengths = np.linalg.norm(along, axis=1)
    if np.any(lengths == 0.0):
        raise InputError("tangents", int(np.argmin(lengths)), "not zero: this one is")
    along /= lengths[:, None]
    if normal is None:
        near = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    else:
        near = np.broadcast_to(np.array(normal, dtype=np.float64), along.shape)
    first = near - np.sum(near * along, axis=1)[:, None] * along
    sizes = np.linalg.norm(first, axis=1)
    if not np.all(sizes > 1e-9 * np.linalg.norm(near, axis=1)):
        raise InputError("normal", np.asarray(normal).tolist(), "finite, and not along a tangent")
    first /= sizes[:, None]
    return np.stack([along, first, np.cross(along, first)], axis=2)


def _checked(positions: ArrayLike, frames: ArrayLike, hold: str) -> tuple[Vector, Vector]:
    """Positions (f, 3) and frames (f, 3, 3) as arrays of their own; raises InputError."""
    if hold not in get_args(Hold):
        raise InputError("roots.hold", hold, " or ".join(get_args(Hold)))
    points = np.ascontiguousarray(np.atleast_2d(np.array(positions, dtype=np.float64)))
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or not np.all(np.isfinite(points)):
        raise InputError("roots.positions", points.shape, "finite positions (f, 3), one at least")
    given = np.array(frames, dtype=np.float64)
    turns = np.tile(given, (len(points), 1, 1)) if given.shape == (3, 3) else given
    if turns.shape != (len(points), 3, 3) or not np.all(np.isfinite(turns)):
        raise InputError("roots.frames", given.shape, f"finite frames ({len(points)}, 3, 3), or one for all")
    off = np.max(np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)), axis=(1, 2))
    wrong = (off > _FRAME_TOLERANCE) | (np.linalg.det(turns) < 0.0)
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise InputError("roots.frames", turns[k].tolist(), f"a rotation matrix; frame {k} is not")
    left, _, right = np.linalg.svd(turns)
    return points, cast(Vector, np.ascontiguousarray(left @ right))
