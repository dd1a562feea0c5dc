"""A rigid body: a shape with a mass, a friction coefficient, a place, and a way to move (seed B, 2.1.1 and 7.4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs, rotations
from barchan.bodies.rigid.motions import Free, Motion, Prescribed, held_components, load_at
from barchan.bodies.rigid.shape import Shape
from barchan.errors import InputError

TORQUE_FRAMES = ("world", "body")
Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, init=False)
class Body:
    """A rigid body and where it starts.

    shape : in the frame of the body.
    name : for messages and results.
    friction : physical coefficient of friction of its boundary, >= 0.
    density [kg/m^d] or mass [kg] : one of them for a free body; a driven one needs none. In the plane per metre of depth.
    position : (d,) [m] of the origin of the shape (default: the origin, or the first place of a prescribed motion).
    rotation : unit quaternion or matrix; in the plane an angle [rad].
    velocity, spin : (d,) [m/s] of the centre of mass and (3,) or one number [rad/s], world frame; free bodies only.
    motion : `Free(...)`, `Fixed()` or `Prescribed(...)`.
    force : (d,) [N], world frame, acting at the centre of mass.
    torque : (3,) or one number [N m], of this and of `motion`, in `torque_frame`: "world" or "body" (turns with the body).

    Derived: `volume`, `centre` (d,) of mass in the frame of the shape, `inertia` about it (3, 3) or (1, 1) [kg m^2],
    `principal_moments` (3,) or (1,) and `principal_axes` (3, 3), columns in the frame of the shape. Driven bodies have an
    infinite mass and inertia, and the origin of their shape as centre.
    """

    shape: Shape
    name: str
    friction: float
    density: float | None
    mass: float
    position: Vector
    rotation: Vector
    velocity: Vector
    spin: Vector
    motion: Motion
    force: Vector
    torque: Vector
    torque_frame: str
    volume: float
    centre: Vector
    inertia: Vector
    principal_moments: Vector
    principal_axes: Vector

    def __init__(
        self,
        shape: Shape,
        name: str = "",
        friction: float = 0.5,
        density: float | None = None,
        mass: float | None = None,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        spin: ArrayLike | None = None,
        motion: Motion | None = None,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        torque_frame: str = "world",
    ) -> None:
        self._set("name", name)
        if not isinstance(shape, Shape):
            raise InputError(self._field("shape"), type(shape).__name__, "a shape")
        self._set("shape", shape)
        self._set("motion", Free() if motion is None else motion)
        if not isinstance(self.motion, Motion):
            raise InputError(
                self._field("motion"), type(motion).__name__, "Free(...), Fixed() or Prescribed(...)"
            )
        if torque_frame not in TORQUE_FRAMES:
            raise InputError(self._field("torque_frame"), torque_frame, "world or body")
        self._set("torque_frame", torque_frame)
        self._set("friction", inputs.not_negative(self._field("friction"), friction))
        self._place(position, rotation)
        self._set_in_motion(velocity=velocity, spin=spin, force=force, torque=torque)
        self._weigh(density, mass)

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return self.shape.dimension

    @property
    def spin_size(self) -> int:
        """3 in space, 1 in the plane."""
        return 3 if self.dimension == 3 else 1

    @property
    def driven(self) -> bool:
        """Whether nothing can change its motion."""
        return not isinstance(self.motion, Free)

    def _field(self, name: str) -> str:
        return f"body.{self.name}.{name}" if self.name else f"body.{name}"

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _vector(self, name: str, value: ArrayLike | None, size: int) -> Vector:
        if value is None:
            return np.zeros(size)
        if isinstance(value, (int, float)) and (size == 1 or value == 0):
            value = np.full(size, float(value))
        return inputs.vector(self._field(name), value, (size,))

    def _place(self, given_position: ArrayLike | None, given_rotation: ArrayLike | None) -> None:
        d = self.dimension
        position = self._vector("position", given_position, d)
        rotation = rotations.as_rotation(self._field("rotation"), given_rotation, d)
        if isinstance(self.motion, Prescribed):
            if self.motion.dimension != d:
                raise InputError(self._field("motion"), self.motion.dimension, f"of dimension {d}")
            first, turn = self.motion.position_at(0.0), self.motion.rotation_at(0.0)
            if given_position is not None and not np.allclose(position, first, rtol=0.0, atol=1e-9):
                allowed = f"left out, or {first.tolist()} as its motion says"
                raise InputError(self._field("position"), position.tolist(), allowed)
            if turn is not None and given_rotation is not None and not _same_rotation(rotation, turn):
                allowed = f"left out, or {turn.tolist()} as its motion says"
                raise InputError(self._field("rotation"), rotation.tolist(), allowed)
            position = first
            rotation = rotation if turn is None else turn
        self._set("position", position)
        self._set("rotation", rotation)

    def _set_in_motion(self, **given: ArrayLike | None) -> None:
        d, s = self.dimension, self.spin_size
        sizes = {"velocity": d, "spin": s, "force": d, "torque": s}
        for name, value in given.items():
            vector = self._vector(name, value, sizes[name])
            if self.driven and np.any(vector):
                raise InputError(self._field(name), vector.tolist(), "zero: only free bodies have one")
            self._set(name, vector)
        moves, spins = held_components(self.motion, d)
        if np.any(self.velocity[moves]) or np.any(self.spin[spins]):
            raise InputError(self._field("motion"), self.motion, "free where the body starts to move")
        if isinstance(self.motion, Free):
            load_at(self._field("motion.force"), self.motion.force, 0.0, d)
            load_at(self._field("motion.torque"), self.motion.torque, 0.0, s)

    def _weigh(self, density: float | None, mass: float | None) -> None:
        d, s = self.dimension, self.spin_size
        if density is not None:
            density = inputs.positive(self._field("density"), density)
        if mass is not None:
            mass = inputs.positive(self._field("mass"), mass)
        if density is not None and mass is not None:
            raise InputError(self._field("mass"), mass, "left out when the density is given")
        if self.driven:
            volume, centre, axes = np.nan, np.zeros(d), np.eye(s)
            mass, moments = np.inf, np.full(s, np.inf)
            inertia = np.diag(moments)
        else:
            if density is None and mass is None:
                raise InputError(self._field("density"), "missing", "given, or the mass, for a free body")
            volume, centre, unit_inertia = self.shape.volume_properties()
            if not volume > 0.0:
                raise InputError(self._field("shape"), type(self.shape).__name__, "a shape with a volume")
            if mass is None:
                mass = float(density or 0.0) * volume
            density = mass / volume
            inertia = density * unit_inertia
            moments, axes = _principal(inertia)
        derived = {"density": density, "mass": mass, "volume": volume, "centre": centre, "inertia": inertia}
        for name, value in (derived | {"principal_moments": moments, "principal_axes": axes}).items():
            self._set(name, value)


def _principal(inertia: Vector) -> tuple[Vector, Vector]:
    """Moments and axes, in columns; a matrix that is diagonal but for rounding keeps its own axes, in their order."""
    off = inertia - np.diag(np.diag(inertia))
    if np.max(np.abs(off)) <= 1e-12 * np.max(np.abs(inertia)):
        return np.diag(inertia).copy(), np.eye(len(inertia))
    moments, axes = np.linalg.eigh(inertia)
    return moments, axes


def _same_rotation(a: Vector, b: Vector) -> bool:
    return bool(np.allclose(rotations.matrix(a), rotations.matrix(b), rtol=0.0, atol=1e-9))
