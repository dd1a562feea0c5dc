"""Shapes made of shapes: union, intersection, difference, complement, and a shape moved to another place.

The distance of a combination is the least (or greatest) of its parts': its zero is the boundary, its slope one, and it is never
more than the true distance. The boundary is that of the parts, cut where they meet.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs, rotations
from barchan.bodies.rigid.shape import Shape
from barchan.bodies.rigid.surfaces import Surface, bisected, clipped, closed, facet_vectors, quadrature
from barchan.errors import InputError

Vector = NDArray[np.float64]


class _Combination(Shape):
    """Points where `sign` times the distance is least over the parts: +1 for a union, -1 for an intersection."""

    sign = 1.0

    def __init__(self, *parts: Shape) -> None:
        if not parts or not all(isinstance(part, Shape) for part in parts):
            raise InputError("parts", [type(part).__name__ for part in parts], "one shape or more")
        if len({part.dimension for part in parts}) > 1:
            raise InputError("parts", [part.dimension for part in parts], "shapes of the same dimension")
        self.parts = parts

    @property
    def dimension(self) -> int:
        return self.parts[0].dimension

    def signed_distance(self, points: Vector) -> Vector:
        distance = self.parts[0].signed_distance(points)
        for part in self.parts[1:]:
            other = part.signed_distance(points)
            distance = np.minimum(distance, other) if self.sign > 0.0 else np.maximum(distance, other)
        return distance

    def normals(self, points: Vector) -> Vector:
        x = inputs.points(points, self.dimension)
        nearest = np.argmin([self.sign * part.signed_distance(x) for part in self.parts], axis=0)
        result = np.empty_like(x)
        for number, part in enumerate(self.parts):
            chosen = nearest == number
            result[chosen] = part.normals(x[chosen])
        return result

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        kept = []
        for number, part in enumerate(self.parts):
            facets = part.facets(spacing, lower, upper)
            others = [(other, rank) for rank, other in enumerate(self.parts) if rank != number]
            facets = _refined_at_seams(facets, [other for other, _ in others])
            for other, rank in others:
                facets = _outside(facets, other, self.sign, first=number < rank)
            kept.append(facets)
        return np.concatenate(kept)

    def quadrature_of(self, facets: Vector, spacing: float, cut: bool) -> Surface:
        surface = quadrature(facets)
        return surface if cut else closed(surface)


class Union(_Combination):
    """All that lies in one of `parts` at least."""

    sign = 1.0

    def bounds(self) -> tuple[Vector, Vector]:
        boxes = [part.bounds() for part in self.parts]
        return np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)


class Intersection(_Combination):
    """All that lies in every one of `parts`."""

    sign = -1.0

    def bounds(self) -> tuple[Vector, Vector]:
        boxes = [part.bounds() for part in self.parts]
        lower, upper = np.max([b[0] for b in boxes], axis=0), np.min([b[1] for b in boxes], axis=0)
        return lower, np.maximum(lower, upper)


class Difference(Intersection):
    """`solid` without what lies in `removed`."""

    def __init__(self, solid: Shape, removed: Shape) -> None:
        super().__init__(solid, Complement(removed))


class Complement(Shape):
    """All that does not lie in `shape`; unbounded."""

    def __init__(self, shape: Shape) -> None:
        self.shape = _as_shape(shape)

    @property
    def dimension(self) -> int:
        return self.shape.dimension

    def signed_distance(self, points: Vector) -> Vector:
        return -self.shape.signed_distance(points)

    def normals(self, points: Vector) -> Vector:
        return -self.shape.normals(points)

    def bounds(self) -> tuple[Vector, Vector]:
        return np.full(self.dimension, -np.inf), np.full(self.dimension, np.inf)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        return np.ascontiguousarray(self.shape.facets(spacing, lower, upper)[:, ::-1])


class Moved(Shape):
    """`shape` turned by `rotation` about its origin (quaternion, matrix, or plane angle), then moved by `offset` (d,)."""

    def __init__(self, shape: Shape, offset: ArrayLike, rotation: ArrayLike | None = None) -> None:
        self.shape = _as_shape(shape)
        self.offset = inputs.vector("offset", offset, (shape.dimension,))
        self.rotation = rotations.as_rotation("rotation", rotation, shape.dimension)
        self._matrix = rotations.matrix(self.rotation)

    @property
    def dimension(self) -> int:
        return self.shape.dimension

    def _local(self, points: Vector) -> Vector:
        local: Vector = (inputs.points(points, self.dimension) - self.offset) @ self._matrix
        return local

    def signed_distance(self, points: Vector) -> Vector:
        return self.shape.signed_distance(self._local(points))

    def normals(self, points: Vector) -> Vector:
        normals: Vector = self.shape.normals(self._local(points)) @ self._matrix.T
        return normals

    def bounds(self) -> tuple[Vector, Vector]:
        return turned_box(*self.shape.bounds(), self._matrix, self.offset)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        back = self._matrix.T
        local = turned_box(lower, upper, back, -back @ self.offset)
        least, most = self.shape.bounds()
        facets = self.shape.facets(spacing, np.maximum(local[0], least), np.minimum(local[1], most))
        moved: Vector = facets @ self._matrix.T + self.offset
        return moved

    def quadrature_of(self, facets: Vector, spacing: float, cut: bool) -> Surface:
        return self.shape.quadrature_of(facets, spacing, cut)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        volume, centre, inertia = self.shape.volume_properties()
        if self.dimension == 3:
            inertia = self._matrix @ inertia @ self._matrix.T
        return volume, self.offset + self._matrix @ centre, inertia


class Repeated(Shape):
    """`count` copies of `shape`, evenly turned about an axis through the origin: 0, 1 or 2 in space.

    The shape is the copy on the side of the next axis in the order x, y, z, x (in the plane: of x) and is mirrored by the
    plane of the two; each copy should stay in its sector, beyond which it is not seen.
    """

    def __init__(self, shape: Shape, count: int, axis: int = 2) -> None:
        self.shape = _as_shape(shape)
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
            raise InputError("count", count, "a whole number >= 1")
        if axis not in (0, 1, 2):
            raise InputError("axis", axis, "0, 1 or 2")
        self.count = int(count)
        self._plane = (0, 1) if shape.dimension == 2 else ((axis + 1) % 3, (axis + 2) % 3)

    @property
    def dimension(self) -> int:
        return self.shape.dimension

    def _turned(self, vectors: Vector, sector: NDArray[np.int64] | int) -> Vector:
        """Vectors (..., d) turned forward by so many sectors."""
        angle = 2.0 * np.pi / self.count * np.asarray(sector)
        c, s = np.cos(angle), np.sin(angle)
        i, j = self._plane
        result = np.array(vectors, dtype=np.float64)
        result[..., i] = c * vectors[..., i] - s * vectors[..., j]
        result[..., j] = s * vectors[..., i] + c * vectors[..., j]
        return result

    def _sector(self, points: Vector) -> NDArray[np.int64]:
        angle = np.arctan2(points[:, self._plane[1]], points[:, self._plane[0]])
        sector: NDArray[np.int64] = np.rint(angle * self.count / (2.0 * np.pi)).astype(np.int64)
        return sector

    def signed_distance(self, points: Vector) -> Vector:
        x = inputs.points(points, self.dimension)
        return self.shape.signed_distance(self._turned(x, -self._sector(x)))

    def normals(self, points: Vector) -> Vector:
        x = inputs.points(points, self.dimension)
        sector = self._sector(x)
        return self._turned(self.shape.normals(self._turned(x, -sector)), sector)

    def bounds(self) -> tuple[Vector, Vector]:
        lower, upper = self.shape.bounds()
        turn = self._turned(np.eye(self.dimension), 1).T
        low, high = lower.copy(), upper.copy()
        matrix = np.eye(self.dimension)
        for _ in range(1, self.count):
            matrix = turn @ matrix
            box = turned_box(lower, upper, matrix, np.zeros(self.dimension))
            low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
        return low, high

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        reach = np.full(self.dimension, np.linalg.norm(np.maximum(np.abs(lower), np.abs(upper))))
        facets = self.shape.facets(spacing, -reach, reach)
        return np.concatenate([self._turned(facets, sector) for sector in range(self.count)])

    def quadrature_of(self, facets: Vector, spacing: float, cut: bool) -> Surface:
        return self.shape.quadrature_of(facets, spacing, cut)


def turned_box(lower: Vector, upper: Vector, matrix: Vector, offset: Vector) -> tuple[Vector, Vector]:
    """The box (d,), (d,) about the image of a box under x -> matrix x + offset; infinite sides stay infinite."""
    if np.all(np.isfinite(lower)) and np.all(np.isfinite(upper)):
        corners = np.array(list(itertools.product(*zip(lower, upper, strict=True)))) @ matrix.T + offset
        return np.min(corners, axis=0), np.max(corners, axis=0)
    low, high = offset.copy(), offset.copy()
    for (row, column), share in np.ndenumerate(matrix):
        if abs(share) > 1e-15:
            ends = sorted((share * lower[column], share * upper[column]))
            low[row] += ends[0]
            high[row] += ends[1]
    return low, high


def _as_shape(value: object) -> Shape:
    if not isinstance(value, Shape):
        raise InputError("shape", type(value).__name__, "a shape")
    return value


def _refined_at_seams(facets: Vector, others: list[Shape]) -> Vector:
    """Facets cut smaller where the boundary of another part passes through them, since they are cut along straight lines."""
    if not others or not len(facets):
        return facets
    middle = np.mean(facets, axis=1)
    reach = np.max(np.linalg.norm(facets - middle[:, None], axis=2), axis=1)
    seam = np.zeros(len(facets), dtype=np.bool_)
    for other in others:
        seam |= np.abs(other.signed_distance(middle)) <= reach
    if not np.any(seam):
        return facets
    return np.concatenate([facets[~seam], bisected(facets[seam], 0.5 * float(np.max(reach)))])


def _outside(facets: Vector, other: Shape, sign: float, first: bool) -> Vector:
    """The parts of facets where `sign` times the distance to `other` is positive.

    Where the two boundaries coincide, the facet of the first shape is kept if both face the same way, and none otherwise.
    """
    if not len(facets):
        return facets
    d = facets.shape[1]
    values = sign * other.signed_distance(facets.reshape(-1, d)).reshape(-1, d)
    tolerance = 1e-10 * float(np.max(np.ptp(facets.reshape(-1, d), axis=0)))
    values[np.abs(values) <= tolerance] = 0.0
    shared = np.all(values == 0.0, axis=1)
    middle = np.mean(facets[shared], axis=1)
    shared[shared] = np.abs(other.signed_distance(middle)) <= tolerance
    middle = np.mean(facets[shared], axis=1)
    same = np.einsum("fi,fi->f", facet_vectors(facets[shared]), other.normals(middle)) > 0.0
    kept = facets[shared][same & first]
    # a facet whose corners alone touch the other boundary lies on one side of it: its middle tells which
    loose = ~shared
    touching = np.all(values == 0.0, axis=1) & loose
    if np.any(touching):
        side = sign * other.signed_distance(np.mean(facets[touching], axis=1))
        values[touching] = side[:, None]
    return np.concatenate([clipped(facets[loose], values[loose]), kept])
