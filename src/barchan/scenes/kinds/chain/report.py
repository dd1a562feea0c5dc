"""What a person is shown of a finished chain: pictures, an animation, figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.results import Results
from barchan.scenes.granular.figures import solver_figures
from barchan.scenes.kinds.chain.parameters import ChainParameters

Vector = NDArray[np.float64]


def summarise(
    parameters: ChainParameters, steps: Mapping[str, NDArray[Any]], observables: Mapping[str, Vector]
) -> dict[str, Any]:
    """Figures at the end and the worst ones over the run."""
    names = parameters.model_names
    distances = {
        key: values for key, values in observables.items() if key.startswith(("difference", "error_"))
    }
    return {
        "end_time": float(observables["time"][-1]),
        **{name: float(values[-1]) for name, values in observables.items() if name != "time"},
        **{f"largest_{name}": float(np.max(values)) for name, values in distances.items()},
        **{
            f"largest_energy_rise_{name}": float(max(np.diff(observables[f"energy_{name}"]).max(), 0.0))
            for name in names
        },
        "largest_joint_error": float(steps["joint_error"].max()),
        "deepest_overlap_of_all": float(steps["deepest"].max()),
        **solver_figures(steps, parameters.solver.tolerance),
        "remarks": remarks(parameters, steps),
    }


def remarks(parameters: ChainParameters, steps: Mapping[str, NDArray[Any]]) -> list[str]:
    """What a person should know of the run."""
    certified = steps["residual"] <= parameters.solver.tolerance
    count = int(np.count_nonzero(certified & ~steps["converged"].astype(bool)))
    if count == 0:
        return []
    return [
        f"in {count} steps {parameters.solver.iterations} linearisations did not settle: shorten time.step"
    ]


def draw(parameters: ChainParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """chain.png, tip.png, curves.png and chain.gif in `folder`."""
    from barchan.results.chain_pictures import ChainScene, draw_animation, draw_strip, draw_tip
    from barchan.results.heap_pictures import draw_curves
    from barchan.scenes.kinds.chain.building import build_obstacles

    title = parameters.scene.description or parameters.scene.name
    scene = ChainScene(results, parameters.model_names, build_obstacles(parameters))
    draw_strip(folder / "chain.png", scene, title)
    draw_tip(folder / "tip.png", scene, title)
    draw_curves(folder / "curves.png", results.times, _panels(parameters, results.observables), title)
    draw_animation(folder / "chain.gif", scene, title)


def _panels(parameters: ChainParameters, found: Mapping[str, Vector]) -> list[tuple[str, dict[str, Vector]]]:
    """What is drawn over time: energies, the tip, distances of models."""
    names = parameters.model_names
    distances = {"between models": found["difference"]} if len(names) > 1 else {}
    distances |= {f"{name} from exact": found[f"error_{name}"] for name in names if f"error_{name}" in found}
    tips = [name for name in (*names, "exact") if f"tip_x_{name}" in found]
    panels = [
        ("energy (J)", {name: found[f"energy_{name}"] for name in names}),
        ("tip x (m)", {name: found[f"tip_x_{name}"] for name in tips}),
        ("tip z (m)", {name: found[f"tip_z_{name}"] for name in tips}),
        ("distance (m)", distances),
    ]
    if list(parameters.obstacle_tables()):
        panels.append(("number", {"contacts": found["contacts"]}))
    return panels


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Distances of the models, energies, joints, remarks."""
    shown = []
    if summary["largest_difference"] > 0.0:
        shown.append(("largest distance between models", f"{summary['largest_difference']:.3g} m"))
    for key, value in summary.items():
        if key.startswith("largest_error_"):
            name = key.removeprefix("largest_error_")
            shown.append((f"{name}: largest distance from the exact motion", f"{value:.3g} m"))
        if key.startswith("largest_energy_rise_"):
            name = key.removeprefix("largest_energy_rise_")
            shown.append((f"{name}: largest rise of energy between frames", f"{value:.2g} J"))
    shown.append(("largest error of a joint", f"{summary['largest_joint_error']:.2g} m"))
    return [*shown, *(("remark", remark) for remark in summary["remarks"])]
