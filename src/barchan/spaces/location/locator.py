"""Point location on meshes of triangles, convex quadrilaterals and tetrahedra, by compiled walks and a grid of bins."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh, MeshQuad1, MeshTet1, MeshTri1

from barchan.errors import InputError
from barchan.spaces.location import _kernels as kernels

Found = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]
"""Cells (n,), reference coordinates (n, d) and whether each point lies in the domain (n,)."""


class Locator:
    """Finds the cells that hold points.

    Parameters
    ----------
    mesh : `skfem` mesh of straight triangles, convex quadrilaterals or tetrahedra.

    Raises InputError for any other kind of mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        # Curved cells are subclasses of the straight ones.
        if type(mesh) not in (MeshTri1, MeshQuad1, MeshTet1):
            raise InputError("mesh", type(mesh).__name__, "a mesh of triangles, quadrilaterals or tetrahedra")
        self.mesh = mesh
        self.dimension = int(mesh.dim())
        self._points = np.ascontiguousarray(mesh.p.T, dtype=np.float64)
        self._corners = self._points[mesh.t.T]
        self._planes = _planes(mesh, self._points, self._corners)
        self._neighbours = _neighbours(mesh)
        self._affine = not isinstance(mesh, MeshQuad1)
        if self._affine:
            edges = np.swapaxes(self._corners[:, 1:] - self._corners[:, :1], 1, 2)
            self._inverses = np.ascontiguousarray(np.linalg.inv(edges))
            self._origins = np.ascontiguousarray(self._corners[:, 0])
        self._boundary = mesh.boundary_facets()
        self._facet_corners = np.ascontiguousarray(self._points[mesh.facets[:, self._boundary].T])
        self._most_steps = 4 * len(self._corners) + 100
        self._make_bins()

    def find(self, points: ArrayLike, start: ArrayLike | None = None) -> Found:
        """Cells (n,), reference coordinates (n, d) and inside (n,) of points (n, d).

        Parameters
        ----------
        points : (n, d).
        start : (n,) cells near the points, from which the search walks; without it, or where it is negative, the
            points are looked up in a grid of bins.

        A point outside the domain is moved to the nearest point of the boundary, and `inside` is False there.

        Raises InputError for points that are not finite or not of the dimension of the mesh.
        """
        targets = self._checked("points", points)
        cells = np.full(len(targets), -1, dtype=np.int64)
        if start is not None:
            guess = self._checked_cells(start, len(targets))
            near = np.flatnonzero(guess >= 0)
            reached, _, states = self._walk(
                np.mean(self._corners[guess[near]], axis=1), targets[near], guess[near]
            )
            # A straight walk may leave the domain at a hole although the point lies in it: then the bins decide.
            done = states == kernels.INSIDE
            cells[near[done]] = reached[done]
        return self._finish(targets, cells)

    def follow(self, origins: ArrayLike, targets: ArrayLike, cells: ArrayLike) -> Found:
        """Ends of the straight paths from origins (n, d), which lie in `cells` (n,), to targets (n, d).

        Returns cells (n,), reference coordinates (n, d) and inside (n,) of the targets; a path that leaves the domain
        stops where it first does, and `inside` is False there. A negative cell means that it is not known.

        Raises InputError for points that are not finite or not of the dimension of the mesh.
        """
        beginnings, goals = self._checked("origins", origins), self._checked("targets", targets)
        current = self._checked_cells(cells, len(goals))
        if len(beginnings) != len(goals):
            raise InputError("origins", f"{len(beginnings)} points", f"as many as the targets ({len(goals)})")
        unknown = np.flatnonzero(current < 0)
        if len(unknown):
            current = current.copy()
            current[unknown] = self.find(beginnings[unknown])[0]
        reached, ends, states = self._walk(beginnings, goals, current)
        lost = np.flatnonzero(states == kernels.LOST)
        reference = self._reference(ends, reached)
        inside = states == kernels.INSIDE
        if len(lost):
            reached[lost], reference[lost], inside[lost] = self._finish(
                goals[lost], np.full(len(lost), -1, dtype=np.int64)
            )
        return reached, reference, inside

    def reference(self, points: ArrayLike, cells: ArrayLike) -> NDArray[np.float64]:
        """Reference coordinates (n, d) of points (n, d) that lie in `cells` (n,)."""
        targets = self._checked("points", points)
        return self._reference(targets, self._checked_cells(cells, len(targets)))

    def position(self, cells: NDArray[np.int64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (n, d) of reference coordinates (n, d) in `cells` (n,)."""
        return self.interpolate(self._points, cells, reference)

    def interpolate(
        self, vertex_values: NDArray[np.float64], cells: NDArray[np.int64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Values (n, c) at reference coordinates (n, d) of the field with `vertex_values` (m, c), linear in each cell."""
        if self._affine:
            weights = np.concatenate([1.0 - np.sum(reference, axis=1, keepdims=True), reference], axis=1)
        else:
            x, y = reference[:, 0], reference[:, 1]
            weights = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
        return np.asarray(np.einsum("nk,nkc->nc", weights, vertex_values[self.mesh.t.T[cells]]))

    def _finish(self, targets: NDArray[np.float64], cells: NDArray[np.int64]) -> Found:
        """Look up the points whose cell is negative; move those outside to the boundary."""
        inside = np.ones(len(targets), dtype=np.bool_)
        open_ = np.flatnonzero(cells < 0)
        if len(open_):
            cells[open_] = kernels.search(
                self._planes,
                targets[open_],
                self._lower,
                self._spacing,
                self._bins,
                self._starts,
                self._members,
            )
        outside = np.flatnonzero(cells < 0)
        if len(outside):
            inside[outside] = False
            facet, ends = kernels.nearest_on_boundary(targets[outside], self._facet_corners)
            targets = targets.copy()
            targets[outside] = ends
            cells[outside] = self.mesh.f2t[0, self._boundary[facet]]
        return cells, self._reference(targets, cells), inside

    def _walk(
        self, origins: NDArray[np.float64], targets: NDArray[np.float64], cells: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        reached, ends = cells.copy(), np.empty_like(targets)
        states = np.empty(len(cells), dtype=np.int64)
        kernels.walk(
            self._planes, self._neighbours, origins, targets, reached, ends, states, self._most_steps
        )
        return reached, ends, states

    def _reference(self, points: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
        if self._affine:
            return np.asarray(kernels.affine_reference(points, cells, self._origins, self._inverses))
        return np.asarray(kernels.bilinear_reference(points, cells, self._corners))

    def _checked(self, field: str, points: ArrayLike) -> NDArray[np.float64]:
        array = np.ascontiguousarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != self.dimension:
            raise InputError(field, f"an array of shape {array.shape}", f"of shape (n, {self.dimension})")
        if not np.all(np.isfinite(array)):
            raise InputError(field, "numbers that are not finite", "finite")
        return array

    def _checked_cells(self, cells: ArrayLike, count: int) -> NDArray[np.int64]:
        array = np.ascontiguousarray(cells, dtype=np.int64)
        if array.shape != (count,):
            raise InputError("cells", f"an array of shape {array.shape}", f"of shape ({count},)")
        if len(array) and np.max(array) >= len(self._corners):
            raise InputError("cells", int(np.max(array)), f"below the number of cells ({len(self._corners)})")
        return array

    def _make_bins(self) -> None:
        """Bins about the size of a cell, each with the list of the cells that reach into it."""
        low, high = np.min(self._corners, axis=1), np.max(self._corners, axis=1)
        self._lower = np.min(low, axis=0)
        size = np.max(high, axis=0) - self._lower
        wanted = (np.prod(size) / len(low)) ** (1.0 / self.dimension)
        self._bins = np.clip(np.ceil(size / wanted), 1, 4096).astype(np.int64)
        self._spacing = size / self._bins
        # A margin so that points on the edge of a bin find the cells on both its sides.
        margin = 1e-9 * self._spacing
        first = np.floor((low - margin - self._lower) / self._spacing).astype(np.int64)
        last = np.floor((high + margin - self._lower) / self._spacing).astype(np.int64)
        limit = self._bins - 1
        self._starts, self._members = kernels.fill_bins(
            np.clip(first, 0, limit), np.clip(last, 0, limit), self._bins
        )


def _neighbours(mesh: Mesh) -> NDArray[np.int64]:
    """(c, f) cell on the other side of each facet of each cell, -1 at the boundary."""
    both = mesh.f2t[:, mesh.t2f]
    own = np.arange(mesh.t.shape[1])[None, :]
    return np.ascontiguousarray(np.where(both[0] == own, both[1], both[0]).T, dtype=np.int64)


def _planes(mesh: Mesh, points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(c, f, d + 1) planes of the facets: 0 on the facet, 1 at the corner of the cell farthest from it."""
    vertices = points[mesh.facets[:, mesh.t2f]]  # (d, f, c, d): vertices of each facet of each cell
    base = vertices[0]
    if mesh.dim() == 2:
        along = vertices[1] - base
        normals = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    else:
        normals = np.cross(vertices[1] - base, vertices[2] - base)
    constants = -np.sum(normals * base, axis=-1)
    values = np.einsum("fcd,ckd->fck", normals, corners) + constants[..., None]
    farthest = np.take_along_axis(values, np.argmax(np.abs(values), axis=2)[..., None], axis=2)
    planes = np.concatenate([normals, constants[..., None]], axis=-1) / farthest
    return np.ascontiguousarray(np.swapaxes(planes, 0, 1))
