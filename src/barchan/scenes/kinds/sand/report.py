"""What a person is shown of a finished scene of kind "sand": pictures, an animation and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.sand.parameters import SandParameters

_ENERGIES = {"kinetic_energy": "grains, kinetic", "bodies_kinetic_energy": "bodies, kinetic"}
_PLACES = {
    "front": "front, farthest particle",
    "front_bulk": "front of 99.5 % of the volume",
    "height": "greatest height",
    "outline_radius": "mean radius of the outline",
}


def draw(parameters: SandParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """section.png, pressure.png, curves.png and sand.gif in `folder`; in 3D above.png, of a column profile.png."""
    from barchan.results.heap_animation import draw_heap_animation
    from barchan.results.heap_pictures import draw_curves, draw_field, draw_reliefs, draw_sections
    from barchan.results.heaps import HeightMap
    from barchan.scenes.kinds.sand.motion import build_bodies
    from barchan.scenes.kinds.sand.observables import heights_of
    from barchan.scenes.kinds.sand.silhouettes import BodyViews

    title = parameters.scene.description or parameters.scene.name
    views = BodyViews(parameters, build_bodies(parameters), results)
    until = float(results.times[-1])

    def heights(frame: int) -> HeightMap:
        particles = results.particles(frame)
        return heights_of(parameters, particles["positions"], particles["volumes"])

    draw_sections(folder / "section.png", results, views.section, until, title)
    draw_field(folder / "pressure.png", results, "pressures", "pressure (Pa)", views.section, title)
    draw_curves(folder / "curves.png", results.times, _panels(parameters, results), title)
    above = None
    if parameters.dimension == 3:
        above = (heights, views.above)
        outline = _outline(parameters, heights(results.frames - 1))
        draw_reliefs(folder / "above.png", results, heights, views.above, until, title, outline)
    if parameters.observe.length is not None:
        _draw_profile(parameters, results, summary, folder, title)
    draw_heap_animation(folder / "sand.gif", results, views.section, above, until, title)


def _outline(parameters: SandParameters, heights: Any) -> Any:
    """Centre and line of the outline of the last frame, where one is observed."""
    from barchan.results.heaps import outline_of
    from barchan.scenes.kinds.sand.observables import outline_centre, outline_level

    kind = parameters.observe.outline
    if kind == "none":
        return None
    centre = outline_centre(parameters)
    return centre, outline_of(heights, centre, outline_level(parameters), kind)


def _draw_profile(
    parameters: SandParameters, results: Results, summary: dict[str, Any], folder: Path, title: str
) -> None:
    """The free surface over x at the start and at the end."""
    from barchan.results.pictures import draw_profile
    from barchan.scenes.granular.surface import free_surface
    from barchan.scenes.kinds.sand.observables import packed

    box = parameters.box
    initial, final = (
        free_surface(
            results.particles(frame)["positions"], results.particles(frame)["volumes"], box.size, box.cells,
            packed(parameters),
        )
        for frame in (0, -1)
    )  # fmt: skip
    verdict = f"{title}\nrun-out (L - L0)/L0 = {summary['run_out']:.2f}, height H/H0 = {summary['height_ratio']:.2f}"
    draw_profile(
        folder / "profile.png", initial.x, initial.height, final.height, (box.size[0], box.size[-1]), verdict
    )


def _panels(parameters: SandParameters, results: Results) -> list[tuple[str, dict[str, Any]]]:
    """What is drawn over time: energies, places, volumes, momenta, the bodies' positions and speeds."""
    found = results.observables
    unit = "J/m" if parameters.dimension == 2 else "J"
    bodies = [name for name, body in parameters.body_tables() if body.motion != "fixed"]
    axes = "xz" if parameters.dimension == 2 else "xyz"
    momenta = "total_momentum_" if "total_momentum_x" in found else "momentum_"
    panels = [
        (f"energy ({unit})", {words: found[key] for key, words in _ENERGIES.items() if key in found}),
        ("place (m)", {words: found[key] for key, words in _PLACES.items() if key in found}),
        ("momentum", {f"{axis}": found[f"{momenta}{axis}"] for axis in axes}),
        ("bodies (m)", {f"{name} {axis}": found[f"{name}_{axis}"] for name in bodies for axis in axes}),
        ("bodies (m/s)", {f"{name} v{axis}": found[f"{name}_v{axis}"] for name in bodies for axis in axes}),
    ]
    if "volume_above" in found:
        share = found["volume_above"] / found["volume_above"][0]
        panels.insert(2, ("share left", {"volume above the level": share}))
    if "outline_circularity" in found:
        panels.insert(2, ("outline", {"largest over smallest radius": found["outline_circularity"]}))
    return panels


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """What was observed, whether the material is at rest, and remarks."""
    shown = [("largest volume fraction", f"{summary['largest_volume_fraction']:.3f}")]
    if "run_out" in summary:
        shown.append(
            ("run-out (L - L0)/L0", f"{summary['run_out']:.3g} (bulk {summary['run_out_bulk']:.3g})")
        )
        shown.append(("height H/H0", f"{summary['height_ratio']:.3g}"))
    if summary.get("discharge") is not None:
        shown.append(
            ("discharge", f"{summary['discharge']:.4g} +- {100.0 * summary['discharge_variation']:.1f} %")
        )
    if "outline_circularity" in summary:
        shown.append(("outline, mean radius", f"{summary['outline_radius']:.4g} m"))
        shown.append(("largest over smallest radius", f"{summary['outline_circularity']:.4f}"))
    if "momentum_drift" in summary:
        shown.append(("momentum drift", f"{summary['momentum_drift']:.1e}"))
    rest = f"from t = {summary['duration']:.3g} s" if summary["duration"] is not None else "no"
    shown.append(("at rest", rest))
    return [*shown, *(("remark", remark) for remark in summary["remarks"])]
