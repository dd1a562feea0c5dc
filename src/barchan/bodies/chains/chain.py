"""The data of a plane chain of inextensible segments, whatever coordinates describe its motion (seed B, 2.1.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]

INERTIAS = {"consistent": 1.0 / 3.0, "lumped": 1.0}
"""Moment of inertia of a segment about its centre over m L^2: a slender rod, or half of the mass at each end."""


@dataclass(frozen=True, eq=False, init=False)
class Chain:
    """N segments, each of length 2 L_i, in the plane (x, z) with gravity down z.

    Parameters
    ----------
    segments : N.
    half_lengths : L_i [m], one number or (N,).
    masses : m_i [kg], one number or (N,); or line_density [kg/m] (density times section), likewise.
    angles : of the segments from the x axis at the start [rad], one number or (N,).
    spins : their rates [rad/s], likewise.
    bending_stiffness : K [N m] of the energy K a^2 / 2 in each joint that is turned by a (seed B, 2.1.1).
    air_friction : eta [kg/(m s)] of the drag -eta v on a unit of length.
    held : whether the first end stays at `root`; otherwise the chain starts there with `velocity` (2,) [m/s] of that end.
    clamp_angle : direction [rad] of the clamp that the first segment is joined to by a spring K; None: a free hinge.
    gravity : [m/s^2].
    inertia : "consistent", slender rods; "lumped", half of the mass and of the drag at each end (seed B, 2.1.2).
    friction : coefficient of its joints on obstacles.

    Raises InputError for segments without length, masses that are not positive, wrong numbers of entries, NaN; a clamp
    without a held end, a held end that moves, bends of half a turn or more.
    """

    segments: int
    half_lengths: Vector
    masses: Vector
    angles: Vector
    spins: Vector
    bending_stiffness: float
    air_friction: float
    held: bool
    root: Vector
    velocity: Vector
    clamp_angle: float | None
    gravity: float
    inertia: str
    friction: float

    def __init__(
        self,
        segments: int,
        half_lengths: ArrayLike,
        masses: ArrayLike | None = None,
        line_density: ArrayLike | None = None,
        angles: ArrayLike = 0.0,
        spins: ArrayLike = 0.0,
        bending_stiffness: float = 0.0,
        air_friction: float = 0.0,
        held: bool = True,
        root: ArrayLike = (0.0, 0.0),
        velocity: ArrayLike = (0.0, 0.0),
        clamp_angle: float | None = None,
        gravity: float = 9.81,
        inertia: Literal["consistent", "lumped"] = "consistent",
        friction: float = 0.5,
    ) -> None:
        store = object.__setattr__
        if isinstance(segments, bool) or not isinstance(segments, (int, np.integer)) or segments < 1:
            raise InputError("chain.segments", segments, "a whole number >= 1")
        store(self, "segments", int(segments))
        store(self, "half_lengths", self._entries("half_lengths", half_lengths, positive=True))
        store(self, "masses", self._weighed(masses, line_density))
        store(self, "angles", self._entries("angles", angles))
        store(self, "spins", self._entries("spins", spins))
        numbers = {"bending_stiffness": bending_stiffness, "air_friction": air_friction}
        for name, value in {**numbers, "gravity": gravity, "friction": friction}.items():
            store(self, name, inputs.not_negative(f"chain.{name}", value))
        store(self, "held", bool(held))
        store(self, "root", inputs.vector("chain.root", root, (2,)))
        store(self, "velocity", inputs.vector("chain.velocity", velocity, (2,)))
        if self.held and np.any(self.velocity):
            raise InputError("chain.velocity", self.velocity.tolist(), "zero where the end is held")
        if inertia not in INERTIAS:
            raise InputError("chain.inertia", inertia, "one of " + ", ".join(INERTIAS))
        store(self, "inertia", inertia)
        self._clamp(clamp_angle)

    def _entries(self, name: str, value: ArrayLike, positive: bool = False) -> Vector:
        """One number for all segments, or one for each."""
        n = self.segments
        allowed = f"one number or {n}" + (", each > 0" if positive else ", finite")
        try:
            given = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"chain.{name}", value, allowed) from None
        if given.shape not in ((), (n,)) or not np.all(np.isfinite(given)):
            raise InputError(f"chain.{name}", value, allowed)
        if positive and np.any(given <= 0.0):
            raise InputError(f"chain.{name}", value, allowed)
        return np.ascontiguousarray(np.broadcast_to(given, (n,)))

    def _weighed(self, masses: ArrayLike | None, line_density: ArrayLike | None) -> Vector:
        if masses is None and line_density is None:
            raise InputError("chain.masses", "missing", "given, or the line_density")
        if masses is not None and line_density is not None:
            raise InputError("chain.masses", masses, "left out when the line_density is given")
        if masses is not None:
            return self._entries("masses", masses, positive=True)
        assert line_density is not None
        return 2.0 * self.half_lengths * self._entries("line_density", line_density, positive=True)

    def _clamp(self, clamp_angle: float | None) -> None:
        if clamp_angle is not None:
            clamp_angle = float(inputs.vector("chain.clamp_angle", [clamp_angle], (1,))[0])
            if not self.held:
                raise InputError("chain.clamp_angle", clamp_angle, "left out where no end is held")
        object.__setattr__(self, "clamp_angle", clamp_angle)
        if self.bending_stiffness > 0.0 and np.any(np.abs(self.bends(self.angles)) >= np.pi):
            raise InputError(
                "chain.angles", self.angles.tolist(), "less than half a turn from one to the next"
            )

    @cached_property
    def length(self) -> float:
        """Of the whole chain [m]."""
        return 2.0 * float(np.sum(self.half_lengths))

    @cached_property
    def moments(self) -> Vector:
        """(N,) moments of inertia about the centres [kg m^2]."""
        return INERTIAS[self.inertia] * self.masses * self.half_lengths**2

    @cached_property
    def drags(self) -> Vector:
        """(N,) drag of a segment over its speed [kg/s]: 2 L eta."""
        return 2.0 * self.half_lengths * self.air_friction

    @cached_property
    def turning_drags(self) -> Vector:
        """(N,) torque of the drag over the spin [kg m^2/s]: 2/3 L^3 eta of a rod (the print of seed B leaves eta out)."""
        return INERTIAS[self.inertia] * self.drags * self.half_lengths**2

    @cached_property
    def springs(self) -> Vector:
        """(b, N) matrix of the turns of the joints that have a spring: the first row that of the clamp, if there is one."""
        turns = np.eye(self.segments) - np.eye(self.segments, k=-1)
        return turns if self.clamp_angle is not None else turns[1:]

    def bends(self, angles: Vector) -> Vector:
        """(b,) turns of the joints with a spring [rad], for angles (N,) of the segments."""
        found: Vector = self.springs @ angles
        if self.clamp_angle is not None:
            found[0] -= self.clamp_angle
        return found

    def joints_at(self, root: Vector, angles: Vector) -> Vector:
        """(N + 1, 2) ends and joints [m] of a chain from `root` (2,) at angles (N,)."""
        steps = 2.0 * self.half_lengths[:, None] * directions(angles)
        return np.concatenate([root[None], root + np.cumsum(steps, axis=0)])


def directions(angles: Vector) -> Vector:
    """(n, 2) unit vectors at angles (n,) from the x axis."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def normals(angles: Vector) -> Vector:
    """(n, 2) unit vectors a quarter turn further."""
    return np.stack([-np.sin(angles), np.cos(angles)], axis=1)
