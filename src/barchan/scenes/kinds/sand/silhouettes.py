"""The bodies of a stored run as pictures show them: cut by the middle plane of the box, or seen from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, Fixed
from barchan.bodies.rigid.rotations import matrix
from barchan.results import Results
from barchan.results.heap_pictures import LevelSet
from barchan.scenes.kinds.sand.observables import pose_of
from barchan.scenes.kinds.sand.parameters import SandParameters

Vector = NDArray[np.float64]

_POINTS = 160  # along the longer side of a picture of a body
_LAYERS = 24  # of points looked through from above


class BodyViews:
    """Level sets of the bodies of a run, frame by frame."""

    def __init__(self, parameters: SandParameters, bodies: Sequence[Body], results: Results) -> None:
        self._parameters, self._bodies, self._results = parameters, bodies, results

    def section(self, frame: int) -> list[LevelSet]:
        """The bodies cut by the plane of the side view: y in the middle of the box in 3D."""
        box = np.array(self._parameters.box.size)
        found = []
        for body in self._bodies:
            lower, upper = self._bounds(body, frame)
            x, z = (_lattice(lower[k], upper[k], box[k]) for k in (0, -1))
            if len(x) < 2 or len(z) < 2:
                continue
            points = np.zeros((len(x), len(z), len(box)))
            points[..., 0], points[..., -1] = x[:, None], z[None, :]
            if len(box) == 3:
                points[..., 1] = 0.5 * box[1]
            found.append(LevelSet(x, z, self._distance(body, frame, points)))
        return found

    def above(self, frame: int) -> list[LevelSet]:
        """The bodies that move, seen from above: where some point over the ground is inside."""
        box = np.array(self._parameters.box.size)
        found = []
        for body in self._bodies:
            if isinstance(body.motion, Fixed):
                continue
            lower, upper = self._bounds(body, frame)
            x, y = (_lattice(lower[k], upper[k], box[k])[::2] for k in (0, 1))
            if len(x) < 2 or len(y) < 2:
                continue
            z = np.linspace(lower[2], upper[2], _LAYERS)
            points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
            found.append(LevelSet(x, y, self._distance(body, frame, points).min(axis=2)))
        return found

    def _pose(self, body: Body, frame: int) -> tuple[Vector, Vector]:
        position, rotation = pose_of(self._results.observables, body.name, frame, self._parameters.dimension)
        return position, matrix(rotation)

    def _bounds(self, body: Body, frame: int) -> tuple[Vector, Vector]:
        """Corners (d,) of a box in the world that holds the body; the scene's box for a body without end."""
        position, rotation = self._pose(body, frame)
        lower, upper = body.shape.bounds()
        if not (np.all(np.isfinite(lower)) and np.all(np.isfinite(upper))):
            return np.zeros(len(position)), np.array(self._parameters.box.size)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        reach = np.abs(rotation) @ half * 1.02
        centre = position + rotation @ middle
        return centre - reach, centre + reach

    def _distance(self, body: Body, frame: int, points: Vector) -> Vector:
        """Signed distances (...) of world points (..., d)."""
        position, rotation = self._pose(body, frame)
        local = (points.reshape(-1, points.shape[-1]) - position) @ rotation
        return np.asarray(body.shape.signed_distance(local).reshape(points.shape[:-1]))


def _lattice(low: float, high: float, length: float) -> Vector:
    """Points from `low` to `high`, as far as they are near the box [0, length]."""
    low, high = max(low, -0.02 * length), min(high, 1.3 * length)
    return np.linspace(low, high, _POINTS) if high > low else np.zeros(0)
