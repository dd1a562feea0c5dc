"""Rigid bodies in frictional contact, stepped by Moreau and Jean's method (seed B, 2.2): state in, state and record out.

A step: contacts at the start of the step and within reach; the friction problem with the predicted gap; end velocities; moves.
Impacts happen over a step, at its end; forces are means over it. Cost: linear in the bodies but for the friction problem.
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

from barchan.bodies.contact import ContactGeometry, ContactSet
from barchan.bodies.moreau.contact_problem import contact_rows, step_problem
from barchan.bodies.moreau.joints import Joint, Joints
from barchan.bodies.moreau.options import Options
from barchan.bodies.moreau.state import AssemblyRecord, AssemblyState
from barchan.bodies.moreau.table import BodyTable
from barchan.bodies.rigid import Body, BodyStates
from barchan.errors import InputError
from barchan.friction import Problem, Solution, solve, write

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AssemblyStep:
    """A step about to be solved: its problem, contacts, warm start (k, d), predicted velocities (k_b, 2, d)."""

    problem: Problem
    contacts: ContactSet
    start: Vector
    predicted: Vector
    joint_error: float
    detection_seconds: float


@dataclass(frozen=True)
class Assembly:
    """Advances rigid bodies that touch, slide, roll and rest.

    Parameters
    ----------
    bodies : free, fixed and prescribed bodies (`barchan.bodies.rigid.Body`), all 2D or all 3D.
    joints : see `joints`; bodies that a joint holds together do not touch one another.
    gravity : [m/s^2] down the last axis, or a vector (d,).
    options : see `Options`.

    Raises InputError for no body, mixed dimensions, shapes that contact detection does not know, joints of unknown bodies.
    """

    bodies: Sequence[Body]
    joints: Sequence[Joint] = ()
    gravity: ArrayLike = 9.81
    options: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        assert self.table is not None and self._joints is not None and self.geometry is not None
        assert self._gravity is not None

    @cached_property
    def table(self) -> BodyTable:
        """The bodies as arrays."""
        return BodyTable.of(self.bodies)

    @cached_property
    def geometry(self) -> ContactGeometry:
        """Their shapes as contact detection sees them."""
        joined = sorted({(min(j.first, j.second), max(j.first, j.second)) for j in self.joints})
        return ContactGeometry.of(self.bodies, self.table.dimension, joined)

    @cached_property
    def _joints(self) -> Joints:
        return Joints.of(self.joints, self.table)

    @cached_property
    def _gravity(self) -> Vector:
        d = self.table.dimension
        value = np.asarray(self.gravity, dtype=np.float64)
        if (
            value.shape not in ((), (d,))
            or not np.all(np.isfinite(value))
            or (value.ndim == 0 and value < 0.0)
        ):
            raise InputError(
                "gravity", self.gravity, f"a finite number >= 0 (m/s^2, downwards) or a vector of {d}"
            )
        return value if value.ndim else -float(value) * np.eye(d)[-1]

    def started(self) -> AssemblyState:
        """The bodies where they start."""
        return AssemblyState.at_start(BodyStates.at_start(self.bodies))

    def problem(self, state: AssemblyState, dt: float) -> Problem:
        """The friction problem of a step of `dt` seconds."""
        return self._build(state, dt).problem

    def write_problem(self, path: Path | str, state: AssemblyState, dt: float) -> None:
        """The problem of a step as a file of the FCLIB (or any other format that `barchan.friction.write` knows)."""
        write(path, self.problem(state, dt))

    def advance(self, state: AssemblyState, dt: float) -> tuple[AssemblyState, AssemblyRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.
        Raises InputError for dt that is not finite and positive, or a state of other bodies.
        """
        step = self._build(state, dt)
        begun = clock.perf_counter()
        solution = self._solve(step)
        seconds = clock.perf_counter() - begun
        d = self.table.dimension
        assert solution.v is not None
        blocks = solution.v.reshape(-1, 2, d)
        bodies = self.table.moved(state.bodies, blocks, dt, state.time, self.options.theta, self._gravity)
        contacts = step.contacts
        new = AssemblyState(
            state.time + dt, state.step + 1, bodies, contacts.keys,
            np.stack([contacts.first, contacts.second], axis=1).astype(np.int32), contacts.points, contacts.normals,
            contacts.gaps, solution.r.reshape(-1, d).copy(),
        )  # fmt: skip
        record = self._record(new, dt, step, solution, seconds)
        step.problem.release()
        return new, record

    def reach(self, state: AssemblyState, dt: float) -> float:
        """Gap [m] up to which bodies may touch within a step beside what their own velocities bring together.

        The margin, and what a body crosses that gets the mean speed of all by the impact of another, or falls from rest.
        """
        free = ~self.table.driven
        speeds = np.linalg.norm(state.bodies.velocities[free], axis=1)
        mean = float(np.mean(speeds)) if len(speeds) else 0.0
        return self.options.margin + dt * (mean + 2.0 * dt * float(np.linalg.norm(self._gravity)))

    def _build(self, state: AssemblyState, dt: float) -> AssemblyStep:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if len(state.bodies) != len(self.table):
            raise InputError(
                "state.bodies", len(state.bodies), f"the {len(self.table)} bodies of this assembly"
            )
        table, states, options = self.table, state.bodies, self.options
        begun = clock.perf_counter()
        contacts = self.geometry.detect(states, self.reach(state, dt), dt)
        seconds = clock.perf_counter() - begun
        predicted = table.predicted(states, self._gravity, dt, state.time)
        movable = table.movable(states)
        given = np.where(movable, 0.0, predicted)
        rows = contact_rows(table, states, contacts, self._before(states, given), predicted, dt, options)
        joints = self._joints.rows(states, dt, options.joint_recovery)
        problem = step_problem(
            table.generalised_masses(states), predicted, rows, dt, None if joints is None else joints[:2], movable,
            self._reference(),
        )  # fmt: skip
        start = np.zeros((len(contacts.gaps), table.dimension))
        _, here, before = np.intersect1d(
            contacts.keys, state.contact_keys, assume_unique=True, return_indices=True
        )
        start[here] = state.forces[before]
        return AssemblyStep(
            problem, contacts, start, predicted, 0.0 if joints is None else joints[2], seconds
        )

    def _before(self, states: BodyStates, given: Vector) -> Vector:
        """(k_b, 2, d) generalised velocities at the start of the step."""
        table = self.table
        before = np.zeros_like(given)
        before[:, 0] = states.velocities
        if table.dimension == 2:
            before[:, 1, 0] = states.spins[:, 0]
        else:
            before[:, 1] = np.einsum("kji,kj->ki", table.spin_axes(states), states.spins)
        return np.where(table.driven[:, None, None], given, before)

    def _reference(self) -> float:
        """A force of the certificate [N]: the weight of the lightest free body, or none without gravity."""
        free = ~self.table.driven
        if not np.any(free):
            return 0.0
        return float(np.min(self.table.masses[free]) * np.linalg.norm(self._gravity))

    def _solve(self, step: AssemblyStep) -> Solution:
        options = self.options
        choices: dict[str, Any] = {}
        if options.method in ("auto", "gauss_seidel"):
            choices["min_iterations"] = options.min_sweeps
        return solve(
            step.problem, method=options.method, tol=options.tolerance, r0=step.start,
            max_iterations=options.max_sweeps, **choices,
        )  # fmt: skip

    def _record(
        self, state: AssemblyState, dt: float, step: AssemblyStep, solution: Solution, seconds: float
    ) -> AssemblyRecord:
        certificate, bodies = solution.certificate, state.bodies
        free = ~self.table.driven
        return AssemblyRecord(
            step=state.step, time=state.time, dt=dt, candidates=len(state.gaps),
            contacts=int(np.count_nonzero(state.forces[:, 0] > 0.0)), sweeps=solution.iterations,
            residual=certificate.residual, law_residual=certificate.law, balance_residual=certificate.balance,
            bilateral_residual=certificate.bilateral, converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=self.table.kinetic_energy(bodies),
            potential_energy=self.table.potential_energy(bodies, self._gravity),
            max_speed=float(np.max(np.linalg.norm(bodies.velocities[free], axis=1), initial=0.0)),
            deepest=float(max(0.0, -np.min(step.contacts.gaps, initial=0.0))), joint_error=step.joint_error,
            detection_seconds=step.detection_seconds, solve_seconds=seconds,
        )  # fmt: skip
