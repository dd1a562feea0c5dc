"""The 3D column of flat grains: isotropic, random and aligned orientations at the start (seed B, Fig. 7.15)."""

from __future__ import annotations

from typing import Any

from barchan.reproductions.mpm_scenes import draw_surfaces, job, speed_panels
from barchan.reproductions.workshop import Report, Table, Workshop, all_converged

TITLE = "Anisotropic column collapse: profiles and velocities (seed B, Fig. 7.15)"

COARSE = {"box.cells": [20, 5, 10], "per_cell": 2, "time.end": 1.2, "time.frame_rate": 10.0}
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("isotropic", {"material.anisotropy": 0.0}),
    ("random at the start", {}),
    ("aligned at the start", {"matter.column.orientation": "aligned"}),
)


def reproduce(workshop: Workshop) -> Report:
    """Friction 0.48, anisotropy 0.8, until t = 2.75 s."""
    runs = workshop.run([
        job(name.partition(" ")[0], "collapse_anisotropic", workshop.quick, COARSE, **overrides)
        for name, overrides in CASES
    ])  # fmt: skip
    named = [(name, run) for (name, _), run in zip(CASES, runs, strict=True)]
    rows = [
        (
            name, f"{run.summary['run_out']:.2f}", f"{run.summary['run_out_bulk']:.2f}",
            f"{run.summary['height_ratio']:.2f}", f"{run.summary['slope_mean']:.1f}",
        )
        for name, run in named
    ]  # fmt: skip
    columns = ("orientations", "run-out", "run-out of the bulk", "H / H0", "mean slope, degrees")
    workshop.write_csv("anisotropy.csv", columns, rows)
    draw_surfaces(workshop, "anisotropy_profiles.png", named)
    speed_panels(
        workshop, "anisotropy_speeds.png", [(name, run, run.results.frames // 3) for name, run in named]
    )
    notes = [
        "Seed B: random orientations give a longer run-out than isotropic friction, since grains turn into the flow."
    ]
    return Report([Table("columns of flat grains", columns, rows)], notes, all_converged(runs))
