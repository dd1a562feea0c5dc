"""Second-order meshes of curved domains from structured grids of twice as many points, each block mapped smoothly.

A cell takes nine points of the grid: corners, middles of its sides, centre. All nodes of the coarsest mesh so lie where
the map of the domain puts them, not only those on its boundary.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad, MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes._cells import Part, best_diagonals, count, named
from barchan.spaces.quadratic import QuadraticMesh

KINDS = ("quadrilateral", "triangle")
FINEST = 8

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

# Nodes of the two triangles (corners, then middles of the sides 01, 12, 02) among the nine of a quadrilateral (corners
# 0..3, middles of 01, 12, 23, 03, centre), cut from corner 0 to 2, and from 1 to 3.
_CUTS = (((0, 1, 2, 4, 5, 8), (0, 2, 3, 8, 6, 7)), ((1, 2, 3, 5, 6, 8), (1, 3, 0, 8, 7, 4)))


def check_level(level: Any, kind: Any) -> int:
    """`level` as an int. Raises InputError for one that is not 1..8 and for an unknown kind of cells."""
    if kind not in KINDS:
        raise InputError("mesh.kind", kind, "one of " + ", ".join(KINDS))
    result = count("mesh.level", level)
    if result > FINEST:
        raise InputError("mesh.level", level, f"from 1 to {FINEST}")
    return result


def nine_nodes(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n m, 9) points of the cells of a grid `index` (2 n + 1, 2 m + 1), whose second axis is left of the first.

    Corners counter-clockwise, middles of the sides 01, 12, 23, 03, centre.
    """
    low, mid, high = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
    places = (
        (low, low), (high, low), (high, high), (low, high),
        (mid, low), (high, mid), (mid, high), (low, mid), (mid, mid),
    )  # fmt: skip
    return np.stack([index[place].ravel() for place in places], axis=1)


def curved_mesh(
    points: NDArray[np.float64],
    cells: NDArray[np.int64],
    parts: Mapping[str, Part],
    curves: Mapping[str, Curve],
    kind: str,
    through: Sequence[tuple[float, float]] = (),
) -> QuadraticMesh:
    """Mesh of the cells (C, 9) on points (F, 2), with named parts of its boundary and their curves.

    kind : "quadrilateral"; or "triangle", when each is cut in two, with the diagonal through the corners of the domain
        given as `through`, so that no triangle has all its corners on the boundary there.
    """
    if kind == "triangle":
        cells = _cut(points, cells, through)
    corner_count = 4 if kind == "quadrilateral" else 3
    corners = cells[:, :corner_count]
    used = np.unique(corners)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    mesh_type = MeshQuad if kind == "quadrilateral" else MeshTri
    skeleton = named(
        mesh_type(np.ascontiguousarray(points[used].T), np.ascontiguousarray(number[corners].T)), parts
    )
    # The middle of each facet, found by its two vertices.
    sides = [(k, (k + 1) % corner_count) for k in range(corner_count)]
    ends = np.sort(number[np.concatenate([corners[:, side] for side in sides])], axis=1)
    keys, first = np.unique(ends[:, 0] * len(used) + ends[:, 1], return_index=True)
    middles = np.concatenate([cells[:, corner_count + k] for k in range(corner_count)])[first]
    facets = np.sort(skeleton.facets.astype(np.int64), axis=0)
    middles = middles[np.searchsorted(keys, facets[0] * len(used) + facets[1])]
    centres = cells[:, 8] if kind == "quadrilateral" else np.zeros(0, dtype=np.int64)
    nodes = points[np.concatenate([used, middles, centres])]
    return QuadraticMesh.of(skeleton, curves=dict(curves), nodes=nodes)


def refined(mesh: QuadraticMesh, level: int) -> QuadraticMesh:
    """The mesh of `level`, that of level 1 being `mesh`."""
    for _ in range(level - 1):
        mesh = mesh.refined()
    return mesh


def circle(centre: tuple[float, float], radius: float) -> Curve:
    """The projection of points (n, 2) on a circle."""
    middle = np.array(centre)

    def project(x: NDArray[np.float64]) -> NDArray[np.float64]:
        away = x - middle
        return np.asarray(middle + radius * away / np.linalg.norm(away, axis=1, keepdims=True))

    return project


def _cut(
    points: NDArray[np.float64], cells: NDArray[np.int64], through: Sequence[tuple[float, float]]
) -> NDArray[np.int64]:
    """(2 C, 6) triangles of second order of the quadrilaterals (C, 9)."""
    corners = cells[:, :4]
    first = best_diagonals(points, corners)
    for place in through:
        corner = int(np.argmin(np.sum((points - np.array(place)) ** 2, axis=1)))
        cell, position = np.nonzero(corners == corner)
        first[cell] = position % 2 == 0
    halves = [
        np.where(first[:, None], cells[:, along], cells[:, across])
        for along, across in zip(*_CUTS, strict=True)
    ]
    return np.stack(halves, axis=1).reshape(-1, 6)
