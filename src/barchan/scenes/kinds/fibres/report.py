"""What a person is shown of a finished scene of fibres: pictures, an animation and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.fibres.parameters import FibresParameters


def draw(parameters: FibresParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """fibres.png, curves.png and fibres.gif in `folder`."""
    from barchan.results.fibre_pictures import picture, side_view
    from barchan.results.fibre_scenes import FibreScene
    from barchan.results.heap_pictures import draw_curves
    from barchan.results.solid_scenes import draw_animation, draw_strip, painter
    from barchan.scenes.kinds.fibres.making import build_obstacles

    title = parameters.scene.description or parameters.scene.name
    scene = FibreScene(
        build_obstacles(parameters), parameters.fibres.radius, results, parameters.observe.colour
    )
    paint = painter(picture, side_view)
    draw_strip(folder / "fibres.png", scene, title, paint)
    draw_curves(folder / "curves.png", results.times, _panels(results), title)
    draw_animation(folder / "fibres.gif", scene, title, paint)


def _panels(results: Results) -> list[tuple[str, dict[str, Any]]]:
    """What is drawn over time: energies, contacts, sliding, tips, the solver."""
    found = results.observables
    return [
        ("energy (J)", {"kinetic": found["kinetic_energy"]}),
        ("speed (m/s)", {"largest": found["max_speed"]}),
        ("number", {"contacts": found["contacts"], "with bodies": found["contacts_with_bodies"]}),
        ("share", {"of contacts that slide": found["sliding_share"]}),
        ("mean tip (m)", {axis: found[f"tip_{axis}"] for axis in "xyz"}),
        ("number", {"sweeps of a step": found["sweeps"]}),
    ]


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """What was observed, and remarks."""
    tip = ", ".join(f"{summary[f'tip_{axis}']:.4g}" for axis in "xyz")
    return [
        ("contacts at the end, most of all", f"{summary['contacts']:.0f}, {summary['most_contacts']}"),
        ("sliding share, mean of the run", f"{summary['mean_sliding_share']:.2f}"),
        ("mean sweeps of a step with contacts", f"{summary['mean_sweeps']:.0f}"),
        ("deepest overlap of all", f"{summary['deepest_relative_of_all']:.2g} radii"),
        ("mean tip at the end", f"{tip} m"),
        ("fastest node", f"{summary['fastest']:.3g} m/s"),
        *(("remark", remark) for remark in summary["remarks"]),
    ]
