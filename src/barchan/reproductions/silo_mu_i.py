"""Discharge of the silo under the mu(I) law, and velocity sections at D = L (seed A 6.2.2, Fig. 10)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.beverloo import OUTLETS, QUICK, SILO
from barchan.reproductions.fits import GRAINS, fit_free, fit_law
from barchan.reproductions.workshop import (
    Finished,
    Job,
    Report,
    Table,
    Workshop,
    all_converged,
    new_figure,
    steady_value,
)

TITLE = "The silo under mu(I): discharge and velocity sections (seed A, Fig. 10)"

FINE = {"final_step": 0.025}
MU_I = {
    "mu": 0.32,
    "mu_increment": 0.28,
    "inertial_reference": 0.4,
    "grain_diameter": 1.0 / GRAINS,
    "reynolds": 100.0,
}
PUBLISHED_C = 1.47
"""Caption of Fig. 10; the text says 1.48 for both methods."""
PUBLISHED_K = 0.52
"""Text of 6.2.2, in grain diameters; the caption gives 0.063 in units of L, 0.71 grain diameters."""


def reproduce(workshop: Workshop) -> Report:
    """Six outlets, quickly three; the sections are those of D = L."""
    outlets = (0.5, 1.0, 2.0) if workshop.quick else OUTLETS
    runs = workshop.run([_job(outlet, workshop.quick) for outlet in outlets])
    Q = np.array([steady_value(run) for run in runs])
    fit, free = fit_law(outlets, Q), fit_free(outlets, Q)
    rows = [
        (
            "C",
            f"{PUBLISHED_C:.2f}",
            f"{fit.factor:.3f}",
            f"{100.0 * (fit.factor / PUBLISHED_C - 1.0):+.1f} %",
        ),
        (
            "k, grain diameters",
            f"{PUBLISHED_K:.2f} (caption: 0.71)",
            f"{fit.k:.2f}",
            f"{fit.k - PUBLISHED_K:+.2f}",
        ),
        ("r2 of the fit", "", f"{fit.quality:.5f}", ""),
        ("free exponent", "1.5", f"{free.exponent:.2f}", ""),
    ]
    table = Table("Q = C (D - k / 11.2)^(3/2) under mu(I)", ("", "published", "ours", "deviation"), rows)
    workshop.write_csv("discharge.csv", ("outlet", "discharge"), list(zip(outlets, Q, strict=True)))
    one = runs[outlets.index(1.0)]
    _write_sections(workshop, one)
    _draw(workshop, np.array(outlets), Q, fit.at, one)
    notes = [
        "S1: the axis; S2: x = L, both vertical; H1: y = L. Seed A takes them from a paper that it does not print.",
    ]
    return Report([table], notes, all_converged(runs))


def _job(outlet: float, quick: bool) -> Job:
    overrides = {**SILO, **FINE, **(QUICK if quick else {}), **MU_I, "outlet": outlet}
    return Job(f"D{outlet:g}", "silo", overrides)


def _write_sections(workshop: Workshop, run: Finished) -> None:
    for name, letter in (("s1", "y"), ("s2", "y"), ("h1", "x")):
        columns = [f"{name}_{key}" for key in (letter, "ux", "uy", "pressure")]
        rows = list(zip(*(run.observables[column] for column in columns), strict=True))
        workshop.write_csv(f"section_{name}.csv", columns, rows)


def _draw(workshop: Workshop, outlets: np.ndarray, Q: np.ndarray, law: Any, run: Finished) -> None:
    figure = new_figure(9.0, 7.5)
    (discharge, across), (up, aside) = figure.subplots(2, 2)
    dense = np.linspace(0.0, outlets.max(), 200)
    discharge.plot(outlets, Q, "o", label="ours")
    discharge.plot(dense, law(dense), linewidth=1.0, label="fit")
    discharge.plot(
        dense,
        PUBLISHED_C * np.maximum(dense - PUBLISHED_K / GRAINS, 0.0) ** 1.5,
        ":",
        color="black",
        label="published fit",
    )
    discharge.set(xlabel="D / L", ylabel="Q / sqrt(g L^3)")
    lines = run.observables
    across.plot(lines["h1_x"], lines["h1_uy"], label="vertical, H1")
    across.plot(lines["h1_x"], lines["h1_ux"], label="horizontal, H1")
    across.set(xlabel="x / L", ylabel="velocity / sqrt(g L)")
    up.plot(lines["s1_uy"], lines["s1_y"], label="S1")
    up.plot(lines["s2_uy"], lines["s2_y"], label="S2")
    up.set(xlabel="vertical velocity / sqrt(g L)", ylabel="y / L")
    aside.plot(lines["s2_ux"], lines["s2_y"], label="S2")
    aside.set(xlabel="horizontal velocity / sqrt(g L)", ylabel="y / L")
    for axis in (discharge, across, up, aside):
        axis.grid(alpha=0.3)
        axis.locator_params(nbins=6)
        axis.legend(fontsize=8)
    workshop.save("silo_mu_i.png", figure)
