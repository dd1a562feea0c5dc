"""The figures of a finished scene of cloth for summary.json, from its step records (steps,) and observables (frames,)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.scenes.granular.figures import solver_figures
from barchan.scenes.kinds.cloth.parameters import ClothParameters

Vector = NDArray[np.float64]

RESTING = 1e-2  # m/s: mean speed of a cloth that hangs still
TIGHT = 0.1  # strain above which a cloth is stretched more than cloth is


def summarise(
    parameters: ClothParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures at the end, worst and mean ones over the run, and remarks."""
    thickness = parameters.material.thickness
    deepest = float(steps["deepest"].max()) / thickness
    touching = steps["contacts"] > 0
    stretch = float(observables["largest_stretch"].max())
    return {
        "end_time": float(observables["time"][-1]),
        **{name: float(values[-1]) for name, values in observables.items() if name != "time"},
        "at_rest": bool(observables["mean_speed"][-1] < RESTING),
        "most_contacts": int(steps["contacts"].max()),
        "mean_contacts": float(steps["contacts"].mean()),
        "mean_sweeps": float(steps["sweeps"][touching].mean()) if touching.any() else 0.0,
        "deepest_relative_of_all": deepest,
        "largest_stretch_of_all": stretch,
        "fastest": float(steps["max_speed"].max()),
        **solver_figures(steps, parameters.solver.tolerance),
        "remarks": remarks(parameters, deepest, stretch),
    }


def remarks(parameters: ClothParameters, deepest: float, stretch: float) -> list[str]:
    """What a person should know of the run."""
    found = []
    if deepest > 1.0:
        found.append(
            f"vertices were up to {deepest:.2g} thicknesses inside something: a shorter time.step is safer"
        )
    if stretch > TIGHT:
        found.append(
            f"edges were stretched by up to {100.0 * stretch:.0f} %: a larger young_modulus holds them"
        )
    if not parameters.contact.self_contact:
        found.append("the cloth does not touch itself: contact.self_contact = true lets it fold")
    return found
