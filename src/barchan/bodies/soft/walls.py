"""Plane walls of soft spheres: at rest, or moving at a constant velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.errors import InputError


@dataclass(frozen=True, eq=False, init=False)
class Wall:
    """The solid normal . x <= offset + (normal . velocity) t, as in `barchan.bodies.rigid.HalfSpace`.

    normal : (d,), out of the solid; need not be unit. offset : [m]. friction : physical coefficient >= 0.
    velocity : (d,) [m/s]; the part along the wall drags grains, the part across moves the plane.
    """

    normal: NDArray[np.float64]
    offset: float
    friction: float
    velocity: NDArray[np.float64]

    def __init__(
        self,
        normal: ArrayLike,
        offset: float = 0.0,
        friction: float = 0.5,
        velocity: ArrayLike | None = None,
    ) -> None:
        given = inputs.vector("wall.normal", normal, (2, 3))
        if not np.any(given):
            raise InputError("wall.normal", given.tolist(), "a vector that is not zero")
        if not np.isfinite(offset):
            raise InputError("wall.offset", offset, "finite")
        d = len(given)
        speed = np.zeros(d) if velocity is None else inputs.vector("wall.velocity", velocity, (d,))
        object.__setattr__(self, "normal", given / np.linalg.norm(given))
        object.__setattr__(self, "offset", float(offset))
        object.__setattr__(self, "friction", inputs.not_negative("wall.friction", friction))
        object.__setattr__(self, "velocity", speed)


def wall_rows(walls: Sequence[Wall], dimension: int) -> NDArray[np.float64]:
    """(m, 8) : normal, offset, velocity and friction, as the kernels read them."""
    rows = np.zeros((len(walls), 8))
    for row, wall in zip(rows, walls, strict=True):
        if len(wall.normal) != dimension:
            raise InputError("walls", wall.normal.tolist(), f"walls with normals of {dimension} numbers")
        row[:dimension] = wall.normal
        row[3] = wall.offset
        row[4 : 4 + dimension] = wall.velocity
        row[7] = wall.friction
    return rows
