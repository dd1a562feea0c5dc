"""The figures of a finished scene of bodies for summary.json, from its step records (steps,) and observables (frames,)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.scenes.granular.discharge import discharge_figures
from barchan.scenes.granular.figures import rest_figures, solver_figures
from barchan.scenes.kinds.bodies.parameters import BodiesParameters

Vector = NDArray[np.float64]


def summarise(
    parameters: BodiesParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures at the end, worst ones over the run, and remarks."""
    soft = parameters.contact.method == "soft"
    final = {name: float(values[-1]) for name, values in observables.items() if name != "time"}
    drop = max(float(np.ptp([observables["top"][0], 0.0])), 1e-12)
    tolerance = parameters.contact.most_overlap if soft else parameters.solver.tolerance
    figures: dict[str, Any] = {
        "end_time": float(observables["time"][-1]),
        **final,
        **rest_figures(steps, math.sqrt(max(parameters.scene.gravity, 1e-12) * drop)),
        "largest_displacement_relative": float(observables["displacement_relative"].max()),
        "deepest_overlap_of_all": float(steps["deepest"].max()),
        "deepest_relative_of_all": float(observables["deepest_relative"].max()),
        "most_contacts": int(steps["contacts"].max()),
        "largest_energy_rise": energy_rise(steps, observables),
        **solver_figures(steps, tolerance),
        "remarks": remarks(steps, soft),
    }
    if not soft:
        figures["largest_joint_error"] = float(steps["joint_error"].max())
    if parameters.observe.level is not None:
        figures |= discharge_figures(observables["time"], observables["mass_above"])
    return figures


def energy_rise(steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]) -> float:
    """Largest rise (J) of kinetic and potential energy together in one step; driven bodies may work."""
    initial = float(observables["kinetic_energy"][0] + observables["potential_energy"][0])
    total = np.concatenate([[initial], steps["kinetic_energy"] + steps["potential_energy"]])
    return float(max(np.diff(total).max(), 0.0))


def remarks(steps: Mapping[str, NDArray[Any]], soft: bool) -> list[str]:
    """What a person should know of the run."""
    found = []
    if soft:
        found.append("soft spheres: the certificate is the deepest overlap over the smallest radius")
    elif int(steps["crossings"].sum()):
        count = int(np.count_nonzero(steps["crossings"]))
        found.append(f"in {count} steps a body could have crossed another: a shorter time.step is safer")
    return found
