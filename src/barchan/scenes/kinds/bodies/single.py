"""Single bodies of a scene from their tables: shape, mass, friction, and how they move (seed B 2.1.1)."""

from __future__ import annotations

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
from barchan.errors import InputError
from barchan.scenes.keyframes import (
    end_of_drive,
    rotation_of,
    scripted_motion,
    steady_motion,
    turning_of,
    vector_of,
)
from barchan.scenes.kinds.bodies.entries import BodyEntry

Vector = NDArray[np.float64]

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
        "velocity": vector_of(entry.velocity, dimension),
        "spin": turning_of(f"{field}.spin", entry.spin, dimension),
        "force": vector_of(entry.force, dimension),
        "torque": turning_of(f"{field}.torque", entry.torque, dimension),
    }


def _driven(field: str, entry: BodyEntry, dimension: int, rotation: Vector | None, end: float) -> Motion:
    if entry.motion == "fixed":
        return Fixed()
    if entry.motion == "scripted":
        return scripted_motion(field, entry, dimension)
    stop = end_of_drive(field, entry.start, entry.stop, end)
    velocity, spin = vector_of(entry.velocity, dimension), turning_of(f"{field}.spin", entry.spin, dimension)
    return steady_motion(np.array(entry.position), rotation, velocity, spin, entry.start, stop)
