"""Soft-sphere DEM: discs or balls on springs and dashpots, with friction that remembers (seed C, 3.2.1 and 3.2.2).

spheres = SoftSpheres(radii, 2500.0, Hookean.of_restitution(1e5, 0.7), 0.5, [Wall((0, 0, 1))], gravity=(0, 0, -9.81))
state = spheres.start(positions)
state = spheres.advance(state, spheres.time_step(), steps=1000)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.coarse_graining.images import Periodic
from barchan.bodies.coarse_graining.interactions import Grains, Interactions
from barchan.bodies.rigid import BodyStates, inputs
from barchan.bodies.soft.cell import Cell, cell_rows
from barchan.bodies.soft.energy import Energy, energy_of
from barchan.bodies.soft.laws import ContactLaw, Hertzian, Hookean
from barchan.bodies.soft.state import SoftState
from barchan.bodies.soft.walls import Wall, wall_rows
from barchan.bodies.soft.workspace import Workspace
from barchan.errors import InputError

Vector = NDArray[np.float64]
_SKIN = 0.3  # of the smallest radius: lists last for many steps and hold few pairs that are apart


class SoftSpheres:
    """n discs (d = 2) or balls (d = 3), and what acts on them.

    radii : (n,) [m]. densities : one number or (n,) [kg/m^d].
    contact : `Hookean` or `Hertzian`. friction : physical, one number or (n,); a pair has sqrt(mu_i mu_j).
    walls : planes. gravity : (d,) [m/s^2], sets the dimension. cell : periodic cell or None.
    rolling_friction : mu_r >= 0; a rolling torque of at most mu_r R* f_n with the tangential spring and dashpot (0: none).
    held : (n,) grains that keep the velocity and spin they start with: glued walls.
    skin : [m] margin of the neighbour list.
    """

    def __init__(
        self,
        radii: ArrayLike,
        densities: ArrayLike,
        contact: ContactLaw,
        friction: ArrayLike = 0.5,
        walls: Sequence[Wall] = (),
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        cell: Cell | None = None,
        rolling_friction: float = 0.0,
        held: ArrayLike | None = None,
        skin: float | None = None,
    ) -> None:
        self.gravity = inputs.vector("gravity", gravity, (2, 3))
        self.dimension = len(self.gravity)
        self.radii = _per_grain("radii", radii, None)
        n = len(self.radii)
        self.densities = _per_grain("densities", densities, n)
        if np.any(self.radii <= 0.0) or np.any(self.densities <= 0.0):
            raise InputError("radii", "radii or densities not above 0", "positive, with positive densities")
        if not isinstance(contact, Hookean | Hertzian):
            raise InputError("contact", type(contact).__name__, "Hookean(...) or Hertzian(...)")
        self.contact = contact
        self.friction = _per_grain("friction", friction, n)
        if np.any(self.friction < 0.0):
            raise InputError("friction", float(np.min(self.friction)), "at least 0")
        self.rolling_friction = inputs.not_negative("rolling_friction", rolling_friction)
        self.walls = tuple(walls)
        wall_rows(self.walls, self.dimension)
        if cell is not None and cell.dimension != self.dimension:
            raise InputError("cell", cell.lengths, f"of {self.dimension} lengths, as gravity")
        self.cell = cell
        self.held = np.zeros(n, dtype=np.bool_) if held is None else np.array(held, dtype=np.bool_)
        if self.held.shape != (n,):
            raise InputError("held", self.held.shape, f"{n} truth values")
        self.skin = _SKIN * float(np.min(self.radii)) if skin is None else inputs.positive("skin", skin)

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def volumes(self) -> Vector:
        """(n,) [m^d]."""
        d = self.dimension
        volumes: Vector = np.pi * self.radii**2 if d == 2 else 4.0 / 3.0 * np.pi * self.radii**3
        return volumes

    @property
    def masses(self) -> Vector:
        """(n,) [kg], in the plane per metre of depth."""
        return self.densities * self.volumes

    @property
    def moments(self) -> Vector:
        """(n,) moments of inertia [kg m^2]: 2 m R^2 / (d + 2)."""
        return 2.0 / (self.dimension + 2.0) * self.masses * self.radii**2

    def time_step(self, speed: float | None = None, share: float = 1.0 / 50.0) -> float:
        """`share` of the shortest contact [s]; a Hertzian one needs the largest `speed` [m/s] of a collision.

        1/50 gives coefficients of restitution to 1 %, 1/20 does for dense flows.
        """
        inputs.positive("share", share)
        free = ~self.held
        if not np.any(free):
            raise InputError("held", "all", "not all: nothing moves")
        masses, radii = self.masses[free], self.radii[free]
        # a lighter pair is a shorter contact; of equal masses m* is half of one, and against a wall all of it
        lightest = int(np.argmin(masses))
        mass, radius = 0.5 * float(masses[lightest]), 0.5 * float(radii[lightest])
        return share * self.contact.shortest_time(mass, radius, speed)

    def start(
        self,
        positions: ArrayLike | BodyStates,
        velocities: ArrayLike | None = None,
        spins: ArrayLike | None = None,
        time: float = 0.0,
    ) -> SoftState:
        """State with no contact older than now; positions (n, d), velocities (n, d), spins (n, 3) or (n, 1), or BodyStates.

        InputError where two grains, or a grain and a wall, overlap by more than half a radius: it names the deepest pair.
        """
        bodies = (
            positions if isinstance(positions, BodyStates) else self._bodies(positions, velocities, spins)
        )
        if len(bodies) != len(self) or bodies.dimension != self.dimension:
            raise InputError("positions", bodies.positions.shape, f"({len(self)}, {self.dimension}) numbers")
        return Workspace.starting(self, bodies, float(time)).state()

    def advance(self, state: SoftState, dt: float, steps: int) -> SoftState:
        """State after `steps` steps of `dt` [s].

        The same state gives the same bytes on any number of threads. InputError when grains pass through one another.
        """
        inputs.positive("dt", dt)
        if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or steps < 0:
            raise InputError("steps", steps, "a whole number >= 0")
        work = Workspace.of(self, state)
        work.advance(float(dt), int(steps))
        return work.state()

    def contacts(self, state: SoftState) -> Interactions:
        """The forces that act in `state`; held grains and walls are walls to it."""
        return Workspace.of(self, state).interactions()

    def grains(self, state: SoftState) -> tuple[Grains, Interactions]:
        """What coarse graining reads: the grains that are free, and the forces on them, numbered among themselves."""
        free = ~self.held
        numbers = np.cumsum(free) - 1
        between = self.contacts(state)
        second = np.where(between.second >= 0, numbers[between.second], -1)
        renumbered = Interactions(
            numbers[between.first], second, between.forces, between.branches, between.normals, between.points
        )
        bodies = state.bodies
        return (
            Grains(bodies.positions[free], bodies.velocities[free], self.masses[free], self.volumes[free]),
            renumbered,
        )

    def periodic(self, state: SoftState) -> Periodic | None:
        """Edges of the periodic cell and the velocities of its images in `state`, for coarse graining."""
        rows = cell_rows(self.cell, state.cell, self.dimension)
        used = np.diag(rows[:, :3]) > 0.0
        if not np.any(used):
            return None
        return Periodic(rows[used, : self.dimension], rows[used, 3 : 3 + self.dimension])

    def energy(self, state: SoftState) -> Energy:
        """Kinetic, elastic and potential energy of the free grains, and what contacts have lost [J]."""
        return energy_of(self, state, Workspace.of(self, state))

    def _bodies(
        self, positions: ArrayLike, velocities: ArrayLike | None, spins: ArrayLike | None
    ) -> BodyStates:
        n, d = len(self), self.dimension
        x = inputs.table("positions", positions, (d,), 0)
        turn, spin = (4, 3) if d == 3 else (1, 1)
        rotations = np.zeros((len(x), turn))
        if d == 3:
            rotations[:, 0] = 1.0
        v = np.zeros((n, d)) if velocities is None else np.array(velocities, dtype=np.float64)
        w = np.zeros((n, spin)) if spins is None else np.array(spins, dtype=np.float64).reshape(-1, spin)
        return BodyStates(x, rotations, v, w)


def _per_grain(field: str, value: ArrayLike, count: int | None) -> Vector:
    array = np.array(value, dtype=np.float64)
    if array.ndim == 0 and count is not None:
        array = np.full(count, float(array))
    if array.ndim != 1 or (count is not None and len(array) != count) or not np.all(np.isfinite(array)):
        raise InputError(field, value, "finite, one number per grain")
    if len(array) == 0:
        raise InputError(field, value, "of one grain at least")
    return array
