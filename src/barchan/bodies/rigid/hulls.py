"""Convex polyhedra from their corners: faces, edges, exact signed distance and moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull as _Qhull
from scipy.spatial import QhullError

from barchan.bodies.rigid import inputs
from barchan.bodies.rigid._kernels import hull_distances
from barchan.bodies.rigid.shape import Shape
from barchan.bodies.rigid.surfaces import bisected, enclosed_moments, inertia_of
from barchan.errors import InputError

Vector = NDArray[np.float64]
TOLERATED_DEPTH = 1e-9  # of the longest side, by which a corner may lie inside: rounding
FLATTEST = 1e-9  # volume of a solid, in cubes of its longest side
SAME_PLANE = 1e-7  # [rad] between triangles that make one face


class ConvexHull(Shape):
    """Convex polyhedron with the corners `vertices` (n, 3) [m], in any order.

    InputError: corners strictly inside the hull of the others (the solid meant is not convex), or no volume.

    Derived: `vertices` (v, 3) on the hull; `faces`, one array of vertex numbers a face, counter-clockwise seen from
    outside; `face_normals` (f, 3), unit, outward; `edges` (e, 2).
    """

    def __init__(self, vertices: ArrayLike) -> None:
        given = inputs.table("vertices", vertices, (3,), 4)
        size = float(np.max(np.ptp(given, axis=0)))
        try:
            hull = _Qhull(given)
        except QhullError:
            raise InputError("vertices", given.tolist(), "points that do not lie in one plane") from None
        if hull.volume <= FLATTEST * size**3:
            raise InputError("vertices", f"a solid of {hull.volume:.3g} m^3", "points that enclose a volume")
        depths = -np.max(given @ hull.equations[:, :3].T + hull.equations[:, 3], axis=1)
        deepest = int(np.argmax(depths))
        if depths[deepest] > TOLERATED_DEPTH * size:
            found = f"vertex {deepest}, {depths[deepest]:.6g} m inside the hull of the others"
            raise InputError("vertices", found, "corners of a convex solid: none inside")
        numbers = np.full(len(given), -1)
        numbers[hull.vertices] = np.arange(len(hull.vertices))
        self.vertices = np.ascontiguousarray(given[hull.vertices])
        self.faces = _merged_faces(self.vertices, numbers[hull.simplices], hull)
        self._triangles = np.array([[f[0], f[k], f[k + 1]] for f in self.faces for k in range(1, len(f) - 1)])
        self.face_normals = np.array([_normal(self.vertices[face]) for face in self.faces])
        counts = [len(face) - 2 for face in self.faces]
        self._corners = np.ascontiguousarray(self.vertices[self._triangles])
        self._triangle_normals = np.ascontiguousarray(np.repeat(self.face_normals, counts, axis=0))
        pairs = np.concatenate([np.stack([f, np.roll(f, -1)], axis=1) for f in self.faces])
        self.edges = np.unique(np.sort(pairs, axis=1), axis=0)

    @property
    def dimension(self) -> int:
        return 3

    def _distances(self, points: Vector) -> tuple[Vector, Vector]:
        x = inputs.points(points, 3)
        distances, gradients = np.empty(len(x)), np.empty_like(x)
        hull_distances(x, self._corners, self._triangle_normals, distances, gradients)
        return distances, gradients

    def signed_distance(self, points: Vector) -> Vector:
        return self._distances(points)[0]

    def normals(self, points: Vector) -> Vector:
        return self._distances(points)[1]

    def bounds(self) -> tuple[Vector, Vector]:
        return np.min(self.vertices, axis=0), np.max(self.vertices, axis=0)

    def facets(self, spacing: float, lower: Vector, upper: Vector) -> Vector:
        return bisected(self._corners, spacing)

    def volume_properties(self) -> tuple[float, Vector, Vector]:
        volume, centre, second = enclosed_moments(self._corners)
        return volume, centre, inertia_of(second)


def _merged_faces(vertices: Vector, triangles: NDArray[np.int64], hull: _Qhull) -> list[NDArray[np.int64]]:
    """Polygons of the triangles that lie in one plane, each counter-clockwise seen from outside."""
    normals, count = hull.equations[:, :3], len(triangles)
    rows, columns = np.repeat(np.arange(count), 3), hull.neighbors.reshape(-1)
    turn = np.linalg.norm(np.cross(normals[rows], normals[columns]), axis=1)
    same = (turn < SAME_PLANE) & (np.einsum("ni,ni->n", normals[rows], normals[columns]) > 0.0)
    links = coo_array((np.ones(np.sum(same)), (rows[same], columns[same])), shape=(count, count))
    pieces, labels = connected_components(links, directed=False)
    faces = []
    for piece in range(pieces):
        corners = np.unique(triangles[labels == piece])
        normal = np.mean(normals[labels == piece], axis=0)
        x = vertices[corners] - np.mean(vertices[corners], axis=0)
        across = x[0] - (x[0] @ normal) * normal
        angles = np.arctan2(x @ np.cross(normal, across), x @ across)
        ring = corners[np.argsort(angles)]
        faces.append(np.roll(ring, -int(np.argmin(ring))))
    return sorted(faces, key=lambda ring: tuple(ring.tolist()))


def _normal(corners: Vector) -> Vector:
    """Unit normal (3,) of a plane polygon (n, 3) by Newell's sum."""
    x = corners - corners[0]
    total = np.sum(np.cross(x, np.roll(x, -1, axis=0)), axis=0)
    unit: Vector = total / np.linalg.norm(total)
    return unit
