"""What the builders share: checked numbers, lines of vertices, quadrilaterals cut into triangles, names of boundary parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh, MeshTri

from barchan.errors import InputError

# A facet belongs to a plane when its middle lies within this fraction of the size of the mesh.
PLANE_TOLERANCE = 1e-9

Part = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


def number(field: str, value: Any, minimum: float = 0.0, allowed: str = "a positive number") -> float:
    """`value` as a finite float above `minimum`. Raises InputError."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise InputError(field, value, allowed) from None
    if not np.isfinite(result) or result <= minimum:
        raise InputError(field, value, allowed)
    return result


def count(field: str, value: Any, minimum: int = 1) -> int:
    """`value` as a whole number of at least `minimum`. Raises InputError."""
    allowed = f"a whole number of at least {minimum}"
    try:
        result = int(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(field, value, allowed) from None
    if result != value or result < minimum or isinstance(value, bool):
        raise InputError(field, value, allowed)
    return result


def corner_points(lower: Any, upper: Any, dimension: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corner (d,) of a box. Raises InputError when they are not d finite numbers in order."""
    corners = []
    for field, value in (("mesh.lower", lower), ("mesh.upper", upper)):
        try:
            corner = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(field, value, f"{dimension} numbers") from None
        if corner.shape != (dimension,) or not np.all(np.isfinite(corner)):
            raise InputError(field, value, f"{dimension} finite numbers")
        corners.append(corner)
    if not np.all(corners[1] > corners[0]):
        raise InputError(
            "mesh.upper", upper, f"above the lower corner {corners[0].tolist()} along every axis"
        )
    return corners[0], corners[1]


def graded_line(start: float, end: float, cells: int, ratio: float = 1.0) -> NDArray[np.float64]:
    """(cells + 1,) increasing coordinates from `start` to `end`, symmetric about the middle.

    The widths grow geometrically from both ends to the middle, where they are `ratio` times those at the ends.
    """
    from_end = np.minimum(np.arange(cells), np.arange(cells)[::-1])
    widths = ratio ** (from_end / max(1, np.max(from_end)))
    line = start + (end - start) * np.concatenate([[0.0], np.cumsum(widths)]) / np.sum(widths)
    line[-1] = end
    return line


def one_sided_line(start: float, end: float, cells: int, ratio: float) -> NDArray[np.float64]:
    """(cells + 1,) coordinates from `start` to `end`; the last width is `ratio` times the first (geometric)."""
    widths = ratio ** (np.arange(cells) / max(1, cells - 1))
    line = start + (end - start) * np.concatenate([[0.0], np.cumsum(widths)]) / np.sum(widths)
    line[-1] = end
    return line


def grid_quadrilaterals(rows: int, columns: int) -> NDArray[np.int64]:
    """((rows - 1)(columns - 1), 4) corners, in circular order, of the cells of a (rows, columns) array of vertices.

    Counter-clockwise when the first index runs to the right and the second upwards.
    """
    index = np.arange(rows * columns).reshape(rows, columns)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    return np.stack([corner.ravel() for corner in corners], axis=1)


def cut(quadrilaterals: NDArray[np.int64], first_diagonal: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(2 n, 3) triangles of quadrilaterals (n, 4), cut from corner 0 to 2 where `first_diagonal` (n,), else 1 to 3."""
    turned = np.where(first_diagonal[:, None], quadrilaterals, np.roll(quadrilaterals, -1, axis=1))
    return np.stack([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def best_diagonals(points: NDArray[np.float64], quadrilaterals: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) whether the diagonal from corner 0 to 2 leaves the larger smallest angle in quadrilaterals (n, 4)."""
    smallest = []
    for first in (True, False):
        triangles = cut(quadrilaterals, np.full(len(quadrilaterals), first))
        smallest.append(np.min(smallest_angles(points, triangles).reshape(-1, 2), axis=1))
    # The tolerance makes ties fall alike on both sides of a symmetry axis and on every machine.
    return np.asarray(smallest[0] > smallest[1] - 1e-9)


def smallest_angles(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n,) smallest angle (rad) of the triangles (n, 3) on points (m, 2)."""
    corners = points[triangles]
    angles = []
    for k in range(3):
        a, b = (corners[:, (k + j) % 3] - corners[:, k] for j in (1, 2))
        cosine = np.sum(a * b, axis=1) / np.maximum(
            np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-300
        )
        angles.append(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return np.min(angles, axis=0)


def triangle_mesh(
    points: NDArray[np.float64], triangles: NDArray[np.int64], parts: Mapping[str, Part]
) -> MeshTri:
    """Triangle mesh of points (m, 2) and cells (n, 3) with named boundary parts."""
    return named(MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles.T)), parts)


def named(mesh: Mesh, parts: Mapping[str, Part]) -> Mesh:
    """`mesh` with every boundary facet named by the first of `parts` that holds its middle, given as x (d, n) -> (n,)."""
    facets = mesh.boundary_facets()
    middles = np.mean(mesh.p[:, mesh.facets[:, facets]], axis=1)
    free = np.ones(len(facets), dtype=bool)
    boundaries = {}
    for name, part in parts.items():
        chosen = free & part(middles)
        boundaries[name] = facets[chosen]
        free &= ~chosen
    if np.any(free):
        raise ValueError(f"{np.count_nonzero(free)} boundary facets belong to no part of {list(parts)}")
    return type(mesh)(np.ascontiguousarray(mesh.p), np.ascontiguousarray(mesh.t), _boundaries=boundaries)


def plane(axis: int, position: float, size: float) -> Part:
    """Part of the boundary on the plane x[axis] = position of a mesh of the given size."""
    return lambda x: np.abs(x[axis] - position) <= PLANE_TOLERANCE * size


def everywhere(x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The part that takes all facets not named before it."""
    return np.ones(x.shape[1], dtype=bool)
