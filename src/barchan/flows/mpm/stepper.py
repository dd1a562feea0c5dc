"""The material point time step: state in, state and record out (seed B, 7.3.5).

Particles to grid, frictional problem of the step, solution, grid to particles, particle move.

Energy. With E = kinetic energy on the grid after the solve + potential energy of the particles after the move, the solve
loses energy (implicit inertia, gravity and friction; seed B, 7.1.2), the correction of excess volume gives back at most
half of what friction took, and with PIC transfers the way from the grid to the particles and back loses energy too (Jensen's
inequality): E then never increases, up to the second order of the move. APIC also carries sum_p m_p Tr(c_p D_p c_p^T) / 2
<= m h^2 |grad u|^2 / 8, where the tensor D_p changes with the particle's place in its cell: E may rise by that lumping
error in fast flow without friction; where matter yields friction outweighs it, and steps that begin nearly at rest are PIC
steps. The kinetic energy of the particles alone, which lacks the affine part, obeys no such bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import Body
from barchan.errors import InputError
from barchan.flows.mpm.coupling import Coupling
from barchan.flows.mpm.kept import kept_on_grid
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.momentum import StepFields, StepProblem, build_step_problem
from barchan.flows.mpm.multilevel import coarse_start
from barchan.flows.mpm.options import Options
from barchan.flows.mpm.particles import follow_flow, started
from barchan.flows.mpm.setting import Setting, checked_materials, gravity_vector
from barchan.flows.mpm.state import State, StepRecord
from barchan.flows.mpm.threads import threads_for
from barchan.flows.mpm.volume import volume_shift, within_energy
from barchan.flows.mpm.walls import Walls
from barchan.friction import Problem, Solution, solve
from barchan.spaces import RegularGrid

# Steps that begin with every particle slower than this share of sqrt(g H) are PIC steps, solved to `rest_tolerance`.
REST_SPEED = 0.02


@dataclass(frozen=True)
class Stepper:
    """Advances states of matter in a box, with rigid bodies in it. Holds no state: the same state and dt give the same bytes.

    Parameters
    ----------
    grid : the background grid.
    material : one, or several, numbered by `State.materials`.
    walls, options : see `Walls`, `Options`.
    gravity : [m/s^2], a number >= 0, acting downwards along the last axis, or a vector (d,).
    bodies : rigid bodies, free, prescribed or fixed (`barchan.bodies.rigid`).

    Raises
    ------
    InputError : for a gravity that is negative or not finite, walls that a plane box does not have, materials that differ
        in what must be shared, an option that does not fit another.
    """

    grid: RegularGrid
    material: Material | Sequence[Material]
    walls: Walls
    gravity: ArrayLike = 9.81
    options: Options = field(default_factory=Options)
    bodies: Sequence[Body] = ()

    def __post_init__(self) -> None:
        self.walls.on(self.grid.dimension)
        assert self.setting is not None

    @cached_property
    def setting(self) -> Setting:
        """What stays the same from step to step."""
        return Setting(
            self.grid,
            checked_materials(self.material),
            self.walls,
            gravity_vector(self.gravity, self.grid.dimension),
            self.options,
            tuple(self.bodies),
            Coupling(self.grid, tuple(self.bodies)) if len(self.bodies) else None,
        )

    def problem(self, state: State, dt: float) -> Problem:
        """The discrete Coulomb friction problem of a step of `dt` seconds: to be saved, or solved by other means."""
        return self._build(self.started(state), dt).problem

    def started(self, state: State) -> State:
        """A first state completed by what this simulation keeps: frames, orientations, bodies and so on."""
        return started(self.setting, state) if state.step == 0 else state

    def advance(self, state: State, dt: float) -> tuple[State, StepRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.

        Raises
        ------
        InputError : for dt that is not finite and positive, a state of another dimension, particles outside the box.
        """
        before = self.started(state)
        step = self._build(before, dt)
        solution = self._solve(before, step)
        assert solution.v is not None  # a full problem always has velocities
        with threads_for(before.particle_count):
            shift = self._shift(step, solution, dt)
        step.problem.release()
        fields = step.fields
        del step  # its matrices make room for the particles
        blocks = solution.v.reshape(-1, self.grid.dimension)
        after, substeps = self._followed(before, fields, blocks, solution.r, shift, dt)
        return after, self._record(after, dt, fields, solution, blocks[: len(fields.velocity.ids)], substeps)

    def _followed(
        self,
        before: State,
        fields: StepFields,
        blocks: NDArray[np.float64],
        r: NDArray[np.float64],
        shift: NDArray[np.float64] | None,
        dt: float,
    ) -> tuple[State, int]:
        """The state after a step with the solution (blocks, r), and the substeps of the particles' move."""
        count, d = len(fields.velocity.ids), self.grid.dimension
        forces = r.reshape(len(fields.start), -1)
        bodies = before.bodies
        if self.setting.coupling is not None:
            bodies = self.setting.coupling.moved(bodies, blocks[count:].reshape(-1, 2, d), dt, before.time)
        with threads_for(before.particle_count):
            after, substeps = follow_flow(
                self.setting, before, fields.velocity, fields.rows, blocks[:count], shift, dt,
                self._rests(before), fields.stresses(forces), bodies,
            )  # fmt: skip
        return replace(after, **self._kept(fields, forces, blocks[:count])), substeps

    def _solve(self, state: State, step: StepProblem) -> Solution:
        choices: dict[str, Any] = {}
        if self.options.method in ("auto", "gauss_seidel"):
            choices["min_iterations"] = self.options.min_sweeps
        return solve(
            step.problem,
            method=self.options.method,
            tol=self._tolerance(state),
            r0=step.start,
            max_iterations=self.options.max_sweeps,
            **choices,
        )

    def _build(self, state: State, dt: float) -> StepProblem:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if state.dimension != self.grid.dimension:
            raise InputError(
                "state", f"{state.dimension}D", f"of the dimension of the grid ({self.grid.dimension})"
            )
        with threads_for(state.particle_count):
            step = build_step_problem(self.setting, state, dt, self._affine(state))
            if self.options.multilevel and state.step == 0 and not np.any(step.start):
                coarse_start(self.setting, state, dt, step)
        return step

    def _affine(self, state: State) -> bool:
        return self.options.transfer == "apic" and not self._rests(state)

    def _rests(self, state: State) -> bool:
        """Whether every particle is slower than REST_SPEED sqrt(g H), H being twice the mean height of the matter.

        Never so in the first step: matter put in place is about to move.
        """
        if state.step == 0:
            return False
        fastest = float(np.max(np.sum(state.velocities**2, axis=1)))
        return fastest < REST_SPEED**2 * 2.0 * self.setting.weight * self.setting.mean_height(state)

    def _tolerance(self, state: State) -> float:
        """The tolerance of a step from `state`: stricter when everything nearly rests."""
        if self._rests(state):
            return min(self.options.tolerance, self.options.rest_tolerance)
        return self.options.tolerance

    def _shift(self, step: StepProblem, solution: Solution, dt: float) -> NDArray[np.float64] | None:
        """Correction of excess volume (n, d) [m], within the energy dissipated by the contact stresses of the step.

        Made for multilinear velocities. What it would push into a body is put on its surface again.
        """
        if self.options.volume_correction == 0.0 or self.options.velocity != "Q1":
            return None
        assert solution.v is not None
        masses, d = step.velocity.masses, self.grid.dimension
        size = len(masses) * d
        contact_forces = step.problem.M.diagonal()[:size] * solution.v[:size] - step.problem.f[:size]
        dissipated = -dt * float(np.sum(contact_forces * solution.v[:size]))
        shift = volume_shift(
            step.matter,
            solution.v[:size].reshape(-1, d),
            dt,
            self.setting.materials[0].max_volume_fraction,
            self.options.volume_correction,
            self.walls,
        )
        return within_energy(shift, masses, self.setting.gravity, dissipated)

    def _kept(
        self, step: StepFields, forces: NDArray[np.float64], velocities: NDArray[np.float64]
    ) -> dict[str, Any]:
        """What the last step leaves on the grid."""
        if self.options.velocity != "Q1":
            velocities = step.velocity.at_nodes(velocities)
        return kept_on_grid(
            self.options, step.matter, step.rows, step.contacts, step.stresses(forces), step.rheology.friction,
            forces[len(step.rows.ids) :, : self.grid.dimension], velocities,
        )  # fmt: skip

    def _record(
        self,
        state: State,
        dt: float,
        step: StepFields,
        solution: Solution,
        velocities: NDArray[np.float64],
        substeps: int,
    ) -> StepRecord:
        certificate = solution.certificate
        above = (state.positions - self.grid.origin) @ self.setting.gravity
        masses = self.setting.masses(state)
        squares = np.sum(state.velocities**2, axis=1)
        return StepRecord(
            step=state.step,
            time=state.time,
            dt=dt,
            sweeps=solution.iterations,
            residual=certificate.residual,
            law_residual=certificate.law,
            balance_residual=certificate.balance,
            converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=float(0.5 * np.sum(step.velocity.masses * np.sum(velocities**2, axis=1))),
            potential_energy=-float(np.sum(masses * above)),
            max_speed=float(np.sqrt(np.max(squares))),
            max_volume_fraction=float(np.max(state.node_volume_fractions)),
            total_volume=float(np.sum(state.volumes)),
            particles=state.particle_count,
            active_nodes=len(step.velocity.ids),
            blocks=len(step.start),
            move_substeps=substeps,
        )
