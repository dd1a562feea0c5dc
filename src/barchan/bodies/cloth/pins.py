"""Vertices of a cloth that are held, or moved as prescribed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import Body, BodyState, Prescribed, inputs, rotations
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]
Path = Callable[[float], ArrayLike]


@dataclass(frozen=True, eq=False, init=False)
class Pins:
    """Some vertices and where they are.

    vertices : (k,) numbers.  path : positions (k, 3) [m] at a time [s]; None holds them where they start.
    """

    vertices: Whole
    path: Path | None

    def __init__(self, vertices: ArrayLike, path: Path | None = None) -> None:
        numbers = np.atleast_1d(np.asarray(vertices))
        if numbers.ndim != 1 or (len(numbers) and not np.issubdtype(numbers.dtype, np.integer)):
            raise InputError("pins.vertices", vertices, "numbers of vertices")
        if path is not None and not callable(path):
            raise InputError("pins.path", type(path).__name__, "a function of the time")
        object.__setattr__(self, "vertices", numbers.astype(np.int64))
        object.__setattr__(self, "path", path)


def carried_by(body: Body, positions: Vector) -> Path:
    """The path of points (k, 3) fixed to a driven body, which are at `positions` at time 0."""
    if not body.driven:
        raise InputError("pins.body", body.name, "a fixed or prescribed body")
    local = (positions - body.position) @ rotations.matrix(body.rotation)
    motion = body.motion

    def path(time: float) -> Vector:
        if not isinstance(motion, Prescribed):
            return positions
        turn = motion.rotation_at(time)
        matrix = rotations.matrix(body.rotation if turn is None else turn)
        return np.asarray(local @ matrix.T + motion.position_at(time))

    return path


class PinnedVertices:
    """All pins of a cloth together; `start` (n, 3) is where the cloth starts.

    Raises InputError for vertices that do not exist, a vertex in two pins, a path that does not start where the cloth does or
    gives the wrong shape.
    """

    def __init__(self, pins: Sequence[Pins], start: Vector) -> None:
        self._pins = [pin for pin in pins if len(pin.vertices)]
        self._start = start
        self.vertices: Whole = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(pin.vertices for pin in self._pins)]
        )
        if len(self.vertices) and not (self.vertices.min() >= 0 and self.vertices.max() < len(start)):
            wrong = self.vertices[(self.vertices < 0) | (self.vertices >= len(start))]
            raise InputError("pins.vertices", int(wrong[0]), f"from 0 to {len(start) - 1}")
        numbers, count = np.unique(self.vertices, return_counts=True)
        if np.any(count > 1):
            raise InputError("pins.vertices", int(numbers[np.argmax(count)]), "in one pin only, once")
        begin = self.at(0.0)
        size = float(np.max(np.ptp(start, axis=0)))
        away = np.linalg.norm(begin - start[self.vertices], axis=1)
        if len(away) and np.max(away) > 1e-6 * size:
            worst = int(np.argmax(away))
            allowed = f"{start[self.vertices[worst]].tolist()} at time 0, where vertex {self.vertices[worst]} starts"
            raise InputError("pins.path", begin[worst].tolist(), allowed)
        self.mask = np.zeros(len(start), dtype=bool)
        self.mask[self.vertices] = True

    def __len__(self) -> int:
        return len(self.vertices)

    def at(self, time: float) -> Vector:
        """(k, 3) positions of the pinned `vertices` [m]."""
        parts = [np.zeros((0, 3))]
        for pin in self._pins:
            if pin.path is None:
                parts.append(self._start[pin.vertices])
                continue
            parts.append(inputs.table("pins.path", pin.path(time), (3,), len(pin.vertices)))
            if len(parts[-1]) != len(pin.vertices):
                raise InputError("pins.path", parts[-1].shape, f"of shape {(len(pin.vertices), 3)}")
        return np.concatenate(parts)


def displacement(before: BodyState, after: BodyState, points: Vector) -> Vector:
    """(m, 3) how far matter of a rigid body at `points` moves between two states [m]."""
    turn = rotations.matrix(after.rotation) @ rotations.matrix(before.rotation).T
    return np.asarray((points - before.position) @ turn.T + after.position - points)
