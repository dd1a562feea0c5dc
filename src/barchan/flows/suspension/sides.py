"""What the faces of the box do to the fluid and to the grains in it: slip, stick, friction, or open (seed B, 8.3.2).

The volume-averaged velocity u_v = phi u_g + (1 - phi) u_f is the one that is held: it alone is free of divergence. Where faces
meet, the component normal to a face is that face's own and a tangential one that several faces fix is the slowest of theirs:
static walls win over a moving lid, and the flux through a face is its normal velocity times its area, to round-off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm.walls import KINDS, Wall, Walls, face_names
from barchan.flows.suspension.phases import CLOSED, FLUID_HELD, FREE, HELD
from barchan.spaces import RegularGrid

# Net flux through a closed box, relative to the flux through its faces, below which it is round-off.
BALANCED = 1e-9


@dataclass(frozen=True)
class Side:
    """One face of the box.

    kind : "slip" (normal velocity given), "stick" (whole velocity given), "friction" (normal u_v given; grains may leave the
        wall and slide under Coulomb's law, the fluid sticks to it tangentially) or "open" (nothing given: no stress and a pore
        pressure of zero outside; matter leaves).
    friction : physical coefficient >= 0 between grains and a frictional wall.
    velocity : (d,) of the wall or of the matter that crosses it [m/s]; None is zero. A slip wall takes a normal one only.

    Raises InputError for an unknown kind, a coefficient that is negative or not finite, velocities that are not finite or are
    given to an open face.
    """

    kind: Literal["slip", "stick", "friction", "open"] = "slip"
    friction: float = 0.0
    velocity: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("side.kind", self.kind, "one of " + ", ".join(KINDS))
        number = isinstance(self.friction, (int, float))
        if not number or not math.isfinite(self.friction) or self.friction < 0.0:
            raise InputError("side.friction", self.friction, "a finite number >= 0")
        if self.velocity is None:
            return
        if self.kind == "open":
            raise InputError("side.velocity", self.velocity, "left out at an open face")
        try:
            numbers = tuple(float(component) for component in self.velocity)
        except (TypeError, ValueError):
            raise InputError("side.velocity", self.velocity, "a vector of 2 or 3 numbers (m/s)") from None
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            raise InputError("side.velocity", self.velocity, "a vector of 2 or 3 finite numbers (m/s)")
        object.__setattr__(self, "velocity", numbers)

    def component(self, axis: int) -> float:
        """Velocity along `axis` [m/s]."""
        return 0.0 if self.velocity is None else self.velocity[axis]


@dataclass(frozen=True)
class Sides:
    """The faces of the box; those not named slip.

    faces : face name ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max"; z is the vertical, the last axis) -> Side.

    Raises InputError for an unknown face name or a value that is not a Side.
    """

    faces: Mapping[str, Side] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, side in self.faces.items():
            if name not in face_names(3):
                raise InputError("sides", name, "a face among " + ", ".join(face_names(3)))
            if not isinstance(side, Side):
                raise InputError(f"sides.{name}", side, "a Side")

    def on(self, dimension: int) -> tuple[Side, ...]:
        """(2 d) sides in the order of `face_names`.

        Raises InputError when a face does not exist in the plane, a velocity has another size, or a slip wall is to move
        along itself, which nothing would feel.
        """
        names = face_names(dimension)
        for name, side in self.faces.items():
            if name not in names:
                raise InputError("sides", name, "a face among " + ", ".join(names) + " in 2D")
            if side.velocity is None:
                continue
            if len(side.velocity) != dimension:
                raise InputError(f"sides.{name}.velocity", side.velocity, f"a vector of {dimension} numbers")
            along = [side.component(k) for k in range(dimension) if k != names.index(name) // 2]
            if side.kind == "slip" and any(along):
                raise InputError(f"sides.{name}.velocity", side.velocity, "normal to the face where it slips")
        return tuple(self.faces.get(name, Side()) for name in names)

    def closed(self, dimension: int) -> bool:
        """Whether no face is open: pressures are then known up to a constant."""
        return all(side.kind != "open" for side in self.on(dimension))

    def walls(self) -> Walls:
        """The same faces as the grains see them (walls at rest: the caller adds what moving walls do to grains)."""
        return Walls({name: Wall(side.kind, side.friction) for name, side in self.faces.items()})

    def boundary(self, grid: RegularGrid) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
        """(n, d) what the faces do to each component at all nodes, and (n, d) the velocities they give [m/s], 0 where FREE.

        HELD: a component of both phases is given (all of them at a sticking wall, the normal one at a slipping wall).
        At a frictional wall the normal u_v is given (CLOSED: grains may leave, fluid takes their place) and the tangential
        u_f (FLUID_HELD). The stricter wins: HELD, CLOSED, FLUID_HELD, FREE.
        """
        d, every, sides = grid.dimension, np.arange(grid.node_count), self.on(grid.dimension)
        kinds, held = np.full((len(every), d), FREE, np.int8), np.zeros((len(every), d))
        places = [grid.on_face(every, face // 2, face % 2 == 1) for face in range(2 * d)]
        for kind, mark in (("friction", FLUID_HELD), ("stick", HELD)):
            for face, side in enumerate(sides):
                for k in range(d if side.kind == kind else 0):
                    if k != face // 2:
                        slower = (kinds[:, k] == FREE) | (np.abs(held[:, k]) > abs(side.component(k)))
                        held[places[face] & slower, k] = side.component(k)
                        kinds[places[face], k] = mark
        for face, side in enumerate(sides):
            if side.kind != "open":
                axis = face // 2
                loose = side.kind == "friction"
                kinds[places[face] & ((kinds[:, axis] != HELD) | (not loose)), axis] = (
                    CLOSED if loose else HELD
                )
                held[places[face], axis] = side.component(axis)
        return kinds, held

    def fixed(
        self, grid: RegularGrid, nodes: NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """(free (n, d), values (n, d) [m/s]) of u_v at the nodes (n,): what is HELD, whatever the phases do."""
        kinds, held = self.boundary(grid)
        free = kinds != HELD
        return free[nodes], np.where(free, 0.0, held)[nodes]

    def check_fluxes(self, grid: RegularGrid) -> None:
        """Raise InputError when no face is open and what flows in through the faces does not flow out [m^d/s]."""
        if not self.closed(grid.dimension):
            return
        lengths, fluxes = grid.upper - grid.origin, {}
        for face, (name, side) in enumerate(
            zip(face_names(grid.dimension), self.on(grid.dimension), strict=True)
        ):
            axis, upper = divmod(face, 2)
            area = float(np.prod(np.delete(lengths, axis)))
            fluxes[name] = (1.0 if upper else -1.0) * side.component(axis) * area
        net, gross = sum(fluxes.values()), sum(map(abs, fluxes.values()))
        if abs(net) > BALANCED * gross:
            crossed = ", ".join(f"{name} {flux:.4g}" for name, flux in fluxes.items() if flux)
            raise InputError(
                "sides",
                f"{net:.4g} m^{grid.dimension}/s out of it in all ({crossed})",
                "without net flux in a closed box (inconsistent fluxes)",
            )
