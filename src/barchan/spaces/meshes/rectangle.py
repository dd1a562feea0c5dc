"""Structured meshes of rectangles and boxes: triangles, quadrilaterals, tetrahedra; even or graded towards the sides.

Triangles are cut so that every corner of the rectangle is shared by two cells: a triangle with all its sides on a wall
where the velocity is imposed could not be strained at all, and its stress would be undetermined.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshQuad, MeshTet, MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes._cells import (
    corner_points,
    count,
    cut,
    graded_line,
    grid_quadrilaterals,
    named,
    number,
    plane,
)

KINDS = ("triangle", "quadrilateral")
DIAGONALS = ("corners", "same", "crossed")


def rectangle(
    lower: ArrayLike,
    upper: ArrayLike,
    cells: Sequence[int],
    kind: str = "triangle",
    grading: float | Sequence[float] = 1.0,
    diagonals: str = "corners",
) -> MeshTri | MeshQuad:
    """Mesh of the rectangle from `lower` (2,) to `upper` (2,), with parts left, right, bottom, top.

    Parameters
    ----------
    lower, upper : (2,) corners.
    cells : number of quadrilaterals along x and y; each is cut into triangles when `kind` is "triangle".
    kind : "triangle" or "quadrilateral".
    grading : width of the middle cells over that of the cells at the sides, one number or one per axis; 1 is even.
    diagonals : how quadrilaterals are cut. "corners": two triangles, diagonals pointing to the centre of the rectangle,
        symmetric about both its axes when the numbers of cells are even; "same": all diagonals parallel; "crossed": four
        triangles around the middle of each.

    Raises InputError for corners out of order, no cells, an unknown kind or a grading that is not positive.
    """
    start, end = corner_points(lower, upper, 2)
    counts = _counts(cells, 2)
    ratios = _ratios(grading, 2)
    lines = [graded_line(start[k], end[k], counts[k], ratios[k]) for k in range(2)]
    return tensor_rectangle(lines[0], lines[1], kind, diagonals)


def tensor_rectangle(
    x: NDArray[np.float64], y: NDArray[np.float64], kind: str = "triangle", diagonals: str = "corners"
) -> MeshTri | MeshQuad:
    """Mesh of the rectangle whose vertices stand at every pair of the increasing x (n,) and y (m,); see `rectangle`."""
    _choice("mesh.kind", kind, KINDS)
    _choice("mesh.diagonals", diagonals, DIAGONALS)
    points = np.stack([line.ravel() for line in np.meshgrid(x, y, indexing="ij")], axis=1)
    corners = grid_quadrilaterals(len(x), len(y))
    if kind == "quadrilateral":
        mesh = MeshQuad(np.ascontiguousarray(points.T), np.ascontiguousarray(corners.T))
    else:
        if diagonals == "crossed":
            points, triangles = _crossed(points, corners)
        elif diagonals == "same":
            triangles = cut(corners, np.ones(len(corners), dtype=bool))
        else:
            triangles = cut(corners, _towards_centre(len(x) - 1, len(y) - 1))
        mesh = MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles.T))
    size = float(max(x[-1] - x[0], y[-1] - y[0]))
    sides = {
        "left": plane(0, x[0], size),
        "right": plane(0, x[-1], size),
        "bottom": plane(1, y[0], size),
        "top": plane(1, y[-1], size),
    }
    return named(mesh, sides)


def box(
    lower: ArrayLike, upper: ArrayLike, cells: Sequence[int], grading: float | Sequence[float] = 1.0
) -> MeshTet:
    """Tetrahedra of the box from `lower` (3,) to `upper` (3,); six to each of the `cells` along x, y, z.

    Parts: left, right (x), front, back (y), bottom, top (z). `grading` as for `rectangle`.

    Raises InputError for corners out of order, no cells or a grading that is not positive.
    """
    start, end = corner_points(lower, upper, 3)
    counts = _counts(cells, 3)
    ratios = _ratios(grading, 3)
    lines = [graded_line(start[k], end[k], counts[k], ratios[k]) for k in range(3)]
    size = float(np.max(end - start))
    names = (("left", "right"), ("front", "back"), ("bottom", "top"))
    parts = {
        name: plane(axis, lines[axis][side], size)
        for axis, pair in enumerate(names)
        for name, side in zip(pair, (0, -1), strict=True)
    }
    return named(tensor_tetrahedra(lines), parts)


def tensor_tetrahedra(lines: Sequence[NDArray[np.float64]]) -> MeshTet:
    """Unnamed tetrahedra on the vertices of three increasing lines, six along the long diagonal of each box.

    The diagonals point to the middle of the whole, so that its eight corners are each shared by six cells.
    """
    sizes = tuple(len(line) for line in lines)
    points = np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")])
    box_index = np.stack(
        [axis.ravel() for axis in np.meshgrid(*(np.arange(size - 1) for size in sizes), indexing="ij")],
        axis=1,
    )
    # Kuhn's cut follows the axes one after the other from one corner to the opposite one. Starting at the corner
    # farthest from the middle along each axis mirrors it in half of the boxes; neighbours still agree on the diagonal
    # of their common face, which depends on the other two axes only.
    far = np.stack([box_index[:, k] * 2 + 1 > sizes[k] - 1 for k in range(3)], axis=1)
    steps = np.where(far, -1, 1)
    strides = np.array([sizes[1] * sizes[2], sizes[2], 1])
    start = (box_index + far) @ strides
    tetrahedra = []
    for order in permutations(range(3)):
        path = [start]
        for axis in order:
            path.append(path[-1] + steps[:, axis] * strides[axis])
        tetrahedra.append(np.stack(path, axis=1))
    cells = np.concatenate(tetrahedra)
    return MeshTet(points, np.ascontiguousarray(positive(points.T, cells).T))


def positive(points: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """The tetrahedra (n, 4) on points (m, 3) with two corners exchanged where their volume is negative."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    negative = np.linalg.det(edges) < 0.0
    result = cells.copy()
    result[negative, 2:] = result[negative, :1:-1]
    return result


def split_at_centres(mesh: MeshTri) -> MeshTri:
    """Each triangle cut in three at its centre, the boundary parts kept (the split on which P2-P1d is a stable pair)."""
    vertices, cells = mesh.p.shape[1], mesh.t.shape[1]
    points = np.hstack([mesh.p, np.mean(mesh.p[:, mesh.t], axis=1)])
    centre = vertices + np.arange(cells)
    triangles = np.hstack([np.stack([mesh.t[a], mesh.t[b], centre]) for a, b in ((0, 1), (1, 2), (0, 2))])
    fine = MeshTri(points, triangles)
    # The boundary facets are the old ones: find them again by their two vertices.
    key = fine.facets[0].astype(np.int64) * points.shape[1] + fine.facets[1]
    order = np.argsort(key)
    boundaries = {}
    for name, facets in (mesh.boundaries or {}).items():
        wanted = mesh.facets[:, facets].astype(np.int64)
        boundaries[name] = order[np.searchsorted(key[order], wanted[0] * points.shape[1] + wanted[1])]
    return MeshTri(points, triangles, _boundaries=boundaries)


def _towards_centre(columns: int, rows: int) -> NDArray[np.bool_]:
    """(columns rows,) whether the diagonal of each cell rises to the right, so that it points to the centre."""
    left = 2 * np.arange(columns) + 1 <= columns
    low = 2 * np.arange(rows) + 1 <= rows
    return np.asarray(left[:, None] == low[None, :]).ravel()


def _crossed(
    points: NDArray[np.float64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Four triangles around the middle of each quadrilateral (n, 4): all points, and triangles (4 n, 3)."""
    middle = len(points) + np.arange(len(corners))
    sides = [np.stack([corners[:, k], corners[:, (k + 1) % 4], middle], axis=1) for k in range(4)]
    return np.concatenate([points, np.mean(points[corners], axis=1)]), np.concatenate(sides)


def _choice(field: str, value: Any, choices: Sequence[str]) -> None:
    if value not in choices:
        raise InputError(field, value, "one of " + ", ".join(choices))


def _counts(cells: Any, dimension: int) -> list[int]:
    values = list(cells) if isinstance(cells, Sequence | np.ndarray) else []
    if len(values) != dimension:
        raise InputError("mesh.cells", cells, f"{dimension} whole numbers")
    return [count("mesh.cells", value) for value in values]


def _ratios(grading: Any, dimension: int) -> list[float]:
    values = list(grading) if isinstance(grading, Sequence | np.ndarray) else [grading] * dimension
    if len(values) != dimension:
        raise InputError("mesh.grading", grading, f"one positive number, or {dimension}")
    return [number("mesh.grading", value) for value in values]
