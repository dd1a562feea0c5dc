"""What a person is shown of a finished scene of bodies: pictures, an animation and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.bodies.parameters import BodiesParameters


def draw(parameters: BodiesParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """bodies.png, forces.png, curves.png and bodies.gif in `folder`."""
    from barchan.results.body_scenes import BodyScene
    from barchan.results.heap_pictures import draw_curves
    from barchan.scenes.kinds.bodies.building import build_bodies

    title = parameters.scene.description or parameters.scene.name
    scene = BodyScene(build_bodies(parameters), results, parameters.observe.colour)
    if parameters.dimension == 2:
        from barchan.results.body_pictures import draw_animation, draw_forces, draw_strip
    else:
        from barchan.results.body_solids import draw_animation, draw_forces, draw_strip
    draw_strip(folder / "bodies.png", scene, title)
    draw_forces(folder / "forces.png", scene, title)
    draw_curves(folder / "curves.png", results.times, _panels(parameters, results), title)
    draw_animation(folder / "bodies.gif", scene, title)


def _panels(parameters: BodiesParameters, results: Results) -> list[tuple[str, dict[str, Any]]]:
    """What is drawn over time: energies, contacts, places, speeds, what [observe] asks for, followed bodies."""
    found = results.observables
    unit = "J/m" if parameters.dimension == 2 else "J"
    energies = {
        "kinetic": "kinetic_energy", "elastic": "elastic_energy", "lost in contacts": "dissipated_energy",
    }  # fmt: skip
    panels: list[tuple[str, dict[str, Any]]] = [
        (f"energy ({unit})", {words: found[key] for words, key in energies.items() if key in found}),
        ("speed (m/s)", {"largest": found["max_speed"]}),
        ("number", {"contacts": found["contacts"]}),
        ("mean number", {"touched bodies": found["coordination"]}),
        ("displacement / size", {"largest since the start": found["displacement_relative"]}),
    ]
    asked: dict[str, dict[str, str]] = {
        "length (m)": {"front of 99.5 % of the mass": "front_bulk"},
        "mass (kg)": {"above the level": "mass_above"},
        "slope (degrees)": {"surface": "surface_angle"},
        "sliding (m/s)": {"block": "sliding_speed", "g (sin a - mu cos a) t": "sliding_speed_exact"},
        "friction": {"|Dev sigma| / p": "friction", "volume fraction": "volume_fraction"},
    }
    for label, curves in asked.items():
        shown = {words: found[key] for words, key in curves.items() if key in found}
        panels += [(label, shown)] if shown else []
    free = [name for name, body in parameters.single_bodies() if body.motion == "free"]
    axes = "xz" if parameters.dimension == 2 else "xyz"
    if 0 < len(free) <= 6:
        panels.append(
            ("speed (m/s)", {f"{name} v{axis}": found[f"{name}_v{axis}"] for name in free for axis in axes})
        )
    return panels


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """What was observed, whether the bodies are at rest, and remarks."""
    shown = [
        ("contacts, touched bodies a body", f"{summary['contacts']:.0f}, {summary['coordination']:.2f}"),
        (
            "deepest overlap of all",
            f"{100.0 * summary['deepest_relative_of_all']:.2g} % of the smallest half size",
        ),
        (
            "largest displacement",
            f"{summary['displacement']:.3g} m, {summary['displacement_relative']:.2g} sizes",
        ),
        ("top, front", f"{summary['top']:.4g} m, {summary['front']:.4g} m"),
    ]
    if "run_out" in summary:
        shown.append(
            ("run-out (L - L0)/L0", f"{summary['run_out']:.3g} (bulk {summary['run_out_bulk']:.3g})")
        )
        shown.append(("height H/H0", f"{summary['height_ratio']:.3g}"))
    if "surface_angle" in summary:
        shown.append(("slope of the surface", f"{summary['surface_angle']:.1f} degrees"))
    if "sliding_speed" in summary:
        shown.append(
            (
                "sliding speed",
                f"{summary['sliding_speed']:.9g} m/s, exact {summary['sliding_speed_exact']:.9g}",
            )
        )
    if summary.get("discharge") is not None:
        shown.append(
            ("discharge", f"{summary['discharge']:.4g} +- {100.0 * summary['discharge_variation']:.1f} %")
        )
    if "inertial_number" in summary:
        shown.append(("mu, I at the end", f"{summary['friction']:.3f}, {summary['inertial_number']:.3g}"))
    rest = f"from t = {summary['duration']:.3g} s" if summary["duration"] is not None else "no"
    shown.append(("at rest", rest))
    return [*shown, *(("remark", remark) for remark in summary["remarks"])]
