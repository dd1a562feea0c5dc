"""Shapes taken apart for contact detection: convex cores, planes, meshes, signed distances, in the frame of the body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact.arrays import BALL, FIELD, KIND_NAMES, MESH, PLANE, POLYTOPE, SEGMENT
from barchan.bodies.rigid import (
    Box,
    Capsule,
    ConvexHull,
    Extruded,
    HalfSpace,
    Moved,
    Polygon,
    Shape,
    Sphere,
    TriangleMesh,
    Union,
)
from barchan.bodies.rigid.rotations import matrix

Vector = NDArray[np.float64]
STRAIGHT = 1e-9  # sine of an angle between sides, below which a corner of a polygon counts as straight


@dataclass(frozen=True, eq=False)
class Piece:
    """One part of a body, in space; z = 0 in plane scenes.

    kind : BALL, SEGMENT, POLYTOPE, PLANE, MESH or FIELD.  radius : by which a core is rounded [m].
    vertices (v, 3); rings, one array of vertex numbers a face; normals (f, 3); edges (e, 2).
    lower, upper (3,) : box.  normal, offset : of a plane.  triangles (t, 3) : of a mesh.
    shape : what the signed distance of a FIELD is that of, d coordinates.  label : for messages.
    """

    kind: int
    label: str
    radius: float = 0.0
    vertices: Vector = field(default_factory=lambda: np.zeros((0, 3)))
    rings: tuple[NDArray[np.int64], ...] = ()
    normals: Vector = field(default_factory=lambda: np.zeros((0, 3)))
    edges: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    lower: Vector = field(default_factory=lambda: np.full(3, -np.inf))
    upper: Vector = field(default_factory=lambda: np.full(3, np.inf))
    normal: Vector = field(default_factory=lambda: np.zeros(3))
    offset: float = 0.0
    triangles: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    shape: Shape | None = None


def pieces_of(shape: Shape) -> tuple[Piece, ...]:
    """The pieces of a shape: unions and moved shapes are taken apart, what is not convex keeps its signed distance."""
    if isinstance(shape, Union):
        return tuple(piece for part in shape.parts for piece in pieces_of(part))
    if isinstance(shape, Moved):
        return tuple(_moved(piece, shape) for piece in pieces_of(shape.shape))
    for known, make in _MAKERS.items():
        if isinstance(shape, known):
            piece: Piece = make(shape)
            return (piece,)
    return (_field_of(shape, f"{type(shape).__name__} ({KIND_NAMES[FIELD]})"),)


def _moved(piece: Piece, at: Moved) -> Piece:
    turn, offset = np.eye(3), np.zeros(3)
    d = at.dimension
    turn[:d, :d], offset[:d] = matrix(at.rotation), at.offset
    if piece.shape is not None:
        return _field_of(Moved(piece.shape, at.offset, at.rotation), piece.label)
    normal = turn @ piece.normal
    moved = replace(
        piece,
        vertices=piece.vertices @ turn.T + offset,
        normals=piece.normals @ turn.T,
        normal=normal,
        offset=piece.offset + float(normal @ offset),
    )
    return _boxed(moved) if len(piece.vertices) else moved


def _boxed(piece: Piece) -> Piece:
    """The piece with the box of its vertices."""
    return replace(
        piece,
        lower=np.min(piece.vertices, axis=0) - piece.radius,
        upper=np.max(piece.vertices, axis=0) + piece.radius,
    )


def _in_space(points: Vector) -> Vector:
    """Points (n, d) with three coordinates."""
    if points.shape[1] == 3:
        return np.ascontiguousarray(points)
    return np.concatenate([points, np.zeros((len(points), 1))], axis=1)


def _field_of(shape: Shape, label: str) -> Piece:
    lower, upper = (_in_space(corner[None])[0] for corner in shape.bounds())
    return Piece(FIELD, label, lower=lower, upper=upper, shape=shape)


def _ball(shape: Sphere) -> Piece:
    return _boxed(Piece(BALL, "Sphere", shape.radius, np.zeros((1, 3))))


def _segment(shape: Capsule) -> Piece:
    ends = _in_space(shape.ends)
    edges = np.array([[0, 1]])
    if shape.dimension == 3:
        return _boxed(Piece(SEGMENT, "Capsule", shape.radius, ends, edges=edges))
    # in the plane a segment has two sides
    return _boxed(replace(_plane_polytope(ends, "Capsule"), radius=shape.radius, edges=edges))


def _plane_polytope(corners: Vector, label: str) -> Piece:
    """A convex polygon, counter-clockwise, or a segment with its two sides."""
    count = len(corners)
    rings = tuple(np.array([k, (k + 1) % count]) for k in range(count))
    side = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([side[:, 1], -side[:, 0], np.zeros(count)], axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return _boxed(Piece(POLYTOPE, label, 0.0, corners, rings, normals, np.array(rings)))


def _box(shape: Box) -> Piece:
    h = shape.half_extents
    if shape.dimension == 2:
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * h
        return _plane_polytope(_in_space(corners), "Box")
    signs = np.array([[(k >> axis & 1) * 2.0 - 1.0 for axis in range(3)] for k in range(8)])
    faces = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    normals = np.concatenate([[-axis, axis] for axis in np.eye(3)])
    edges = np.array([(k, k + step) for step in (1, 2, 4) for k in range(8) if not k & step])
    return _boxed(Piece(POLYTOPE, "Box", 0.0, signs * h, tuple(np.array(f) for f in faces), normals, edges))


def _hull(shape: ConvexHull) -> Piece:
    rings = tuple(np.asarray(face, dtype=np.int64) for face in shape.faces)
    return _boxed(Piece(POLYTOPE, "ConvexHull", 0.0, shape.vertices, rings, shape.face_normals, shape.edges))


def _polygon(shape: Polygon) -> Piece:
    corners = _without_straight_corners(shape.vertices)
    if corners is None:
        return _field_of(shape, "Polygon (not convex)")
    return _plane_polytope(_in_space(corners), "Polygon")


def _extruded(shape: Extruded) -> Piece:
    corners = _without_straight_corners(shape.polygon.vertices)
    if corners is None:
        return _field_of(shape, "Extruded (not convex)")
    x, z = corners.T
    rows = [np.stack([x, np.full(len(x), y), z], axis=1) for y in (-shape.half_depth, shape.half_depth)]
    return replace(_hull(ConvexHull(np.concatenate(rows))), label="Extruded")


def _without_straight_corners(corners: Vector) -> Vector | None:
    """The corners of a convex counter-clockwise polygon where it turns; None when it is not convex."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = turn / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
    if np.any(turn < -STRAIGHT):
        return None
    return np.ascontiguousarray(corners[turn > STRAIGHT])


def _half_space(shape: HalfSpace) -> Piece:
    normal = _in_space(shape.normal[None])[0]
    return Piece(PLANE, "HalfSpace", normal=normal, offset=shape.offset)


def _mesh(shape: TriangleMesh) -> Piece:
    return _boxed(Piece(MESH, "TriangleMesh", vertices=shape.vertices, triangles=shape.faces))


_MAKERS: dict[type[Shape], Callable[[Any], Piece]] = {
    Sphere: _ball, Capsule: _segment, Box: _box, ConvexHull: _hull, Polygon: _polygon, Extruded: _extruded,
    HalfSpace: _half_space, TriangleMesh: _mesh,
}  # fmt: skip
