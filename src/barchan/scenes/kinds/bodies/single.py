"""Single bodies of a scene from their tables: shape, mass, friction, and how they move (seed B 2.1.1)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import (
    Body,
    Box,
    Capsule,
    ConvexHull,
    Fixed,
    Free,
    HalfSpace,
    Motion,
    Polygon,
    Prescribed,
    Shape,
    Sphere,
    TriangleMesh,
)
from barchan.bodies.rigid.rotations import exponential, identity, product
from barchan.errors import InputError
from barchan.scenes.kinds.bodies.entries import BodyEntry
from barchan.scenes.kinds.sand.shapes import rotation_of

Vector = NDArray[np.float64]

_LARGEST_TURN = math.radians(60.0)  # between two keyframes of a body that is driven round
_KEYS = {
    "vertices": "points",
    "half_extents": "size",
    "half_length": "length",
    "faces": "file",
    "mesh": "file",
}


def build_single(name: str, entry: BodyEntry, dimension: int, end: float) -> Body:
    """One body of [bodies]; driven ones move until twice the `end` (s). Raises InputError naming the key at fault."""
    field = f"bodies.{name}"
    if entry.position is None and entry.motion != "scripted":
        raise InputError(f"{field}.position", "missing", f"{dimension} numbers, one for each axis (m)")
    try:
        return _body(name, field, entry, dimension, end)
    except InputError as error:
        if error.field.startswith("bodies."):
            raise
        key = error.field.rpartition(".")[2]
        raise InputError(f"{field}.{_KEYS.get(key, key)}", error.value, error.allowed) from None


def _body(name: str, field: str, entry: BodyEntry, dimension: int, end: float) -> Body:
    rotation = rotation_of(f"{field}.rotation", entry.rotation, dimension)
    given: dict[str, Any] = {"friction": entry.friction}
    shape = _shape(field, entry, dimension)
    if entry.motion == "free":
        given |= _free(field, entry, dimension)
        if not shape.bounded:
            raise InputError(f"{field}.motion", entry.motion, f"'fixed' or driven for a {entry.shape}")
    else:
        for key in ("density", "mass", "force", "torque", "held"):
            if getattr(entry, key) is not None:
                raise InputError(f"{field}.{key}", getattr(entry, key), "left out: only free bodies have it")
        given["motion"] = _driven(field, entry, dimension, rotation, end)
    if not isinstance(given["motion"], Prescribed):  # a prescribed motion says where the body starts
        given |= {"position": np.array(entry.position, dtype=np.float64), "rotation": rotation}
    elif given["motion"].rotations is None:
        given["rotation"] = rotation
    return Body(shape, name=name, **given)


def _shape(field: str, entry: BodyEntry, dimension: int) -> Shape:
    """The shape of a body. Raises InputError for a length that is missing or a shape that the space does not have."""
    only = {"polygon": 2, "hull": 3, "mesh": 3}
    if only.get(entry.shape, dimension) != dimension:
        allowed = f"another one: {entry.shape} is of {only[entry.shape]}D"
        raise InputError(f"{field}.shape", entry.shape, allowed)
    if entry.shape == "sphere":
        return Sphere(_given(field, entry, "radius"), dimension)
    if entry.shape == "box":
        return Box(0.5 * np.array(_given(field, entry, "size")))
    if entry.shape == "capsule":
        return Capsule(
            _given(field, entry, "radius"), 0.5 * _given(field, entry, "length"), dimension=dimension
        )
    if entry.shape == "polygon":
        return Polygon(_given(field, entry, "points"))
    if entry.shape == "hull":
        return ConvexHull(_given(field, entry, "points"))
    if entry.shape == "plane":
        return HalfSpace(np.eye(dimension)[-1] if entry.normal is None else entry.normal)
    if not entry.file:
        raise InputError(f"{field}.file", entry.file, "a mesh file")
    return TriangleMesh.from_file(entry.file, scale=entry.scale)


def _given(field: str, entry: BodyEntry, name: str) -> Any:
    value = getattr(entry, name)
    if value is None:
        raise InputError(f"{field}.{name}", "missing", f"given for a {entry.shape}")
    return value


def _free(field: str, entry: BodyEntry, dimension: int) -> dict[str, Any]:
    """What makes a body that moves by its forces."""
    if (entry.density is None) == (entry.mass is None):
        allowed = "given for a free body, or its mass instead (one of the two)"
        raise InputError(f"{field}.density", entry.density, allowed)
    return {
        "motion": Free(held=tuple(entry.held or ())),
        "density": entry.density,
        "mass": entry.mass,
        "velocity": _vector(entry.velocity, dimension),
        "spin": _spin(f"{field}.spin", entry.spin, dimension),
        "force": _vector(entry.force, dimension),
        "torque": _spin(f"{field}.torque", entry.torque, dimension),
    }


def _driven(field: str, entry: BodyEntry, dimension: int, rotation: Vector | None, end: float) -> Motion:
    if entry.motion == "fixed":
        return Fixed()
    if entry.motion == "scripted":
        return _scripted(field, entry, dimension)
    stop = entry.stop if entry.stop is not None else 2.0 * end + entry.start
    if stop <= entry.start:
        raise InputError(f"{field}.stop", stop, f"later than the body starts, {entry.start:g} s")
    velocity, spin = _vector(entry.velocity, dimension), _spin(f"{field}.spin", entry.spin, dimension)
    return steady_motion(np.array(entry.position), rotation, velocity, spin, entry.start, stop)


def steady_motion(
    position: Vector, rotation: Vector | None, velocity: Vector, spin: Vector, start: float, stop: float
) -> Prescribed:
    """Keyframes of a constant velocity (d,) and spin (3,) or (1,) from `start` to `stop` (s)."""
    turn = float(np.linalg.norm(spin)) * (stop - start)
    times = np.linspace(start, stop, max(2, math.ceil(turn / _LARGEST_TURN) + 1))
    begin = identity(len(position)) if rotation is None else rotation
    places = position + np.outer(times - start, velocity)
    turns = np.array([product(exponential(t * spin), begin) for t in times - start])
    return Prescribed(times, places, turns)


def _scripted(field: str, entry: BodyEntry, dimension: int) -> Motion:
    """Keyframes as they stand in the table."""
    if entry.times is None or entry.positions is None:
        missing = "times" if entry.times is None else "positions"
        raise InputError(f"{field}.{missing}", "missing", "given for a scripted body")
    for name in ("positions", "rotations"):
        rows = getattr(entry, name)
        if rows is not None and len(rows) != len(entry.times):
            allowed = f"{len(entry.times)} rows, one for each of the times"
            raise InputError(f"{field}.{name}", f"{len(rows)} rows", allowed)
    if any(len(row) != dimension for row in entry.positions):
        raise InputError(f"{field}.positions", entry.positions, f"rows of {dimension} numbers")
    turns = None
    if entry.rotations is not None:
        turns = np.array([rotation_of(f"{field}.rotations", row, dimension) for row in entry.rotations])
    return Prescribed(np.array(entry.times), np.array(entry.positions), turns)


def _vector(value: list[float] | None, dimension: int) -> Vector:
    return np.zeros(dimension) if value is None else np.array(value, dtype=np.float64)


def _spin(field: str, value: list[float] | None, dimension: int) -> Vector:
    """An angular velocity or torque: one number in the plane, three in space."""
    count = 1 if dimension == 2 else 3
    if value is None:
        return np.zeros(count)
    if len(value) != count:
        raise InputError(field, value, "one number in 2D, three in 3D")
    return np.array(value, dtype=np.float64)
