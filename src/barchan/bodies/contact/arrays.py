"""Pieces of bodies as flat arrays: what the kernels of contact detection read.

A piece is a convex core rounded by a radius (ball: one vertex; capsule: a segment; polyhedron, polygon: its corners), a plane,
a triangle mesh, or a signed distance. Plane scenes are kept in space with z = 0: a polygon is a flat solid whose faces
are its sides. All arrays count pieces as `g`, their corners, faces and edges one piece after the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BALL, SEGMENT, POLYTOPE, PLANE, MESH, FIELD = range(6)
KIND_NAMES = ("ball", "capsule", "polytope", "half space", "mesh", "signed distance")


class Cores(NamedTuple):
    """Convex cores; coordinates in the frame of their body, or in the world once placed.

    radius (g,), size (g,) greatest distance of a corner from the centre, inner (g,) radius of a ball about the centre inside
    the core [m]; centre (g, 3).
    vertex_start (g + 1,), vertices (v, 3).
    face_start (g + 1,), normals (f, 3) unit and outward, areas (f,); ring_start (f + 1,), ring: the corners of each face in
    order, counter-clockwise from outside.
    edge_start (g + 1,), edges (e, 2) numbers of vertices, edge_faces (e, 2) of the faces they part, -1 for a bare segment.
    """

    radius: NDArray[np.float64]
    size: NDArray[np.float64]
    inner: NDArray[np.float64]
    centre: NDArray[np.float64]
    vertex_start: NDArray[np.int64]
    vertices: NDArray[np.float64]
    face_start: NDArray[np.int64]
    normals: NDArray[np.float64]
    areas: NDArray[np.float64]
    ring_start: NDArray[np.int64]
    ring: NDArray[np.int64]
    edge_start: NDArray[np.int64]
    edges: NDArray[np.int64]
    edge_faces: NDArray[np.int64]


class Meshes(NamedTuple):
    """Closed triangle meshes in the frame of their bodies.

    of_piece (g,) number m of a piece's mesh, or -1; lower, upper (m, 3) of its box.
    vertices (v, 3), spread (v, 3) sum of the normals about each; near_start (v + 1,), near: vertices that share an edge.
    triangles (t, 3), normals (t, 3); across (t, 3) the corner opposite of edge k (corners k, k + 1) in the neighbour,
    beside (t, 3) that neighbour, -1 when there is none; patch (t,) name of the plane part a triangle belongs to.
    node_start (m + 1,): trees of boxes node_lower, node_upper (n, 3) in depth-first order; `skip` (n,) is the node after
    the subtree; leaves hold `leaf_count` (n,) triangles from `order[leaf_first]` on, other nodes none.
    """

    of_piece: NDArray[np.int64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    vertices: NDArray[np.float64]
    spread: NDArray[np.float64]
    near_start: NDArray[np.int64]
    near: NDArray[np.int64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64]
    across: NDArray[np.int64]
    beside: NDArray[np.int64]
    patch: NDArray[np.int64]
    node_start: NDArray[np.int64]
    node_lower: NDArray[np.float64]
    node_upper: NDArray[np.float64]
    skip: NDArray[np.int64]
    leaf_first: NDArray[np.int64]
    leaf_count: NDArray[np.int64]
    order: NDArray[np.int64]


class Placed(NamedTuple):
    """Where everything is in one state of the bodies.

    cores : in the world; plane_normal (g, 3) and plane_offset (g,): normal . x <= offset is solid, for planes.
    turns (b, 3, 3), places (b, 3) of the bodies; body (g,) of each piece.
    """

    cores: Cores
    plane_normal: NDArray[np.float64]
    plane_offset: NDArray[np.float64]
    turns: NDArray[np.float64]
    places: NDArray[np.float64]
    body: NDArray[np.int64]


class Slots(NamedTuple):
    """Contacts of p pairs, at most w each: used (p,) of them, points and normals (p, w, 3), gaps (p, w), features (p, w).

    Normals point from the first piece of the pair, as given, to the second.
    """

    used: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    gaps: NDArray[np.float64]
    features: NDArray[np.int64]

    @classmethod
    def empty(cls, pairs: int, width: int) -> Slots:
        """Room for the contacts of so many pairs."""
        return cls(
            np.zeros(pairs, dtype=np.int64), np.empty((pairs, width, 3)), np.empty((pairs, width, 3)),
            np.empty((pairs, width)), np.empty((pairs, width), dtype=np.int64),
        )  # fmt: skip
