"""Sphere, box, half space, cylinder and torus with their exact signed distances; disk and rectangle in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid.shape import Shape, unit_or_vertical
from barchan.bodies.rigid.surfaces import bisected, clipped_to_box, inertia_of
from barchan.bodies.rigid.tessellation import disk_facets, geodesic_sphere, revolved_facets
from barchan.errors import InputError

Vector = NDArray[np.float64]


class Sphere(Shape):
    """Ball of `radius` [m] about the origin; with `dimension=2` a disk."""

    def __init__(self, radius: float, dimension: int = 3) -> None:
        self.radius = inputs.positive("radius", radius)
        if dimension not in (2, 3):
            raise InputError("dimension", dimension, "2 or 3")
        self._dimension = dimension

    @property
    def dimension(self) -> int:
        return self._dimension

    def signed_distance(self, points: Vector) -> Vector:
        x = inputs.points(points, self.dimension)
        distance: Vector = np.sqrt(np.einsum("ni,ni->n", x, x)) - self.radius
        return distance

    def normals(self, points: Vector) -> Vector:
        return unit_or_vertical(inputs.points(points, self.dimension))

    def bounds(self) -> tuple[Vector, Vector]:
        return np.full(self.dimension, -self.radius), np.full(self.dimension, self.radius)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        if self.dimension == 2:
            return disk_facets(self.radius, spacing)
        return geodesic_sphere(self.radius, spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        r, d = self.radius, self.dimension
        volume = np.pi * r**2 if d == 2 else 4.0 / 3.0 * np.pi * r**3
        return float(volume), np.zeros(d), inertia_of(volume * r**2 / (d + 2) * np.eye(d))


class Box(Shape):
    """Box |x_k| <= half_extents[k] [m], three of them in space, two in the plane (a rectangle)."""

    def __init__(self, half_extents: ArrayLike) -> None:
        self.half_extents = inputs.vector("half_extents", half_extents, (2, 3))
        if np.any(self.half_extents <= 0.0):
            raise InputError("half_extents", half_extents, "positive")

    @property
    def dimension(self) -> int:
        return len(self.half_extents)

    def signed_distance(self, points: Vector) -> Vector:
        q = np.abs(inputs.points(points, self.dimension)) - self.half_extents
        outside = np.maximum(q, 0.0)
        distance: Vector = np.sqrt(np.einsum("ni,ni->n", outside, outside)) + np.minimum(
            np.max(q, axis=1), 0.0
        )
        return distance

    def normals(self, points: Vector) -> Vector:
        x = inputs.points(points, self.dimension)
        q = np.abs(x) - self.half_extents
        nearest = np.eye(self.dimension)[np.argmax(q, axis=1)]
        inside = np.max(q, axis=1) <= 0.0
        direction = np.where(inside[:, None], nearest, np.maximum(q, 0.0))
        return unit_or_vertical(np.where(x < 0.0, -direction, direction))

    def bounds(self) -> tuple[Vector, Vector]:
        return -self.half_extents, self.half_extents.copy()

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        if self.dimension == 2:
            corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * self.half_extents
            return bisected(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1), spacing)
        faces = []
        for axis in range(3):
            for sign in (-1.0, 1.0):
                a, b, c = np.eye(3)[axis] * sign, np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
                if sign < 0.0:
                    b, c = c, b
                square = [a - b - c, a + b - c, a + b + c, a - b + c]
                faces += [[square[0], square[1], square[2]], [square[0], square[2], square[3]]]
        return bisected(np.array(faces) * self.half_extents, spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        volume = float(np.prod(2.0 * self.half_extents))
        return volume, np.zeros(self.dimension), inertia_of(np.diag(volume * self.half_extents**2 / 3.0))


class HalfSpace(Shape):
    """Everything with normal . x <= offset [m]; `normal` (d,) need not be unit, it points out of the solid."""

    def __init__(self, normal: ArrayLike, offset: float = 0.0) -> None:
        given = inputs.vector("normal", normal, (2, 3))
        if not np.any(given):
            raise InputError("normal", normal, "a vector that is not zero")
        if not np.isfinite(offset):
            raise InputError("offset", offset, "finite")
        self.normal = given / np.linalg.norm(given)
        self.offset = float(offset)

    @property
    def dimension(self) -> int:
        return len(self.normal)

    def signed_distance(self, points: Vector) -> Vector:
        distance: Vector = inputs.points(points, self.dimension) @ self.normal - self.offset
        return distance

    def normals(self, points: Vector) -> Vector:
        return np.tile(self.normal, (len(inputs.points(points, self.dimension)), 1))

    def bounds(self) -> tuple[Vector, Vector]:
        lower, upper = np.full(self.dimension, -np.inf), np.full(self.dimension, np.inf)
        axis = int(np.argmax(np.abs(self.normal)))
        if abs(self.normal[axis]) == 1.0:
            (upper if self.normal[axis] > 0.0 else lower)[axis] = self.offset * self.normal[axis]
        return lower, upper

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        middle, d = 0.5 * (lower + upper), self.dimension
        middle = middle + (self.offset - self.normal @ middle) * self.normal
        reach = float(np.linalg.norm(upper - lower))
        slack = 1e-3 * reach  # so that a plane that is a side of the box is not lost
        if d == 2:
            tangent = reach * np.array([-self.normal[1], self.normal[0]])
            line = np.array([[middle - tangent, middle + tangent]])
            return bisected(clipped_to_box(line, lower - slack, upper + slack), spacing)
        b, c = (reach * t for t in _tangents(self.normal))
        square = [middle - b - c, middle + b - c, middle + b + c, middle - b + c]
        plane = np.array([[square[0], square[1], square[2]], [square[0], square[2], square[3]]])
        return bisected(clipped_to_box(plane, lower - slack, upper + slack), spacing)


class _Round(Shape):
    """A solid of revolution about `axis` through the origin, given by its half plane (r, z), z along the axis."""

    def __init__(self, axis: int | ArrayLike) -> None:
        self.axis = inputs.axis_direction("axis", axis)

    @property
    def dimension(self) -> int:
        return 3

    def _half_plane(self, points: Vector) -> tuple[Vector, Vector, Vector]:
        """Distance r from the axis, unit radial direction (n, 3), height z along the axis."""
        x = inputs.points(points, 3)
        z = x @ self.axis
        radial = x - z[:, None] * self.axis
        r = np.sqrt(np.einsum("ni,ni->n", radial, radial))
        anywhere = _tangents(self.axis)[0]
        far = r > 1e-12 * (1e-300 + np.abs(z) + r)
        unit = np.where(far[:, None], radial / np.where(far, r, 1.0)[:, None], anywhere)
        return r, unit, z

    def _axes(self) -> Vector:
        """Rotation (3, 3) whose columns are two directions across the axis and the axis."""
        b, c = _tangents(self.axis)
        return np.stack([b, c, self.axis], axis=1)

    def _bounds_of(self, radius: float, half_length: float) -> tuple[Vector, Vector]:
        reach = radius * np.sqrt(np.maximum(0.0, 1.0 - self.axis**2)) + half_length * np.abs(self.axis)
        return -reach, reach

    def _moments_of(self, volume: float, across: float, along: float) -> tuple[float, Vector, Vector]:
        axes = self._axes()
        second = axes @ np.diag(volume * np.array([across, across, along])) @ axes.T
        return volume, np.zeros(3), inertia_of(second)


class Cylinder(_Round):
    """Cylinder of `radius` and `half_length` [m] along `axis` (0, 1, 2 or any vector) about the origin."""

    def __init__(self, radius: float, half_length: float, axis: int | ArrayLike = 2) -> None:
        super().__init__(axis)
        self.radius = inputs.positive("radius", radius)
        self.half_length = inputs.positive("half_length", half_length)

    def signed_distance(self, points: Vector) -> Vector:
        r, _, z = self._half_plane(points)
        across, along = r - self.radius, np.abs(z) - self.half_length
        outside = np.hypot(np.maximum(across, 0.0), np.maximum(along, 0.0))
        distance: Vector = outside + np.minimum(np.maximum(across, along), 0.0)
        return distance

    def normals(self, points: Vector) -> Vector:
        r, unit, z = self._half_plane(points)
        across, along = r - self.radius, np.abs(z) - self.half_length
        inside = np.maximum(across, along) <= 0.0
        side = across >= along
        a = np.where(inside, side, np.maximum(across, 0.0))
        b = np.where(inside, ~side, np.maximum(along, 0.0)) * np.where(z < 0.0, -1.0, 1.0)
        return unit_or_vertical(a[:, None] * unit + b[:, None] * self.axis)

    def bounds(self) -> tuple[Vector, Vector]:
        return self._bounds_of(self.radius, self.half_length)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        r, h = self.radius, self.half_length
        profile = np.array([[0.0, -h], [r, -h], [r, h], [0.0, h]])
        return revolved_facets(profile, spacing, is_closed=False) @ self._axes().T

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        volume = float(2.0 * np.pi * self.radius**2 * self.half_length)
        return self._moments_of(volume, self.radius**2 / 4.0, self.half_length**2 / 3.0)


class Torus(_Round):
    """Torus about `axis`: all within `minor` [m] of the circle of radius `major` [m], major > minor."""

    def __init__(self, major: float, minor: float, axis: int | ArrayLike = 2) -> None:
        super().__init__(axis)
        self.major = inputs.positive("major", major)
        self.minor = inputs.positive("minor", minor)
        if self.minor >= self.major:
            raise InputError("minor", minor, f"smaller than major = {major}")

    def signed_distance(self, points: Vector) -> Vector:
        r, _, z = self._half_plane(points)
        distance: Vector = np.hypot(r - self.major, z) - self.minor
        return distance

    def normals(self, points: Vector) -> Vector:
        r, unit, z = self._half_plane(points)
        return unit_or_vertical((r - self.major)[:, None] * unit + z[:, None] * self.axis)

    def bounds(self) -> tuple[Vector, Vector]:
        reach = self.major * np.sqrt(np.maximum(0.0, 1.0 - self.axis**2)) + self.minor
        return -reach, reach

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        circle = disk_facets(self.minor, spacing)[:, 0] + np.array([self.major, 0.0])
        return revolved_facets(circle, spacing, is_closed=True) @ self._axes().T

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        a, b = self.major, self.minor
        volume = float(2.0 * np.pi**2 * a * b**2)
        return self._moments_of(volume, a**2 / 2.0 + 3.0 * b**2 / 8.0, b**2 / 4.0)


def _tangents(normal: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors that make a right-handed frame (b, c, normal)."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    b = np.cross(helper, normal)
    b = b / np.linalg.norm(b)
    return b, np.cross(normal, b)
