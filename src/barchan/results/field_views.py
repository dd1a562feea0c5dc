"""What a picture of a finite-element field shows: triangles of the whole domain, mirrored if asked, values on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh, MeshQuad, MeshTri

from barchan.errors import InputError
from barchan.spaces.location import Locator

# Points across the longer side of the grid on which stream lines are followed.
_STREAM_POINTS = 160
# Matter slower than this fraction of the fastest has no stream lines.
_STILL = 1e-4


@dataclass(frozen=True, eq=False)
class View:
    """A mesh of the plane as drawn.

    `points` (m, 2), `triangles` (n, 3) counter-clockwise, `cell` (n,) the cell of the mesh each triangle shows, `mirrored`
    whether the second half of points and triangles is the image of the first about the axis normal to `normal`,
    `outline` (k, 2) the vertices of each side of the domain, but for those on the axis of a mirrored mesh.
    """

    mesh: Mesh
    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    cell: NDArray[np.int64]
    outline: NDArray[np.int64]
    normal: int
    mirrored: bool

    @property
    def lower(self) -> NDArray[np.float64]:
        """(2,) lower corner of the picture."""
        return np.asarray(np.min(self.points, axis=0))

    @property
    def upper(self) -> NDArray[np.float64]:
        """(2,) upper corner of the picture."""
        return np.asarray(np.max(self.points, axis=0))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        width, height = self.upper - self.lower
        return float(width), float(height)

    def scalars(self, name: str, values: ArrayLike, odd: bool) -> tuple[NDArray[np.float64], bool]:
        """Numbers at the points or on the triangles, and whether at the points; vectors give their lengths.

        Raises InputError for values of another shape.
        """
        array = np.asarray(values, dtype=np.float64)
        vertices, cells = self.mesh.p.shape[1], self.mesh.t.shape[1]
        if array.ndim == 2 and array.shape == (vertices, 2):
            array = np.linalg.norm(array, axis=1)
        if array.shape not in ((vertices,), (cells,)):
            raise InputError(
                f"field {name!r}", f"values of shape {array.shape}", f"of shape ({vertices},) or ({cells},)"
            )
        sign = -1.0 if odd else 1.0
        if array.shape == (vertices,):
            return (np.concatenate([array, sign * array]) if self.mirrored else array), True
        shown = array[self.cell]
        if self.mirrored:
            shown[len(shown) // 2 :] *= sign
        return shown, False

    def marked(self, mask: ArrayLike) -> NDArray[np.bool_]:
        """(n,) triangles shown as marked by a mask of cells, or of vertices (a triangle needs all of its own)."""
        shown, at_points = self.scalars("rigid", np.asarray(mask, dtype=np.float64), odd=False)
        return np.all(shown[self.triangles] > 0.5, axis=1) if at_points else shown > 0.5

    def weights(self, at_points: bool) -> NDArray[np.float64]:
        """Area that each point (m,) or triangle (n,) stands for."""
        corners = self.points[self.triangles]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        if not at_points:
            return np.asarray(areas)
        shares = np.repeat(areas / 3.0, 3)
        return np.bincount(self.triangles.ravel(), shares, minlength=len(self.points)).astype(np.float64)


def make_view(mesh: Mesh, mirror: bool) -> View:
    """View of a mesh of triangles or quadrilaterals.

    Raises InputError for another mesh, or one without a straight part "axis" along x or y when it is to be mirrored.
    """
    if not isinstance(mesh, MeshTri | MeshQuad):
        raise InputError("mesh", type(mesh).__name__, "made of triangles or quadrilaterals, to be drawn")
    points, cells = np.array(mesh.p.T, dtype=np.float64), np.asarray(mesh.t.T, dtype=np.int64)
    triangles, cell = cells, np.arange(len(cells))
    if cells.shape[1] == 4:
        triangles, cell = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]]), np.tile(cell, 2)
    outer = mesh.boundary_facets()
    normal = 0
    if mirror:
        normal, axis_facets = _axis(mesh)
        outer = np.setdiff1d(outer, axis_facets)
    sides = mesh.facets[:, outer].T
    if mirror:
        image = points.copy()
        image[:, normal] *= -1.0
        triangles = np.concatenate([triangles, triangles + len(points)])
        sides = np.concatenate([sides, sides + len(points)])
        cell = np.tile(cell, 2)
        points = np.concatenate([points, image])
    a, b = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0.0
    triangles = np.where(clockwise[:, None], triangles[:, ::-1], triangles)
    return View(mesh, points, triangles, cell, sides, normal, mirror)


def stream_grid(
    view: View, velocity: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], np.ma.MaskedArray, np.ma.MaskedArray]:
    """x (i,), y (j,) and masked components (j, i) of vertex velocities on an even grid, blank outside and where still."""
    vertex = np.asarray(velocity, dtype=np.float64)
    if vertex.shape != (view.mesh.p.shape[1], 2):
        raise InputError(
            "velocity", f"values of shape {vertex.shape}", f"of shape ({view.mesh.p.shape[1]}, 2)"
        )
    step = max(view.size) / _STREAM_POINTS
    x, y = (np.linspace(view.lower[k], view.upper[k], max(12, round(view.size[k] / step))) for k in range(2))
    places = np.stack([line.ravel() for line in np.meshgrid(x, y)], axis=1)
    other = np.zeros(len(places), dtype=bool)
    if view.mirrored:
        half = np.mean(view.mesh.p[view.normal])
        other = places[:, view.normal] * half < 0.0
        places[other, view.normal] *= -1.0
    locator = Locator(view.mesh)
    cells, reference, inside = locator.find(places)
    found = locator.interpolate(vertex, cells, reference)
    found[other, view.normal] *= -1.0
    speed = np.linalg.norm(found, axis=1)
    blank = ~inside | (speed <= _STILL * np.max(speed)) | ~np.isfinite(speed)
    u, w = (np.ma.array(found[:, k], mask=blank).reshape(len(y), len(x)) for k in range(2))
    return x, y, u, w


def _axis(mesh: Mesh) -> tuple[int, NDArray[np.int64]]:
    """Direction normal to the part "axis", which lies at coordinate 0 of it, and its facets."""
    facets = (mesh.boundaries or {}).get("axis")
    if facets is not None and len(facets):
        place = mesh.p[:, np.unique(mesh.facets[:, facets])]
        for normal in range(2):
            if np.max(np.abs(place[normal])) <= 1e-9 * np.max(np.ptp(mesh.p, axis=1)):
                return normal, np.asarray(facets)
    raise InputError("mirror", True, "used with a mesh that has a part 'axis' on x = 0 or y = 0")
