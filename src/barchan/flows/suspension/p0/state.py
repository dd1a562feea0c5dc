"""State of the mesh-based two-phase model, and the record of a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.flows.dry.state import StoredState


@dataclass(frozen=True, eq=False)
class SuspensionState(StoredState):
    """Everything the next step depends on; c cells with k sides in d dimensions, v vertices.

    time : [s].  step : steps taken.
    fractions : (c,) volume fractions of grains in [0, phi_max].
    grains, fluid : (c, d) velocities of the phases at the end of the last step; of grains zero where there are none [m/s].
    carried_grains, carried_fluid, carried_mean : (c, d) velocities that what is now in each cell brings into the next step, and
        that of the mass average, whose inertia is the only one of the Darcy-like model [m/s].
    pressure : (v,) pore pressure at the vertices; of zero mean in a closed box [Pa].
    stresses : (c, s) contact stresses lambda in cone coordinates, compression positive [Pa].
    tractions : (c, k, d) forces of walls on the grains of cells by area (normal; tangents), zero elsewhere [Pa].
    frictions : (c,) physical friction coefficients of the last step.
    left : volume of grains that has left through free boundaries [m^d].
    """

    time: float
    step: int
    fractions: NDArray[np.float64]
    grains: NDArray[np.float64]
    fluid: NDArray[np.float64]
    carried_grains: NDArray[np.float64]
    carried_fluid: NDArray[np.float64]
    carried_mean: NDArray[np.float64]
    pressure: NDArray[np.float64]
    stresses: NDArray[np.float64]
    tractions: NDArray[np.float64]
    frictions: NDArray[np.float64]
    left: float

    @property
    def volume_average(self) -> NDArray[np.float64]:
        """(c, d) u_v = phi u_g + (1 - phi) u_f with the volume fractions after transport [m/s]."""
        phi = self.fractions[:, None]
        return phi * self.grains + (1.0 - phi) * self.fluid


@dataclass(frozen=True)
class SuspensionRecord:
    """One step.

    step, time, dt : its number from 1, the time at its end, its length.
    sweeps : iterations of the friction solver.  viscous_iterations : of the Stokes-like first step.
    residual, law_residual, balance_residual, bilateral_residual : certificate of the friction problem.
    converged : whether the tolerance is met.
    divergence : |C u_v - k| of the weak divergence over the size of its terms (`Pressures.imbalance`).
    grain_kinetic_energy, fluid_kinetic_energy : at the end of the momentum step [J; by metre of depth in the plane]; in the
        Darcy-like model with the mass-averaged velocity, which alone has inertia there.
    potential_energy : of both phases, after transport [J].
    max_grain_speed : of cells at least a tenth full, max_fluid_speed : of all [m/s].
    pressure_range : greatest less smallest pore pressure [Pa].
    min_volume_fraction, max_volume_fraction : over all cells, after the step.
    volume, left : grains inside, and gone through free boundaries since the start [m^d].
    excess : grains that transport put above phi_max and that were moved to the nearest room [m^d].
    active_cells, blocks : size of the friction problem.
    """

    step: int
    time: float
    dt: float
    sweeps: int
    viscous_iterations: int
    residual: float
    law_residual: float
    balance_residual: float
    bilateral_residual: float
    converged: bool
    divergence: float
    grain_kinetic_energy: float
    fluid_kinetic_energy: float
    potential_energy: float
    max_grain_speed: float
    max_fluid_speed: float
    pressure_range: float
    min_volume_fraction: float
    max_volume_fraction: float
    volume: float
    left: float
    excess: float
    active_cells: int
    blocks: int

    @property
    def energy(self) -> float:
        """Kinetic and potential energy of both phases [J]."""
        return self.grain_kinetic_energy + self.fluid_kinetic_energy + self.potential_energy
