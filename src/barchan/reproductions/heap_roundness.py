"""Round heaps and craters: the exact cone beside the faceted yield surface (seed B, Fig. 7.1 and 7.7)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.mpm_scenes import heights_at, job
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure
from barchan.results.heaps import HeightMap, outline_of

TITLE = "A round column collapses: exact cone and faceted yield surface (seed B, Fig. 7.1)"

COARSE = {"box.cells": [30, 30, 8], "time.end": 0.9}
FRICTION = 0.6
"""Caption of Fig. 7.1; the parameters of the scene give 0.5."""


def reproduce(workshop: Workshop) -> Report:
    """The same column with both yield surfaces."""
    runs = workshop.run([
        job("exact", "cylinder_collapse", workshop.quick, COARSE, friction=FRICTION),
        job("faceted", "cylinder_collapse", workshop.quick, COARSE, friction=FRICTION, faceted=True),
    ])  # fmt: skip
    names = ("exact cone", "faceted")
    rows = [
        (
            name, f"{run.summary['outline_radius']:.4f}", f"{run.summary['outline_circularity']:.4f}",
            f"{100.0 * run.summary['outline_fourfold']:.2f} %", f"{run.summary['surface_highest']:.4f}",
        )
        for name, run in zip(names, runs, strict=True)
    ]  # fmt: skip
    columns = ("yield surface", "mean radius, m", "largest / smallest radius", "fourfold wave", "height, m")
    workshop.write_csv("roundness.csv", columns, rows)
    _draw(workshop, list(zip(names, runs, strict=True)))
    notes = [
        "Round within 2 % means a ratio of at most 1.02; the fourfold wave is the amplitude of cos 4 theta in the radius.",
        "With the largest component instead of the norm, friction ranges from mu to sqrt(5) mu with the direction of flow.",
    ]
    return Report([Table("final heaps", columns, rows)], notes, all_converged(runs))


def _draw(workshop: Workshop, runs: list[tuple[str, Finished]]) -> None:
    figure = new_figure(4.6 * len(runs), 4.6)
    for axis, (name, run) in zip(np.atleast_1d(figure.subplots(1, len(runs))), runs, strict=True):
        heights = heights_at(run, -1)
        axis.contourf(heights.x, heights.y, heights.height.T, levels=14)
        line = outline_of(heights, (0.5, 0.5), _edge(heights), "heap")
        x, y = 0.5 + line.radii * np.cos(line.angles), 0.5 + line.radii * np.sin(line.angles)
        axis.plot(x, y, color="tab:red", linewidth=1.0)
        axis.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
        axis.set_title(f"{name}: {line.circularity:.3f}", fontsize=9, loc="left")
    workshop.save("heap_roundness.png", figure)


def _edge(heights: HeightMap) -> float:
    """The height at which the scene takes its outline: an edge of a cell of the floor (m)."""
    return float(max(heights.x[1], heights.y[1]))
