"""Shapes of `barchan.bodies.rigid` from the tables of a scene, about the origin of their own frame.

A table names a shape and gives its lengths; a length that is missing is an InputError that names it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import (
    Box,
    Cylinder,
    Difference,
    Moved,
    Polygon,
    Revolved,
    Shape,
    Sphere,
    Torus,
    TriangleMesh,
    hourglass,
    plate_with_hole,
    sample_mesh,
    wheel,
)
from barchan.errors import InputError
from barchan.scenes.keyframes import rotation_of
from barchan.scenes.kinds.sand.entries import BodyTable, Piece
from barchan.scenes.kinds.sand.parameters import SAMPLE_MESH
from barchan.scenes.parameters import Group

Vector = NDArray[np.float64]

_AXES = {"x": 0, "y": 1, "z": 2}


def shape_of_piece(field: str, piece: Piece, dimension: int) -> Shape:
    """The shape of a piece of matter, where it is in the box."""
    if piece.shape == "box":
        shape: Shape = Box(_half_size(field, piece, dimension))
    elif piece.shape == "sphere":
        shape = Sphere(_length(field, piece, "radius"), dimension)
    elif piece.shape == "cylinder":
        radius, half = _length(field, piece, "radius"), 0.5 * _length(field, piece, "height")
        shape = Cylinder(radius, half, 2) if dimension == 3 else Box([radius, half])
    else:
        radius, height = _length(field, piece, "radius"), _length(field, piece, "height")
        if dimension == 3:
            shape = Revolved(Polygon([[0.0, 0.0], [radius, 0.0], [0.0, height]]))
        else:
            shape = Polygon([[-radius, 0.0], [radius, 0.0], [0.0, height]])
    rotation = rotation_of(f"{field}.rotation", piece.rotation, dimension)
    return Moved(shape, np.array(piece.position, dtype=np.float64), rotation)


def shape_of_body(field: str, body: BodyTable, dimension: int) -> Shape:
    """The shape of a rigid body. Raises InputError for a length that is missing or a shape that the plane does not have."""
    makers = {
        "sphere": lambda: Sphere(_length(field, body, "radius"), dimension),
        "box": lambda: Box(_half_size(field, body, dimension)),
        "plate_with_hole": lambda: _plate(field, body, dimension),
        "hourglass": lambda: _hourglass(field, body, dimension),
        "bucket": lambda: _bucket(field, body, dimension),
    }
    if body.shape in makers:
        return makers[body.shape]()
    if body.shape == "polygon":
        if dimension == 3 or body.points is None:
            raise InputError(f"{field}.points", body.points, "rows [x, z] of a polygon in 2D")
        return Polygon(body.points)
    if dimension == 2:
        raise InputError(
            f"{field}.shape", body.shape, "one that the plane has: " + ", ".join([*makers, "polygon"])
        )
    return _solid(field, body)


def _solid(field: str, body: BodyTable) -> Shape:
    """Shapes that only space has."""
    axis = _AXES[body.axis]
    if body.shape == "mesh":
        return _mesh(field, body)
    if body.shape == "torus":
        return Torus(_length(field, body, "radius"), _length(field, body, "minor_radius"), axis)
    radius, half = _length(field, body, "radius"), 0.5 * _length(field, body, "height")
    if body.shape == "cylinder":
        return Cylinder(radius, half, axis)
    tread = _length(field, body, "tread_height") if body.treads else 0.0
    return wheel(radius, half, body.treads, tread, axis=axis)


def _mesh(field: str, body: BodyTable) -> Shape:
    if body.file == SAMPLE_MESH:
        return sample_mesh(body.scale)
    if not body.file:
        raise InputError(f"{field}.file", body.file, f"a mesh file, or {SAMPLE_MESH!r}")
    return TriangleMesh.from_file(body.file, scale=body.scale)


def _plate(field: str, body: BodyTable, dimension: int) -> Shape:
    """A plate with a round hole in its middle, through its last axis; in 2D two bars with a gap."""
    half, hole = _half_size(field, body, dimension), _length(field, body, "hole")
    if hole >= 2.0 * float(half[:-1].min()):
        raise InputError(
            f"{field}.hole", hole, f"less than the plate is wide, {2.0 * float(half[:-1].min()):g} m"
        )
    return plate_with_hole(half, 0.5 * hole)


def _hourglass(field: str, body: BodyTable, dimension: int) -> Shape:
    """Two walls that leave an hourglass between them, its neck `hole` wide and `thickness` high; in 3D the same all along y."""
    half, hole = _half_size(field, body, dimension), _length(field, body, "hole")
    if hole >= 2.0 * half[0]:
        raise InputError(f"{field}.hole", hole, f"less than the hourglass is wide, {2.0 * half[0]:g} m")
    depth = float(half[1]) if dimension == 3 else None
    return hourglass(2.0 * half[0], 2.0 * half[-1], hole, depth, body.thickness or 0.0)


def _bucket(field: str, body: BodyTable, dimension: int) -> Shape:
    """A box without lid; its walls and bottom are `thickness` thick inside its size."""
    half, wall = _half_size(field, body, dimension), _length(field, body, "thickness")
    if wall >= float(half.min()):
        raise InputError(f"{field}.thickness", wall, f"less than half of the size, {float(half.min()):g} m")
    hollow = half - wall
    hollow[-1] = half[-1]  # reaches above the rim
    up = np.zeros(dimension)
    up[-1] = wall
    return Difference(Box(half), Moved(Box(hollow), up))


def _length(field: str, table: Group, name: str) -> float:
    value = getattr(table, name)
    if value is None:
        raise InputError(f"{field}.{name}", "missing", "given for this shape (m)")
    return float(value)


def _half_size(field: str, table: BodyTable | Piece, dimension: int) -> Vector:
    if table.size is None:
        raise InputError(f"{field}.size", "missing", f"{dimension} lengths (m), for this shape")
    return 0.5 * np.array(table.size, dtype=np.float64)
