"""State of a two-phase simulation, complete and immutable, and the record of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm import State


@dataclass(frozen=True, eq=False)
class SuspensionState:
    """Grains as material points and the fluid on the n nodes of the box, at the end of a step.

    grains : time, step, particles and contact stresses (`barchan.flows.mpm.State`).
    fluid_velocities : (n, d) u_f [m/s].
    pressures : (n,) pore pressure [Pa]; of zero mean over a closed box.
    """

    grains: State
    fluid_velocities: NDArray[np.float64]
    pressures: NDArray[np.float64]

    def __post_init__(self) -> None:
        d = self.grains.dimension
        if self.fluid_velocities.ndim != 2 or self.fluid_velocities.shape[1] != d:
            raise InputError("state.fluid_velocities", self.fluid_velocities.shape, f"of shape (n, {d})")
        if self.pressures.shape != self.fluid_velocities.shape[:1]:
            raise InputError(
                "state.pressures", self.pressures.shape, f"of shape {self.fluid_velocities.shape[:1]}"
            )
        for name in ("fluid_velocities", "pressures"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise InputError(f"state.{name}", "an array with NaN or infinite entries", "finite")

    @property
    def time(self) -> float:
        """[s]."""
        return self.grains.time

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self.grains.step

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        own = {"fluid_velocities": self.fluid_velocities, "pressures": self.pressures}
        return {**self.grains.arrays(), **own}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> SuspensionState:
        """State from the arrays of `arrays()`; InputError names a missing field or one of the wrong shape."""
        own = {}
        for name in ("fluid_velocities", "pressures"):
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")
            own[name] = np.ascontiguousarray(arrays[name], dtype=np.float64)
        return cls(State.from_arrays({k: v for k, v in arrays.items() if k not in own}), **own)


@dataclass(frozen=True)
class SuspensionRecord:
    """What happened in one time step.

    step, time, dt : number of the step (from 1), time at its end and its length [s].
    stokes_iterations, sweeps : iterations of the first step and of the friction solver.
    residual : the certificate of the friction problem, the largest of `law_residual`, `balance_residual` and
        `bilateral_residual`.  converged : whether it met the tolerance.
    divergence : largest mean of |div u_v| that a pressure function sees [1/s].
    kinetic_grains, kinetic_fluid : [J] (per metre of depth in the plane).
    potential_energy : [J] of grains and fluid together, up to a constant: buoyant weight of the grains times height.
    max_speed, max_fluid_speed, max_slip : of particles, of the fluid, and the largest |u_g - u_f| [m/s].
    max_volume_fraction : at a node when the step began.  total_volume : of grains [m^d].
    particles, active_nodes, blocks : numbers of particles, nodes with grains, blocks of the friction problem.
    move_substeps : substeps of the particle move.
    """

    step: int
    time: float
    dt: float
    stokes_iterations: int
    sweeps: int
    residual: float
    law_residual: float
    balance_residual: float
    bilateral_residual: float
    converged: bool
    divergence: float
    kinetic_grains: float
    kinetic_fluid: float
    potential_energy: float
    max_speed: float
    max_fluid_speed: float
    max_slip: float
    max_volume_fraction: float
    total_volume: float
    particles: int
    active_nodes: int
    blocks: int
    move_substeps: int
