"""What is measured of grains inside a fluid at each frame, and the figures of the finished run (seed B, 8.4)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.flows.suspension.state import SuspensionRecord, SuspensionState
from barchan.results import Results
from barchan.scenes.granular.figures import ColumnReference, run_out_observables, solver_figures
from barchan.scenes.granular.surface import Surface, free_surface
from barchan.scenes.kinds.suspension.building import numbers_of, remarks
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters
from barchan.scenes.kinds.suspension.profiles import deviations

Vector = NDArray[np.float64]

BULK = 0.995
"""Share of the volume whose front and top are given beside those of the farthest particle."""
ENDED = 0.95
"""Grains that settle only in the last part of a run, beyond this share of it, are not called settled."""


def surface_of(parameters: SuspensionParameters, positions: Vector, volumes: Vector) -> Surface:
    """Height of the grains along x, packed."""
    box = parameters.box
    return free_surface(positions, volumes, box.size, box.cells, parameters.grains.max_volume_fraction)


def extent(positions: Vector, volumes: Vector, axis: int) -> tuple[float, float]:
    """The largest coordinate of a particle, and the one below which lies `BULK` of the volume (m)."""
    along = positions[:, axis]
    order = np.argsort(along, kind="stable")
    behind = np.cumsum(volumes[order])
    return float(along.max()), float(along[order[np.searchsorted(behind, BULK * behind[-1])]])


def ripple_amplitude(parameters: SuspensionParameters, positions: Vector, volumes: Vector) -> float:
    """Amplitude (m) of the wave cos(half_waves pi x / length) in the thickness of the grains, packed as the first piece.

    The thickness is the volume above each x; its share of the wave is a sum over particles, free of the noise of the grid.
    """
    length, first = parameters.box.size[0], next(iter(parameters.pieces()))[1]
    fraction = first.packing * parameters.grains.max_volume_fraction
    wave = np.cos(parameters.observe.half_waves * np.pi * positions[:, 0] / length)
    sign = -1.0 if first.rippled == "bottom" else 1.0
    return sign * 2.0 * float(volumes @ wave) / (parameters.ground * fraction)


def observables_of_frame(
    parameters: SuspensionParameters,
    state: SuspensionState,
    record: SuspensionRecord | None,
    nodal_volumes: Vector,
) -> dict[str, float]:
    """Scalars of a frame; before the first step energies come from particles and nodes. nodal_volumes : (n,) m^d."""
    positions, velocities, volumes = state.grains.positions, state.grains.velocities, state.grains.volumes
    front, front_bulk = extent(positions, volumes, 0)
    top, top_bulk = extent(positions, volumes, -1)
    centre = volumes @ positions / volumes.sum()
    values = {
        "time": state.time,
        "volume": float(volumes.sum()),
        **energies(parameters, state, record, nodal_volumes),
        "max_speed": float(np.sqrt(np.max(np.sum(velocities**2, axis=1)))),
        "max_fluid_speed": float(np.sqrt(np.max(np.sum(state.fluid_velocities**2, axis=1)))),
        "front": front - parameters.observe.back,
        "front_bulk": front_bulk - parameters.observe.back,
        "top": top,
        "top_bulk": top_bulk,
        "centre_x": float(centre[0]),
        "centre_z": float(centre[-1]),
        "residual": 0.0 if record is None else record.residual,
        "divergence": 0.0 if record is None else record.divergence,
    }
    observe = parameters.observe
    if observe.length is not None and observe.height is not None:
        column = ColumnReference(observe.length, observe.height, observe.back)
        surface = surface_of(parameters, positions, volumes)
        values |= run_out_observables(column, surface, positions, volumes, parameters.spacing[-1])
        values["front"], values["front_bulk"] = front - observe.back, front_bulk - observe.back
    if observe.half_waves:
        values["ripple"] = ripple_amplitude(parameters, positions, volumes)
    return values


def energies(
    parameters: SuspensionParameters,
    state: SuspensionState,
    record: SuspensionRecord | None,
    nodal_volumes: Vector,
) -> dict[str, float]:
    """Kinetic energies of grains and fluid, potential energy of both together and the sum (J; in the plane J/m).

    The potential energy is the grains' buoyant weight times height: what grains gain in height the fluid loses.
    """
    grains, fluid = state.grains, parameters.fluid.density
    buoyant = (parameters.grains.density - fluid) * parameters.scene.gravity
    potential = buoyant * float(grains.volumes @ grains.positions[:, -1])
    if record is None:
        own = 0.5 * parameters.grains.density * float(grains.volumes @ np.sum(grains.velocities**2, axis=1))
        rest = 0.5 * fluid * float(nodal_volumes @ np.sum(state.fluid_velocities**2, axis=1))
    else:
        own, rest, potential = record.kinetic_grains, record.kinetic_fluid, record.potential_energy
    return {
        "kinetic_grains": own,
        "kinetic_fluid": rest,
        "potential_energy": potential,
        "total_energy": own + rest + potential,
    }


def time_unit(parameters: SuspensionParameters) -> float | None:
    """H / sqrt(|alpha| / (alpha + 1) g H) [s], H the height of the box (seed B, 8.4.2); None when nothing settles."""
    grains, fluid = parameters.grains.density, parameters.fluid.density
    share = abs(grains - fluid) / grains
    gravity, height = parameters.scene.gravity, parameters.height
    return height / math.sqrt(share * gravity * height) if share * gravity > 0.0 else None


def settling_time(times: Vector, potential: Vector, share: float) -> float | None:
    """When the potential energy (n,) has come within `share` of its whole drop of its last value, for good [s].

    None when it never dropped, or came there only in the last twentieth of the run: then it may still be falling.
    """
    drop = potential[0] - potential[-1]
    if not drop > 0.0:
        return None
    outside = np.flatnonzero(np.abs(potential - potential[-1]) > share * drop)
    when = float(times[outside[-1] + 1])
    return when if when <= ENDED * float(times[-1]) else None


def summarise(parameters: SuspensionParameters, results: Results) -> dict[str, Any]:
    """Figures of a finished run for summary.json."""
    steps, observables = results.steps, results.observables
    skipped = ("time", "residual", "divergence")
    return {
        "end_time": float(observables["time"][-1]),
        **{name: float(values[-1]) for name, values in observables.items() if name not in skipped},
        **settling_figures(parameters, steps, observables),
        **energy_figures(parameters, steps, observables),
        **deviations(parameters, results.lines(-1), float(observables["volume"][-1])),
        "volume_drift": float(np.abs(steps["total_volume"] / observables["volume"][0] - 1.0).max()),
        "largest_divergence": float(steps["divergence"].max()),
        "largest_volume_fraction": float(steps["max_volume_fraction"].max()),
        "particles": int(steps["particles"][0]),
        **numbers_of(parameters).figures(),
        **solver_figures(steps, parameters.solver.tolerance),
        "worst_bilateral": float(steps["bilateral_residual"].max()),
        "stokes_iterations": int(steps["stokes_iterations"].sum()),
        "remarks": remarks(parameters),
    }


def settling_figures(
    parameters: SuspensionParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, float | None]:
    """When grains have settled: in seconds, and over `time_unit`; None when they have not."""
    times = np.append(0.0, steps["time"])
    potential = np.append(observables["potential_energy"][0], steps["potential_energy"])
    unit = time_unit(parameters)
    settled = settling_time(times, potential, parameters.observe.settled_share)
    return {
        "settling_time": settled,
        "settling_duration": None if settled is None or unit is None else settled / unit,
        "time_unit": unit,
    }


def energy_figures(
    parameters: SuspensionParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, float]:
    """The drop of the total energy (J), its largest rise in a step over the buoyant weight times the height of the box."""
    own = steps["kinetic_grains"] + steps["kinetic_fluid"] + steps["potential_energy"]
    total = np.append(observables["total_energy"][0], own)
    buoyant = abs(parameters.grains.density - parameters.fluid.density) * parameters.scene.gravity
    scale = max(buoyant * float(observables["volume"][0]) * parameters.height, 1e-300)
    return {
        "energy_drop": float(total[0] - total[-1]),
        "largest_energy_rise": float(max(np.diff(total).max(), 0.0) / scale),
    }
