"""What is measured of bodies at each frame: contacts, extent, displacements, run-out, slope of the surface, sliding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.moreau.frames import matrices
from barchan.bodies.rigid import Body, BodyStates, Prescribed, Sphere
from barchan.errors import InputError
from barchan.scenes.kinds.bodies.parameters import BodiesParameters

Vector = NDArray[np.float64]

AXES = {2: "xz", 3: "xyz"}
_SPINS = {2: ("spin",), 3: ("spin_x", "spin_y", "spin_z")}
_TURNS = {2: ("angle",), 3: ("qw", "qx", "qy", "qz")}
_BULK_SHARE = 0.995  # of the mass, behind the front of the bulk
_COLUMNS = 12  # that a surface is looked at in


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts with force: pairs (k, 2) of bodies (-1: a soft wall), forces (k, d) [N], the deepest overlap [m]."""

    pairs: NDArray[np.int32]
    forces: Vector
    deepest: float


class Observer:
    """Measures states of `bodies` that started in `start`. Raises InputError for bodies in [observe] that do not exist."""

    def __init__(self, parameters: BodiesParameters, bodies: Sequence[Body], start: BodyStates) -> None:
        self._parameters, self._bodies, self._start = parameters, bodies, start
        self.free = np.array([not body.driven for body in bodies])
        names = [body.name for body in bodies]
        for key in ("sliding", "ground"):
            name = getattr(parameters.observe, key)
            if name and name not in names:
                raise InputError(f"observe.{key}", name, "the name of a body")
        single = {name for name, _ in parameters.single_bodies()}
        self._followed = [
            number
            for number, body in enumerate(bodies)
            if isinstance(body.motion, Prescribed) or (body.name in single and not body.driven)
        ]
        self._numbers = {name: number for number, name in enumerate(names)}

    @cached_property
    def masses(self) -> Vector:
        """(f,) masses [kg] of the free bodies."""
        return np.array([body.mass for body in self._bodies if not body.driven])

    @cached_property
    def lengths(self) -> Vector:
        """(f,) greatest extents [m] of the free bodies along the axes of their frames."""
        return np.array([float(np.max(high - low)) for low, high in self._bounds])

    @cached_property
    def smallest(self) -> float:
        """Half of the least extent [m] of all free bodies: of spheres the smallest radius."""
        return min(0.5 * float(np.min(high - low)) for low, high in self._bounds)

    @cached_property
    def _bounds(self) -> list[tuple[Vector, Vector]]:
        return [body.shape.bounds() for body in self._bodies if not body.driven]

    def observed(self, states: BodyStates, contacts: Contacts, time: float) -> dict[str, float]:
        """Scalars of a state."""
        free = self.free
        places, speeds = states.positions[free], np.linalg.norm(states.velocities[free], axis=1)
        away = np.linalg.norm(places - self._start.positions[free], axis=1)
        half = self._half_extents(states)
        middle = self._middles(states)
        share = self.masses / np.sum(self.masses)
        centre = share @ middle
        values = {
            "max_speed": float(np.max(speeds)),
            "contacts": float(len(contacts.pairs)),
            "coordination": self._coordination(contacts.pairs),
            "largest_force": float(np.max(np.linalg.norm(contacts.forces, axis=1), initial=0.0)),
            "deepest_overlap": contacts.deepest,
            "deepest_relative": contacts.deepest / self.smallest,
            "displacement": float(np.max(away)),
            "displacement_relative": float(np.max(away / self.lengths)),
            "top": float(np.max(middle[:, -1] + half[:, -1])),
            "front": float(np.max(middle[:, 0] + half[:, 0])) - self._parameters.observe.back,
            **{f"centre_{axis}": float(x) for axis, x in zip(AXES[states.dimension], centre, strict=True)},
        }
        return values | self._poses(states) | self._asked(states, middle, half, time)

    def _middles(self, states: BodyStates) -> Vector:
        """(f, d) middles of the bounds of the free bodies in the world."""
        turn = matrices(states.rotations[self.free])
        local = np.array([0.5 * (low + high) for low, high in self._bounds])
        return states.positions[self.free] + np.einsum("kij,kj->ki", turn, local)

    def _half_extents(self, states: BodyStates) -> Vector:
        """(f, d) half extents of the free bodies along the axes of the world; exact for spheres and boxes, else a bound."""
        half = np.array([0.5 * (high - low) for low, high in self._bounds])
        round_ = np.array([isinstance(body.shape, Sphere) for body in self._bodies if not body.driven])
        turned = np.einsum("kij,kj->ki", np.abs(matrices(states.rotations[self.free])), half)
        return np.where(round_[:, None], half, turned)

    def _coordination(self, pairs: NDArray[np.int32]) -> float:
        """Mean number of bodies that a free body touches."""
        if len(pairs) == 0:
            return 0.0
        apart = np.unique(np.sort(pairs, axis=1), axis=0)
        ends = np.sum([(column >= 0) & self.free[np.maximum(column, 0)] for column in apart.T])
        return float(ends) / float(np.sum(self.free))

    def _poses(self, states: BodyStates) -> dict[str, float]:
        """Pose and velocity of the bodies of [bodies] that are not fixed, and of drums."""
        d = states.dimension
        values: dict[str, float] = {}
        for number in self._followed:
            row, name = states.row(number), self._bodies[number].name
            named = {
                **dict(zip(AXES[d], row.position, strict=True)),
                **dict(zip((f"v{axis}" for axis in AXES[d]), row.velocity, strict=True)),
                **dict(zip(_TURNS[d], row.rotation, strict=True)),
                **dict(zip(_SPINS[d], row.spin, strict=True)),
            }
            values |= {f"{name}_{key}": float(value) for key, value in named.items()}
        return values

    def _asked(self, states: BodyStates, middle: Vector, half: Vector, time: float) -> dict[str, float]:
        """What [observe] asks for."""
        observe = self._parameters.observe
        values: dict[str, float] = {}
        if observe.length is not None and observe.height is not None:
            order = np.argsort(middle[:, 0], kind="stable")
            behind = np.cumsum(self.masses[order])
            bulk = float(middle[order[np.searchsorted(behind, _BULK_SHARE * behind[-1])], 0]) - observe.back
            front = float(np.max(middle[:, 0] + half[:, 0])) - observe.back
            values |= {
                "front_bulk": bulk,
                "run_out": front / observe.length - 1.0,
                "run_out_bulk": bulk / observe.length - 1.0,
                "height_ratio": float(np.max(middle[:, -1] + half[:, -1])) / observe.height,
            }
        if observe.level is not None:
            values["mass_above"] = float(np.sum(self.masses[middle[:, -1] > observe.level]))
        if observe.surface is not None:
            values["surface_angle"] = surface_angle(middle, half, observe.surface)
        if observe.sliding:
            values |= self._sliding(states, time)
        return values

    def _sliding(self, states: BodyStates, time: float) -> dict[str, float]:
        """Speed of a block along x and that of Coulomb's law from rest: g (sin a - mu cos a) t, or none."""
        observe, scene = self._parameters.observe, self._parameters.scene
        block, ground = self._numbers[observe.sliding], self._numbers[observe.ground]
        mu = friction_of(self._parameters, self._bodies[block], self._bodies[ground])
        angle = math.radians(scene.slope_deg)
        gained = max(0.0, scene.gravity * (math.sin(angle) - mu * math.cos(angle))) * time
        begun = float(self._start.velocities[block, 0])
        return {"sliding_speed": float(states.velocities[block, 0]), "sliding_speed_exact": begun + gained}


def friction_of(parameters: BodiesParameters, first: Body, second: Body) -> float:
    """Friction of a pair, as [contact] says."""
    contact = parameters.contact
    for one, two, value in contact.pairs or []:
        if {one, two} == {first.name, second.name}:
            return float(value)
    a, b = first.friction, second.friction
    rules = {"geometric": math.sqrt(a * b), "mean": 0.5 * (a + b), "min": min(a, b), "max": max(a, b)}
    return rules[contact.mixing]


def surface_angle(middle: Vector, half: Vector, between: Sequence[float]) -> float:
    """Slope (degrees) of the line through the highest bodies of columns between two abscissae; 0 with fewer than three."""
    edges = np.linspace(between[0], between[1], _COLUMNS + 1)
    column = np.digitize(middle[:, 0], edges) - 1
    tops = [
        (middle[column == k, 0], (middle + half)[column == k, -1])
        for k in range(_COLUMNS)
        if np.any(column == k)
    ]
    if len(tops) < 3:
        return 0.0
    highest = np.array([(x[np.argmax(z)], np.max(z)) for x, z in tops])
    return float(np.degrees(np.arctan(np.polyfit(highest[:, 0], highest[:, 1], 1)[0])))
