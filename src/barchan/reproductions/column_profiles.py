"""Profiles of a 3D column of aspect ratio 1.4 through time, final height and run-out (seed B, Fig. 7.16 and 7.5.1)."""

from __future__ import annotations

import math

import numpy as np

from barchan.reproductions.mpm_scenes import job, speed_panels, surface_at
from barchan.reproductions.workshop import Report, Table, Workshop, all_converged, new_figure

TITLE = "3D column of aspect ratio 1.4: profiles through time (seed B, Fig. 7.16)"

COARSE = {"box.cells": [20, 5, 10], "per_cell": 2, "time.end": 2.0}
PUBLISHED = {"height_ratio": 0.56, "run_out": 2.98}
MOMENTS = (0.0, 0.66, 1.3, 1.9, 2.6, 4.0)
"""In sqrt(H0 / g), about those of Lagree et al. 2011, Fig. 9."""


def reproduce(workshop: Workshop) -> Report:
    """One run of `collapse_3d`, its profiles at six instants."""
    (run,) = workshop.run([job("column", "collapse_3d", workshop.quick, COARSE, frame_rate=48.0)])
    column = run.results.scene["column"]
    unit = math.sqrt(column["height"] / run.results.scene["scene"]["gravity"])
    frames = [int(np.argmin(np.abs(run.results.times - moment * unit))) for moment in MOMENTS]
    figure = new_figure(9.0, 3.6)
    axis = figure.subplots()
    rows = []
    for moment, frame in [*zip(MOMENTS, frames, strict=True), (math.inf, run.results.frames - 1)]:
        surface = surface_at(run, frame)
        axis.plot(surface.x / column["length"], surface.height / column["height"], label=_words(moment))
        rows += [(moment, x, h) for x, h in zip(surface.x, surface.height, strict=True)]
    axis.set(xlabel="x / L0", ylabel="height / H0", ylim=(0.0, None))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    workshop.save("column_profiles.png", figure)
    workshop.write_csv("profiles.csv", ("t / sqrt(H0/g)", "x, m", "height, m"), rows)
    speed_panels(workshop, "column_speeds.png", [("", run, frame) for frame in frames[1:5]])
    ours = run.summary
    table = [
        (name, f"{theirs:.2f}", f"{ours[key]:.3f}", f"{100.0 * (ours[key] / theirs - 1.0):+.1f} %")
        for name, key, theirs in (
            ("H / H0", "height_ratio", PUBLISHED["height_ratio"]),
            ("(L - L0) / L0, farthest particle", "run_out", PUBLISHED["run_out"]),
            ("(L - L0) / L0, 99.5 % of the volume", "run_out_bulk", PUBLISHED["run_out"]),
        )
    ]
    return Report(
        [Table("final heap", ("", "published", "ours", "deviation"), table)], [], all_converged([run])
    )


def _words(moment: float) -> str:
    return "final" if math.isinf(moment) else f"t = {moment:g} sqrt(H0/g)"
