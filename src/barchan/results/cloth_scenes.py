"""A cloth and the bodies it touches in the frames of a stored run, and the window that pictures of them show."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.results.solid_scenes import SolidScene

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

_MARGIN = 0.03
_MOST_SUNKEN = 0.03  # of the least extent of a body
_SPARE = 1.3  # so that lines on the body stay hidden as well


class ClothScene(SolidScene):
    """A cloth and `bodies` that move as given, in the frames of `results`; colour is "speed" (m/s) or "height" (m)."""

    @cached_property
    def triangles(self) -> Whole:
        """(m, 3) numbers of vertices."""
        return np.asarray(self.results.grid(0)["cells"], dtype=np.int64)

    def vertices(self, frame: int) -> Vector:
        """(n, 3) [m]."""
        return np.asarray(self.results.grid(frame)["positions"], dtype=np.float64)

    def values(self, frame: int) -> Vector:
        """(n,) what vertices are coloured by."""
        if self.colour == "height":
            return self.vertices(frame)[:, 2]
        return np.linalg.norm(self.results.grid(frame)["velocities"].astype(np.float64), axis=1)

    @property
    def label(self) -> str:
        """What the colours mean."""
        return "height (m)" if self.colour == "height" else "speed (m/s)"

    @cached_property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale over the frames that pictures show."""
        seen = np.concatenate([self.values(frame) for frame in self.looked_at])
        low = 0.0 if self.colour == "speed" else float(np.min(seen))
        return low, max(float(np.quantile(seen, 0.99)), low + 1e-9)

    def sunken(self, number: int, frame: int) -> float:
        """How far [m] the middles of triangles and edges are inside a body: its contacts are at vertices.

        At most a share of the body's size, for pictures that hide no real fault.
        """
        body, place = self.bodies[number], self.pose(number, float(self.times[frame]))
        corner = self.vertices(frame)[self.triangles]
        middles = np.concatenate(
            [corner.mean(axis=1), *(0.5 * (corner[:, k] + corner[:, k - 1]) for k in range(3))]
        )
        depth = -float(np.min(body.shape.signed_distance((middles - place[0]) @ place[1])))
        low, high = body.shape.bounds()
        return min(max(_SPARE * depth, 0.0), _MOST_SUNKEN * float(np.min(high - low)))

    @cached_property
    def window(self) -> tuple[Vector, Vector]:
        """Lower and upper corner (3,) of a box that holds the cloth, and most of the bodies that have an end."""
        seen = np.concatenate([self.vertices(frame) for frame in self.looked_at])
        lower, upper = np.min(seen, axis=0), np.max(seen, axis=0)
        room = 0.6 * float(np.max(upper - lower))
        for number, body in enumerate(self.bodies):
            if not body.shape.bounded:
                continue
            low, high = body.shape.bounds()
            place, turn = self.pose(number, 0.0)
            middle, half = place + turn @ (0.5 * (low + high)), np.abs(turn) @ (0.5 * (high - low))
            lower = np.maximum(np.minimum(lower, middle - half), lower - room)
            upper = np.minimum(np.maximum(upper, middle + half), upper + room)
        margin = _MARGIN * float(np.max(upper - lower))
        return lower - margin, upper + margin
