"""Rigid bodies of a scene from their tables: shape, mass, friction, and how they move (seed B 7.4.1 and 7.5.2).

A driven body, a script and a pen all become keyframes of a prescribed motion with infinite inertia.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, Fixed, Free, Motion, Prescribed
from barchan.errors import InputError
from barchan.scenes.keyframes import (
    end_of_drive,
    rotation_of,
    scripted_motion,
    steady_motion,
    turning_of,
    vector_of,
)
from barchan.scenes.kinds.sand.entries import BodyTable
from barchan.scenes.kinds.sand.letters import pen_script, strokes_of
from barchan.scenes.kinds.sand.parameters import SandParameters
from barchan.scenes.kinds.sand.shapes import shape_of_body

Vector = NDArray[np.float64]


def build_bodies(parameters: SandParameters) -> list[Body]:
    """The bodies of a scene, in the order of their tables. Raises InputError naming the table of one that cannot be."""
    return [build_body(name, table, parameters) for name, table in parameters.body_tables()]


def build_body(name: str, table: BodyTable, parameters: SandParameters) -> Body:
    """One body."""
    field, d = f"bodies.{name}", parameters.dimension
    if table.position is None and table.motion != "scripted":
        raise InputError(f"{field}.position", "missing", f"{d} numbers, one for each axis (m)")
    rotation = rotation_of(f"{field}.rotation", table.rotation, d)
    given: dict[str, Any] = {"friction": table.friction}
    try:
        shape = shape_of_body(field, table, d)
        if table.motion == "free":
            given |= _free(field, table, d)
        else:
            given["motion"] = _driven_motion(field, table, parameters, rotation)
        if not isinstance(given["motion"], Prescribed):  # a prescribed motion says where the body starts
            given |= {"position": np.array(table.position, dtype=np.float64), "rotation": rotation}
        elif given["motion"].rotations is None:
            given["rotation"] = rotation
        return Body(shape, name=name, **given)
    except InputError as error:
        if error.field.startswith("bodies."):
            raise
        key = error.field.rpartition(".")[2]
        raise InputError(f"{field}.{key}", error.value, error.allowed) from None


def _check_mass(field: str, table: BodyTable) -> None:
    if (table.density is None) == (table.mass is None):
        raise InputError(
            f"{field}.density", table.density, "given for a free body, or its mass instead (one of the two)"
        )


def _free(field: str, table: BodyTable, dimension: int) -> dict[str, Any]:
    """What makes a body that moves by its forces."""
    _check_mass(field, table)
    return {
        "motion": Free(held=tuple(table.held or ())),
        "density": table.density,
        "mass": table.mass,
        "velocity": vector_of(table.velocity, dimension),
        "spin": turning_of(f"{field}.spin", table.spin, dimension),
        "force": vector_of(table.force, dimension),
        "torque": turning_of(f"{field}.torque", table.torque, dimension),
        "torque_frame": table.torque_frame,
    }


def _driven_motion(
    field: str, table: BodyTable, parameters: SandParameters, rotation: Vector | None
) -> Motion:
    if table.motion == "fixed":
        return Fixed()
    if table.motion == "driven":
        return _driven(field, table, parameters, rotation)
    if table.motion == "writing":
        return _writing(field, table, parameters)
    return scripted_motion(field, table, parameters.dimension)


def _driven(field: str, table: BodyTable, parameters: SandParameters, rotation: Vector | None) -> Motion:
    """Constant velocity and spin from `start` to `stop`."""
    d = parameters.dimension
    stop = end_of_drive(field, table.start, table.stop, parameters.time.end)
    velocity, spin = vector_of(table.velocity, d), turning_of(f"{field}.spin", table.spin, d)
    return steady_motion(np.array(table.position), rotation, velocity, spin, table.start, stop)


def _writing(field: str, table: BodyTable, parameters: SandParameters) -> Motion:
    """A pen whose letters begin at the position of the body."""
    if parameters.dimension == 2:
        raise InputError(
            f"{field}.motion", table.motion, "another one in 2D: letters are written on the ground"
        )
    for name in ("letter_height", "speed", "lift"):
        if getattr(table, name) is None:
            raise InputError(f"{field}.{name}", "missing", "given for a pen")
    assert table.letter_height is not None and table.speed is not None and table.lift is not None
    try:
        strokes = strokes_of(table.text, table.letter_height)
    except InputError as error:
        raise InputError(f"{field}.text", error.value, error.allowed) from None
    times, positions = pen_script(strokes, np.array(table.position), table.lift, table.speed, table.start)
    return Prescribed(times, positions)
