"""Rigid bodies in frictional contact, stepped by Moreau and Jean's method (seed B, 2.2): state in, state and record out.

A step: contacts at the start of the step and within reach (`moreau.reach`); the friction problem with the predicted gap; end
velocities; moves.
Impacts happen over a step, at its end; forces are means over it. Cost: linear in the bodies but for the friction problem.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.contact import ContactGeometry, ContactSet
from barchan.bodies.moreau.contact_problem import contact_rows, step_problem
from barchan.bodies.moreau.impacts import Impacts
from barchan.bodies.moreau.joints import Joint, Joints
from barchan.bodies.moreau.options import Options
from barchan.bodies.moreau.reach import Sizes, missed
from barchan.bodies.moreau.state import AssemblyRecord, AssemblyState
from barchan.bodies.moreau.table import BodyTable
from barchan.bodies.rigid import Body, BodyStates
from barchan.errors import InputError
from barchan.friction import Problem, Solution, solve, write

Vector = NDArray[np.float64]
MOST_LOOKS = 6  # times that a step is solved again for contacts it makes itself


@dataclass(frozen=True, eq=False)
class AssemblyStep:
    """A step about to be solved: its problem, contacts within `ways` (b,) of the bodies, warm start (k, d), its impacts."""

    problem: Problem
    contacts: ContactSet
    ways: Vector
    start: Vector
    joint_error: float
    detection_seconds: float
    impacts: Impacts


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
        step, solution, seconds = self._solved(state, dt)
        assert solution.v is not None
        blocks = solution.v.reshape(-1, 2, self.table.dimension)
        bodies = self.table.moved(state.bodies, blocks, dt, state.time, self.options.theta, self._gravity)
        contacts = step.contacts
        new = AssemblyState(
            state.time + dt, state.step + 1, bodies, contacts.keys,
            np.stack([contacts.first, contacts.second], axis=1).astype(np.int32), contacts.points, contacts.normals,
            contacts.gaps, solution.r.reshape(-1, self.table.dimension).copy(),
        )  # fmt: skip
        record = self._record(new, dt, step, solution, seconds)
        step.problem.release()
        return new, record

    def reach(self, state: AssemblyState, dt: float) -> Vector:
        """Ways (b,) [m] from each body within which a step looks for contacts; those of both bodies of a pair add up.

        Half the margin, what the body crosses at its speed, whichever way another turns it, and what it falls from rest.
        """
        given = self.table.predicted(state.bodies, self._gravity, dt, state.time)
        own, driven = state.bodies, self.table.driven[:, None]
        velocities = np.where(driven, given[:, 0], own.velocities)
        spins = np.where(driven, given[:, 1, : own.spins.shape[1]], own.spins)
        return self._ways(self._sizes.speeds(velocities, spins), dt)

    def _ways(self, speeds: Vector, dt: float) -> Vector:
        falling = float(np.linalg.norm(self._gravity)) * dt
        return np.asarray(0.5 * self.options.margin + dt * (speeds + falling))

    @cached_property
    def _sizes(self) -> Sizes:
        return Sizes.of(self.geometry)

    def _solved(self, state: AssemblyState, dt: float) -> tuple[AssemblyStep, Solution, float]:
        """A step, its solution and the seconds it took, solved again while bodies would go through others unseen."""
        step = self._build(state, dt)
        begun = clock.perf_counter()
        solution = self._solve(step)
        for _ in range(MOST_LOOKS):
            ways = self._longer(state, step, solution, dt)
            if ways is None:
                break
            again = self._build(state, dt, ways, (step.contacts.keys, solution.r))
            if np.array_equal(again.contacts.keys, step.contacts.keys):
                break
            step.problem.release()
            before, step = solution.iterations, again
            solution = self._solve(step)
            solution = replace(solution, iterations=solution.iterations + before)
        step, solution = self._tamed(step, solution)
        return step, solution, clock.perf_counter() - begun

    def _tamed(self, step: AssemblyStep, solution: Solution) -> tuple[AssemblyStep, Solution]:
        """The step with the restitution that makes no energy, and its solution."""
        rows = step.impacts.rows
        if not np.any(rows.rebound):
            return step, solution
        shape, bodies = rows.offsets.shape, (len(self.table), 2, self.table.dimension)
        found = [(step, solution)]

        def solved(factors: Vector) -> tuple[Vector, Vector]:
            w = rows.offsets - (1.0 - factors)[:, None] * rows.rebound
            known, before = found[-1]
            known.problem.release()
            tried = replace(
                step, problem=replace(step.problem, w=w.reshape(-1)), start=before.r.reshape(shape)
            )
            answer = self._solve(tried)
            found.append((tried, replace(answer, iterations=answer.iterations + before.iterations)))
            assert answer.v is not None
            return answer.r.reshape(shape), answer.v.reshape(bodies)

        assert solution.v is not None
        factors, had = step.impacts.tamed(solution.r.reshape(shape), solution.v.reshape(bodies), solved)
        if not had:
            solved(factors)
        return found[-1]

    def _longer(
        self, state: AssemblyState, step: AssemblyStep, solution: Solution, dt: float
    ) -> Vector | None:
        """Ways (b,) within which to look for contacts again; None where nothing was missed."""
        assert solution.v is not None
        theta, table = self.options.theta, self.table
        blocks = solution.v.reshape(-1, 2, table.dimension)
        velocities, spins = blocks[:, 0], blocks[:, 1, : table.moments.shape[1]]
        if table.dimension == 3:
            spins = np.einsum("kij,kj->ki", table.spin_axes(state.bodies), spins)
        middle = (
            theta * velocities + (1.0 - theta) * state.bodies.velocities,
            theta * spins + (1.0 - theta) * state.bodies.spins,
        )
        ways = self._ways(self._sizes.speeds(*middle), dt)
        if np.all(ways - step.ways <= dt**2 * float(np.linalg.norm(self._gravity))):
            return None
        if not missed(self.geometry, self._sizes, state.bodies, step.contacts, middle, dt):
            return None
        return np.maximum(step.ways, ways)

    def _build(
        self, state: AssemblyState, dt: float, ways: Vector | None = None,
        known: tuple[NDArray[np.int64], Vector] | None = None,
    ) -> AssemblyStep:  # fmt: skip
        """A step with the contacts within `ways` (b,), started from the forces (m d,) of `known` contacts (m,)."""
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if len(state.bodies) != len(self.table):
            raise InputError(
                "state.bodies", len(state.bodies), f"the {len(self.table)} bodies of this assembly"
            )
        table, states, options = self.table, state.bodies, self.options
        begun = clock.perf_counter()
        ways = self.reach(state, dt) if ways is None else ways
        contacts = self.geometry.detect(states, ways)
        seconds = clock.perf_counter() - begun
        predicted = table.predicted(states, self._gravity, dt, state.time)
        movable = table.movable(states)
        before = self._before(states, np.where(movable, 0.0, predicted))
        rows = contact_rows(table, states, contacts, before, predicted, dt, options)
        joints = self._joints.rows(states, dt, options.joint_recovery)
        problem = step_problem(
            table.generalised_masses(states), predicted, rows, dt, None if joints is None else joints[:2], movable,
            self._reference(),
        )  # fmt: skip
        keys, forces = (state.contact_keys, state.forces) if known is None else known
        start = contacts.carried(keys, forces.reshape(-1, table.dimension))
        impacts = Impacts(
            rows, np.stack([contacts.first, contacts.second], axis=1), self._joined, np.any(movable, axis=(1, 2)),
            table.generalised_masses(states), before, predicted, dt, options.theta, options.tolerance,
        )  # fmt: skip
        return AssemblyStep(
            problem, contacts, ways, start, 0.0 if joints is None else joints[2], seconds, impacts
        )

    @cached_property
    def _joined(self) -> NDArray[np.int64]:
        """(j, 2) bodies of the joints."""
        return np.array([(joint.first, joint.second) for joint in self.joints], np.int64).reshape(-1, 2)

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
