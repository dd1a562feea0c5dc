"""Where bodies are and how they move: plain arrays, immutable, one row a body; part of the state of a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid.rotations import UNIT_TOLERANCE
from barchan.errors import InputError

if TYPE_CHECKING:
    from barchan.bodies.rigid.body import Body


@dataclass(frozen=True, eq=False)
class BodyState:
    """One body.

    position : (d,) [m] of the origin of its shape.
    rotation : unit quaternion (4,) in space, angle (1,) in the plane; takes the frame of the shape to the world.
    velocity : (d,) [m/s] of its centre of mass if it is free, of the origin of its shape if it is driven.
    spin : (3,), in the plane (1,) counter-clockwise [rad/s]; world frame.
    """

    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyStates:
    """k bodies: the rows of `BodyState` as arrays.

    positions (k, d), rotations (k, 4) or (k, 1), velocities (k, d), spins (k, 3) or (k, 1).
    """

    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    velocities: NDArray[np.float64]
    spins: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.positions.ndim != 2 or self.positions.shape[1] not in (2, 3):
            raise InputError("bodies.positions", self.positions.shape, "an array of shape (k, 2) or (k, 3)")
        k, d = self.positions.shape
        turn, spin = (4, 3) if d == 3 else (1, 1)
        shapes = {"positions": (k, d), "rotations": (k, turn), "velocities": (k, d), "spins": (k, spin)}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise InputError(f"bodies.{name}", value.shape, f"an array of shape {shape}")
            if not np.all(np.isfinite(value)):
                raise InputError(f"bodies.{name}", "an array with NaN or infinite entries", "finite")
        if d == 3 and k and np.max(np.abs(np.linalg.norm(self.rotations, axis=1) - 1.0)) > UNIT_TOLERANCE:
            raise InputError("bodies.rotations", self.rotations.tolist(), "unit quaternions")

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.positions.shape[1])

    def row(self, number: int) -> BodyState:
        """State of one body."""
        return BodyState(
            self.positions[number], self.rotations[number], self.velocities[number], self.spins[number]
        )

    @classmethod
    def none(cls, dimension: int) -> BodyStates:
        """No body at all."""
        turn, spin = (4, 3) if dimension == 3 else (1, 1)
        return cls(
            np.zeros((0, dimension)), np.zeros((0, turn)), np.zeros((0, dimension)), np.zeros((0, spin))
        )

    @classmethod
    def of(cls, rows: Sequence[BodyState], dimension: int) -> BodyStates:
        """The given rows, in order."""
        if not rows:
            return cls.none(dimension)
        names = ("position", "rotation", "velocity", "spin")
        return cls(*(np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in names))

    @classmethod
    def at_start(cls, bodies: Sequence[Body], dimension: int | None = None) -> BodyStates:
        """Initial states of `bodies`; `dimension` is needed only when there is none."""
        sizes = {body.dimension for body in bodies} | ({dimension} if dimension is not None else set())
        if len(sizes) != 1:
            raise InputError("bodies", sorted(sizes), "bodies of one dimension, that of the simulation")
        rows = [BodyState(body.position, body.rotation, body.velocity, body.spin) for body in bodies]
        return cls.of(rows, sizes.pop())

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        return {entry.name: np.asarray(getattr(self, entry.name)) for entry in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> BodyStates:
        """States from the arrays of `arrays()`; InputError names a missing field or one of the wrong shape."""
        values = []
        for entry in fields(cls):
            if entry.name not in arrays:
                raise InputError(f"bodies.{entry.name}", "missing", "given")
            values.append(np.ascontiguousarray(arrays[entry.name], dtype=np.float64))
        return cls(*values)
