"""What the parts of the boundary do to grains and fluid: walls that move along themselves, porous walls, open parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.dry.boundaries import Boundary as DryBoundary
from barchan.flows.dry.boundaries import codes_of_sides
from barchan.flows.dry.cells import Cells

STICK = ("no_slip", "friction")


@dataclass(frozen=True)
class Boundary(DryBoundary):
    """One part of the boundary.

    kind, friction : what the grains meet, as in the dry model. The fluid slips along "slip", sticks to "no_slip" and
        "friction" where it is viscous, and crosses "free", where the pore pressure is zero.
    velocity : (d,) [m/s] of the wall, or none. Its part along the wall drags grains and fluid; its part across is the
        velocity at which volume enters through the wall, which stays closed to grains.

    Raises InputError for an unknown kind, a friction that is negative or not finite, a velocity that is not finite or given on
    a free part.
    """

    velocity: Sequence[float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.velocity is None:
            return
        allowed = "finite numbers, one for each axis"
        try:
            finite = all(math.isfinite(float(value)) for value in self.velocity)
        except (TypeError, ValueError):
            raise InputError("boundary.velocity", self.velocity, allowed) from None
        if not finite:
            raise InputError("boundary.velocity", self.velocity, allowed)
        if self.kind == "free":
            raise InputError(
                "boundary.velocity", self.velocity, "none on a free part, where pressure is given"
            )


@dataclass(frozen=True, eq=False)
class Sides:
    """What each side (c, k) of the cells meets.

    codes : (c, k) INNER, WALL, STICKY or FREE for the grains.
    stick : (c, k) walls along which a viscous fluid does not slip.
    velocities : (c, k, d) of the walls, zero elsewhere [m/s].
    """

    codes: NDArray[np.int64]
    stick: NDArray[np.bool_]
    velocities: NDArray[np.float64]

    @classmethod
    def of(cls, cells: Cells, boundaries: tuple[Boundary, ...]) -> Sides:
        """From boundaries in the order of `cells.names`; InputError for a velocity of another size."""
        velocities = np.zeros((len(boundaries), cells.dimension))
        for number, boundary in enumerate(boundaries):
            if boundary.velocity is None:
                continue
            given = np.array(boundary.velocity, dtype=float)
            if given.shape != (cells.dimension,):
                field = f"boundaries.{cells.names[number]}.velocity"
                raise InputError(field, boundary.velocity, f"{cells.dimension} numbers")
            velocities[number] = given
        stick = np.array([boundary.kind in STICK for boundary in boundaries], dtype=bool)
        outer = cells.parts >= 0
        return cls(
            codes_of_sides(cells, boundaries),
            np.where(outer, stick[cells.parts], False),
            np.where(outer[:, :, None], velocities[cells.parts], 0.0),
        )

    def wall_fluxes(self, cells: Cells) -> NDArray[np.float64]:
        """(c, k) volumes that walls take out of each cell [m^d/s]."""
        return np.asarray(np.einsum("ckd,ckd->ck", self.velocities, cells.faces))

    def sliding(self, cells: Cells) -> NDArray[np.float64]:
        """(c, k, d) part of the velocities along the walls."""
        squares = np.sum(cells.faces**2, axis=2)
        across = (self.wall_fluxes(cells) / squares)[:, :, None] * cells.faces
        return np.asarray(self.velocities - across)
