"""Plane polygons, and the solids made of them: extruded along y, or revolved about z (walls, funnels, hourglasses)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid._kernels import polygon_distances
from barchan.bodies.rigid.shape import Shape, unit_or_vertical
from barchan.bodies.rigid.surfaces import bisected, enclosed_moments, inertia_of
from barchan.bodies.rigid.tessellation import revolved_facets
from barchan.errors import InputError

Vector = NDArray[np.float64]
# Gauss rule of degree 4 on a triangle: barycentric coordinates (a, b, b) and their weights, each in three turns.
_TRIANGLE_RULE = (
    (0.108103018168070, 0.445948490915965, 0.223381589678011),
    (0.816847572980459, 0.091576213509771, 0.109951743655322),
)


class Polygon(Shape):
    """Plane polygon with `vertices` (n, 2) [m] in order, convex or not; it must not cross itself."""

    def __init__(self, vertices: ArrayLike) -> None:
        given = inputs.table("vertices", vertices, (2,), 3)
        if np.any(np.all(given == np.roll(given, -1, axis=0), axis=1)):
            raise InputError("vertices", given.tolist(), "distinct from their neighbours")
        following = np.roll(given, -1, axis=0)
        area = 0.5 * float(np.sum(given[:, 0] * following[:, 1] - given[:, 1] * following[:, 0]))
        if abs(area) <= 1e-14 * float(np.max(np.ptp(given, axis=0))) ** 2:
            raise InputError("vertices", given.tolist(), "a polygon with an area")
        self.vertices = given if area > 0.0 else np.ascontiguousarray(given[::-1])
        if _crosses_itself(self.vertices):
            raise InputError("vertices", given.tolist(), "a polygon that does not cross itself")
        self._ends = np.ascontiguousarray(np.roll(self.vertices, -1, axis=0))
        self._counted = np.ones(len(given), dtype=np.bool_)

    @property
    def dimension(self) -> int:
        return 2

    def distances(self, points: Vector, counted: NDArray[np.bool_] | None = None) -> tuple[Vector, Vector]:
        """Signed distances (n,) and their gradients (n, 2), to the `counted` edges only when given."""
        x = inputs.points(points, 2)
        distance, gradient = np.empty(len(x)), np.empty_like(x)
        edges = self._counted if counted is None else counted
        polygon_distances(x, self.vertices, self._ends, edges, distance, gradient)
        return distance, gradient

    def signed_distance(self, points: Vector) -> Vector:
        return self.distances(points)[0]

    def normals(self, points: Vector) -> Vector:
        return self.distances(points)[1]

    def bounds(self) -> tuple[Vector, Vector]:
        return np.min(self.vertices, axis=0), np.max(self.vertices, axis=0)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        return bisected(np.stack([self.vertices, self._ends], axis=1), spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        area, centre, second = enclosed_moments(np.stack([self.vertices, self._ends], axis=1))
        return area, centre, inertia_of(second)


class Extruded(Shape):
    """The `polygon` of the plane (x, z), as thick as |y| <= `half_depth` [m]."""

    def __init__(self, polygon: Polygon, half_depth: float) -> None:
        self.polygon = _as_polygon(polygon)
        self.half_depth = inputs.positive("half_depth", half_depth)

    @property
    def dimension(self) -> int:
        return 3

    def signed_distance(self, points: Vector) -> Vector:
        x = inputs.points(points, 3)
        across, along = self.polygon.signed_distance(x[:, [0, 2]]), np.abs(x[:, 1]) - self.half_depth
        outside = np.hypot(np.maximum(across, 0.0), np.maximum(along, 0.0))
        distance: Vector = outside + np.minimum(np.maximum(across, along), 0.0)
        return distance

    def normals(self, points: Vector) -> Vector:
        x = inputs.points(points, 3)
        across, gradient = self.polygon.distances(x[:, [0, 2]])
        along = np.abs(x[:, 1]) - self.half_depth
        inside = np.maximum(across, along) <= 0.0
        a = np.where(inside, across >= along, np.maximum(across, 0.0))
        b = np.where(inside, across < along, np.maximum(along, 0.0)) * np.where(x[:, 1] < 0.0, -1.0, 1.0)
        return unit_or_vertical(np.stack([a * gradient[:, 0], b, a * gradient[:, 1]], axis=1))

    def bounds(self) -> tuple[Vector, Vector]:
        low, high = self.polygon.bounds()
        h = self.half_depth
        return np.array([low[0], -h, low[1]]), np.array([high[0], h, high[1]])

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        h, corners = self.half_depth, self.polygon.vertices
        a, b = corners, np.roll(corners, -1, axis=0)

        def at(p: Vector, y: float) -> Vector:
            return np.stack([p[..., 0], np.full(p.shape[:-1], y), p[..., 1]], axis=-1)

        # (x, z) counter-clockwise is clockwise seen from +y, hence the order of the corners
        walls = [
            np.stack([at(b, h), at(b, -h), at(a, -h)], axis=1),
            np.stack([at(a, h), at(b, h), at(a, -h)], axis=1),
        ]
        cap = corners[_ears(corners)]
        return bisected(np.concatenate([*walls, at(cap, -h), at(cap, h)[:, ::-1]]), spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        area, centre, second = enclosed_moments(
            np.stack([self.polygon.vertices, np.roll(self.polygon.vertices, -1, axis=0)], axis=1)
        )
        depth = 2.0 * self.half_depth
        moments = np.zeros((3, 3))
        moments[np.ix_([0, 2], [0, 2])] = depth * second
        moments[1, 1] = area * depth * self.half_depth**2 / 3.0
        return depth * area, np.array([centre[0], 0.0, centre[1]]), inertia_of(moments)


class Revolved(Shape):
    """The `profile` polygon of (r, z), r >= 0, turned about the vertical axis z."""

    def __init__(self, profile: Polygon) -> None:
        self.profile = _as_polygon(profile)
        r = self.profile.vertices[:, 0]
        if np.min(r) < 0.0:
            raise InputError("profile", self.profile.vertices.tolist(), "a polygon of (r, z) with r >= 0")
        self._counted = (r > 0.0) | (np.roll(r, -1) > 0.0)  # edges on the axis bound nothing
        self._least = 1e-12 * float(np.max(r))

    @property
    def dimension(self) -> int:
        return 3

    def _distances(self, points: Vector) -> tuple[Vector, Vector]:
        x = inputs.points(points, 3)
        r = np.maximum(
            np.hypot(x[:, 0], x[:, 1]), self._least
        )  # just off the axis, where inside and outside are clear
        distance, gradient = self.profile.distances(np.stack([r, x[:, 2]], axis=1), self._counted)
        outward = unit_or_vertical(x[:, :2])
        return distance, np.concatenate([gradient[:, :1] * outward, gradient[:, 1:]], axis=1)

    def signed_distance(self, points: Vector) -> Vector:
        return self._distances(points)[0]

    def normals(self, points: Vector) -> Vector:
        return unit_or_vertical(self._distances(points)[1])

    def bounds(self) -> tuple[Vector, Vector]:
        low, high = self.profile.bounds()
        return np.array([-high[0], -high[0], low[1]]), np.array([high[0], high[0], high[1]])

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        return revolved_facets(self.profile.vertices, spacing, is_closed=True)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        """Exact: int dV = 2 pi int r dA over the profile, by signed triangles from its first vertex."""
        corners = self.profile.vertices
        rest = corners[1:-1], corners[2:]
        triangles = np.stack([np.broadcast_to(corners[0], rest[0].shape), *rest], axis=1)
        edges = triangles[:, 1:] - triangles[:, :1]
        areas = 0.5 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        sums = np.zeros(4)  # of r, r z, r^3, r z^2
        for a, b, weight in _TRIANGLE_RULE:
            for k in range(3):
                barycentric = np.full(3, b)
                barycentric[k] = a
                r, z = np.einsum("v,tvx->xt", barycentric, triangles)
                sums += weight * np.array([np.sum(areas * q) for q in (r, r * z, r**3, r * z**2)])
        volume, height = 2.0 * np.pi * sums[0], sums[1] / sums[0]
        across, along = np.pi * sums[2], 2.0 * np.pi * sums[3] - volume * height**2
        return float(volume), np.array([0.0, 0.0, height]), inertia_of(np.diag([across, across, along]))


def _as_polygon(value: object) -> Polygon:
    if not isinstance(value, Polygon):
        raise InputError("polygon", type(value).__name__, "a Polygon")
    return value


def _crosses_itself(vertices: Vector) -> bool:
    """Whether two edges without a common vertex meet."""
    a, b = vertices, np.roll(vertices, -1, axis=0)
    count = len(a)

    def side(p: Vector, q: Vector, x: Vector) -> Vector:
        sign: Vector = np.sign((q[0] - p[0]) * (x[:, 1] - p[1]) - (q[1] - p[1]) * (x[:, 0] - p[0]))
        return sign

    for i in range(count - 2):
        others = np.arange(i + 2, count if i > 0 else count - 1)
        c, d = a[others], b[others]
        apart_here = side(a[i], b[i], c) * side(a[i], b[i], d)
        cross = (
            np.stack([side(p, q, np.stack([a[i], b[i]])) for p, q in zip(c, d, strict=True)])
            if len(c)
            else None
        )
        if cross is None:
            continue
        apart_there = cross[:, 0] * cross[:, 1]
        low, high = np.minimum(a[i], b[i]), np.maximum(a[i], b[i])
        boxes = np.all((np.maximum(c, d) >= low) & (np.minimum(c, d) <= high), axis=1)
        if np.any((apart_here <= 0.0) & (apart_there <= 0.0) & boxes):
            return True
    return False


def _ears(vertices: Vector) -> NDArray[np.int64]:
    """Triangles (n - 2, 3) of a counter-clockwise simple polygon: ears cut off one after the other."""
    left = list(range(len(vertices)))
    triangles = []
    while len(left) > 3:
        for k in range(len(left)):
            i, j, m = left[k - 1], left[k], left[(k + 1) % len(left)]
            corners = vertices[[i, j, m]]
            others = vertices[[n for n in left if n not in (i, j, m)]]
            u, v = corners[1] - corners[0], corners[2] - corners[0]
            turn = u[0] * v[1] - u[1] * v[0]
            if turn >= 0.0 and not np.any(_within(others, corners)):
                break
        else:  # rounding alone can bring us here: cut the corner off all the same
            k, (i, j, m) = 0, (left[-1], left[0], left[1])
        triangles.append([i, j, m])
        left.pop(k)
    triangles.append(left)
    return np.array(triangles)


def _within(points: Vector, corners: Vector) -> NDArray[np.bool_]:
    """Whether points lie in a counter-clockwise triangle or on its border, its corners excepted."""
    inside = np.ones(len(points), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0]) >= 0.0
    for corner in corners:
        inside &= np.any(points != corner, axis=1)
    return inside
