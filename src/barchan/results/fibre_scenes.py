"""Fibres and the bodies they touch in the frames of a stored run, and the window that pictures of them show."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body
from barchan.results.reader import Results
from barchan.results.solid_scenes import SolidScene

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

_LARGEST_BODY = 1.0  # of the extent of the fibres: larger bodies do not set the window


class FibreScene(SolidScene):
    """Fibres of one `radius` [m] and `bodies` that move as given, in the frames of `results`.

    colour : "speed" (m/s) or "fibre", its number.
    """

    def __init__(
        self, bodies: Sequence[Body], radius: float, results: Results, colour: str = "speed"
    ) -> None:
        super().__init__(bodies, results, colour)
        self.radius = radius

    def nodes(self, frame: int) -> Vector:
        """(p, 3) of all fibres, one after the other [m]."""
        return np.asarray(self.results.particles(frame)["positions"], dtype=np.float64)

    @cached_property
    def starts(self) -> Whole:
        """(f + 1,) first node of each fibre."""
        fibre = self.results.particles(0)["fibres"]
        return np.concatenate([[0], np.cumsum(np.bincount(fibre))])

    def values(self, frame: int) -> Vector:
        """(p,) what nodes are coloured by."""
        if self.colour == "fibre":
            return np.asarray(self.results.particles(frame)["fibres"], dtype=np.float64)
        return np.linalg.norm(self.results.particles(frame)["velocities"].astype(np.float64), axis=1)

    @property
    def label(self) -> str:
        """What the colours mean."""
        return "number of the fibre" if self.colour == "fibre" else "speed (m/s)"

    @cached_property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale over the frames that pictures show."""
        seen = np.concatenate([self.values(frame) for frame in self.looked_at])
        return 0.0, max(float(np.quantile(seen, 0.995)), 1e-9)

    @cached_property
    def window(self) -> tuple[Vector, Vector]:
        """Lower and upper corner (3,) of a box that holds the fibres, and bodies that are not much larger than they."""
        seen = np.concatenate([self.nodes(frame) for frame in self.looked_at])
        lower, upper = np.min(seen, axis=0), np.max(seen, axis=0)
        extent = float(np.max(upper - lower))
        for number, body in enumerate(self.bodies):
            if not body.shape.bounded:
                continue
            low, high = body.shape.bounds()
            reach = 0.5 * float(np.linalg.norm(high - low))
            if reach > _LARGEST_BODY * extent:
                continue
            for frame in self.looked_at:
                place, turn = self.pose(number, float(self.times[frame]))
                middle = place + turn @ (0.5 * (low + high))
                half = np.abs(turn) @ (0.5 * (high - low))
                lower, upper = np.minimum(lower, middle - half), np.maximum(upper, middle + half)
        return lower - 2.0 * self.radius, upper + 2.0 * self.radius
