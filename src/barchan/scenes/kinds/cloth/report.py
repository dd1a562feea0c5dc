"""What a person is shown of a finished scene of cloth: pictures, an animation and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.cloth.parameters import ClothParameters


def draw(parameters: ClothParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """cloth.png, curves.png and cloth.gif in `folder`."""
    from barchan.results.cloth_pictures import picture, shaded_view
    from barchan.results.cloth_scenes import ClothScene
    from barchan.results.heap_pictures import draw_curves
    from barchan.results.solid_scenes import draw_animation, draw_strip, painter
    from barchan.scenes.kinds.cloth.making import build_obstacles

    title = parameters.scene.description or parameters.scene.name
    scene = ClothScene(build_obstacles(parameters), results, parameters.observe.colour)
    paint = painter(picture, shaded_view)
    draw_strip(folder / "cloth.png", scene, title, paint)
    draw_curves(folder / "curves.png", results.times, _panels(results), title)
    draw_animation(folder / "cloth.gif", scene, title, paint)


def _panels(results: Results) -> list[tuple[str, dict[str, Any]]]:
    """What is drawn over time: energies, speeds, contacts, sliding, places, spins, the solver."""
    found = results.observables
    return [
        ("energy (J)", {"kinetic": found["kinetic_energy"], "elastic": found["elastic_energy"]}),
        ("speed (m/s)", {"largest": found["max_speed"], "mean": found["mean_speed"]}),
        ("number", {"contacts": found["contacts"], "with itself": found["self_contacts"]}),
        ("share", {"of contacts that slide": found["sliding_share"]}),
        ("force (N)", {"normal, from bodies": found["normal_force"], "weight": found["weight"]}),
        ("height (m)", {name: found[key] for name, key in
                        (("centre of mass", "centre_z"), ("lowest", "lowest"), ("highest", "highest"))}),
        ("spin (rad/s)", {"hem": found["hem_spin"], "cloth": found["cloth_spin"]}),
        ("number", {"iterations of a step": found["sweeps"]}),
    ]  # fmt: skip


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """What was observed, and remarks."""
    centre = ", ".join(f"{summary[f'centre_{axis}']:.4g}" for axis in "xyz")
    return [
        ("contacts at the end, most of all", f"{summary['contacts']:.0f}, {summary['most_contacts']}"),
        ("sliding share at the end", f"{summary['sliding_share']:.2f}"),
        ("mean iterations of a step in contact", f"{summary['mean_sweeps']:.0f}"),
        ("deepest overlap of all", f"{summary['deepest_relative_of_all']:.2g} thicknesses"),
        ("centre of mass", f"{centre} m"),
        ("lowest, highest", f"{summary['lowest']:.4g} m, {summary['highest']:.4g} m"),
        ("spin of the hem", f"{summary['hem_spin']:.3g} rad/s"),
        ("largest stretch", f"{100.0 * summary['largest_stretch_of_all']:.2g} %"),
        ("at rest", "yes" if summary["at_rest"] else "no"),
        *(("remark", remark) for remark in summary["remarks"]),
    ]
