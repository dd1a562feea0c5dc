"""The mesh-based two-phase model, piecewise constant but for the pressure (seed B, 8.3): state in, state and record out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.cones import tensor_block_size
from barchan.errors import InputError
from barchan.flows.dry.boundaries import boundaries_of_parts
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.flow import (
    SEEN,
    checked_fractions,
    filled_shares,
    gravity_vector,
    refuse_unknown_strength,
)
from barchan.flows.dry.transport import Moved, transport
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.p0.boundaries import Boundary, Sides
from barchan.flows.suspension.p0.fluxes import VolumeFluxes, carried_by
from barchan.flows.suspension.p0.momentum import Setting, StepProblem, build_step_problem, pressures_of
from barchan.flows.suspension.p0.options import Options
from barchan.flows.suspension.p0.pressure import Pressures
from barchan.flows.suspension.p0.state import SuspensionRecord, SuspensionState
from barchan.flows.suspension.p0.viscosity import Viscosity
from barchan.friction import Problem, Solution, solve

Vector = NDArray[np.float64]


class SuspensionFlow:
    """Grains inside a fluid on a mesh: velocities, stresses and volume fractions constant in each cell, pressures linear.

    Parameters
    ----------
    mesh : scikit-fem mesh of triangles or tetrahedra with named parts of the boundary.
    mixture : `barchan.flows.suspension.mixture.Mixture`.
    boundaries : name of a part -> `Boundary` of this room; parts not named are slip walls.
    gravity : [m/s^2] down the last axis, or a vector (d,).
    options : see `Options`.

    Raises
    ------
    InputError : a mesh that `check_mesh` refuses or of quadrilaterals, an unknown part, walls that let a net volume into a
        closed box, a gravity of another size or not finite, grains larger than the smallest cell, grains with cohesion,
        yield stresses, dilatancy or anisotropy.
    """

    def __init__(
        self, mesh: Any, mixture: Mixture, boundaries: Mapping[str, Boundary],
        gravity: float | ArrayLike = 9.81, options: Options | None = None,
    ) -> None:  # fmt: skip
        cells = Cells.of(mesh)
        refuse_unknown_strength(mixture.grains)
        if mixture.grain_diameter > cells.smallest_width:
            allowed = f"at most the smallest width of a cell, {cells.smallest_width:.4g} m"
            raise InputError("mixture.grain_diameter", mixture.grain_diameter, allowed)
        parts = boundaries_of_parts(cells, boundaries, Boundary)
        sides = Sides.of(cells, parts)
        self.cells, self.mixture = cells, mixture
        self.options = Options() if options is None else options
        self.gravity = gravity_vector(gravity, cells.dimension)
        self.setting = Setting(
            cells, parts, sides, Pressures.of(cells, sides), Viscosity.of(cells, sides), mixture, self.gravity,
            self.options,
        )  # fmt: skip
        self._fluxes = VolumeFluxes.of(cells, sides)

    # -- states ------------------------------------------------------------------------------------------------------

    def at_rest(self, fractions: ArrayLike) -> SuspensionState:
        """State at time 0 with volume fractions (c,) of grains between 0 and phi_max. Raises InputError for others."""
        cells, grains = self.cells, self.mixture.grains
        given = checked_fractions(fractions, cells.count, grains.max_volume_fraction)
        d, s = cells.dimension, tensor_block_size(cells.dimension)
        still = np.zeros((cells.count, d))
        return SuspensionState(
            0.0, 0, given, still, still, still, still, still, np.zeros(len(self.setting.pressures.volumes)),
            np.zeros((cells.count, s)), np.zeros((*cells.neighbours.shape, d)),
            np.full(cells.count, float(grains.friction)), 0.0,
        )  # fmt: skip

    def filled(
        self, inside: Callable[[Vector], NDArray[np.bool_]], fraction: float | None = None
    ) -> SuspensionState:
        """State at rest with grains where `inside` (points (n, d) -> (n,)) holds, packed or of the given volume fraction."""
        largest = self.mixture.grains.max_volume_fraction
        return self.at_rest(filled_shares(self.cells, inside) * (largest if fraction is None else fraction))

    # -- steps -------------------------------------------------------------------------------------------------------

    def problem(self, state: SuspensionState, dt: float) -> Problem:
        """The discrete Coulomb friction problem of a step of `dt` seconds."""
        return self._build(state, dt).problem

    def advance(self, state: SuspensionState, dt: float) -> tuple[SuspensionState, SuspensionRecord]:
        """State after one step of `dt` seconds, and its record; raises InputError for a dt that is not finite and positive.

        A step whose certificate misses the tolerance is accepted and recorded with `converged` False.
        """
        step = self._build(state, dt)
        options, cells, grains = self.options, self.cells, self.mixture.grains
        swept = options.method in ("auto", "gauss_seidel")
        choices: dict[str, Any] = {"min_iterations": options.min_sweeps} if swept else {}
        solution = solve(
            step.problem, method=options.method, tol=options.tolerance, r0=step.start,
            max_iterations=options.max_sweeps, **choices,
        )  # fmt: skip
        assert solution.v is not None  # a full problem always has velocities
        of_grains, of_fluid, mean = step.velocities(solution.v)
        moved = transport(
            cells,
            self.setting.sides.codes,
            state.fractions,
            of_grains,
            dt,
            grains.max_volume_fraction,
            options,
        )
        brought, mean_brought = self._carried(state, moved, dt, of_grains, of_fluid, mean)
        forces = np.asarray(solution.r).reshape(step.start.shape)
        n, contacts = len(step.active), step.contacts
        stresses, tractions = np.zeros(state.stresses.shape), np.zeros(state.tractions.shape)
        stresses[step.active] = forces[:n]
        tractions[contacts.cells, contacts.sides] = forces[n:, : cells.dimension]
        frictions = np.full(cells.count, float(grains.friction))
        frictions[step.active] = step.friction
        pressure = self.setting.pressures.field(pressures_of(self.setting, step, forces.reshape(-1)))
        after = SuspensionState(
            state.time + dt, state.step + 1, moved.fractions, of_grains, of_fluid, moved.carried, brought, mean_brought,
            pressure, stresses, tractions, frictions, state.left + moved.gone,
        )  # fmt: skip
        heavy = of_grains, of_fluid
        if options.darcy:
            average = mass_average(self.mixture, state.fractions, of_grains, of_fluid)
            heavy = average, average
        return after, self._record(after, dt, step, solution, moved, mean, heavy)

    def max_grain_speed(self, state: SuspensionState, share: float = SEEN) -> float:
        """Greatest speed [m/s] of grains in cells with more than this share of what they can hold; 0 when there is none."""
        there = state.fractions > share * self.mixture.grains.max_volume_fraction
        return math.sqrt(float(np.max(np.sum(state.grains[there] ** 2, axis=1), initial=0.0)))

    def _build(self, state: SuspensionState, dt: float) -> StepProblem:
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if state.grains.shape != (self.cells.count, self.cells.dimension):
            raise InputError(
                "state", f"of {len(state.fractions)} cells", f"of the {self.cells.count} cells of the mesh"
            )
        return build_step_problem(self.setting, state, dt)

    def _carried(
        self,
        state: SuspensionState,
        moved: Moved,
        dt: float,
        of_grains: Vector,
        of_fluid: Vector,
        mean: Vector,
    ) -> tuple[Vector, Vector]:
        """Velocities (c, d) that fluid and mass average bring into the next step."""
        cells, sides, mixture = self.cells, self.setting.sides, self.mixture
        crossing = dt * self._fluxes.across(mean) - moved.crossing
        volumes = (1.0 - state.fractions) * cells.volumes
        fluid = carried_by(cells, sides, volumes, crossing, of_fluid)
        if self.options.darcy:
            average = mass_average(mixture, state.fractions, of_grains, of_fluid)
            masses = (
                mixture.grains.density * state.fractions * cells.volumes + mixture.fluid_density * volumes
            )
            crossing = mixture.grains.density * moved.crossing + mixture.fluid_density * crossing
            return fluid, carried_by(cells, sides, masses, crossing, average)
        return fluid, mass_average(mixture, moved.fractions, moved.carried, fluid)

    def _record(
        self, state: SuspensionState, dt: float, step: StepProblem, solution: Solution, moved: Moved, mean: Vector,
        heavy: tuple[Vector, Vector],
    ) -> SuspensionRecord:  # fmt: skip
        cells, mixture, certificate = self.cells, self.mixture, solution.certificate
        matter = state.fractions * cells.volumes
        masses = mixture.grains.density * matter + mixture.fluid_density * (cells.volumes - matter)
        squares = [np.sum(velocities**2, axis=1) for velocities in heavy]
        return SuspensionRecord(
            step=state.step, time=state.time, dt=dt, sweeps=solution.iterations,
            viscous_iterations=step.first.iterations, residual=certificate.residual,
            law_residual=certificate.law, balance_residual=certificate.balance,
            bilateral_residual=certificate.bilateral, converged=certificate.residual <= self.options.tolerance,
            divergence=self.setting.pressures.imbalance(mean),
            grain_kinetic_energy=float(0.5 * step.algebra.grain_masses @ squares[0]),
            fluid_kinetic_energy=float(0.5 * step.algebra.fluid_masses @ squares[1]),
            potential_energy=float(-masses @ (cells.centres @ self.gravity)),
            max_grain_speed=self.max_grain_speed(state),
            max_fluid_speed=math.sqrt(float(np.max(np.sum(state.fluid**2, axis=1)))),
            pressure_range=float(np.ptp(state.pressure)),
            min_volume_fraction=float(np.min(state.fractions)),
            max_volume_fraction=float(np.max(state.fractions)),
            volume=float(np.sum(matter)), left=state.left, excess=moved.excess,
            active_cells=len(step.active), blocks=len(step.start),
        )  # fmt: skip


def mass_average(mixture: Mixture, fractions: Vector, grains: Vector, fluid: Vector) -> Vector:
    """u_m (c, d) of the velocities (c, d) of the phases at volume fractions (c,)."""
    heavy = (mixture.grains.density * fractions)[:, None]
    light = (mixture.fluid_density * (1.0 - fractions))[:, None]
    return np.asarray((heavy * grains + light * fluid) / (heavy + light))
