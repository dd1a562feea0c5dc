"""Edges of a triangle mesh and the hinges between triangles, with their dihedral angles (Grinspun et al. 2003)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Hinges:
    """Edges (e, 2), lower vertex first, in order; what lies beside them.

    beside : (e, 2) triangles at an edge, -1 for none.  stencils : (h, 4) of edges between two triangles: the ends a, b of the
    edge, the vertex left in the triangle (a, b, c), and that of the triangle (b, a, d).  edge_of_hinge : (h,).
    triangle_edges : (m, 3) edge opposite to each corner.
    """

    edges: Whole
    beside: Whole
    stencils: Whole
    edge_of_hinge: Whole
    triangle_edges: Whole


def half_edges(triangles: Whole) -> tuple[Whole, Whole, Whole]:
    """(3 m, 2) directed edges of the triangles, their triangle (3 m,), and the vertex opposite (3 m,)."""
    directed = np.concatenate([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]])
    owner = np.tile(np.arange(len(triangles)), 3)
    return directed, owner, np.concatenate([triangles[:, 0], triangles[:, 1], triangles[:, 2]])


def hinges_of(triangles: Whole) -> Hinges:
    """Edges and hinges of an oriented manifold mesh."""
    directed, owner, opposite = half_edges(triangles)
    low, high = directed.min(axis=1), directed.max(axis=1)
    edges, number = np.unique(np.stack([low, high], axis=1), axis=0, return_inverse=True)
    number = number.reshape(-1)
    forward = directed[:, 0] == low
    beside = np.full((len(edges), 2), -1, dtype=np.int64)
    far = np.full((len(edges), 2), -1, dtype=np.int64)
    for side, chosen in ((0, forward), (1, ~forward)):
        beside[number[chosen], side] = owner[chosen]
        far[number[chosen], side] = opposite[chosen]
    inner = np.flatnonzero(np.all(beside >= 0, axis=1))
    stencils = np.concatenate([edges[inner], far[inner]], axis=1)
    lone = beside[:, 0] < 0
    beside[lone] = beside[lone][:, ::-1]
    return Hinges(
        edges.astype(np.int64), beside, np.ascontiguousarray(stencils, dtype=np.int64), inner,
        np.ascontiguousarray(number.reshape(3, -1).T),
    )  # fmt: skip


def dihedral_angles(vertices: Vector, stencils: Whole) -> Vector:
    """(h,) angles [rad] between the normals of the two triangles of each hinge, -pi to pi; 0 where it is flat.

    Positive where the normals turn about the edge a -> b from the triangle (a, b, c) to (b, a, d).
    """
    a, b, c, d = (vertices[stencils[:, k]] for k in range(4))
    edge = b - a
    first, second = np.cross(edge, c - a), np.cross(d - a, edge)
    lengths = np.linalg.norm(edge, axis=1)
    sine = np.einsum("hi,hi->h", np.cross(first, second), edge) / np.where(lengths > 0.0, lengths, 1.0)
    return np.arctan2(sine, np.einsum("hi,hi->h", first, second))
