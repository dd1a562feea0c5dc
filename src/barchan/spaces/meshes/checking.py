"""The check that every mesh passes before a flow is computed on it: cells, their joints, and the names of the boundary.

A bad mesh seldom stops a solver; it gives a wrong flow. So each fault is refused here, with the place where it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem import Mesh

from barchan.errors import InputError

# Vertices closer than this fraction of the size of the mesh are the same point drawn twice.
_SAME_POINT = 1e-9
# A cell smaller than this fraction of its longest edge to the power d is flat.
_FLAT = 1e-10
_FACETS = {
    (2, 3): ((0, 1), (1, 2), (2, 0)),
    (2, 4): ((0, 1), (1, 2), (2, 3), (3, 0)),
    (3, 4): ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
}


def check_mesh(mesh: Mesh, source: str = "mesh") -> None:
    """Refuse a mesh on which no flow should be computed.

    Parameters
    ----------
    mesh : `skfem` mesh of triangles, quadrilaterals or tetrahedra, with named boundary parts.
    source : what the messages call it (a file name).

    Raises
    ------
    InputError : coordinates that are not finite; flat, folded or overlapping cells; vertices used by no cell; vertices drawn
        twice or cells that meet along part of a side (an open mesh); no named part; boundary facets without a name or with
        two; a part that is empty or lies inside the domain.
    """
    check_cells(np.asarray(mesh.p.T, dtype=np.float64), np.asarray(mesh.t.T, dtype=np.int64), source)
    check_names(mesh, source)


def check_cells(
    points: NDArray[np.float64], cells: NDArray[np.int64], source: str = "mesh", oriented: bool = False
) -> None:
    """Refuse points (m, d) and cells (n, k) that are no conforming mesh; see `check_mesh`.

    With `oriented` also those listed clockwise (a negative volume): files are, while scikit-fem sorts its triangles.
    """
    if not np.all(np.isfinite(points)):
        raise InputError(source, "coordinates that are not finite", "finite in every coordinate")
    if (points.shape[1], cells.shape[1]) not in _FACETS or len(cells) == 0:
        raise InputError(
            source,
            f"{len(cells)} cells of {cells.shape[1]} vertices",
            "triangles, quadrilaterals or tetrahedra",
        )
    if np.min(cells) < 0 or np.max(cells) >= len(points):
        raise InputError(
            source, f"vertex {int(np.max(cells))} of {len(points)}", "made of vertices that exist"
        )
    _check_sizes(points, cells, source, oriented)
    _check_vertices(points, cells, source)
    _check_joints(points, cells, source)


def check_names(mesh: Mesh, source: str = "mesh") -> None:
    """Refuse boundary parts that do not cover the boundary exactly once; see `check_mesh`."""
    parts = mesh.boundaries or {}
    if not parts:
        raise InputError(
            source, "no named boundary", "a mesh whose boundary parts are named (physical groups in gmsh)"
        )
    boundary = mesh.boundary_facets()
    owner = np.full(mesh.facets.shape[1], -1)
    names = list(parts)
    on_boundary = np.zeros(mesh.facets.shape[1], dtype=bool)
    on_boundary[boundary] = True
    for number, name in enumerate(names):
        facets = np.unique(np.asarray(parts[name], dtype=np.int64))
        if len(facets) == 0:
            raise InputError(source, f"part {name!r} is empty", "made of parts with at least one facet")
        inner = facets[~on_boundary[facets]]
        if len(inner):
            raise InputError(
                source,
                f"{len(inner)} facets of {name!r} inside the domain, one at {_middle(mesh, inner[0])}",
                "a mesh whose named parts lie on its boundary",
            )
        twice = facets[owner[facets] >= 0]
        if len(twice):
            raise InputError(
                source,
                f"{len(twice)} facets in both {names[owner[twice[0]]]!r} and {name!r}",
                "a mesh whose boundary facets each have one name",
            )
        owner[facets] = number
    unnamed = boundary[owner[boundary] < 0]
    if len(unnamed):
        raise InputError(
            source,
            f"{len(unnamed)} boundary facets without a name, one at {_middle(mesh, unnamed[0])}",
            "a closed mesh whose boundary facets all have a name",
        )


def signed_sizes(points: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, c) signed sizes of cells (n, k): the volume of a simplex, the four corner triangles of a quadrilateral."""
    corners = points[cells]
    if points.shape[1] == 3:
        return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)[:, None]
    turns = ((0, 1, 2),) if cells.shape[1] == 3 else ((0, 1, 2), (1, 2, 3), (2, 3, 0), (3, 0, 1))
    sizes = []
    for a, b, c in turns:
        first, second = corners[:, b] - corners[:, a], corners[:, c] - corners[:, a]
        sizes.append(0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]))
    return np.stack(sizes, axis=1)


def _check_sizes(points: NDArray[np.float64], cells: NDArray[np.int64], source: str, oriented: bool) -> None:
    """No flat cell, no crossed or concave quadrilateral, and no clockwise cell when it matters."""
    corners = points[cells]
    longest = np.max(np.ptp(corners, axis=1), axis=1)
    sizes = signed_sizes(points, cells)
    flat = np.any(np.abs(sizes) <= _FLAT * longest[:, None] ** points.shape[1], axis=1)
    _refuse_cells(points, cells, flat, source, "flat", "made of cells with a positive size")
    folded = np.any(np.sign(sizes) != np.sign(sizes[:, :1]), axis=1)
    _refuse_cells(points, cells, folded, source, "concave or crossed", "made of convex quadrilaterals")
    if oriented:
        _refuse_cells(
            points, cells, sizes[:, 0] < 0.0, source, "inverted",
            "made of cells listed counter-clockwise (positive size)",
        )  # fmt: skip


def _check_vertices(points: NDArray[np.float64], cells: NDArray[np.int64], source: str) -> None:
    """Every vertex used, and none drawn twice."""
    used = np.zeros(len(points), dtype=bool)
    used[cells] = True
    if not np.all(used):
        first = int(np.argmin(used))
        raise InputError(
            source,
            f"{np.count_nonzero(~used)} vertices used by no cell, one at {_place(points[first])}",
            "a mesh whose vertices all belong to a cell",
        )
    size = float(np.max(np.ptp(points, axis=0)))
    pairs = cKDTree(points).query_pairs(_SAME_POINT * size, output_type="ndarray")
    if len(pairs):
        first = int(np.min(pairs))
        raise InputError(
            source,
            f"{len(pairs)} pairs of vertices at the same place, one at {_place(points[first])}",
            "closed: cells that touch share their vertices",
        )


def _check_joints(points: NDArray[np.float64], cells: NDArray[np.int64], source: str) -> None:
    """At most two cells to a facet, on opposite sides of it; no vertex in the middle of a side of another cell."""
    pattern = _FACETS[points.shape[1], cells.shape[1]]
    facets = np.sort(np.concatenate([cells[:, list(corners)] for corners in pattern]), axis=1)
    owners = np.tile(np.arange(len(cells)), len(pattern))
    order = np.lexsort(facets.T)
    facets, owners = facets[order], owners[order]
    same = np.all(facets[1:] == facets[:-1], axis=1)
    crowded = np.flatnonzero(same[1:] & same[:-1])
    if len(crowded):
        raise InputError(
            source,
            f"a facet at {_place(np.mean(points[facets[crowded[0]]], axis=0))} shared by more than two cells",
            "a mesh whose facets belong to one or two cells",
        )
    inner = np.flatnonzero(same)
    heights = [
        _heights(points, facets[inner], np.mean(points[cells[owners[inner + k]]], axis=1)) for k in (0, 1)
    ]
    overlap = np.zeros(len(cells), dtype=bool)
    overlap[owners[inner[heights[0] * heights[1] > 0.0]]] = True
    _refuse_cells(points, cells, overlap, source, "inverted", "made of cells that do not overlap")
    if points.shape[1] == 2:
        alone = np.ones(len(facets), dtype=bool)
        alone[inner], alone[inner + 1] = False, False
        _check_hanging(points, facets[alone], source)


def _check_hanging(points: NDArray[np.float64], sides: NDArray[np.int64], source: str) -> None:
    """No boundary vertex in the middle of a boundary side (n, 2): two cells would touch there without being joined."""
    vertices = np.unique(sides)
    begin, along = points[sides[:, 0]], points[sides[:, 1]] - points[sides[:, 0]]
    length = np.linalg.norm(along, axis=1)
    near = cKDTree(points[vertices]).query_ball_point(begin + 0.5 * along, 0.5 * length)
    for side, candidates in enumerate(near):
        if len(candidates) == 0:
            continue
        offset = points[vertices[candidates]] - begin[side]
        fraction = offset @ along[side] / length[side] ** 2
        height = np.abs(offset[:, 0] * along[side, 1] - offset[:, 1] * along[side, 0]) / length[side]
        hanging = (height < 1e-6 * length[side]) & (fraction > 1e-6) & (fraction < 1.0 - 1e-6)
        if np.any(hanging):
            vertex = int(vertices[candidates[int(np.argmax(hanging))]])
            raise InputError(
                source,
                f"vertex {vertex} at {_place(points[vertex])} in the middle of a cell's side",
                "closed: cells that touch share whole sides",
            )


def _heights(
    points: NDArray[np.float64], facets: NDArray[np.int64], tops: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n,) signed distance, up to a positive factor, of tops (n, d) from facets (n, d)."""
    edges = points[facets[:, 1:]] - points[facets[:, :1]]
    return np.asarray(np.linalg.det(np.concatenate([edges, (tops - points[facets[:, 0]])[:, None]], axis=1)))


def _refuse_cells(
    points: NDArray[np.float64],
    cells: NDArray[np.int64],
    bad: NDArray[np.bool_],
    source: str,
    fault: str,
    allowed: str,
) -> None:
    """InputError naming the first of the bad cells (n,), if there is one."""
    if np.any(bad):
        first = int(np.argmax(bad))
        count = np.count_nonzero(bad)
        others = f" and {count - 1} more" if count > 1 else ""
        raise InputError(
            source,
            f"{fault} cell {first} at {_place(np.mean(points[cells[first]], axis=0))}{others}",
            allowed,
        )


def _middle(mesh: Mesh, facet: int) -> str:
    return _place(np.mean(mesh.p[:, mesh.facets[:, facet]], axis=1))


def _place(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"
