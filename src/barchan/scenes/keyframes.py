"""Motions of bodies as tables of a scene give them: at a velocity, or by a script; and the vectors of such tables."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Prescribed
from barchan.bodies.rigid.rotations import exponential, identity, product
from barchan.errors import InputError

Vector = NDArray[np.float64]

_LARGEST_TURN = math.radians(60.0)  # between two keyframes of a body that is driven round


class Script(Protocol):
    """A table with keyframes: times [s], positions [m] and rotation vectors [degrees] at them."""

    @property
    def times(self) -> list[float] | None:
        """Increasing."""

    @property
    def positions(self) -> list[list[float]] | None:
        """A row for each time."""

    @property
    def rotations(self) -> list[list[float]] | None:
        """A row for each time."""


def vector_of(value: list[float] | None, dimension: int) -> Vector:
    """(d,) a vector of a table; zero where it is left out."""
    return np.zeros(dimension) if value is None else np.array(value, dtype=np.float64)


def turning_of(field: str, value: list[float] | None, dimension: int) -> Vector:
    """An angular velocity or torque: one number in the plane, three in space; zero where it is left out."""
    count = 1 if dimension == 2 else 3
    if value is None:
        return np.zeros(count)
    if len(value) != count:
        raise InputError(field, value, "one number in 2D, three in 3D")
    return np.array(value, dtype=np.float64)


def rotation_of(field: str, degrees: list[float] | None, dimension: int) -> Vector | None:
    """Rotation (1,) or unit quaternion (4,) of a rotation vector in degrees; None for none."""
    if degrees is None:
        return None
    count = 1 if dimension == 2 else 3
    if len(degrees) != count:
        raise InputError(field, degrees, "one angle in 2D, three numbers in 3D (degrees)")
    return np.asarray(exponential(np.radians(np.array(degrees, dtype=np.float64))))


def end_of_drive(field: str, start: float, stop: float | None, end: float) -> float:
    """When a driven body stops [s]: long after the `end` of the run where it is not said; InputError if before it starts."""
    last = stop if stop is not None else 2.0 * end + start
    if last <= start:
        raise InputError(f"{field}.stop", last, f"later than the body starts, {start:g} s")
    return last


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


def scripted_motion(field: str, table: Script, dimension: int) -> Prescribed:
    """Keyframes as they stand in the table `field`; InputError for rows that are missing, too few or too short."""
    if table.times is None or table.positions is None:
        missing = "times" if table.times is None else "positions"
        raise InputError(f"{field}.{missing}", "missing", "given for a scripted body")
    for name, rows in (("positions", table.positions), ("rotations", table.rotations)):
        if rows is not None and len(rows) != len(table.times):
            allowed = f"{len(table.times)} rows, one for each of the times"
            raise InputError(f"{field}.{name}", f"{len(rows)} rows", allowed)
    if any(len(row) != dimension for row in table.positions):
        raise InputError(f"{field}.positions", table.positions, f"rows of {dimension} numbers")
    turns = None
    if table.rotations is not None:
        turns = np.array([rotation_of(f"{field}.rotations", row, dimension) for row in table.rotations])
    return Prescribed(np.array(table.times), np.array(table.positions), turns)
