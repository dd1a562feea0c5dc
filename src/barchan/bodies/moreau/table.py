"""Bodies as arrays: masses, moments, and the equations of motion of all of them at once (seed B, Eq. 2.3-2.5).

Generalised velocities are those of `barchan.bodies.rigid.dynamics`: two blocks of d a body, the velocity of the centre of
mass, and the spin along the principal axes (in the plane: the spin, and a component of unit mass that nothing moves). Bodies
with held components, loads that are functions, or prescribed motions go through that module one by one; all others at once,
fixed ones among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.moreau import frames
from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Fixed,
    Free,
    generalised_masses,
    moved,
    predicted_velocities,
)
from barchan.bodies.rigid.dynamics import spin_axes
from barchan.errors import InputError

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyTable:
    """k bodies of one dimension.

    plain : (k,) free bodies without held components and loads in time: all that follows is for them.
    fixed : (k,) bodies at rest for ever.  special : numbers of all other bodies.  driven : (k,) bodies that nothing can move.
    masses : (k,) [kg].  moments : (k, s) principal [kg m^2].  axes : (k, s, s), in columns, in the frames of the shapes.
    centres : (k, d) centres of mass in the frames of the shapes [m].  forces, torques : (k, d), (k, s), world or body frame.
    """

    bodies: tuple[Body, ...]
    plain: NDArray[np.bool_]
    fixed: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    special: tuple[int, ...]
    masses: Vector
    moments: Vector
    axes: Vector
    centres: Vector
    forces: Vector
    torques: Vector
    torque_turns: NDArray[np.bool_]
    friction: Vector

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> BodyTable:
        """The table of some bodies; InputError for none, or bodies of different dimensions."""
        if not bodies or len({body.dimension for body in bodies}) != 1:
            raise InputError(
                "bodies", sorted({body.dimension for body in bodies}), "at least one, all 2D or all 3D"
            )
        s = bodies[0].spin_size
        driven = np.array([body.driven for body in bodies])
        plain = np.array([not body.driven and _is_plain(body) for body in bodies])
        fixed = np.array([isinstance(body.motion, Fixed) for body in bodies])
        one = np.ones(s)
        return cls(
            tuple(bodies), plain, fixed, driven, tuple(np.flatnonzero(~plain & ~fixed).tolist()),
            np.array([1.0 if body.driven else body.mass for body in bodies]),
            np.array([one if body.driven else body.principal_moments for body in bodies]),
            np.array([np.eye(s) if body.driven else body.principal_axes for body in bodies]),
            np.array([body.centre for body in bodies]), np.array([body.force for body in bodies]),
            np.array([body.torque for body in bodies]), np.array([body.torque_frame == "body" for body in bodies]),
            np.array([body.friction for body in bodies]),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.bodies)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.centres.shape[1])

    def spin_axes(self, states: BodyStates) -> Vector:
        """(k, 3, 3) world directions, in columns, along which the spins of bodies in space are counted."""
        found = np.asarray(frames.matrices(states.rotations) @ self.axes)
        for number in self.special:
            found[number] = spin_axes(self.bodies[number], states.row(number))
        return found

    def centres_of(self, states: BodyStates) -> Vector:
        """(k, d) centres of mass in the world."""
        turn = frames.matrices(states.rotations)
        return states.positions + np.einsum("kij,kj->ki", turn, self.centres)

    def generalised_masses(self, states: BodyStates) -> Vector:
        """(k, 2, d) diagonal of M; 1 for components that nothing moves."""
        k, d = len(self), self.dimension
        masses = np.ones((k, 2, d))
        masses[:, 0] = self.masses[:, None]
        masses[:, 1, : self.moments.shape[1]] = self.moments
        for number in self.special:
            own = generalised_masses(self.bodies[number], states.row(number))
            masses[number] = np.where(np.isinf(own), 1.0, own)
        return masses

    def movable(self, states: BodyStates) -> NDArray[np.bool_]:
        """(k, 2, d) components that forces can change."""
        found = np.ones((len(self), 2, self.dimension), dtype=bool)
        found[self.fixed] = False
        if self.dimension == 2:
            found[:, 1, 1] = False
        for number in self.special:
            found[number] = np.isfinite(generalised_masses(self.bodies[number], states.row(number)))
            if self.dimension == 2:
                found[number, 1, 1] = False
        return found

    def predicted(self, states: BodyStates, gravity: Vector, dt: float, time: float) -> Vector:
        """(k, 2, d) velocities at the end of a step if nothing touched: gravity, loads and the gyroscopic torque, explicit."""
        blocks = np.zeros((len(self), 2, self.dimension))
        blocks[:, 0] = states.velocities + dt * (gravity + self.forces / self.masses[:, None])
        blocks[:, 1, : self.moments.shape[1]] = self._spins(states, dt)
        blocks[self.fixed] = 0.0
        for number in self.special:
            blocks[number] = predicted_velocities(self.bodies[number], states.row(number), gravity, dt, time)
        return blocks

    def columns(self, number: NDArray[np.int64], points: Vector, states: BodyStates) -> Vector:
        """(m, 2, d, d): matter of the bodies `number` (m,) at world `points` (m, d) moves with C[:, 0] @ v + C[:, 1] @ w."""
        d = self.dimension
        arms = points - self.centres_of(states)[number]
        found = np.zeros((len(number), 2, d, d))
        found[:, 0] = np.eye(d)
        if d == 2:
            found[:, 1, 0, 0], found[:, 1, 1, 0] = -arms[:, 1], arms[:, 0]
        else:
            axes = self.spin_axes(states)[number].transpose(0, 2, 1)
            found[:, 1] = np.cross(axes, arms[:, None, :]).transpose(0, 2, 1)
        return found

    def moved(
        self, states: BodyStates, blocks: Vector, dt: float, time: float, theta: float, gravity: Vector
    ) -> BodyStates:
        """The bodies after the step whose end velocities (k, 2, d) are `blocks`.

        Plain bodies keep the angular momentum that impulses leave them to round-off: they turn at the spin it has in the middle
        of the step. Places move with theta v^(k+1) + (1 - theta) v^k.
        """
        d = self.dimension
        s = self.moments.shape[1]
        middle = theta * blocks[:, 0] + (1.0 - theta) * states.velocities
        centres = self.centres_of(states) + dt * middle
        if d == 2:
            spins = blocks[:, 1, :1]
            rotations = frames.turned(states.rotations, theta * spins + (1.0 - theta) * states.spins, dt)
        else:
            rotations, spins = self._turned(states, blocks[:, 1, :s], dt)
        positions = centres - np.einsum("kij,kj->ki", frames.matrices(rotations), self.centres)
        fields = [np.array(array) for array in (positions, rotations, blocks[:, 0], spins)]
        before = (states.positions, states.rotations, states.velocities, states.spins)
        for array, old in zip(fields, before, strict=True):
            array[self.fixed] = old[self.fixed]
        for number in self.special:
            row = moved(self.bodies[number], states.row(number), blocks[number], dt, time)
            for array, value in zip(
                fields, (row.position, row.rotation, row.velocity, row.spin), strict=True
            ):
                array[number] = value
        return BodyStates(*fields)

    def kinetic_energy(self, states: BodyStates) -> float:
        """Of all bodies that are free [J]."""
        free = ~self.driven
        moving = self.masses[free] @ np.sum(states.velocities[free] ** 2, axis=1)
        if self.dimension == 2:
            return 0.5 * float(moving + self.moments[free, 0] @ states.spins[free, 0] ** 2)
        along = np.einsum("kji,kj->ki", self.spin_axes(states)[free], states.spins[free])
        return 0.5 * float(moving + np.sum(self.moments[free] * along**2))

    def potential_energy(self, states: BodyStates, gravity: Vector) -> float:
        """-m g . x of the free bodies [J]."""
        free = ~self.driven
        return -float(self.masses[free] @ (self.centres_of(states)[free] @ gravity))

    def _torques(self, states: BodyStates) -> Vector:
        if self.dimension == 2 or not np.any(self.torque_turns):
            return self.torques
        turn = np.einsum("kij,kj->ki", frames.matrices(states.rotations), self.torques)
        return np.where(self.torque_turns[:, None], turn, self.torques)

    def _spins(self, states: BodyStates, dt: float) -> Vector:
        """(k, s) second blocks after torque and gyroscopic term: I dw/dt = torque - w x I w (seed B, Eq. 2.4)."""
        torques = self._torques(states)
        if self.dimension == 2:
            return states.spins + dt * torques / self.moments
        axes = self.spin_axes(states)
        along = np.einsum("kji,kj->ki", axes, states.spins)
        gyroscopic = np.cross(along, self.moments * along)
        return along + dt * (np.einsum("kji,kj->ki", axes, torques) - gyroscopic) / self.moments

    def _turned(self, states: BodyStates, block: Vector, dt: float) -> tuple[Vector, Vector]:
        axes = self.spin_axes(states)
        impulse = np.einsum("kij,kj->ki", axes, self.moments * (block - self._spins(states, dt)))
        along = np.einsum("kji,kj->ki", axes, states.spins)
        momentum = np.einsum("kij,kj->ki", axes, self.moments * along) + dt * self._torques(states) + impulse
        halfway = frames.turned(states.rotations, np.einsum("kij,kj->ki", axes, block), 0.5 * dt)
        rotations = frames.turned(states.rotations, self._spins_of(halfway, momentum), dt)
        return rotations, self._spins_of(rotations, momentum)

    def _spins_of(self, rotations: Vector, momentum: Vector) -> Vector:
        axes = frames.matrices(rotations) @ self.axes
        along = np.einsum("kji,kj->ki", axes, momentum) / self.moments
        return np.asarray(np.einsum("kij,kj->ki", axes, along))


def _is_plain(body: Body) -> bool:
    motion = body.motion
    return isinstance(motion, Free) and not motion.held and motion.force is None and motion.torque is None
