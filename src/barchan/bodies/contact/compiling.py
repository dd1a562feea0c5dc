"""From pieces to the flat arrays that kernels read: cores one after the other, meshes with their neighbours and trees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact.arrays import MESH, Cores, Meshes
from barchan.bodies.contact.pieces import Piece

Vector = NDArray[np.float64]
Numbers = NDArray[np.int64]
LEAF = 4  # triangles in a leaf of a tree of boxes
SAME_PATCH = 1e-6  # [rad] between neighbouring triangles of one plane patch


def starts_of(counts: Sequence[int] | Numbers) -> Numbers:
    """First index of each of several parts, and the end of the last."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, dtype=np.int64))]).astype(np.int64)


def compiled_cores(pieces: Sequence[Piece]) -> Cores:
    """Convex cores in the frames of their bodies; planes, meshes and signed distances have no corners here."""
    parts = {id(piece): _core_of(piece) for piece in {id(p): p for p in pieces}.values()}
    cores = [parts[id(piece)] for piece in pieces]
    vertices = np.array([len(core.vertices) for core in cores], dtype=np.int64)
    faces = np.array([len(core.normals) for core in cores], dtype=np.int64)
    edges = np.array([len(core.edges) for core in cores], dtype=np.int64)
    entries = np.array([len(core.ring) for core in cores], dtype=np.int64)
    vertex_start, face_start = starts_of(vertices), starts_of(faces)
    edge_faces = np.concatenate([_NO_ROWS, *(core.edge_faces for core in cores)])
    return Cores(
        radius=np.array([core.radius for core in cores]),
        size=np.array([core.size for core in cores]),
        inner=np.array([core.inner for core in cores]),
        centre=np.array([core.centre for core in cores]).reshape(-1, 3),
        vertex_start=vertex_start,
        vertices=np.concatenate([np.zeros((0, 3)), *(core.vertices for core in cores)]),
        face_start=face_start,
        normals=np.concatenate([np.zeros((0, 3)), *(core.normals for core in cores)]),
        areas=np.concatenate([np.zeros(0), *(core.areas for core in cores)]),
        ring_start=starts_of(_joined([core.ring_sizes for core in cores])),
        ring=_joined([core.ring for core in cores]) + np.repeat(vertex_start[:-1], entries),
        edge_start=starts_of(edges),
        edges=np.concatenate([_NO_ROWS, *(core.edges for core in cores)])
        + np.repeat(vertex_start[:-1], edges)[:, None],
        edge_faces=np.where(edge_faces < 0, -1, edge_faces + np.repeat(face_start[:-1], edges)[:, None]),
    )


_NO_ROWS = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Core:
    """What one convex core adds to the arrays, its numbers counted from zero."""

    radius: float
    size: float
    inner: float
    centre: Vector
    vertices: Vector
    normals: Vector
    areas: Vector
    ring_sizes: Numbers
    ring: Numbers
    edges: Numbers
    edge_faces: Numbers


def _core_of(piece: Piece) -> _Core:
    if piece.kind == MESH or len(piece.vertices) == 0:
        piece = Piece(piece.kind, piece.label, vertices=np.zeros((0, 3)))
    x, rings = piece.vertices, piece.rings
    centre = np.mean(x, axis=0) if len(x) else np.zeros(3)
    inner = 0.0
    if rings:
        roots = x[[ring[0] for ring in rings]]
        inner = max(0.0, float(np.min(np.einsum("fi,fi->f", roots - centre, piece.normals))))
    return _Core(
        radius=piece.radius,
        size=float(np.max(np.linalg.norm(x - centre, axis=1), initial=0.0)),
        inner=inner,
        centre=centre,
        vertices=x,
        normals=piece.normals,
        areas=np.array([_area(x[ring]) for ring in rings], dtype=np.float64),
        ring_sizes=np.array([len(ring) for ring in rings], dtype=np.int64),
        ring=_joined(list(rings)),
        edges=np.asarray(piece.edges, dtype=np.int64).reshape(-1, 2),
        edge_faces=_edge_faces(piece),
    )


def _edge_faces(piece: Piece) -> Numbers:
    """The two faces (e, 2) that each edge parts; -1 for a bare segment and in the plane, where faces are edges."""
    beside = np.full((len(piece.edges), 2), -1, dtype=np.int64)
    if not piece.rings or min(len(ring) for ring in piece.rings) < 3:
        return beside
    face_of = {}
    for face, ring in enumerate(piece.rings):
        for a, b in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True):
            face_of[a, b] = face
    for e, (a, b) in enumerate(piece.edges.tolist()):
        beside[e] = face_of[a, b], face_of[b, a]
    return beside


def _area(corners: Vector) -> float:
    """Area of a polygon (n, 3), or the length of a side (2, 3)."""
    if len(corners) == 2:
        return float(np.linalg.norm(corners[1] - corners[0]))
    x = corners - corners[0]
    return 0.5 * float(np.linalg.norm(np.sum(np.cross(x, np.roll(x, -1, axis=0)), axis=0)))


def compiled_meshes(pieces: Sequence[Piece]) -> Meshes:
    """All meshes, with numbers of vertices, triangles and nodes that run through."""
    meshes = [(g, piece) for g, piece in enumerate(pieces) if piece.kind == MESH]
    of_piece = np.full(len(pieces), -1, dtype=np.int64)
    of_piece[[g for g, _ in meshes]] = np.arange(len(meshes))
    vertex_start = starts_of([len(piece.vertices) for _, piece in meshes])
    triangle_start = starts_of([len(piece.triangles) for _, piece in meshes])
    vertices = np.concatenate([np.zeros((0, 3))] + [piece.vertices for _, piece in meshes])
    triangles = np.concatenate(
        [np.zeros((0, 3), dtype=np.int64)]
        + [piece.triangles + vertex_start[m] for m, (_, piece) in enumerate(meshes)]
    )
    normals, spread = _normals(vertices, triangles)
    beside, across = _neighbours(triangles)
    near_start, near = _vertex_neighbours(len(vertices), triangles)
    trees = [
        _Tree(vertices[triangles[triangle_start[m] : triangle_start[m + 1]]], int(triangle_start[m]))
        for m in range(len(meshes))
    ]
    node_start = starts_of([len(tree.skip) for tree in trees])
    return Meshes(
        of_piece=of_piece,
        lower=np.array([piece.lower for _, piece in meshes]).reshape(-1, 3),
        upper=np.array([piece.upper for _, piece in meshes]).reshape(-1, 3),
        vertices=vertices,
        spread=spread,
        near_start=near_start,
        near=near,
        triangles=triangles,
        normals=normals,
        across=across,
        beside=beside,
        patch=_patches(normals, beside),
        node_start=node_start,
        node_lower=np.concatenate([np.zeros((0, 3))] + [np.array(tree.lower) for tree in trees]),
        node_upper=np.concatenate([np.zeros((0, 3))] + [np.array(tree.upper) for tree in trees]),
        skip=_joined([np.array(tree.skip) + node_start[m] for m, tree in enumerate(trees)]),
        leaf_first=_joined([np.array(tree.first) + triangle_start[m] for m, tree in enumerate(trees)]),
        leaf_count=_joined([np.array(tree.count) for tree in trees]),
        order=_joined([tree.order for tree in trees]),
    )


def _joined(parts: list[Numbers]) -> Numbers:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)


def _normals(vertices: Vector, triangles: Numbers) -> tuple[Vector, Vector]:
    """Unit normals of triangles, and at vertices their sum weighted by angles, whose sign tells inside from outside."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    spread = np.zeros_like(vertices)
    for k in range(3):
        u, v = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ti,ti->t", u, v))
        np.add.at(spread, triangles[:, k], angle[:, None] * normals)
    return normals, spread


def _neighbours(triangles: Numbers) -> tuple[Numbers, Numbers]:
    """Triangle beside each edge k (corners k, k + 1), and its corner off that edge; -1 where there is none."""
    beside = np.full(triangles.shape, -1, dtype=np.int64)
    across = np.full(triangles.shape, -1, dtype=np.int64)
    seen: dict[tuple[int, int], tuple[int, int]] = {}
    for t, corners in enumerate(triangles.tolist()):
        for k in range(3):
            seen[corners[k], corners[(k + 1) % 3]] = (t, k)
    for (a, b), (t, k) in seen.items():
        other = seen.get((b, a))
        if other is not None:
            beside[t, k] = other[0]
            across[t, k] = triangles[other[0], (other[1] + 2) % 3]
    return beside, across


def _vertex_neighbours(count: int, triangles: Numbers) -> tuple[Numbers, Numbers]:
    """Vertices joined to each vertex by an edge, one vertex after the other."""
    pairs = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    return starts_of(np.bincount(pairs[:, 0], minlength=count)), np.ascontiguousarray(pairs[:, 1])


def _patches(normals: Vector, beside: Numbers) -> Numbers:
    """Least number of a triangle in the plane part that each belongs to, grown over edges without an angle."""
    patch = np.full(len(normals), -1, dtype=np.int64)
    flat = np.linalg.norm(np.cross(normals[:, None], normals[beside]), axis=2) < SAME_PATCH
    flat &= (beside >= 0) & (np.einsum("ti,tki->tk", normals, normals[beside]) > 0.0)
    for first in range(len(normals)):
        if patch[first] >= 0:
            continue
        patch[first] = first
        waiting = [first]
        while waiting:
            t = waiting.pop()
            for k in range(3):
                other = int(beside[t, k])
                if flat[t, k] and patch[other] < 0:
                    patch[other] = first
                    waiting.append(other)
    return patch


class _Tree:
    """Tree of boxes about triangles (t, 3, 3), halved across the longest side; nodes in depth-first order."""

    def __init__(self, corners: Vector, first_triangle: int) -> None:
        self.lower: list[Vector] = []
        self.upper: list[Vector] = []
        self.skip: list[int] = []
        self.first: list[int] = []
        self.count: list[int] = []
        self._low, self._high = np.min(corners, axis=1), np.max(corners, axis=1)
        self._middle = 0.5 * (self._low + self._high)
        numbers = np.arange(len(corners))
        self._grow(numbers, 0)
        self.order = numbers + first_triangle

    def _grow(self, numbers: Numbers, first: int) -> None:
        """Add the node of some triangles, a view into the order, and those below it."""
        node = len(self.skip)
        self.lower.append(np.min(self._low[numbers], axis=0))
        self.upper.append(np.max(self._high[numbers], axis=0))
        leaf = len(numbers) <= LEAF
        self.skip.append(0)
        self.first.append(first)
        self.count.append(len(numbers) if leaf else 0)
        if not leaf:
            middle = self._middle[numbers]
            half = len(numbers) // 2
            by_size = np.argsort(middle[:, int(np.argmax(np.ptp(middle, axis=0)))], kind="stable")
            numbers[:] = numbers[by_size]
            self._grow(numbers[:half], first)
            self._grow(numbers[half:], first + half)
        self.skip[node] = len(self.skip)
