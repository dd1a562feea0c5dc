"""Meshes of the silo of seed A, Fig. 8: half of it in two dimensions, a quarter with a square outlet in three.

`width` and `outlet` are those of the whole silo (W and D of seed A, where W = H = 8 L); only one side of its symmetry
axis is meshed, so that the half silo spans 0 <= x <= W/2 and its outlet 0 <= x <= D/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTet, MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes._cells import count, cut, everywhere, named, number, one_sided_line, plane
from barchan.spaces.meshes.rectangle import tensor_tetrahedra

# The graded mesh starts from even triangles, about this many times fewer than asked for, and cuts the largest in two.
_COARSENING = 12
# Cells at the edge of the outlet are as small as those of a mesh graded like the square root of the distance to a point
# this fraction of the outlet away from that edge.
_CORE = 0.125
_FEWEST_VERTICES = 12


def silo(
    outlet: float, width: float, height: float, vertices: int, below: float = 0.0, grading: bool = True
) -> MeshTri:
    """Triangles of the half silo 0 <= x <= width/2, 0 <= y <= height, open at y = 0 for 0 <= x <= outlet/2.

    Parameters
    ----------
    outlet : aperture D of the whole silo, below `width`; its edge (outlet/2, 0) is a vertex.
    width, height : of the whole silo.
    vertices : about how many the mesh should have (within 5 % from a few hundred on).
    below : length of a chute below the outlet, as wide as it; none when 0.
    grading : cells refined towards the edge of the outlet; otherwise even cells, all cut quadrilaterals.

    Parts: axis (x = 0), wall (x = width/2), bottom, outlet, top; with a chute, its side is "chute" and its end "outlet".

    Raises InputError for lengths that are not positive, an outlet as wide as the silo, fewer than 12 vertices.
    """
    half_outlet, half_width = _halves(outlet, width)
    height = number("silo.height", height)
    below = number("silo.below", below, -1e-300, "a length of at least 0")
    wanted = count("silo.vertices", vertices, _FEWEST_VERTICES)
    lengths = (half_outlet, half_width, height, below)
    if grading:
        points, triangles = _even_silo(lengths, max(_FEWEST_VERTICES, wanted // _COARSENING))
        points, triangles = _refine(points, triangles, half_outlet, wanted)
    else:
        points, triangles = _even_silo(lengths, wanted)
    size = max(half_width, height + below)
    parts = {
        "axis": plane(0, 0.0, size),
        "wall": plane(0, half_width, size),
        "top": plane(1, height, size),
        "outlet": lambda x: (np.abs(x[1] + below) <= 1e-9 * size) & (x[0] < half_outlet),
        "bottom": lambda x: (np.abs(x[1]) <= 1e-9 * size) & (x[0] > half_outlet),
    }
    if below > 0.0:
        parts["chute"] = lambda x: (np.abs(x[0] - half_outlet) <= 1e-9 * size) & (x[1] < 0.0)
    mesh = MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles.T))
    return named(mesh, parts)


def silo_3d(
    outlet: float, width: float, height: float, cells: Sequence[int], grading: float = 4.0
) -> MeshTet:
    """Tetrahedra of a quarter of a square silo, 0 <= x, y <= width/2, 0 <= z <= height, with a square outlet at z = 0.

    Parameters
    ----------
    outlet : side of the outlet of the whole silo, below `width`.
    width, height : of the whole silo.
    cells : (2,) number of boxes along x (and along y), and along z; six tetrahedra to a box.
    grading : width of the largest boxes over that of those at the edge of the outlet.

    Parts: axis_x (the plane x = 0), axis_y (the plane y = 0), wall (x or y = width/2), bottom, outlet, top.

    Raises InputError for lengths that are not positive, an outlet as wide as the silo, fewer than 2 boxes along x.
    """
    half_outlet, half_width = _halves(outlet, width)
    height = number("silo.height", height)
    ratio = number("silo.grading", grading)
    if not isinstance(cells, Sequence | np.ndarray) or len(cells) != 2:
        raise InputError("silo.cells", cells, "two whole numbers: boxes along x and along z")
    across, along = count("silo.cells", cells[0], 2), count("silo.cells", cells[1])
    line = _line_with_edge(half_outlet, half_width, across, ratio)
    up = one_sided_line(0.0, height, along, ratio)
    size = max(half_width, height)
    parts = {
        "axis_x": plane(0, 0.0, size),
        "axis_y": plane(1, 0.0, size),
        "top": plane(2, height, size),
        "outlet": lambda x: (x[2] <= 1e-9 * size) & (x[0] < half_outlet) & (x[1] < half_outlet),
        "bottom": plane(2, 0.0, size),
        "wall": everywhere,
    }
    return named(tensor_tetrahedra((line, line, up)), parts)


def _halves(outlet: Any, width: Any) -> tuple[float, float]:
    """Half outlet and half width: the one place that says lengths are those of the whole silo."""
    whole = number("silo.width", width)
    aperture = number("silo.outlet", outlet)
    if aperture >= whole:
        raise InputError("silo.outlet", outlet, f"below the width of the silo ({whole:g})")
    return aperture / 2.0, whole / 2.0


def _line_with_edge(edge: float, end: float, cells: int, ratio: float) -> NDArray[np.float64]:
    """(cells + 1,) coordinates from 0 to `end` with one at `edge`, the cells there smallest."""
    inner = min(max(1, round(cells * (0.5 * edge / end + 0.5 * np.sqrt(edge / end)))), cells - 1)
    below = edge - one_sided_line(0.0, edge, inner, ratio ** min(1.0, inner / (cells - inner)))[::-1]
    below[0], below[-1] = 0.0, edge
    return np.concatenate([below[:-1], one_sided_line(edge, end, cells - inner, ratio)])


def _even_silo(
    lengths: tuple[float, float, float, float], wanted: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (m, 2) and triangles (n, 3) of even cells with about `wanted` vertices, the edge of the outlet being one."""
    half_outlet, half_width, height, below = lengths
    inner, outer, chute, rows = _even_counts(lengths, wanted)
    x = np.concatenate(
        [
            np.linspace(0.0, half_outlet, inner + 1)[:-1],
            np.linspace(half_outlet, half_width, outer + 1),
        ]
    )
    y = np.concatenate([np.linspace(-below, 0.0, chute + 1)[:-1], np.linspace(0.0, height, rows + 1)])
    index = np.full((len(x), len(y)), -1, dtype=np.int64)
    used = (np.arange(len(x))[:, None] <= inner) | (np.arange(len(y))[None, :] >= chute)
    index[used] = np.arange(np.count_nonzero(used))
    i, j = np.nonzero(used[:-1, :-1] & used[1:, :-1] & used[1:, 1:] & used[:-1, 1:])
    corners = np.stack([index[i, j], index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]], axis=1)
    # Diagonals point to the middle of the silo, so that its corners are shared by two cells.
    left, low = 2 * i + 1 <= len(x) - 1, 2 * (j - chute) + 1 <= rows
    points = np.stack(
        [np.broadcast_to(x[:, None], used.shape)[used], np.broadcast_to(y, used.shape)[used]], axis=1
    )
    return points, cut(corners, (left == low) | (j < chute))


def _even_counts(lengths: tuple[float, float, float, float], wanted: int) -> tuple[int, int, int, int]:
    """Numbers of cells over the outlet, over the bottom, in the chute and up the silo: nearest to square cells and `wanted`."""
    half_outlet, half_width, height, below = lengths
    even = np.sqrt((half_width * height + half_outlet * below) / wanted)
    best: tuple[float, tuple[int, int, int, int]] = (np.inf, (1, 1, 0, 1))
    for cell in even * np.linspace(0.8, 1.6, 161):
        inner = max(1, round(half_outlet / cell))
        outer = max(1, round((half_width - half_outlet) / cell))
        chute = max(1, round(below / cell)) if below > 0.0 else 0
        rows = max(1, round((wanted - chute * (inner + 1)) / (inner + outer + 1)) - 1)
        vertices = (rows + 1) * (inner + outer + 1) + chute * (inner + 1)
        stretch = abs(np.log((height / rows) / ((half_width - half_outlet) / outer)))
        stretch += abs(np.log((height / rows) / (half_outlet / inner)))
        miss = stretch + 5.0 * abs(vertices / wanted - 1.0)
        if miss < best[0]:
            best = (miss, (inner, outer, chute, rows))
    return best[1]


def _refine(
    points: NDArray[np.float64], triangles: NDArray[np.int64], half_outlet: float, wanted: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Cut the triangles that are largest for their place, until the mesh has about `wanted` vertices.

    Every cut halves a longest edge (conforming closure of scikit-fem), which keeps angles bounded from below.
    """
    mesh = MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles.T))
    edge = np.array([half_outlet, 0.0])
    while True:
        corners = mesh.p[:, mesh.t]
        sides = corners - np.roll(corners, 1, axis=1)
        longest = np.sqrt(np.max(np.sum(sides**2, axis=0), axis=0))
        distance = np.linalg.norm(np.mean(corners, axis=1).T - edge, axis=1)
        excess = longest / np.sqrt(distance + 2.0 * _CORE * half_outlet)
        order = np.argsort(-excess, kind="stable")
        most = int(np.searchsorted(-excess[order], -0.6 * excess[order[0]]))
        fine = mesh.refined(order[:most])
        if fine.nvertices >= wanted:
            break
        mesh = fine
    # The last round: as many of the largest as bring the count nearest to the number asked for.
    low, high = 0, most
    while high - low > max(1, most // 200):
        middle = (low + high) // 2
        if mesh.refined(order[:middle]).nvertices < wanted:
            low = middle
        else:
            high = middle
    mesh = mesh.refined(order[:high])
    return np.ascontiguousarray(mesh.p.T), np.ascontiguousarray(mesh.t.T)
