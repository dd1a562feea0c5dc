"""A cloth: rest shape, material, start, pins; its linearised implicit step without contacts (seed B, Eq. 2.16).

Unknowns are the velocities of the vertices at the end of a step, (n, 3) flattened. With masses lumped at vertices, the step
linearised about positions q_l = q^k + dt v_l reads A v = f,

    A = (1/dt + a) M + (dt + b) K(q_l),   f = dt K v_l - dE/dq(q_l) + M g + M v^k / dt,

K the positive semidefinite part of the Hessian of E, a and b Rayleigh's damping. The first iterate is v_l = 0, q_l = q^k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.cloth.energy import ShellEnergy
from barchan.bodies.cloth.material import ClothMaterial
from barchan.bodies.cloth.mesh import ClothMesh
from barchan.bodies.cloth.pins import PinnedVertices, Pins
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cloth:
    """A sheet that stretches and bends.

    mesh : rest shape.  material : see `ClothMaterial`.
    start : (n, 3) positions at time 0 [m]; left out: the rest shape.  velocity : (3,) or (n, 3) at time 0 [m/s].
    pins : vertices that are held or moved.  Masses are those of the rest shape.

    Raises InputError for arrays of the wrong shape, a triangle that starts without area, inconsistent pins.
    """

    mesh: ClothMesh
    material: ClothMaterial
    start: ArrayLike | None = None
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    pins: Sequence[Pins] = ()

    def __post_init__(self) -> None:
        assert self.positions is not None and self.velocities is not None and self.pinned is not None

    def __len__(self) -> int:
        """Number of vertices n."""
        return len(self.mesh.vertices)

    @cached_property
    def positions(self) -> Vector:
        """(n, 3) at time 0 [m]."""
        if self.start is None:
            return self.mesh.vertices
        given = inputs.table("cloth.start", self.start, (3,), len(self))
        if len(given) != len(self):
            raise InputError("cloth.start", given.shape, f"of shape {self.mesh.vertices.shape}")
        corner = given[self.mesh.triangles]
        double = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        if np.min(double / self.mesh.areas) < 1e-6:
            flat = self.mesh.triangles[int(np.argmin(double / self.mesh.areas))].tolist()
            raise InputError("cloth.start", flat, "triangles with an area: this one starts without")
        return given

    @cached_property
    def velocities(self) -> Vector:
        """(n, 3) at time 0 [m/s], those of pinned vertices as they move."""
        given = np.asarray(self.velocity, dtype=np.float64)
        if given.shape not in ((3,), (len(self), 3)) or not np.all(np.isfinite(given)):
            raise InputError(
                "cloth.velocity", given.shape, f"three numbers, or a table of shape {(len(self), 3)}"
            )
        found = np.array(np.broadcast_to(given, (len(self), 3)))
        found[self.pinned.vertices] = 0.0
        return found

    @cached_property
    def pinned(self) -> PinnedVertices:
        """All pins."""
        return PinnedVertices(self.pins, self.positions)

    @cached_property
    def energy(self) -> ShellEnergy:
        """The elastic energy."""
        return ShellEnergy.of(self.mesh, self.material)

    @cached_property
    def masses(self) -> Vector:
        """(n,) [kg], a third of that of the triangles around."""
        return self.material.area_density * self.mesh.vertex_areas

    def with_rest(self, rest: Vector) -> Cloth:
        """The same cloth, masses and start with other rest positions (n, 3) [m], which are not checked for crossings."""
        other = Cloth(self.mesh, self.material, self.positions, self.velocity, self.pins)
        other.__dict__["energy"] = self.energy.with_rest(rest)
        return other

    def system(
        self, positions: Vector, velocities: Vector, time: float, dt: float, gravity: Vector, iterate: Vector | None = None
    ) -> tuple[sp.bsr_array, Vector]:  # fmt: skip
        """A (3 n, 3 n) and f (3 n,) of the step from `time` to `time + dt` without contacts; A is positive definite.

        positions, velocities : (n, 3) at `time`.  gravity : (3,) [m/s^2].  iterate : (n, 3) end velocities to linearise about,
        none for the first.  Pinned vertices keep rows of their own, m/dt v = m/dt (their velocity over the step), and nothing
        else in their rows and columns.
        """
        about = np.zeros_like(positions) if iterate is None else iterate
        here = positions + dt * about
        material, pattern = self.material, self.energy.pattern
        stiffness = self.energy.hessian(here, convex=True)
        forces = self.masses[:, None] * (gravity + velocities / dt) - self.energy.gradient(here)
        right = forces.ravel() + dt * (stiffness @ about.ravel())
        data = (dt + material.stiffness_damping) * stiffness.data
        inertia = self.masses * (1.0 / dt + material.mass_damping)
        data[pattern.diagonal] += inertia[:, None, None] * np.eye(3)
        if len(self.pinned):
            self._hold(data, right, positions, time, dt)
        return pattern.matrix(data), right

    def _hold(self, data: Vector, right: Vector, positions: Vector, time: float, dt: float) -> None:
        """Put what pinned vertices do into the right-hand side, and leave them rows of their own."""
        pattern, pinned = self.energy.pattern, self.pinned
        given = np.zeros_like(positions)
        given[pinned.vertices] = (pinned.at(time + dt) - positions[pinned.vertices]) / dt
        right -= pattern.matrix(data) @ given.ravel()
        rows = np.repeat(np.arange(len(self)), np.diff(pattern.starts))
        data[pinned.mask[rows] | pinned.mask[pattern.columns]] = 0.0
        weight = self.masses[pinned.vertices] / dt
        data[pattern.diagonal[pinned.vertices]] = weight[:, None, None] * np.eye(3)
        right.reshape(-1, 3)[pinned.vertices] = weight[:, None] * given[pinned.vertices]

    def kinetic_energy(self, velocities: Vector) -> float:
        """[J]."""
        return 0.5 * float(self.masses @ np.sum(velocities**2, axis=1))

    def potential_energy(self, positions: Vector, gravity: Vector) -> float:
        """Elastic energy and -m g . x [J]."""
        return self.energy.value(positions) - float(self.masses @ (positions @ gravity))
