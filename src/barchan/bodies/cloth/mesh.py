"""Triangle meshes of cloth: their edges, hinges, boundary and areas; a mesh that no cloth can have is refused (`checking`).

The vertices of a mesh are the rest shape of the cloth: what it would be without weight and contact (seed B, 4.3 and 4.4.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.cloth.checking import check_rest_shape, check_topology
from barchan.bodies.cloth.hinges import Hinges, hinges_of
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False, init=False)
class ClothMesh:
    """An oriented surface of triangles, with or without boundary, in one piece or several.

    vertices : (n, 3) rest positions [m].  triangles : (m, 3) numbers of vertices, turning the same way in neighbours.

    Raises InputError naming the place for: vertices that coincide or belong to no triangle, triangles without area or folded
    back onto their neighbour, edges of more than two triangles, vertices where surfaces touch in a point, neighbours that
    turn opposite ways, a surface that cuts itself.
    """

    vertices: Vector
    triangles: Whole

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        points = inputs.table("vertices", vertices, (3,), 3)
        corners = np.asarray(triangles)
        if corners.ndim != 2 or corners.shape[1] != 3 or not np.issubdtype(corners.dtype, np.integer):
            raise InputError("triangles", corners.shape, "a table of whole numbers of shape (m, 3)")
        if len(corners) == 0 or corners.min() < 0 or corners.max() >= len(points):
            raise InputError("triangles", corners.shape, f"at least one, of the {len(points)} vertices")
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "triangles", np.ascontiguousarray(corners, dtype=np.int64))
        check_topology(self.vertices, self.triangles)
        check_rest_shape(self.vertices, self.triangles, self.hinges)

    def with_vertices(self, vertices: ArrayLike) -> ClothMesh:
        """The same triangles between other rest positions (n, 3); InputError if they make no cloth."""
        return ClothMesh(vertices, self.triangles)

    @cached_property
    def hinges(self) -> Hinges:
        """Edges, and those between two triangles with their four vertices."""
        return hinges_of(self.triangles)

    @cached_property
    def areas(self) -> Vector:
        """(m,) of the triangles [m^2]."""
        return triangle_areas(self.vertices, self.triangles)

    @cached_property
    def vertex_areas(self) -> Vector:
        """(n,) a third of the area of the triangles around each vertex [m^2]."""
        shares = np.repeat(self.areas / 3.0, 3)
        return np.asarray(np.bincount(self.triangles.ravel(), shares, len(self.vertices)), dtype=np.float64)

    @cached_property
    def edge_lengths(self) -> Vector:
        """(e,) [m]."""
        ends = self.vertices[self.hinges.edges]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    @cached_property
    def boundary(self) -> Whole:
        """Numbers of the vertices on a boundary, increasing."""
        return np.unique(self.hinges.edges[self.hinges.beside[:, 1] < 0])

    def nearest(self, point: ArrayLike) -> int:
        """Number of the vertex nearest to a point of the rest shape."""
        place = inputs.vector("point", point, (3,))
        return int(np.argmin(np.linalg.norm(self.vertices - place, axis=1)))


def triangle_areas(vertices: Vector, triangles: Whole) -> Vector:
    """(m,) areas [m^2]."""
    corner = vertices[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return 0.5 * np.linalg.norm(normal, axis=1)
