"""A ball hits a cohesive tower: multilinear stresses with decaying cohesion beside particle-based ones (seed B, Fig. 7.22)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.mpm_scenes import job, speed_panels
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged

TITLE = "A ball knocks down a cohesive tower, two stress spaces (seed B, Fig. 7.22)"

COARSE = {"box.cells": [20, 20, 10], "time.end": 0.25, "time.frame_rate": 40.0}
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("Q1 stresses, decaying cohesion", {}),
    (
        "particle stresses, lasting cohesion",
        {"particles.stress": "particles", "material.cohesion_decay": 0.0, "solver.method": "apgd"},
    ),
)
SHARES = (0.15, 0.4, 1.0)
"""Of the run, at which it is shown."""


def reproduce(workshop: Workshop) -> Report:
    """Both variants of the figure."""
    runs = workshop.run([
        job("q1" if not overrides else "particles", "tower", workshop.quick, COARSE, **overrides)
        for _, overrides in CASES
    ])  # fmt: skip
    rows = [
        (
            name, f"{run.summary['top']:.3f}", f"{100.0 * _standing(run):.0f} %", f"{run.summary['ball_vx']:.2f}",
            f"{run.summary['ball_x']:.3f}",
        )
        for (name, _), run in zip(CASES, runs, strict=True)
    ]  # fmt: skip
    columns = ("variant", "top, m", "share above half the height", "speed of the ball, m/s", "its x, m")
    workshop.write_csv("tower.csv", columns, rows)
    for (name, _), run in zip(CASES, runs, strict=True):
        frames = [round(share * (run.results.frames - 1)) for share in SHARES]
        file = "tower_q1.png" if run is runs[0] else "tower_particles.png"
        speed_panels(workshop, file, [(name, run, frame) for frame in frames])
    notes = ["Seed B: particle-based stresses retain sharper features of the tower."]
    return Report([Table("the tower at the end", columns, rows)], notes, all_converged(runs))


def _standing(run: Finished) -> float:
    """Share of the volume above half of the height of the tower at the start."""
    start, end = run.results.particles(0), run.results.particles(-1)
    level = 0.5 * float(np.max(start["positions"][:, 2]))
    above = end["positions"][:, 2] > level
    return float(np.sum(end["volumes"][above]) / np.sum(end["volumes"]))
