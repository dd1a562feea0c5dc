"""A column collapses in air, in water, in a viscous fluid, and there with triple grains (seed B, Fig. 8.5-8.6)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.suspension_runs import frame_at, job, phase_panels
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure

TITLE = "Columns of grains in air, water and a viscous fluid, and of triple grains (seed B, Fig. 8.5-8.6)"

COARSE = {"box.cells": [50, 26], "per_cell": 2, "time.step": 0.004}
GRID: dict[str, Any] = {"box.cells": [70, 36]}
"""Of all four: the widest grains need cells of 3 mm."""
SLOW: dict[str, Any] = {
    "time.end": 6.0, "time.frame_rate": 20.0, "time.step": 0.004, "solver.method": "proximal_newton"
}  # fmt: skip
"""Grains part from a viscous fluid so slowly that sweeps, which meet its constraint in turn with contacts, stall."""
FLUIDS: dict[str, dict[str, Any]] = {
    "air": {"fluid.density": 1.0, "fluid.viscosity": 1e-5, **GRID},
    "water": {"fluid.density": 1000.0, "fluid.viscosity": 1e-3, **GRID},
    "viscous": {"fluid.density": 1000.0, "fluid.viscosity": 1.0, **SLOW, **GRID},
    "triple": {"fluid.density": 1000.0, "fluid.viscosity": 1.0, "grains.diameter": 3e-3, **SLOW, **GRID},
}
PAIR = ("viscous", "triple")
MOMENTS = (0.1, 0.25, 0.5, 1.5)
"""Of the snapshots (s)."""
REACHED = 0.95
"""Share of the final run-out whose time is given."""


def reproduce(workshop: Workshop) -> Report:
    """Four columns on one grid."""
    runs = dict(
        zip(
            FLUIDS,
            workshop.run([
                job(label.replace(", ", "-").replace(" ", "-"), "immersed_column", workshop.quick, COARSE, **overrides)
                for label, overrides in FLUIDS.items()
            ]),
            strict=True,
        )
    )  # fmt: skip
    rows = [
        (
            label, f"{run.summary['run_out']:.2f}", f"{run.summary['run_out_bulk']:.2f}",
            f"{run.summary['height_ratio']:.2f}", f"{reached_at(run):.2f}",
            f"{run.summary['viscous_time_over_contact_time']:.2g}", f"{run.summary['stokes_number']:.2g}",
            f"{run.summary['largest_energy_rise']:.1e}",
        )
        for label, run in runs.items()
    ]  # fmt: skip
    columns = (
        "column", "run-out", "run-out of the bulk", "H / H0", "95 % of the way at, s", "T_v / T_c", "St",
        "largest rise of the energy",
    )  # fmt: skip
    workshop.write_csv("columns.csv", columns, rows)
    _draw(workshop, runs)
    shown = [
        [(label, runs[label], frame_at(runs[label], moment)) for moment in MOMENTS]
        for label in ("air", "water", "viscous")
    ]
    phase_panels(workshop, "columns.png", shown, panel=3.4, same_scale=False)
    slow = (0.25, 0.75, 2.0, 6.0)
    phase_panels(
        workshop, "triple.png",
        [[(label, runs[label], frame_at(runs[label], moment)) for moment in slow] for label in PAIR], panel=3.4,
    )  # fmt: skip
    return Report(
        [Table("final columns", columns, rows), _order(runs)], [], all_converged(list(runs.values()))
    )


def reached_at(run: Finished) -> float:
    """When the front of the bulk has made `REACHED` of its way for the first time (s)."""
    front, times = run.observables["front_bulk"], run.observables["time"]
    way = front - front[0]
    return float(times[int(np.argmax(way >= REACHED * way[-1]))])


def _order(runs: dict[str, Finished]) -> Table:
    """What the seed says of the four columns, and whether it is so here."""
    out = {label: run.summary["run_out_bulk"] for label, run in runs.items()}
    when = {label: reached_at(run) for label, run in runs.items()}
    far = "{:.2f} and {:.2f} L0"
    soon = "{:.2f} and {:.2f} s"
    fast = max(when["water"], when["air"])
    claims = [
        (
            "water goes as far as air, or farther",
            far.format(out["water"], out["air"]),
            out["water"] >= out["air"],
        ),
        (
            "the viscous fluid slows the collapse",
            soon.format(when["viscous"], fast),
            when["viscous"] > 1.5 * fast,
        ),
        (
            "and hardly shortens it",
            far.format(out["viscous"], out["water"]),
            out["viscous"] >= 0.75 * out["water"],
        ),
        (
            "triple grains stop earlier",
            far.format(out["triple"], out["viscous"]),
            out["triple"] < out["viscous"],
        ),
        ("and sooner", soon.format(when["triple"], when["viscous"]), when["triple"] < when["viscous"]),
    ]
    rows = [(words, figures, "yes" if true else "no") for words, figures, true in claims]
    return Table("seed B, 8.4.3", ("", "this and that", "here"), rows)


def _draw(workshop: Workshop, runs: dict[str, Finished]) -> None:
    figure = new_figure(9.5, 4.2)
    early, whole = figure.subplots(1, 2, sharey=True)
    for label, run in runs.items():
        for axis in (early, whole):
            axis.plot(run.observables["time"], run.observables["run_out_bulk"], label=label)
    early.set(xlim=(0.0, 1.5), xlabel="time (s)", ylabel="run-out (L - L0) / L0 of 99.5 % of the grains")
    whole.set(xlabel="time (s)")
    for axis in (early, whole):
        axis.grid(alpha=0.3)
    whole.legend(fontsize=8)
    workshop.save("fronts.png", figure)
