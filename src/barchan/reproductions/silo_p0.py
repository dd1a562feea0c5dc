"""The hourglass effect: matter left in an emptying silo over time, by the mesh-based model (seed B, Fig. 7.5)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure
from barchan.scenes.kinds.dry_p0.report import HOURGLASS, discharge_by_tenths

TITLE = "Emptying of a silo on a mesh: the hourglass effect (seed B, Fig. 7.5)"

FRICTIONS = (0.0, 0.3, 0.5)
CELLS, QUICK_CELLS = 12, 6
"""Cells on the unit of length; the half outlet is half of it."""
CONSTANT = 0.05
"""A discharge is constant when it stays within this share of its mean."""


def reproduce(workshop: Workshop) -> Report:
    """One silo for each friction coefficient; discharges while each tenth of the matter leaves."""
    cells = QUICK_CELLS if workshop.quick else CELLS
    runs = workshop.run([_job(mu, cells) for mu in FRICTIONS])
    rows, table = [], []
    for mu, run in zip(FRICTIONS, runs, strict=True):
        rates, start = _rates(run), float(run.observables["volume"][0])
        rows.append((mu, *(2.0 * rates)))
        spread = float(np.max(np.abs(rates / np.mean(rates) - 1.0)))
        verdict = "constant" if spread <= CONSTANT else "decreasing" if rates[-1] < rates[0] else "growing"
        table.append((
            f"{mu:g}", f"{2.0 * rates.mean():.3f}", f"{2.0 * rates[0]:.3f}", f"{2.0 * rates[-1]:.3f}",
            f"{100.0 * spread:.1f} %", verdict, "decreasing" if mu == 0.0 else "constant",
            f"{final_share(mu, run):.3f}", f"{run.summary['volume'] / start:.3f}",
        ))  # fmt: skip
    workshop.write_csv(
        "discharge.csv", ("mu", *(f"to_{share:.1f}" for share in np.arange(0.8, 0.15, -0.1))), rows
    )
    _draw(workshop, runs)
    columns = (
        "mu", "discharge", "0.9 to 0.8 V0", "0.3 to 0.2 V0", "largest deviation", "ours", "seed B", "wedge / V0",
        "V / V0 at the end",
    )  # fmt: skip
    notes = [
        "Discharges of the whole silo in units of sqrt(g D^3), over tenths of V0 from 0.9 V0 to 0.2 V0; seed B draws "
        "curves and prints no numbers. Wedge: what stays at the rest angle (dashed lines); the end is at 0.1 V0.",
        f"Matter inside and gone conserved to {max(run.summary['volume_drift'] for run in runs):.1e}; volume fractions up to "
        f"{max(run.summary['max_volume_fraction'] for run in runs):.9g}.",
    ]
    return Report([Table("discharge of the silo", columns, table)], notes, all_converged(runs))


def final_share(mu: float, run: Finished) -> float:
    """Share of the matter in the wedge beside the outlet at the Mohr-Coulomb rest angle (mu is its sine in the plane)."""
    scene = run.results.scene
    beside = scene["mesh"]["size"][0] - scene["outlet"]["width"]
    slope = mu / np.sqrt(1.0 - mu**2)
    return float(0.5 * slope * beside**2 / (scene["fill"]["length"] * scene["fill"]["height"]))


def _job(mu: float, cells: int) -> Job:
    return Job(f"mu{mu:g}", "silo_p0", {"material.friction": mu, "mesh.cells": [2 * cells, 8 * cells]})


def _rates(run: Finished) -> np.ndarray:
    """(7,) discharge of half of the silo over the tenths; NaN when it has not come so far."""
    steps = run.results.steps
    rates = discharge_by_tenths(steps["time"], steps["volume"], float(run.observables["volume"][0]))
    return rates if len(rates) else np.full(round(10 * (HOURGLASS[0] - HOURGLASS[1])), np.nan)


def _draw(workshop: Workshop, runs: list[Finished]) -> None:
    figure = new_figure(10.0, 4.2)
    volume, discharge = figure.subplots(1, 2)
    for mu, run in zip(FRICTIONS, runs, strict=True):
        steps, start = run.results.steps, float(run.observables["volume"][0])
        (line,) = volume.plot(steps["time"], steps["volume"] / start, label=f"mu = {mu:g}")
        volume.axhline(final_share(mu, run), linestyle="--", linewidth=0.8, color=line.get_color())
        discharge.plot(
            np.arange(0.85, 0.2, -0.1), 2.0 * _rates(run), "o-", color=line.get_color(), label=f"mu = {mu:g}"
        )
    volume.set(xlabel="t / sqrt(D / g)", ylabel="V / V0", ylim=(0.0, 1.0))
    discharge.set(xlabel="V / V0", ylabel="discharge / sqrt(g D^3)", ylim=(0.0, None), xlim=(0.9, 0.2))
    for axis in (volume, discharge):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    workshop.save("silo_p0.png", figure)
