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
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.momentum import StepProblem, build_step_problem, mean_height
from barchan.flows.mpm.options import Options
from barchan.flows.mpm.state import State, StepRecord
from barchan.flows.mpm.threads import threads_for
from barchan.flows.mpm.transfer import grid_to_particles, move_particles, particles_to_grid, substeps_needed
from barchan.flows.mpm.volume import volume_shift, within_energy
from barchan.flows.mpm.walls import Walls
from barchan.friction import Problem, Solution, solve
from barchan.spaces import RegularGrid

# Steps that begin with every particle slower than this share of sqrt(g H) are PIC steps, solved to `rest_tolerance`.
REST_SPEED = 0.02


@dataclass(frozen=True)
class Stepper:
    """Advances states of one material in one box. Holds no state: the same state and dt give the same bytes.

    Parameters
    ----------
    grid : the background grid.
    material, walls, options : see `Material`, `Walls`, `Options`.
    gravity : [m/s^2], >= 0, acting downwards along the last axis.

    Raises
    ------
    InputError : for a negative or non-finite gravity, or walls that a plane box does not have.
    """

    grid: RegularGrid
    material: Material
    walls: Walls
    gravity: float = 9.81
    options: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        if (
            not isinstance(self.gravity, (int, float))
            or not math.isfinite(self.gravity)
            or self.gravity < 0.0
        ):
            raise InputError("gravity", self.gravity, "a finite number >= 0 (m/s^2, downwards)")
        self.walls.on(self.grid.dimension)

    def problem(self, state: State, dt: float) -> Problem:
        """The discrete Coulomb friction problem of a step of `dt` seconds: to be saved, or solved by other means."""
        return self._build(state, dt).problem

    def advance(self, state: State, dt: float) -> tuple[State, StepRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.

        Raises
        ------
        InputError : for dt that is not finite and positive, a state of another dimension, particles outside the box.
        """
        step = self._build(state, dt)
        choices: dict[str, Any] = {}
        if self.options.method in ("auto", "gauss_seidel"):
            choices["min_iterations"] = self.options.min_sweeps
        solution = solve(
            step.problem,
            method=self.options.method,
            tol=self._tolerance(state),
            r0=step.start,
            max_iterations=self.options.max_sweeps,
            **choices,
        )
        assert solution.v is not None  # a full problem always has velocities
        node_velocities = solution.v.reshape(step.matter.velocities.shape)
        with threads_for(state.particle_count):
            velocities, affine = grid_to_particles(step.matter, node_velocities, state.positions)
            substeps = substeps_needed(step.matter, node_velocities, dt, self.options.cfl)
            shift = self._shift(step, node_velocities, dt)
            positions = move_particles(
                step.matter, node_velocities, state.positions, velocities, dt, substeps, shift
            )
        count = len(step.masses)
        forces = solution.r.reshape(len(step.start), -1)
        after = State(
            time=state.time + dt,
            step=state.step + 1,
            positions=positions,
            velocities=velocities,
            affine=affine,
            volumes=state.volumes,
            node_ids=step.matter.active.nodes,
            node_velocities=node_velocities,
            node_stresses=forces[:count].copy(),
            node_volume_fractions=step.matter.volume_fractions,
            node_friction=step.node_friction,
            wall_keys=step.contacts.keys,
            wall_tractions=forces[count:, : self.grid.dimension].copy(),
        )
        return after, self._record(after, dt, step, solution, substeps)

    def _build(self, state: State, dt: float) -> StepProblem:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if state.dimension != self.grid.dimension:
            raise InputError(
                "state", f"{state.dimension}D", f"of the dimension of the grid ({self.grid.dimension})"
            )
        affine = self.options.transfer == "apic" and not self._rests(state)
        with threads_for(state.particle_count):
            matter = particles_to_grid(self.grid, state, affine=affine)
            return build_step_problem(
                matter, state, self.material, self.walls, self.gravity, dt, self.options.viscous_tolerance
            )

    def _rests(self, state: State) -> bool:
        """Whether every particle is slower than REST_SPEED sqrt(g H), H being twice the mean height of the matter.

        Never so in the first step: matter put in place is about to move.
        """
        if state.step == 0:
            return False
        fastest = float(np.max(np.sum(state.velocities**2, axis=1)))
        return fastest < REST_SPEED**2 * 2.0 * self.gravity * mean_height(state)

    def _tolerance(self, state: State) -> float:
        """The tolerance of a step from `state`: stricter when everything nearly rests."""
        if self._rests(state):
            return min(self.options.tolerance, self.options.rest_tolerance)
        return self.options.tolerance

    def _shift(
        self, step: StepProblem, node_velocities: NDArray[np.float64], dt: float
    ) -> NDArray[np.float64] | None:
        """Correction of excess volume (n, d) [m], within the energy dissipated by the contact stresses of the step."""
        if self.options.volume_correction == 0.0:
            return None
        flat = node_velocities.reshape(-1)
        contact_forces = step.problem.M.diagonal() * flat - step.problem.f
        dissipated = -dt * float(np.sum(contact_forces * flat))
        shift = volume_shift(
            step.matter,
            node_velocities,
            dt,
            self.material.max_volume_fraction,
            self.options.volume_correction,
        )
        return within_energy(shift, step.masses, self.gravity, dissipated)

    def _record(
        self, state: State, dt: float, step: StepProblem, solution: Solution, substeps: int
    ) -> StepRecord:
        speed_squared: NDArray[np.float64] = np.sum(state.node_velocities**2, axis=1)
        heights = state.positions[:, -1] - self.grid.origin[-1]
        certificate = solution.certificate
        return StepRecord(
            step=state.step,
            time=state.time,
            dt=dt,
            sweeps=solution.iterations,
            residual=certificate.residual,
            law_residual=certificate.law,
            balance_residual=certificate.balance,
            converged=certificate.residual <= self.options.tolerance,
            kinetic_energy=float(0.5 * np.sum(step.masses * speed_squared)),
            potential_energy=float(self.material.density * self.gravity * np.sum(state.volumes * heights)),
            max_speed=float(np.sqrt(np.max(np.sum(state.velocities**2, axis=1)))),
            max_volume_fraction=float(np.max(state.node_volume_fractions)),
            total_volume=float(np.sum(state.volumes)),
            active_nodes=len(state.node_ids),
            blocks=len(step.start),
            move_substeps=substeps,
        )
