"""What a person is shown of finished grains inside a fluid: pictures, an animation and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from barchan.results import Results
from barchan.scenes.kinds.suspension.parameters import SuspensionParameters

_ENERGIES = {
    "kinetic_grains": "grains, kinetic",
    "kinetic_fluid": "fluid, kinetic",
    "lost": "potential, lost since the start",
}
_PLACES = {
    "front_bulk": "front of 99.5 % of the grains",
    "top_bulk": "top of 99.5 % of the grains",
    "centre_z": "height of their centre",
}
_INSTANTS = 5


def draw(parameters: SuspensionParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """phases.png, layers.png, curves.png and suspension.gif in `folder`; of a column profile.png, in 3D solid.png."""
    from barchan.results.heap_pictures import draw_curves
    from barchan.results.suspension_animation import draw_suspension_animation
    from barchan.results.suspension_pictures import draw_layers, draw_phases, draw_solid
    from barchan.results.view import spread_frames
    from barchan.scenes.kinds.suspension.profiles import at_rest

    title = parameters.scene.description or parameters.scene.name
    until = float(results.times[-1])
    draw_phases(folder / "phases.png", results, until, title)
    frames = spread_frames(results, _INSTANTS, until)
    shown = [(f"t = {results.times[frame]:.3g} s", results.lines(frame)) for frame in frames]
    theory = at_rest(parameters, shown[-1][1], summary["volume"])
    exact = {name: {"packed at rest": values} for name, values in theory.items()}
    draw_layers(folder / "layers.png", shown, exact, title)
    draw_curves(folder / "curves.png", results.times, _panels(parameters, results), title)
    if parameters.observe.length is not None:
        _draw_profile(parameters, results, summary, folder, title)
    if parameters.dimension == 3:
        draw_solid(folder / "solid.png", results, until, title)
    draw_suspension_animation(folder / "suspension.gif", results, until, title)


def _panels(parameters: SuspensionParameters, results: Results) -> list[tuple[str, dict[str, Any]]]:
    """What is drawn over time: energies, places, speeds, the amplitude of the interface."""
    found = dict(results.observables)
    found["lost"] = found["potential_energy"][0] - found["potential_energy"]
    unit = "J/m" if parameters.dimension == 2 else "J"
    panels: list[tuple[str, dict[str, Any]]] = [
        (f"energy ({unit})", {words: found[name] for name, words in _ENERGIES.items()}),
        ("length (m)", {words: found[name] for name, words in _PLACES.items()}),
        (
            "largest speed (m/s)",
            {"grains": found["max_speed"], "fluid": found["max_fluid_speed"]},
        ),
    ]
    if "ripple" in found:
        panels.append(("amplitude (m)", {"wave of the interface": np.abs(found["ripple"])}))
    return panels


def _draw_profile(
    parameters: SuspensionParameters, results: Results, summary: dict[str, Any], folder: Path, title: str
) -> None:
    """The free surface over x at the start and at the end."""
    from barchan.results.pictures import draw_profile
    from barchan.scenes.kinds.suspension.observables import surface_of

    box = parameters.box
    initial, final = (
        surface_of(parameters, results.particles(frame)["positions"], results.particles(frame)["volumes"])
        for frame in (0, -1)
    )
    verdict = f"{title}\nrun-out (L - L0)/L0 = {summary['run_out']:.2f}, height H/H0 = {summary['height_ratio']:.2f}"
    draw_profile(
        folder / "profile.png", initial.x, initial.height, final.height, (box.size[0], box.size[-1]), verdict
    )


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Dimensionless numbers, what was observed, and remarks."""
    shown = [
        (
            "Re, St, D/L, alpha",
            f"{summary['reynolds_number']:.3g}, {summary['stokes_number']:.3g}, "
            f"{summary['grain_size_over_length']:.3g}, {summary['relative_density_excess']:.4g}",
        ),
        ("T_v / T_c", f"{summary['viscous_time_over_contact_time']:.3g}"),
    ]
    if "run_out" in summary:
        shown.append(
            ("run-out (L - L0)/L0", f"{summary['run_out']:.3g} (bulk {summary['run_out_bulk']:.3g})")
        )
        shown.append(("height H/H0", f"{summary['height_ratio']:.3g}"))
    settled = summary["settling_time"]
    words = "no" if settled is None else f"after {settled:.3g} s"
    if summary["settling_duration"] is not None:
        words += f", {summary['settling_duration']:.3g} H / sqrt(alpha / (alpha + 1) g H)"
    shown += [
        ("grains have settled", words),
        (
            "pore pressure off hydrostatic",
            f"{100.0 * summary['pressure_deviation']:.3g} % of that at the floor",
        ),
        ("contact stress off weight", f"{100.0 * summary['stress_deviation']:.3g} % of that at the floor"),
        (
            "largest rise of the energy",
            f"{summary['largest_energy_rise']:.1e} of the weight times the height",
        ),
        ("largest divergence", f"{summary['largest_divergence']:.1e} / s"),
    ]
    return [*shown, *(("remark", remark) for remark in summary["remarks"])]
