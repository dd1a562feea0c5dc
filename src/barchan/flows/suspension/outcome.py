"""The record of a two-phase step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.flows.mpm.setting import Setting
from barchan.flows.suspension.fluid_grid import FluidGrid
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.phases import Phases
from barchan.flows.suspension.state import SuspensionRecord, SuspensionState
from barchan.flows.suspension.step_problem import GrainRows
from barchan.friction import Solution

Vector = NDArray[np.float64]

# Share of phi_max from which on the slip at a node is reported.
SEEN = 0.01


def record_of(
    setting: Setting, mixture: Mixture, fluid: FluidGrid, rows: GrainRows, algebra: Phases, solution: Solution,
    state: SuspensionState, grains: Vector, rest: Vector, dt: float, stokes_iterations: int, substeps: int,
) -> SuspensionRecord:  # fmt: skip
    """The record of a step that ends in `state`, with unknowns `grains` and `rest` (n, d)."""
    certificate, moving = solution.certificate, algebra.fractions > SEEN * mixture.grains.max_volume_fraction
    average = algebra.volume_average(grains, rest)
    buoyant = (mixture.grains.density - mixture.fluid_density) * state.grains.volumes
    heights = -(state.grains.positions - setting.grid.origin) @ setting.gravity
    slip = np.linalg.norm(grains - state.fluid_velocities, axis=1)[moving]
    return SuspensionRecord(
        step=state.step, time=state.time, dt=dt, stokes_iterations=stokes_iterations, sweeps=solution.iterations,
        residual=certificate.residual, law_residual=certificate.law, balance_residual=certificate.balance,
        bilateral_residual=certificate.bilateral,
        converged=certificate.residual <= setting.options.tolerance,
        divergence=fluid.largest_divergence(average),
        kinetic_grains=float(0.5 * algebra.grain_masses @ np.sum(grains**2, axis=1)),
        kinetic_fluid=float(0.5 * algebra.fluid_masses @ np.sum(state.fluid_velocities**2, axis=1)),
        potential_energy=float(buoyant @ heights),
        max_speed=float(np.sqrt(np.max(np.sum(state.grains.velocities**2, axis=1)))),
        max_fluid_speed=float(np.sqrt(np.max(np.sum(state.fluid_velocities**2, axis=1)))),
        max_slip=float(np.max(slip, initial=0.0)),
        max_volume_fraction=float(np.max(state.grains.node_volume_fractions)),
        total_volume=float(np.sum(state.grains.volumes)), particles=state.grains.particle_count,
        active_nodes=len(rows.velocity.ids), blocks=len(rows.start), move_substeps=substeps,
    )  # fmt: skip
