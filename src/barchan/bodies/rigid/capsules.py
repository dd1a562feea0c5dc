"""Capsules: all points within a radius of a segment, in space and in the plane, with closed forms throughout."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid.shape import Shape, unit_or_vertical
from barchan.bodies.rigid.surfaces import bisected, inertia_of
from barchan.bodies.rigid.tessellation import circle_sides, revolved_facets, stretch
from barchan.errors import InputError

Vector = NDArray[np.float64]


class Capsule(Shape):
    """All within `radius` [m] of the segment from -`half_length` to +`half_length` [m] along `axis` through the origin.

    axis : its number or any vector (d,) that is not zero; the vertical by default.
    dimension : 3, or 2 for a rectangle with two half disks.
    """

    def __init__(
        self, radius: float, half_length: float, axis: int | ArrayLike | None = None, dimension: int = 3
    ) -> None:
        if dimension not in (2, 3):
            raise InputError("dimension", dimension, "2 or 3")
        self.radius = inputs.positive("radius", radius)
        self.half_length = inputs.positive("half_length", half_length)
        self.axis = inputs.axis_direction("axis", dimension - 1 if axis is None else axis, dimension)

    @property
    def dimension(self) -> int:
        return len(self.axis)

    @property
    def ends(self) -> Vector:
        """The two ends (2, d) of the segment."""
        return np.stack([-self.half_length * self.axis, self.half_length * self.axis])

    def _from_segment(self, points: Vector) -> Vector:
        """Vectors (n, d) to points from the nearest point of the segment."""
        x = inputs.points(points, self.dimension)
        along = np.clip(x @ self.axis, -self.half_length, self.half_length)
        vectors: Vector = x - along[:, None] * self.axis
        return vectors

    def signed_distance(self, points: Vector) -> Vector:
        distance: Vector = np.linalg.norm(self._from_segment(points), axis=1) - self.radius
        return distance

    def normals(self, points: Vector) -> Vector:
        away = self._from_segment(points)
        lost = ~np.any(away, axis=1)  # on the segment any direction across it will do
        if np.any(lost):
            away[lost] = self._frame()[0]
        return unit_or_vertical(away)

    def bounds(self) -> tuple[Vector, Vector]:
        reach = self.half_length * np.abs(self.axis) + self.radius
        return -reach, reach

    def _frame(self) -> Vector:
        """Rows: directions across the axis, then the axis; a rotation (d, d)."""
        a = self.axis
        if len(a) == 2:
            return np.array([[a[1], -a[0]], a])
        helper = np.eye(3)[int(np.argmin(np.abs(a)))]
        b = np.cross(helper, a)
        b /= np.linalg.norm(b)
        return np.stack([b, np.cross(a, b), a])

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        sides = circle_sides(self.radius, spacing)
        turn = np.linspace(-0.5 * np.pi, 0.0, sides // 4 + 1)
        r = self.radius * stretch(sides)
        quarter = np.stack([r * np.cos(turn), r * np.sin(turn) - self.half_length], axis=1)
        quarter[0, 0] = 0.0
        profile = np.concatenate([quarter, (quarter * [1.0, -1.0])[::-1]])
        if self.dimension == 3:
            round_about: Vector = revolved_facets(profile, spacing, is_closed=False) @ self._frame()
            return round_about
        outline = np.concatenate([profile, (profile * [-1.0, 1.0])[-2:0:-1]])
        segments = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
        return bisected(segments @ self._frame(), spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        r, h, d = self.radius, self.half_length, self.dimension
        if d == 3:
            middle, ends = 2.0 * np.pi * r**2 * h, 4.0 / 3.0 * np.pi * r**3
            across = middle * r**2 / 4.0 + ends * r**2 / 5.0
            shift = 3.0 * r / 8.0  # from the flat face of half a ball to its centre of mass
        else:
            middle, ends = 4.0 * r * h, np.pi * r**2
            across = middle * r**2 / 3.0 + ends * r**2 / 4.0
            shift = 4.0 * r / (3.0 * np.pi)
        along = middle * h**2 / 3.0 + ends * (r**2 / (d + 2) + h**2 + 2.0 * h * shift)
        frame = self._frame()
        second = frame.T @ np.diag([across] * (d - 1) + [along]) @ frame
        return middle + ends, np.zeros(d), inertia_of(second)
