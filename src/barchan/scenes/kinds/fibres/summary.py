"""The figures of a finished scene of fibres for summary.json, from its step records (steps,) and observables (frames,)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.scenes.granular.figures import solver_figures
from barchan.scenes.kinds.fibres.parameters import FibresParameters

Vector = NDArray[np.float64]
CROSSED = 1.0  # overlap of two fibres over their radius from which their centre lines may cross in time


def summarise(
    parameters: FibresParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures at the end, worst and mean ones over the run, and remarks."""
    radius = parameters.fibres.radius
    deepest = float(steps["deepest"].max()) / radius
    loaded = steps["contacts"] > 0
    return {
        "end_time": float(observables["time"][-1]),
        **{name: float(values[-1]) for name, values in observables.items() if name != "time"},
        "most_contacts": int(steps["contacts"].max()),
        "most_candidates": int(steps["candidates"].max()),
        "mean_contacts": float(steps["contacts"].mean()),
        "mean_sweeps": float(steps["sweeps"][loaded].mean()) if loaded.any() else 0.0,
        "mean_sliding_share": _mean_sliding(observables),
        "deepest_relative_of_all": deepest,
        "fastest": float(steps["max_speed"].max()),
        **solver_figures(steps, parameters.solver.tolerance),
        "remarks": remarks(parameters, deepest),
    }


def _mean_sliding(observables: Mapping[str, Vector]) -> float:
    """Share of loaded contacts that slide, over the frames that have any."""
    touched = observables["contacts"] > 0.0
    return float(observables["sliding_share"][touched].mean()) if touched.any() else 0.0


def remarks(parameters: FibresParameters, deepest: float) -> list[str]:
    """What a person should know of the run."""
    found = []
    if parameters.contact.law == "faceted":
        found.append("the friction cone is a pyramid of four sides: for comparison with exact friction only")
    if deepest > CROSSED:
        found.append(
            f"fibres overlapped by up to {deepest:.2g} radii and may have crossed: a shorter time.step is safer"
        )
    return found
