"""What is measured on a collapsing column at each frame (seed B 7.2.3 and 7.5.1), and the verdict at the end.

The run-out is (L - L0)/L0 and the height ratio H/H0. L is taken twice: from the farthest particle (`front`,
the definition of seed B: "the maximum abscissa reached by the grains") and from the abscissa behind which lie
99.5 % of the volume (`front_bulk`), which a few grains rolling ahead cannot move.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.scenes.kinds.column.parameters import ColumnParameters
from barchan.scenes.kinds.column.surface import Surface, free_surface

Vector = NDArray[np.float64]

REST_SPEED = 1e-4  # of sqrt(g H0)
REST_SHARE = 0.1  # of the run, at its end, over which the material must stay at rest
_BULK_SHARE = 0.995


def surface_of(parameters: ColumnParameters, positions: Vector, volumes: Vector) -> Surface:
    """Free surface of particles of the scene."""
    box = parameters.box
    return free_surface(positions, volumes, box.size, box.cells, parameters.material.max_volume_fraction)


def column_volume(parameters: ColumnParameters) -> float:
    """Volume (m^d) of material in the initial column."""
    column = parameters.column
    depth = parameters.box.size[1] if parameters.dimension == 3 else 1.0
    return column.length * column.height * depth * parameters.material.max_volume_fraction


def geometry_observables(
    parameters: ColumnParameters, positions: Vector, volumes: Vector
) -> dict[str, float]:
    """Front, run-out, height and slope of particles at `positions` (P, d) m with `volumes` (P,) m^d.

    Lengths in metres, slopes in degrees; front and run-out are measured from the back of the initial column.
    """
    column = parameters.column
    x = positions[:, 0]
    order = np.argsort(x, kind="stable")
    behind = np.cumsum(volumes[order])
    bulk = float(x[order[np.searchsorted(behind, _BULK_SHARE * behind[-1])]])
    surface = surface_of(parameters, positions, volumes)
    height = float(surface.height.max())
    return {
        "front": float(x.max()),
        "front_bulk": bulk,
        "run_out": (float(x.max()) - column.position - column.length) / column.length,
        "run_out_bulk": (bulk - column.position - column.length) / column.length,
        "height": height,
        "height_back": float(surface.height[0]),
        "top": float(positions[:, -1].max()),
        "height_ratio": height / column.height,
        "slope_steepest": surface.steepest_slope(parameters.spacing[-1]),
        "slope_mean": surface.mean_slope(),
    }


def summarise(
    parameters: ColumnParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures of a finished run for summary.json, from its step records (steps,) and observables (frames,)."""
    final = {name: float(values[-1]) for name, values in observables.items()}
    return {
        "end_time": final["time"],
        "front": final["front"],
        "front_bulk": final["front_bulk"],
        "run_out": final["run_out"],
        "run_out_bulk": final["run_out_bulk"],
        "height": final["height"],
        "height_ratio": final["height_ratio"],
        "slope_steepest": final["slope_steepest"],
        "slope_mean": final["slope_mean"],
        **_rest(parameters, steps),
        **_energies(steps, observables),
        "volume": final["volume"],
        "volume_drift": float(np.abs(steps["total_volume"] / observables["volume"][0] - 1.0).max()),
        "largest_volume_fraction": float(steps["max_volume_fraction"].max()),
        "final_volume_fraction": float(steps["max_volume_fraction"][-1]),
        "worst_certificate": float(steps["residual"].max()),
        "tolerance": parameters.solver.tolerance,
        "converged": bool(np.all(steps["converged"])),
        "unconverged_steps": int(np.sum(~steps["converged"].astype(bool))),
        "steps": len(steps["time"]),
        "sweeps": int(steps["sweeps"].sum()),
    }


def _rest(parameters: ColumnParameters, steps: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Whether the material ends at rest, and from which time on (s)."""
    threshold = REST_SPEED * math.sqrt(parameters.scene.gravity * parameters.column.height)
    times, speeds = steps["time"], steps["max_speed"]
    moving = np.flatnonzero(speeds >= threshold)
    last = int(moving[-1]) if len(moving) else -1
    duration = float(times[last + 1]) if last + 1 < len(times) else None
    return {
        "at_rest": duration is not None and duration <= (1.0 - REST_SHARE) * float(times[-1]),
        "duration": duration,
        "rest_speed": threshold,
        "final_speed": float(speeds[-1]),
    }


def _energies(steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]) -> dict[str, float]:
    """Initial and final energies (J; per metre of depth in 2D) and the largest rise of their sum in one step."""
    initial = float(observables["kinetic_energy"][0] + observables["potential_energy"][0])
    total = np.concatenate([[initial], steps["kinetic_energy"] + steps["potential_energy"]])
    return {
        "initial_energy": initial,
        "final_energy": float(total[-1]),
        "largest_energy_rise": float(max(np.diff(total).max(), 0.0) / initial),
        "energy_drop": float((initial - total[-1]) / initial),
    }
