"""A cloth among moving and static obstacles, stepped with implicit contact and friction (seed B, 4.3): state in, state out.

A step: contacts at its start and within reach; the linearised implicit system (2.16); the friction problem with the predicted
gap; positions move with the end velocities (theta = 1, seed B 2.2.2).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.cloth.contacts import ClothContacts, joined
from barchan.bodies.cloth.model import Cloth
from barchan.bodies.cloth.obstacles import Obstacles, advanced
from barchan.bodies.cloth.options import ClothOptions
from barchan.bodies.cloth.self_contact import SelfContact
from barchan.bodies.cloth.state import ClothState
from barchan.bodies.moreau import AssemblyRecord
from barchan.bodies.rigid import Body, BodyStates
from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction import Problem, Solution, solve, write
from barchan.friction.methods.nodal import applicable
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Step:
    """A step about to be solved: contacts and sides, the bodies at its end, a warm start (k, 3) in the frames of contacts."""

    contacts: ClothContacts
    side_keys: NDArray[np.int64]
    sides: NDArray[np.int64]
    bodies: BodyStates
    start: Vector
    detection_seconds: float


@dataclass(frozen=True)
class ClothAssembly:
    """Advances a cloth that hangs, falls, drapes, slides and folds.

    cloth : see `Cloth`.  bodies : fixed and prescribed bodies in space (`barchan.bodies.rigid.Body`), which the cloth does not
    move.  gravity : [m/s^2] down the last axis, or a vector (3,).  options : see `ClothOptions`.

    Raises InputError for free or plane bodies, and a gravity that is not finite.
    """

    cloth: Cloth
    bodies: Sequence[Body] = ()
    gravity: ArrayLike = 9.81
    options: ClothOptions = field(default_factory=ClothOptions)

    def __post_init__(self) -> None:
        for body in self.bodies:
            if not body.driven or body.dimension != 3:
                raise InputError(
                    f"body.{body.name}.motion", "free or plane", "a fixed or prescribed body in space"
                )
        assert self.acceleration is not None

    @cached_property
    def acceleration(self) -> Vector:
        """(3,) gravity [m/s^2]."""
        value = np.asarray(self.gravity, dtype=np.float64)
        if (
            value.shape not in ((), (3,))
            or not np.all(np.isfinite(value))
            or (value.ndim == 0 and value < 0.0)
        ):
            raise InputError(
                "gravity", self.gravity, "a finite number >= 0 (m/s^2, downwards) or a vector of 3"
            )
        return value if value.ndim else np.array([0.0, 0.0, -float(value)])

    @cached_property
    def _obstacles(self) -> Obstacles:
        material = self.cloth.material
        return Obstacles(self.bodies, material.friction, self.options.mixing, 0.5 * material.thickness)

    @cached_property
    def _self_contact(self) -> SelfContact:
        return SelfContact(self.cloth.mesh, self.cloth.material.thickness, self.cloth.material.friction)

    def started(self) -> ClothState:
        """The cloth where it starts."""
        return ClothState.at_start(
            self.cloth.positions, self.cloth.velocities, BodyStates.at_start(self.bodies, 3)
        )

    def problem(self, state: ClothState, dt: float) -> Problem:
        """The friction problem of a step of `dt` seconds (of its first linearisation).

        Vertex i owns the velocities 3 i to 3 i + 2. A contact with an obstacle has one block in H, orthonormal.
        """
        return self._problem(state, self._begin(state, dt), dt, None)

    def write_problem(self, path: Path | str, state: ClothState, dt: float) -> None:
        """That problem as a file of the FCLIB (or any other format that `barchan.friction.write` knows)."""
        write(path, self.problem(state, dt))

    def advance(self, state: ClothState, dt: float) -> tuple[ClothState, AssemblyRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.
        Raises InputError for dt that is not finite and positive, or a state of another cloth.
        """
        step = self._begin(state, dt)
        begun = clock.perf_counter()
        start, iterate, sweeps = step.start, None, 0
        for _ in range(self.options.iterations):
            problem = self._problem(state, step, dt, iterate)
            solution = self._solve(problem, start)
            assert solution.v is not None
            iterate, start = solution.v.reshape(-1, 3), solution.r.reshape(-1, 3)
            sweeps += solution.iterations
            problem.release()
        seconds = clock.perf_counter() - begun
        new = self._moved(state, step, np.array(iterate), start, dt)
        return new, self._record(new, dt, solution, sweeps, step.detection_seconds, seconds)

    def _begin(self, state: ClothState, dt: float) -> _Step:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if state.positions.shape != (len(self.cloth), 3) or len(state.bodies) != len(self.bodies):
            raise InputError("state.positions", state.positions.shape, f"of shape {(len(self.cloth), 3)}")
        begun = clock.perf_counter()
        after = advanced(self.bodies, state.bodies, dt, state.time)
        reach = self.reach(state, dt)
        loose = ~self.cloth.pinned.mask
        contacts = self._obstacles.contacts(state.positions, reach, state.bodies, after, dt, loose)
        keys, sides = state.side_keys, state.sides
        if self.options.self_contact:
            own, keys, sides = self._self_contact.contacts(
                state.positions, state.velocities, dt, self.options.margin, keys, sides
            )
            contacts = joined(contacts, own.beside(self.cloth.pinned.mask, self._given(state, dt)))
        start = np.zeros((len(contacts), 3))
        _, here, before = np.intersect1d(
            contacts.keys, state.contact_keys, assume_unique=True, return_indices=True
        )
        turn = contact_frames(contacts.normals[here])
        start[here] = np.einsum("kij,kj->ki", turn, state.forces[before])
        return _Step(contacts, keys, sides, after, start, clock.perf_counter() - begun)

    def _given(self, state: ClothState, dt: float) -> Vector:
        """(n, 3) velocities of pinned vertices over the step [m/s], 0 of others."""
        pinned = self.cloth.pinned
        given = np.zeros_like(state.positions)
        given[pinned.vertices] = (pinned.at(state.time + dt) - state.positions[pinned.vertices]) / dt
        return given

    def reach(self, state: ClothState, dt: float) -> Vector:
        """(n,) gaps [m] up to which vertices may touch something within a step.

        The margin, and what a vertex crosses at its own speed, that of the mean of all, and in falling from rest.
        """
        speeds = np.linalg.norm(state.velocities, axis=1)
        falling = 2.0 * dt * float(np.linalg.norm(self.acceleration))
        return self.options.margin + dt * (speeds + float(np.mean(speeds)) + falling)

    def _problem(self, state: ClothState, step: _Step, dt: float, iterate: Vector | None) -> Problem:
        cloth = self.cloth
        A, f = cloth.system(state.positions, state.velocities, state.time, dt, self.acceleration, iterate)
        H, w = step.contacts.rows(len(cloth), dt, self.options.recovery)
        least = float(np.min(cloth.masses)) * float(np.linalg.norm(self.acceleration))
        return Problem(
            M=A, f=f, H=H, w=w, law=Coulomb(step.contacts.friction), block_size=3, reference_force=least
        )

    def _solve(self, problem: Problem, start: Vector) -> Solution:
        options = self.options
        limits: dict[str, Any] = {} if options.max_sweeps is None else {"max_iterations": options.max_sweeps}
        method = options.method
        if method == "auto" and len(start) and applicable(problem):
            method = "nodal"
        solution = solve(problem, method=method, tol=options.tolerance, r0=start, **limits)
        if options.method == "auto" and method == "nodal" and not solution.converged:
            return solve(problem, tol=options.tolerance, r0=solution.r, **limits)
        return solution

    def _moved(
        self, state: ClothState, step: _Step, velocities: Vector, forces: Vector, dt: float
    ) -> ClothState:
        positions = state.positions + dt * velocities
        pinned, contacts = self.cloth.pinned, step.contacts
        positions[pinned.vertices] = pinned.at(state.time + dt)
        turn = contact_frames(contacts.normals)
        return ClothState(
            state.time + dt, state.step + 1, positions, velocities, step.bodies, contacts.keys, contacts.bodies,
            contacts.points, contacts.normals, contacts.gaps, np.einsum("kij,ki->kj", turn, forces), step.side_keys, step.sides,
        )  # fmt: skip

    def _record(
        self, state: ClothState, dt: float, solution: Solution, sweeps: int, detection: float, seconds: float
    ) -> AssemblyRecord:
        certificate = solution.certificate
        return AssemblyRecord(
            step=state.step, time=state.time, dt=dt, candidates=len(state.gaps),
            contacts=int(np.count_nonzero(state.pressing)), sweeps=sweeps, residual=certificate.residual,
            law_residual=certificate.law, balance_residual=certificate.balance, bilateral_residual=certificate.bilateral,
            converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=self.cloth.kinetic_energy(state.velocities),
            potential_energy=self.cloth.potential_energy(state.positions, self.acceleration),
            max_speed=float(np.max(np.linalg.norm(state.velocities, axis=1))),
            deepest=float(max(0.0, -np.min(state.gaps, initial=0.0))), joint_error=0.0, detection_seconds=detection,
            solve_seconds=seconds,
        )  # fmt: skip
