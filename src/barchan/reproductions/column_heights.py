"""Final heaps of a 3D column for several friction laws: mu sets the slope, mu_D the spread (seed B, Fig. 7.14)."""

from __future__ import annotations

from barchan.reproductions.mpm_scenes import draw_surfaces, job
from barchan.reproductions.workshop import Report, Table, Workshop, all_converged

TITLE = "3D column collapse: slope and spread against friction (seed B, Fig. 7.14)"

COARSE = {"box.cells": [20, 5, 10], "per_cell": 2, "time.end": 2.0, "time.frame_rate": 6.0}
LAWS = (  # mu, mu_D - mu
    (0.26, 0.0),
    (0.26, 0.22),
    (0.48, 0.0),
    (0.48, 0.22),
)


def reproduce(workshop: Workshop) -> Report:
    """Constant friction 0.26 and 0.48, and each growing by 0.22 in rapid flow."""
    labels = [f"mu{mu:g}-increment{increment:g}" for mu, increment in LAWS]
    runs = workshop.run([
        job(label, "collapse_3d", workshop.quick, COARSE, friction=mu, friction_increment=increment)
        for label, (mu, increment) in zip(labels, LAWS, strict=True)
    ])  # fmt: skip
    rows = [
        (
            f"{mu:g}", f"{mu + increment:g}", f"{run.summary['run_out']:.2f}", f"{run.summary['run_out_bulk']:.2f}",
            f"{run.summary['height_ratio']:.2f}", f"{run.summary['slope_mean']:.1f}",
        )
        for (mu, increment), run in zip(LAWS, runs, strict=True)
    ]  # fmt: skip
    columns = ("mu", "mu_D", "run-out", "run-out of the bulk", "H / H0", "mean slope, degrees")
    workshop.write_csv("columns.csv", columns, rows)
    words = [f"mu = {mu:g}, mu_D = {mu + increment:g}" for mu, increment in LAWS]
    draw_surfaces(workshop, "column_heights.png", list(zip(words, runs, strict=True)))
    notes = [
        "Seed B prints pictures only: a higher mu gives a steeper heap, a higher mu_D a shorter spread at the same slope."
    ]
    return Report([Table("final heaps", columns, rows)], notes, all_converged(runs))
