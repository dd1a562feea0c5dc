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

from barchan.scenes.granular.figures import (
    ColumnReference,
    energy_figures,
    rest_figures,
    run_out_observables,
    solver_figures,
)
from barchan.scenes.granular.surface import Surface, free_surface
from barchan.scenes.kinds.column.parameters import ColumnParameters

Vector = NDArray[np.float64]


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
    reference = ColumnReference(column.length, column.height, column.position)
    surface = surface_of(parameters, positions, volumes)
    return run_out_observables(reference, surface, positions, volumes, parameters.spacing[-1])


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
        **rest_figures(steps, math.sqrt(parameters.scene.gravity * parameters.column.height)),
        **energy_figures(steps, observables),
        "volume": final["volume"],
        "volume_drift": float(np.abs(steps["total_volume"] / observables["volume"][0] - 1.0).max()),
        "largest_volume_fraction": float(steps["max_volume_fraction"].max()),
        "final_volume_fraction": float(steps["max_volume_fraction"][-1]),
        **solver_figures(steps, parameters.solver.tolerance),
    }
