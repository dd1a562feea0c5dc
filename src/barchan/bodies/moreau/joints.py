"""Joints as bilateral rows C v = k of a step (seed B, 2.1.1 and 2.2.2): the relative motion that a joint forbids.

Every joint is made of anchors and axes in the frames of the shapes of two bodies. Its rows hold in velocity; the share
`joint_recovery` of its error in place is taken back in every step, so errors stay of second order in the step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.moreau import frames
from barchan.bodies.moreau.table import BodyTable
from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placed:
    """A pair of bodies as a joint sees it: anchors (2, d) and turns (2, d, d) in the world."""

    anchors: Vector
    turns: Vector


@dataclass(frozen=True, eq=False)
class Joint(ABC):
    """A joint of the bodies number `first` and `second`.

    anchor : (d,) [m] in the world where the bodies start.
    """

    first: int
    second: int
    anchor: ArrayLike

    @abstractmethod
    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """Directions (q, d) of relative translation at the anchor, (q, s) of relative spin that vanish, errors (q,)."""


@dataclass(frozen=True, eq=False)
class BallJoint(Joint):
    """The anchors stay together; in the plane a pin."""

    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """d rows."""
        d = now.anchors.shape[1]
        return np.eye(d), np.zeros((d, _spins(d))), now.anchors[0] - now.anchors[1]


@dataclass(frozen=True, eq=False)
class FixedJoint(Joint):
    """The bodies move as one."""

    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """d + s rows."""
        d = now.anchors.shape[1]
        s = _spins(d)
        along = np.concatenate([np.eye(d), np.zeros((s, d))])
        around = np.concatenate([np.zeros((d, s)), np.eye(s)])
        return along, around, np.concatenate([now.anchors[0] - now.anchors[1], _turn_error(start, now)])


@dataclass(frozen=True, eq=False)
class Hinge(Joint):
    """In space: the anchors stay together and the bodies turn about one common axis (3,)."""

    axis: ArrayLike = (0.0, 0.0, 1.0)

    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """5 rows."""
        if now.anchors.shape[1] != 3:
            raise InputError("joint", "Hinge", "in space; in the plane a BallJoint is a pin")
        across = contact_frames(_unit("joint.axis", self.axis)[None])[0, 1:]
        across = across @ start.turns[1] @ now.turns[1].T  # carried along by the second body
        along = np.concatenate([np.eye(3), np.zeros((2, 3))])
        around = np.concatenate([np.zeros((3, 3)), across])
        return (
            along,
            around,
            np.concatenate([now.anchors[0] - now.anchors[1], across @ _turn_error(start, now)]),
        )


@dataclass(frozen=True, eq=False)
class Slider(Joint):
    """The bodies do not turn relative to each other and slide along one axis (d,)."""

    axis: ArrayLike = (1.0, 0.0, 0.0)

    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """d - 1 + s rows."""
        d = now.anchors.shape[1]
        s = _spins(d)
        axis = np.asarray(self.axis, dtype=np.float64)[:d]
        across = contact_frames(_unit("joint.axis", axis)[None])[0, 1:] @ start.turns[1] @ now.turns[1].T
        along = np.concatenate([across, np.zeros((s, d))])
        around = np.concatenate([np.zeros((d - 1, s)), np.eye(s)])
        apart = across @ (now.anchors[0] - now.anchors[1])
        return along, around, np.concatenate([apart, _turn_error(start, now)])


@dataclass(frozen=True, eq=False)
class DistanceJoint(Joint):
    """The anchor on `first` and `second_anchor` on the other stay at their distance: a massless rod."""

    second_anchor: ArrayLike = ()

    def rows(self, start: Placed, now: Placed) -> tuple[Vector, Vector, Vector]:
        """One row."""
        d = now.anchors.shape[1]
        apart = now.anchors[0] - now.anchors[1]
        length = float(np.linalg.norm(apart))
        rest = float(np.linalg.norm(start.anchors[0] - start.anchors[1]))
        if rest == 0.0:
            raise InputError(
                "joint.second_anchor", self.second_anchor, "away from the first (or use a BallJoint)"
            )
        return (apart / length)[None], np.zeros((1, _spins(d))), np.array([length - rest])


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of a table of bodies, and where they were at the start.

    Raises InputError for a joint of a body that does not exist, of one body with itself, or of two driven ones.
    """

    joints: tuple[Joint, ...]
    table: BodyTable
    start: tuple[Placed, ...]
    local: tuple[Vector, ...]

    @classmethod
    def of(cls, joints: Sequence[Joint], table: BodyTable) -> Joints:
        """Joints that hold where the bodies start."""
        states = BodyStates.at_start(table.bodies)
        local = []
        for joint in joints:
            pair = (joint.first, joint.second)
            if not all(0 <= number < len(table) for number in pair) or joint.first == joint.second:
                raise InputError("joint", pair, f"two different numbers below {len(table)}")
            if np.all(table.driven[list(pair)]):
                raise InputError("joint", pair, "of bodies of which one at least is free")
            ends = [joint.anchor, getattr(joint, "second_anchor", None) or joint.anchor]
            turn = frames.matrices(states.rotations[list(pair)])
            places = np.stack([_place("joint.anchor", end, table.dimension) for end in ends])
            local.append(np.einsum("kji,kj->ki", turn, places - states.positions[list(pair)]))
        made = cls(tuple(joints), table, (), tuple(local))
        start = tuple(made._placed(number, states) for number in range(len(joints)))
        return cls(made.joints, table, start, made.local)

    def __len__(self) -> int:
        return len(self.joints)

    def rows(
        self, states: BodyStates, dt: float, recovery: float
    ) -> tuple[sp.csr_array, Vector, float] | None:
        """C (c, 2 k_b d), k (c,) and the largest error; None without joints."""
        if not self.joints:
            return None
        d, width = self.table.dimension, 2 * len(self.table) * self.table.dimension
        axes = self.table.spin_axes(states) if d == 3 else None
        placed = [self._placed(number, states) for number in range(len(self.joints))]
        bodies = np.array([(joint.first, joint.second) for joint in self.joints])
        anchors = np.array([now.anchors for now in placed]).reshape(-1, d)
        moving = self.table.columns(bodies.reshape(-1), anchors, states).reshape(-1, 2, 2, d, d)
        parts, errors = [], []
        for number, (joint, now) in enumerate(zip(self.joints, placed, strict=True)):
            along, around, error = joint.rows(self.start[number], now)
            ends = []
            for side, (body, sign) in enumerate(((joint.first, 1.0), (joint.second, -1.0))):
                own = np.einsum("qi,bij->qbj", along, moving[number, side])
                own[:, 1, : around.shape[1]] += around @ (axes[body] if axes is not None else np.eye(1))
                ends.append(sign * own.reshape(len(error), -1))
            parts.append(np.concatenate(ends, axis=1))
            errors.append(error)
        wrong = np.concatenate(errors)
        matrix = _in_columns(
            np.concatenate(parts), np.repeat(bodies, [len(part) for part in parts], axis=0), width
        )
        return matrix, -recovery * wrong / dt, float(np.max(np.abs(wrong), initial=0.0))

    def _placed(self, number: int, states: BodyStates) -> Placed:
        joint = self.joints[number]
        pair = [joint.first, joint.second]
        turns = frames.matrices(states.rotations[pair])
        anchors = states.positions[pair] + np.einsum("kij,kj->ki", turns, self.local[number])
        return Placed(anchors, turns)


def _in_columns(values: Vector, pairs: NDArray[np.int64], width: int) -> sp.csr_array:
    """C (c, width) of rows (c, 4 d), the first half in the columns of the first body of `pairs` (c, 2)."""
    own = values.shape[1] // 2
    columns = (own * pairs[:, :, None] + np.arange(own)).reshape(-1)
    starts = 2 * own * np.arange(len(pairs) + 1)
    matrix = sp.csr_array((values.reshape(-1), columns, starts), shape=(len(pairs), width))
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def _turn_error(start: Placed, now: Placed) -> Vector:
    """Rotation vector of the turn of the first body relative to the second since the start; small angles."""
    first, second = (now.turns[side] @ start.turns[side].T for side in (0, 1))
    turn = first @ second.T
    if len(turn) == 2:
        return np.array([np.arctan2(turn[1, 0], turn[0, 0])])
    return 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def _spins(d: int) -> int:
    return 3 if d == 3 else 1


def _unit(field: str, value: ArrayLike) -> Vector:
    vector = np.asarray(value, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0.0:
        raise InputError(field, value, "a finite vector that is not zero")
    return vector / length


def _place(field: str, value: ArrayLike, d: int) -> Vector:
    place = np.asarray(value, dtype=np.float64)
    if place.shape != (d,) or not np.all(np.isfinite(place)):
        raise InputError(field, value, f"{d} finite coordinates")
    return place
