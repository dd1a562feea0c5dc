"""Contact of the joints of a chain with fixed bodies in the plane: gaps, normals and how joints move along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, BodyStates, Fixed
from barchan.bodies.rigid.placement import body_distance, body_normals
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Fixed bodies that joints may touch.

    frictions : (o,) coefficients of pairs, the geometric mean of both.  free : (j,) numbers of the joints that can touch.
    """

    bodies: Sequence[Body]
    states: BodyStates
    frictions: Vector
    free: NDArray[np.int64]

    @classmethod
    def of(cls, bodies: Sequence[Body], friction: float, free: NDArray[np.int64]) -> Obstacles:
        """Raises InputError for a body that is not fixed or not in the plane."""
        for body in bodies:
            if not isinstance(body, Body) or body.dimension != 2:
                raise InputError("obstacles", body, "bodies in the plane")
            if not isinstance(body.motion, Fixed):
                raise InputError("obstacles", body.name or body.motion, "fixed bodies")
        own = np.array([body.friction for body in bodies], dtype=np.float64)
        return cls(tuple(bodies), BodyStates.at_start(bodies, 2), np.sqrt(friction * own), free)

    def gaps(self, joints: Vector) -> Vector:
        """(j, o) signed distances [m] of the free joints among `joints` (N + 1, 2) from every obstacle."""
        points = joints[self.free]
        columns = [body_distance(body, self.states.row(o), points) for o, body in enumerate(self.bodies)]
        return np.stack(columns, axis=1) if columns else np.zeros((len(points), 0))

    def within(self, joints: Vector, reach: float) -> NDArray[np.int64]:
        """(k,) names of the pairs of joint and obstacle closer than `reach` [m]."""
        joint, obstacle = np.nonzero(self.gaps(joints) < reach)
        return self.free[joint] * max(len(self.bodies), 1) + obstacle

    def pairs(self, keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Joints and obstacles (k,) of names."""
        count = max(len(self.bodies), 1)
        return keys // count, keys % count

    def contacts(self, keys: NDArray[np.int64], joints: Vector) -> tuple[Vector, Vector]:
        """Gaps (k,) [m] and frames (k, 2, 2), normal out of the obstacle first, of pairs with joints (N + 1, 2)."""
        joint, obstacle = self.pairs(keys)
        gaps, outward = np.zeros(len(keys)), np.zeros((len(keys), 2))
        for number, body in enumerate(self.bodies):
            chosen = obstacle == number
            if np.any(chosen):
                points = joints[joint[chosen]]
                gaps[chosen] = body_distance(body, self.states.row(number), points)
                outward[chosen] = body_normals(body, self.states.row(number), points)
        return gaps, contact_frames(outward)
