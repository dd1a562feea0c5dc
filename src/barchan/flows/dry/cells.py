"""Cells of a mesh as the piecewise constant model sees them: sizes, neighbours, outward faces (seed B, 7.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.spaces.meshes import check_mesh

BOUNDARY = -1


@dataclass(frozen=True, eq=False)
class Cells:
    """c cells with k sides each, in d dimensions.

    mesh : the scikit-fem mesh.
    volumes : (c,) [m^d].  centres : (c, d) centres of mass [m].
    neighbours : (c, k) number of the cell behind each side, `BOUNDARY` at the boundary.
    faces : (c, k, d) outward normals times areas [m^(d-1)]; those of the two cells of a side are exactly opposite.
    parts : (c, k) number of the named part in `names`, -1 inside.
    names : names of the parts of the boundary.
    """

    mesh: Any
    volumes: NDArray[np.float64]
    centres: NDArray[np.float64]
    neighbours: NDArray[np.int64]
    faces: NDArray[np.float64]
    parts: NDArray[np.int64]
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of cells c."""
        return len(self.volumes)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.centres.shape[1])

    @property
    def smallest_width(self) -> float:
        """The smallest volume over half of the areas around it [m]: the edge of a square cell times 1/2 x 4/4."""
        around = np.sum(np.linalg.norm(self.faces, axis=2), axis=1)
        return float(np.min(2.0 * self.dimension * self.volumes / around))

    @classmethod
    def of(cls, mesh: Any) -> Cells:
        """The cells of a scikit-fem mesh of triangles, quadrilaterals or tetrahedra with named parts.

        Raises InputError for what `check_mesh` refuses, and for anything that is not such a mesh.
        """
        if not all(hasattr(mesh, name) for name in ("p", "t", "facets", "f2t", "t2f")):
            raise InputError(
                "mesh", type(mesh).__name__, "a scikit-fem mesh of triangles, quadrilaterals or tetrahedra"
            )
        check_mesh(mesh)
        points, corners = np.asarray(mesh.p.T, dtype=float), np.asarray(mesh.t.T)
        volumes, centres = _sizes(points, corners)
        sides = np.asarray(mesh.t2f.T)  # (c, k)
        area_vectors, middles = _area_vectors(points, np.asarray(mesh.facets.T))
        # Seen from its first cell the vector of a facet points outwards, seen from the second it is the opposite.
        first = np.asarray(mesh.f2t[0])
        inwards = np.sum(area_vectors * (middles - centres[first]), axis=1) < 0.0
        area_vectors[inwards] *= -1.0
        own = np.arange(len(corners))[:, None]
        sign = np.where(first[sides] == own, 1.0, -1.0)
        other = np.where(first[sides] == own, np.asarray(mesh.f2t[1])[sides], first[sides])
        part_of = np.full(len(area_vectors), -1)
        for number, facets in enumerate(mesh.boundaries.values()):
            part_of[facets] = number
        return cls(
            mesh, volumes, centres, np.ascontiguousarray(other, dtype=np.int64),
            np.ascontiguousarray(sign[:, :, None] * area_vectors[sides]),
            np.where(other == BOUNDARY, part_of[sides], -1).astype(np.int64), tuple(mesh.boundaries),
        )  # fmt: skip


def _sizes(
    points: NDArray[np.float64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Volumes (c,) and centres of mass (c, d) of simplices, or of quadrilaterals as two triangles."""
    d = points.shape[1]
    if corners.shape[1] == d + 1:
        place = points[corners]
        volumes = np.abs(np.linalg.det(place[:, 1:] - place[:, :1])) / (2.0 if d == 2 else 6.0)
        return volumes, np.mean(place, axis=1)
    one, at_one = _sizes(points, corners[:, [0, 1, 2]])
    two, at_two = _sizes(points, corners[:, [0, 2, 3]])
    volumes = one + two
    return volumes, (one[:, None] * at_one + two[:, None] * at_two) / volumes[:, None]


def _area_vectors(
    points: NDArray[np.float64], facets: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal vectors (f, d) as long as the facets are large, of either sense, and the middles (f, d)."""
    place = points[facets]
    along = place[:, 1] - place[:, 0]
    if points.shape[1] == 2:
        return np.stack([along[:, 1], -along[:, 0]], axis=1), np.mean(place, axis=1)
    return 0.5 * np.cross(along, place[:, 2] - place[:, 0]), np.mean(place, axis=1)
