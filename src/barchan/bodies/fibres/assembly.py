"""Fibres in frictional contact with one another and with moving bodies: state in, state and record out (seed B, 4.2 and 2.2).

A step is linearised and implicit (2.16): the model's block-diagonal system, contacts on the ways the fibres would go without
any, the friction problem with the predicted gap, end velocities, moves. Cost: linear in fibres and contacts but for the solve.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.fibres.contact import FibreContacts, Layout, fibre_contacts
from barchan.bodies.fibres.model import FibreModel, FibreSystem, Shape
from barchan.bodies.fibres.obstacles import empty_contacts, obstacle_contacts
from barchan.bodies.fibres.state import FibreState
from barchan.bodies.fibres.step_problem import BlockPattern, contact_rows, without_fixed
from barchan.bodies.moreau import AssemblyRecord, Options
from barchan.bodies.rigid import Body, BodyStates, moved, predicted_velocities
from barchan.cones import Coulomb, FacetedCoulomb
from barchan.errors import InputError
from barchan.friction import Problem, Solution, solve, write
from barchan.linalg.dense_blocks import DenseBlocks
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]
_TRIFLE = 0.02  # of a radius: overlaps that are not worth another solve
LAWS = {"coulomb": Coulomb, "faceted": FacetedCoulomb}


@dataclass(frozen=True, eq=False)
class FibreStep:
    """A step about to be solved: its problem, contacts (k), friction (k,) and warm start (k, 3), and what it is made of.

    left_out : keys of contacts that nothing can move.
    """

    problem: Problem
    contacts: FibreContacts
    friction: Vector
    start: Vector
    system: FibreSystem
    body_velocities: Vector
    left_out: NDArray[np.int64]
    detection_seconds: float


@dataclass(frozen=True)
class FibreAssembly(Generic[Shape]):
    """Advances fibres that touch, slide and stick.

    Parameters
    ----------
    model : Discrete Elastic Rods, Super-Helices or any other `FibreModel`.
    bodies : fixed or prescribed bodies in space that the fibres touch; forces do not move them.
    gravity : [m/s^2] down the last axis, or a vector (3,).
    friction_fibres : coefficient between fibres, >= 0.  friction_bodies : that with bodies (None: each body's own).
    options : see `barchan.bodies.moreau.Options`; theta is 1, there is no restitution, and pairs and mixing have no meaning.
    bare : length of fibre [m] at the roots that touches nothing, where roots stand in a body or close together.
    touching : whether fibres touch one another.
    passes : most solves of a step: where the velocities found bring together what the free ones did not, those contacts are
        added and the step is solved once more.
    law : "coulomb", or "faceted": a pyramid of four sides in the frames of the contacts (`barchan.cones.FacetedCoulomb`), which
        only shows what facets do; `options.method` is then "auto".
    reference_force : force of the certificate [N].
    solver_options : further options of the method (`barchan.friction.solve`), for example {"local_solver": "enumerative"}.

    Raises InputError for bodies that are free or plane, coefficients and lengths that are negative, options without meaning.
    """

    model: FibreModel[Shape]
    bodies: Sequence[Body] = ()
    gravity: ArrayLike = 9.81
    friction_fibres: float = 0.3
    friction_bodies: float | None = None
    options: Options = field(default_factory=Options)
    bare: float = 0.0
    touching: bool = True
    passes: int = 2
    law: Literal["coulomb", "faceted"] = "coulomb"
    reference_force: float = 0.0
    solver_options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for number, body in enumerate(self.bodies):
            name = body.name or f"number {number}"
            if body.dimension != 3:
                raise InputError("bodies", f"{name} in the plane", "bodies in space")
            if not body.driven:
                raise InputError(
                    "bodies", f"{name} is free", "fixed or prescribed: fibres do not move bodies"
                )
        for name in ("friction_fibres", "friction_bodies", "bare", "reference_force"):
            value = getattr(self, name)
            if name == "friction_bodies" and value is None:
                continue
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= 0.0):
                raise InputError(name, value, "a finite number >= 0")
        if isinstance(self.passes, bool) or not isinstance(self.passes, int) or self.passes < 1:
            raise InputError("passes", self.passes, "a whole number >= 1")
        if self.law not in LAWS:
            raise InputError("law", self.law, "one of " + ", ".join(LAWS))
        if self.law == "faceted" and self.options.method != "auto":
            raise InputError("options.method", self.options.method, "'auto' for the faceted law")
        if self.options.theta != 1.0:
            raise InputError("options.theta", self.options.theta, "1: a linearised step is implicit")
        if self.options.restitution != 0.0 or self.options.tangential_restitution != 0.0:
            raise InputError("options.restitution", self.options.restitution, "0 for fibres")
        assert self.gravity_vector is not None and self.layout is not None

    @cached_property
    def gravity_vector(self) -> Vector:
        """(3,) [m/s^2]."""
        value = np.asarray(self.gravity, dtype=np.float64)
        down = value.ndim == 0
        if value.shape not in ((), (3,)) or not np.all(np.isfinite(value)) or (down and value < 0.0):
            raise InputError(
                "gravity", self.gravity, "a finite number >= 0 (m/s^2, downwards) or a vector of 3"
            )
        return np.array([0.0, 0.0, -float(value)]) if down else value

    @cached_property
    def layout(self) -> Layout:
        """The segments of the fibres, as contact detection sees them."""
        return Layout(self.model.node_offsets, self.model.radii)

    @cached_property
    def _pattern(self) -> BlockPattern:
        return BlockPattern(self.model.offsets)

    def started(self) -> FibreState[Shape]:
        """Fibres and bodies where they start."""
        return FibreState.at_start(self.model.started(), BodyStates.at_start(self.bodies, 3))

    def restored(self, arrays: Mapping[str, NDArray[Any]]) -> FibreState[Shape]:
        """The state that `FibreState.arrays()` wrote."""
        return FibreState.from_arrays(self.model, arrays)

    def problem(self, state: FibreState[Shape], dt: float) -> Problem:
        """The friction problem of a step of `dt` seconds."""
        return self._build(state, dt).problem

    def write_problem(self, path: Path | str, state: FibreState[Shape], dt: float) -> None:
        """The problem of a step as a file of the FCLIB (or any other format that `barchan.friction.write` knows)."""
        write(path, self.problem(state, dt))

    def contacts(self, state: FibreState[Shape], dt: float) -> FibreContacts:
        """What may touch within a step of `dt` seconds."""
        return self._build(state, dt).contacts

    def advance(self, state: FibreState[Shape], dt: float) -> tuple[FibreState[Shape], AssemblyRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.
        Raises InputError for dt that is not finite and positive.
        """
        step = self._build(state, dt)
        begun = clock.perf_counter()
        solution, sweeps = self._solve(step), 0
        shape = self.model.moved(state.shape, _velocities(solution), dt)
        for _ in range(self.passes - 1):
            missed = self._missed(state, step, shape, dt)
            if len(missed) == 0:
                break
            sweeps += solution.iterations
            warm = replace(state, contacts=step.contacts, forces=solution.r.reshape(-1, 3))
            step.problem.release()
            joined = FibreContacts.joined([step.contacts, missed])
            step = self._step_of(
                state, step.system, step.body_velocities, joined, dt, warm, step.detection_seconds
            )
            solution = self._solve(step)
            shape = self.model.moved(state.shape, _velocities(solution), dt)
        seconds = clock.perf_counter() - begun
        new = FibreState(
            state.time + dt, state.step + 1, shape, self._bodies_after(state, dt), step.contacts, step.friction,
            solution.r.reshape(-1, 3).copy(),
        )  # fmt: skip
        record = self._record(new, dt, step, solution, seconds, sweeps + solution.iterations)
        step.problem.release()
        return new, record

    def _build(self, state: FibreState[Shape], dt: float) -> FibreStep:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        blocks = self._body_velocities(state, dt)
        system = self.model.system(state.shape, dt, self.gravity_vector)
        factor = DenseBlocks.of_blocks(system.blocks, np.diff(self.model.offsets), "fibres")
        free = self.model.moved(state.shape, factor.solve(system.forces), dt)
        begun = clock.perf_counter()
        contacts = self._detect(state, free, blocks, dt, self.options.margin)
        seconds = clock.perf_counter() - begun
        return self._step_of(state, system, blocks, contacts, dt, state, seconds)

    def _step_of(
        self, state: FibreState[Shape], system: FibreSystem, blocks: Vector, contacts: FibreContacts, dt: float,
        before: FibreState[Shape], seconds: float,
    ) -> FibreStep:  # fmt: skip
        """The step with these contacts; `before` has the forces to start from."""
        rows = contact_rows(
            self.model, state.shape, contacts, self.bodies, state.bodies, blocks, dt, self.options.recovery
        )
        all_keys = contacts.keys
        contacts, rows = without_fixed(contacts, rows)
        left_out = np.setdiff1d(all_keys, contacts.keys)
        friction = self._friction(contacts)
        problem = Problem(
            M=self._pattern.matrix(system), f=system.forces, H=rows.operator, w=rows.offsets.reshape(-1),
            law=LAWS[self.law](friction), block_size=3, reference_force=self.reference_force,
        )  # fmt: skip
        return FibreStep(
            problem, contacts, friction, _warm_start(contacts, before), system, blocks, left_out, seconds
        )

    def _detect(
        self, state: FibreState[Shape], after: Shape, blocks: Vector, dt: float, margin: float
    ) -> FibreContacts:
        """Contacts between fibres and with bodies on the ways to the shape `after`, of fibres without contact at first.

        Seed B, 2.2.3: what a step brings together is only known from the velocities at its end.
        """
        nodes = self.model.centre_line(state.shape)
        velocities = (self.model.centre_line(after) - nodes) / dt
        found = [empty_contacts()]
        if self.touching:
            found.append(fibre_contacts(self.layout, nodes, velocities, dt, margin, self.bare))
        if len(self.bodies):
            near = (velocities, self.bodies, state.bodies, blocks, dt, margin, self.bare)
            found.append(obstacle_contacts(self.layout, nodes, *near))
        return FibreContacts.joined(found)

    def _missed(self, state: FibreState[Shape], step: FibreStep, after: Shape, dt: float) -> FibreContacts:
        """Contacts with an overlap on the ways to the shape `after` that the step does not have and that a force can move."""
        trifle = _TRIFLE * float(np.min(self.layout.radii))
        found = self._detect(state, after, step.body_velocities, dt, -trifle)
        return found.take(~np.isin(found.keys, step.contacts.keys) & ~np.isin(found.keys, step.left_out))

    def _body_velocities(self, state: FibreState[Shape], dt: float) -> Vector:
        """(b, 2, 3) mean velocities and spins of the bodies over the step."""
        blocks = [
            predicted_velocities(body, state.bodies.row(number), self.gravity_vector, dt, state.time)
            for number, body in enumerate(self.bodies)
        ]
        return np.array(blocks).reshape(-1, 2, 3)

    def _bodies_after(self, state: FibreState[Shape], dt: float) -> BodyStates:
        still = np.zeros((2, 3))
        rows = [
            moved(body, state.bodies.row(number), still, dt, state.time)
            for number, body in enumerate(self.bodies)
        ]
        return BodyStates.of(rows, 3)

    def _friction(self, contacts: FibreContacts) -> Vector:
        own = np.array(
            [body.friction if self.friction_bodies is None else self.friction_bodies for body in self.bodies]
            + [self.friction_fibres]
        )
        return np.asarray(own[contacts.bodies], dtype=np.float64)

    def _solve(self, step: FibreStep) -> Solution:
        options = self.options
        choices: dict[str, Any] = dict(self.solver_options)
        if options.method in ("auto", "gauss_seidel"):
            choices.setdefault("min_iterations", options.min_sweeps)
        return solve(
            step.problem, method=options.method, tol=options.tolerance, r0=step.start,
            max_iterations=options.max_sweeps, **choices,
        )  # fmt: skip

    def _record(
        self,
        state: FibreState[Shape],
        dt: float,
        step: FibreStep,
        solution: Solution,
        seconds: float,
        sweeps: int,
    ) -> AssemblyRecord:
        certificate, shape = solution.certificate, state.shape
        speeds = np.linalg.norm(self.model.node_velocities(shape), axis=1)
        return AssemblyRecord(
            step=state.step, time=state.time, dt=dt, candidates=len(step.contacts),
            contacts=int(np.count_nonzero(state.forces[:, 0] > 0.0)), sweeps=sweeps,
            residual=certificate.residual, law_residual=certificate.law, balance_residual=certificate.balance,
            bilateral_residual=certificate.bilateral, converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=self.model.kinetic_energy(shape),
            potential_energy=self.model.potential_energy(shape, self.gravity_vector), max_speed=float(np.max(speeds)),
            deepest=float(max(0.0, -np.min(step.contacts.gaps, initial=0.0))), joint_error=0.0,
            detection_seconds=step.detection_seconds, solve_seconds=seconds,
        )  # fmt: skip


def _velocities(solution: Solution) -> Vector:
    assert solution.v is not None
    return np.asarray(solution.v)


def _warm_start(contacts: FibreContacts, state: FibreState[Any]) -> Vector:
    """(k, 3) forces of the same contacts a step before, turned to the frames they have now; zero for new ones."""
    start = np.zeros((len(contacts), 3))
    _, here, before = np.intersect1d(
        contacts.keys, state.contacts.keys, assume_unique=True, return_indices=True
    )
    if len(here):
        turns = contact_frames(contacts.normals[here])
        start[here] = np.einsum("kij,kj->ki", turns, state.world_forces()[before])
    return start
