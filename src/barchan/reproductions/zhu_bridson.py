"""The column collapse of Zhu and Bridson (2005), simulated again (seed B, Fig. 7.17)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.mpm_scenes import heights_at, job, speed_panels
from barchan.reproductions.workshop import Report, Table, Workshop, all_converged, new_figure

TITLE = "The sand column of Zhu and Bridson (seed B, Fig. 7.17)"

COARSE = {"box.cells": [30, 30, 15], "per_cell": 2, "time.end": 0.8}
SHARES = (0.15, 0.3, 0.6, 1.0)
"""Of the run, at which it is shown."""


def reproduce(workshop: Workshop) -> Report:
    """One run of `zb05`, seen from the side and from above at four instants."""
    (run,) = workshop.run([job("zb05", "zb05", workshop.quick, COARSE)])
    last = run.results.frames - 1
    frames = [round(share * last) for share in SHARES]
    speed_panels(workshop, "zhu_bridson_side.png", [("", run, frame) for frame in frames])
    figure = new_figure(3.6 * len(frames), 3.8)
    for axis, frame in zip(np.atleast_1d(figure.subplots(1, len(frames))), frames, strict=True):
        heights = heights_at(run, frame)
        axis.contourf(heights.x, heights.y, heights.height.T, levels=12)
        axis.set(aspect="equal")
        axis.set_title(f"t = {run.results.times[frame]:.2f} s", fontsize=9, loc="left")
    workshop.save("zhu_bridson_above.png", figure)
    summary = run.summary
    rows = [
        ("particles", f"{summary['most_particles']}"),
        ("active nodes", f"{summary['most_active_nodes']}"),
        ("mean radius of the heap, m", f"{summary['outline_radius']:.3f}"),
        ("largest / smallest radius", f"{summary['outline_circularity']:.3f}"),
        ("height, m", f"{summary['surface_highest']:.3f}"),
    ]
    notes = ["Seed B prints frames only; the block's corners have gone when the heap is round."]
    return Report([Table("the heap at the end", ("", "ours"), rows)], notes, all_converged([run]))
