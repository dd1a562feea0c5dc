"""The two-phase time step: fluid on the grid, grains as material points (seed B, 8.3): state in, state and record out.

 1. the fluid's velocity is carried along its own field (characteristics), the grains' comes from the particles;
 2. inertia, gravity and drag predict the unknowns node by node, and a Stokes-like problem of the volume average adds viscosity
    and pore pressure (8.25 without contacts);
 3. contacts act, with lumped inertia and with the volume average still free of divergence (8.27);
 4. particles move with u_g.

The solves of 2 and 3 never raise the energy. The ways between particles and grid lose some (docs/mpm.md), the limited
interpolation of the fluid creates no new extremum of a velocity component.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm.kept import kept_on_grid
from barchan.flows.mpm.particles import follow_flow, started
from barchan.flows.mpm.setting import Setting, checked_materials, gravity_vector
from barchan.flows.mpm.state import State
from barchan.flows.mpm.threads import threads_for
from barchan.flows.mpm.volume import volume_shift, within_energy
from barchan.flows.suspension.characteristics import advected
from barchan.flows.suspension.checks import notes
from barchan.flows.suspension.fluid_grid import FluidGrid
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.options import Options
from barchan.flows.suspension.outcome import record_of
from barchan.flows.suspension.phases import DENSEST, Phases, phases
from barchan.flows.suspension.sides import Side, Sides
from barchan.flows.suspension.state import SuspensionRecord, SuspensionState
from barchan.flows.suspension.step_problem import (
    GrainRows,
    constraint,
    coupled_problem,
    grain_rows,
    grains_on_grid,
    lumped_problem,
)
from barchan.flows.suspension.stokes import StokesSolver
from barchan.friction import Problem, Solution, solve
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]

# First steps made once more to find a drag that grows with the slip.
DRAG_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class SuspensionStep:
    """A step about to be solved.

    problem : the frictional problem.  algebra : of all n nodes.  grains : the rows.  carried : (n, d) fluid velocities after
    the characteristics.  pressure : (c,) of the first step.  stokes_iterations : its iterations.
    """

    problem: Problem
    algebra: Phases
    grains: GrainRows
    carried: Vector
    pressure: Vector
    stokes_iterations: int


@dataclass(frozen=True)
class Suspension:
    """Advances grains and the fluid around them in a box. Holds no state: the same state and dt give the same bytes.

    Parameters
    ----------
    grid : the grid of both phases; with "coarse" pressures an even number of cells along each axis.
    mixture : densities, viscosities, drag and the friction of the grains.
    sides : what the faces do to both phases; those not named slip.
    gravity : [m/s^2], downwards along the last axis, or a vector (d,).
    options : see `Options`.

    Raises
    ------
    InputError : for a gravity that is not finite, faces that the box does not have, walls that drive net volume into a closed
        box, grains larger than a cell, an odd number of cells, a viscosity or cohesion of the dry grains.
    """

    grid: RegularGrid
    mixture: Mixture
    sides: Sides | Mapping[str, Side] = field(default_factory=Sides)
    gravity: ArrayLike = 9.81
    options: Options = field(default_factory=Options)

    def __post_init__(self) -> None:
        if not isinstance(self.sides, Sides):
            object.__setattr__(self, "sides", Sides(self.sides))
        assert self.notes is not None
        assert self.setting is not None and self.fluid is not None

    @cached_property
    def notes(self) -> list[str]:
        """What is worth knowing before a run: grains that rise, laws outside of their range."""
        darcy = self.options.model == "darcy"
        weight = float(np.linalg.norm(gravity_vector(self.gravity, self.grid.dimension)))
        return notes(self.mixture, self.grid.spacing, weight, darcy=darcy)

    @cached_property
    def setting(self) -> Setting:
        """What the granular part keeps from step to step."""
        assert isinstance(self.sides, Sides)
        gravity = gravity_vector(self.gravity, self.grid.dimension)
        return Setting(
            self.grid,
            checked_materials(self.mixture.grains),
            self.sides.walls(),
            gravity,
            self.options.grains,
        )

    @cached_property
    def fluid(self) -> FluidGrid:
        """The matrices of the fluid."""
        assert isinstance(self.sides, Sides)
        return FluidGrid(self.grid, self.sides, self.options.pressure, self.options.penalty)

    @cached_property
    def _boundary(self) -> tuple[NDArray[np.int8], Vector]:
        """(n, d) what the faces do to each component, and the velocities they give."""
        assert isinstance(self.sides, Sides)
        return self.sides.boundary(self.grid)

    @cached_property
    def _solver(self) -> StokesSolver:
        masses = self.fluid.slack_masses
        return StokesSolver(self.fluid.divergence, None if masses is None else 1.0 / masses)

    def at_rest(self, grains: State) -> SuspensionState:
        """First state: the grains as they are, the fluid at rest."""
        n = self.grid.node_count
        return SuspensionState(grains, np.zeros((n, self.grid.dimension)), np.zeros(n))

    def problem(self, state: SuspensionState, dt: float) -> Problem:
        """The frictional problem of a step of `dt` seconds."""
        return self._build(self._started(state), dt).problem

    def volume_fractions(self, state: SuspensionState) -> Vector:
        """(n,) volume fractions of grains at all nodes, as they are now."""
        matter, _ = grains_on_grid(self.setting, state.grains, affine=False)
        found = np.zeros(self.grid.node_count)
        found[matter.active.nodes] = matter.volumes
        return found / self.fluid.volumes

    def advance(self, state: SuspensionState, dt: float) -> tuple[SuspensionState, SuspensionRecord]:
        """State after one step of `dt` seconds, and its record.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.

        Raises InputError for dt that is not finite and positive, a state of another grid, particles outside the box.
        """
        before = self._started(state)
        step = self._build(before, dt)
        solution = self._solve(step)
        assert solution.v is not None  # a full problem always has velocities
        nodes, d = step.grains.velocity.ids, self.grid.dimension
        inner = solution.v[: len(nodes) * d].reshape(-1, d)
        rest = solution.v[len(nodes) * d :][: step.algebra.a.size].reshape(-1, d)
        grains = np.array(step.algebra.held)
        grains[nodes] = np.where(step.algebra.grains_move[nodes], inner, step.algebra.held[nodes])
        fluid = step.algebra.fluid(grains, rest)
        forces = solution.r.reshape(len(step.grains.start), -1)
        own = np.ascontiguousarray(grains[nodes])
        with threads_for(before.grains.particle_count):
            shift = self._shift(step, solution, own, dt)
            after, substeps = follow_flow(
                self.setting, before.grains, step.grains.velocity, step.grains.rows, own, shift, dt,
                False, step.grains.stresses(forces), before.grains.bodies,
            )  # fmt: skip
        rows = step.grains
        kept = kept_on_grid(
            self.options.grains, rows.matter, rows.rows, rows.contacts, rows.stresses(forces), rows.rheology.friction,
            forces[len(rows.rows.ids) :, :d], own,
        )  # fmt: skip
        after = replace(after, **kept)
        pressure = self.fluid.pressure_field(self._pressures(step, solution))
        new = SuspensionState(after, fluid, pressure)
        record = record_of(
            self.setting, self.mixture, self.fluid, step.grains, step.algebra, solution, new, grains, rest, dt,
            step.stokes_iterations, substeps,
        )  # fmt: skip
        step.problem.release()
        return new, record

    # -- a step ------------------------------------------------------------------------------------------------------

    def _started(self, state: SuspensionState) -> SuspensionState:
        if state.fluid_velocities.shape != (self.grid.node_count, self.grid.dimension):
            raise InputError(
                "state.fluid_velocities", state.fluid_velocities.shape,
                f"({self.grid.node_count}, {self.grid.dimension}), a row for each node of the grid",
            )  # fmt: skip
        return replace(state, grains=started(self.setting, state.grains)) if state.step == 0 else state

    def _build(self, state: SuspensionState, dt: float) -> SuspensionStep:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        carried = advected(self.grid, state.fluid_velocities, dt)
        with threads_for(state.grains.particle_count):
            affine = self.options.grains.transfer == "apic"
            matter, velocity = grains_on_grid(self.setting, state.grains, affine)
        own, seen = np.zeros(self.grid.node_count), carried.copy()
        own[velocity.ids], seen[velocity.ids] = matter.volumes, velocity.velocities
        algebra, predicted, pressure, iterations, stiffness = self._without_contacts(own, seen, carried, dt)
        divergence = self.fluid.divergence
        held = algebra.held[velocity.ids]
        with threads_for(state.grains.particle_count):
            rows = grain_rows(
                self.setting, state.grains, matter, velocity, algebra.grains_move[velocity.ids], held, dt
            )
        problem = lumped_problem(
            rows, algebra, predicted, constraint(divergence, algebra, velocity.ids), self._slacks(pressure),
            self._heaviest(dt), self._reference(state.grains, len(rows.start)),
        )  # fmt: skip
        if self.options.solution == "coupled" and stiffness is not None:
            problem = coupled_problem(problem, stiffness, algebra, velocity.ids)
        return SuspensionStep(problem, algebra, rows, carried, pressure, iterations)

    def _without_contacts(
        self, own: Vector, seen: Vector, carried: Vector, dt: float
    ) -> tuple[Phases, tuple[Vector, Vector], Vector, int, sp.sparray | None]:
        """The first step: algebra, unknowns, pressures, iterations, and the viscous stiffness.

        own : (n,) volumes of grains.  seen, carried : (n, d) velocities of grains and fluid before it. A drag that grows with
        the slip takes a few rounds: the geometric mean of the last two slips converges where a fixed point overshoots, in steps
        longer than the time of the drag.
        """
        fractions = np.minimum(own / self.fluid.volumes, DENSEST)
        stiffness = self._stiffness(fractions)
        slip = np.linalg.norm(seen - carried, axis=1)
        rounds = 0 if self.mixture.drag.linear else DRAG_ROUNDS
        for number in range(rounds + 1):
            algebra = self._algebra(own, fractions, slip, dt)
            predicted = algebra.predicted(seen, carried, self.setting.gravity)
            pressure, iterations = np.zeros(self.fluid.divergence.shape[0]), 0
            if self.options.solution == "two_step" or number < rounds:
                predicted, pressure, iterations = self._stokes(algebra, predicted, stiffness)
            following = np.linalg.norm(predicted[0] - algebra.fluid(*predicted), axis=1)
            slip = np.where(slip > 0.0, np.sqrt(slip * following), following)
        return algebra, predicted, pressure, iterations, stiffness

    def _algebra(self, own: Vector, fractions: Vector, slip: Vector, dt: float) -> Phases:
        mixture, whole = self.mixture, self.fluid.volumes
        drag = whole * mixture.drag.coefficient(fractions, slip, mixture)
        masses = mixture.grains.density * own, mixture.fluid_density * (1.0 - fractions) * whole
        kind, held = self._boundary
        darcy = self.options.model == "darcy"
        return phases(*masses, fractions, drag, dt, self.grid.dimension, kind, held, darcy)

    def _slacks(self, pressure: Vector) -> tuple[Vector, Vector] | None:
        masses = self.fluid.slack_masses
        return None if masses is None else (masses, pressure)

    def _stiffness(self, fractions: Vector) -> sp.sparray | None:
        mixture = self.mixture
        if mixture.fluid_viscosity == 0.0:
            return None
        ratio = mixture.effective_viscosity.ratio(fractions, mixture.grains.max_volume_fraction)
        return self.fluid.stiffness(mixture.fluid_viscosity * ratio)

    def _stokes(
        self, algebra: Phases, predicted: tuple[Vector, Vector], stiffness: sp.sparray | None
    ) -> tuple[tuple[Vector, Vector], Vector, int]:
        """The unknowns after the first step, its pressures and iterations."""
        start = algebra.volume_average(*predicted)
        compliance = algebra.volume_compliance
        free = compliance > 0.0
        inertia = np.divide(1.0, compliance, out=np.ones_like(compliance), where=free)
        found = self._solver.solve(
            inertia.reshape(-1), stiffness, (inertia * start).reshape(-1), free=free.reshape(-1),
            values=np.where(free, 0.0, start).reshape(-1), tolerance=self.options.stokes_tolerance,
        )  # fmt: skip
        force = np.where(free, inertia * (found.u.reshape(start.shape) - start), 0.0)
        return algebra.with_volume_force(*predicted, force), found.p, found.iterations

    def _solve(self, step: SuspensionStep) -> Solution:
        options = self.options.grains
        choices: dict[str, Any] = {}
        if options.method in ("auto", "gauss_seidel"):
            choices["min_iterations"] = options.min_sweeps
        return solve(
            step.problem, method=options.method, tol=options.tolerance, r0=step.grains.start,
            max_iterations=options.max_sweeps, **choices,
        )  # fmt: skip

    def _pressures(self, step: SuspensionStep, solution: Solution) -> Vector:
        """(c,) pore pressures: those of both steps; a slack velocity has its whole pressure."""
        assert solution.v is not None and solution.multipliers is not None
        if self.fluid.slack_masses is not None:
            first = step.grains.operator.shape[1] + step.algebra.a.size
            return np.asarray(self.fluid.slack_masses * solution.v[first : first + len(step.pressure)])
        return np.asarray(step.pressure + solution.multipliers)

    def _shift(
        self, step: SuspensionStep, solution: Solution, velocities: Vector, dt: float
    ) -> Vector | None:
        """Correction of excess volume (n_g, d) [m], within the energy that the contacts dissipated (`mpm.volume`)."""
        share, mixture = self.options.grains.volume_correction, self.mixture
        if share == 0.0:
            return None
        assert solution.v is not None
        matter = step.grains.matter
        working = -dt * float(solution.r.reshape(-1) @ (step.problem.H @ solution.v))
        shift = volume_shift(
            matter, velocities, dt, mixture.grains.max_volume_fraction, share, self.setting.walls
        )
        lighter = abs(mixture.grains.density - mixture.fluid_density)
        return within_energy(shift, lighter * matter.volumes, self.setting.gravity, working)

    def _heaviest(self, dt: float) -> float:
        mixture = self.mixture
        return max(mixture.grains.density, mixture.fluid_density) * self.grid.cell_volume / dt

    def _reference(self, grains: State, blocks: int) -> float:
        """Buoyant overburden [Pa] of the grains at their densest, times sqrt(blocks), as in the dry model."""
        mixture, setting = self.mixture, self.setting
        lighter = abs(mixture.grains.density - mixture.fluid_density) * mixture.grains.max_volume_fraction
        return lighter * setting.weight * setting.mean_height(grains) * math.sqrt(blocks)
