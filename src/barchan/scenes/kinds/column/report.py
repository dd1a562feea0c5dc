"""What a person is shown of a finished column: pictures and the first figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from barchan.results import Results
from barchan.scenes.kinds.column.observables import surface_of
from barchan.scenes.kinds.column.parameters import ColumnParameters


def draw(parameters: ColumnParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """strip.png, profile.png, observables.png and collapse.gif in `folder`."""
    from barchan.results.animation import draw_animation
    from barchan.results.pictures import draw_observables, draw_profile, draw_strip

    title = parameters.scene.description or parameters.scene.name
    until = _end_of_motion(results)
    draw_strip(folder / "strip.png", results, until, title)
    initial, final = (
        surface_of(parameters, results.particles(frame)["positions"], results.particles(frame)["volumes"])
        for frame in (0, -1)
    )
    verdict = (
        f"{title}\nrun-out (L - L0)/L0 = {summary['run_out']:.2f}, "
        f"height H/H0 = {summary['height_ratio']:.2f}, steepest slope {summary['slope_steepest']:.0f}°"
    )
    box = (parameters.box.size[0], parameters.box.size[-1])
    draw_profile(folder / "profile.png", initial.x, initial.height, final.height, box, verdict)
    draw_observables(
        folder / "observables.png", results.steps, results.observables, parameters.dimension, title
    )
    draw_animation(folder / "collapse.gif", results, until, title)


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Run-out, heights, slopes and whether the material is at rest."""
    rest = f"from t = {summary['duration']:.3g} s" if summary["duration"] is not None else "no"
    return [
        ("front", f"{summary['front']:.4g} m, 99.5 % of the volume {summary['front_bulk']:.4g} m"),
        ("run-out (L - L0)/L0", f"{summary['run_out']:.3g} (bulk {summary['run_out_bulk']:.3g})"),
        ("height H/H0", f"{summary['height_ratio']:.3g}"),
        ("steepest, mean slope", f"{summary['slope_steepest']:.1f}, {summary['slope_mean']:.1f} degrees"),
        ("at rest", rest),
        ("volume drift", f"{summary['volume_drift']:.1e}"),
        ("largest volume fraction", f"{summary['largest_volume_fraction']:.3f}"),
    ]


def _end_of_motion(results: Results) -> float:
    """Time (s) after which the bulk of the front moves by less than 1 % of its whole way, at least a tenth of the run."""
    front, times = results.observables["front_bulk"], results.times
    far = abs(front - front[-1]) > 0.01 * max(abs(front[-1] - front[0]), 1e-12)
    last = int(far.nonzero()[0][-1]) + 1 if far.any() else 0
    return float(max(times[min(last, len(times) - 1)], 0.1 * times[-1]))
