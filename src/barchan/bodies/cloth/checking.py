"""What makes a triangle mesh no cloth: each check names the place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from barchan.bodies.cloth._crossings import crossing_pair
from barchan.bodies.cloth.hinges import Hinges, dihedral_angles, half_edges
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]

COINCIDENT = 1e-9  # of the size of the mesh, between vertices
FLATTEST = 1e-7  # area of a triangle over the square of its longest edge
FOLDED = np.pi - 1e-3  # rest angle of a hinge, rad


def check_topology(vertices: Vector, triangles: Whole) -> None:
    """Refuse vertices without triangle or in one place, and triangles that do not make an oriented manifold."""
    used = np.bincount(triangles.ravel(), minlength=len(vertices))
    if np.any(used == 0):
        raise InputError("vertices", int(np.argmin(used)), "vertices of triangles only: this one has none")
    twice = np.flatnonzero(np.any(triangles == np.roll(triangles, 1, axis=1), axis=1))
    if len(twice):
        raise InputError("triangles", triangles[twice[0]].tolist(), "three different vertices")
    size = float(np.max(np.ptp(vertices, axis=0)))
    close = cKDTree(vertices).query_pairs(COINCIDENT * size, output_type="ndarray")
    if len(close):
        pair = sorted(int(k) for k in close[0])
        raise InputError("vertices", pair, f"apart: both are at {_place(vertices[pair[0]])}")
    _check_edges(vertices, triangles)
    _check_fans(vertices, triangles)


def _check_edges(vertices: Vector, triangles: Whole) -> None:
    directed, owner, _ = half_edges(triangles)
    order = np.lexsort((directed[:, 1], directed[:, 0]))
    same = np.flatnonzero(np.all(directed[order][1:] == directed[order][:-1], axis=1))
    undirected, count = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    if np.any(count > 2):
        edge = undirected[int(np.argmax(count))]
        where = _place(np.mean(vertices[edge], axis=0))
        raise InputError(
            "triangles",
            f"{int(count.max())} triangles at the edge {edge.tolist()}",
            f"two at most: not a surface at {where}",
        )
    if len(same):
        edge = directed[order[same[0]]]
        pair = sorted(owner[order[same[0] : same[0] + 2]].tolist())
        where = _place(np.mean(vertices[edge], axis=0))
        raise InputError("triangles", pair, f"neighbours that turn the same way: these do not, at {where}")


def _check_fans(vertices: Vector, triangles: Whole) -> None:
    """Refuse a vertex where two surfaces touch in a point: its triangles are not one fan."""
    corners = np.concatenate([triangles, np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)])
    centre, following, before = corners.T  # the triangle goes from `following` to `before` about `centre`
    starts = np.bincount(centre, minlength=len(vertices))
    key = centre * np.int64(len(vertices))
    joined = np.isin(key + before, key + following)
    ends = np.bincount(centre[~joined], minlength=len(vertices))
    suspects = np.flatnonzero(ends > 1)
    if not len(suspects):
        suspects = _closed_fans_broken(centre, following, before, starts)
    if len(suspects):
        vertex = int(suspects[0])
        raise InputError(
            "triangles", f"vertex {vertex}", f"one fan of triangles about it: there are more at {_place(vertices[vertex])}"
        )  # fmt: skip


def _closed_fans_broken(centre: Whole, following: Whole, before: Whole, counts: Whole) -> Whole:
    """Vertices whose triangles do not all follow one another; each has at most one open end."""
    order = np.argsort(centre, kind="stable")
    first = np.concatenate([[0], np.cumsum(counts)])
    broken = []
    for vertex in range(len(counts)):
        rows = order[first[vertex] : first[vertex + 1]]
        after = dict(zip(following[rows].tolist(), before[rows].tolist(), strict=True))
        opening = set(after) - set(after.values())
        at = next(iter(opening)) if opening else next(iter(after))
        begun, seen = at, 0
        while at in after:
            at = after[at]
            seen += 1
            if at == begun:
                break
        if seen != len(rows):
            broken.append(vertex)
    return np.array(broken, dtype=np.int64)


def check_rest_shape(vertices: Vector, triangles: Whole, hinges: Hinges) -> None:
    """Refuse triangles without area, triangles folded back onto their neighbour, and a surface that cuts itself."""
    corner = vertices[triangles]
    sides = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    shape = area / np.max(sides, axis=1) ** 2
    if np.min(shape) < FLATTEST:
        number = int(np.argmin(shape))
        where = _place(np.mean(corner[number], axis=0))
        raise InputError(
            "triangles", triangles[number].tolist(), f"a triangle with an area: not so at {where}"
        )
    angles = dihedral_angles(vertices, hinges.stencils)
    if len(angles) and np.max(np.abs(angles)) > FOLDED:
        number = int(np.argmax(np.abs(angles)))
        pair = hinges.beside[hinges.edge_of_hinge[number]].tolist()
        where = _place(np.mean(vertices[hinges.stencils[number, :2]], axis=0))
        raise InputError("triangles", pair, f"not folded back onto one another (inverted?), as at {where}")
    pair = crossing_pair(vertices, triangles)
    if pair is not None:
        where = _place(np.mean(vertices[triangles[pair[0]]], axis=0))
        raise InputError("triangles", list(pair), f"a rest shape that does not cut itself, as at {where}")


def _place(point: Vector) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
