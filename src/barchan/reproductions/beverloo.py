"""Discharge of the plane silo with inertia against its outlet: Beverloo's law and its absence (seed A, Fig. 9, Table 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from barchan.reproductions.fits import Fit, fit_exponent, fit_free, fit_law
from barchan.reproductions.workshop import (
    Finished,
    Job,
    Report,
    Table,
    Workshop,
    all_converged,
    new_figure,
    published,
    steady_value,
)

TITLE = "Beverloo scaling of the silo with inertia (seed A, Fig. 9 and Table 1)"

OUTLETS = (0.5, 0.75, 1.0, 1.625, 2.0)
SILO = {"regime": "inertial", "vertices": 600, "tolerance": 2e-4, "final_step": 0.05}
QUICK = {"vertices": 400, "final_step": 0.1}


@dataclass(frozen=True)
class Rheology:
    """A row of the table. C, k : published, None where seed A gives none."""

    mu: float
    reynolds: float
    bingham: float
    C: float | None = None
    k: float | None = None

    @property
    def words(self) -> str:
        """In short."""
        return f"mu {self.mu:g}, Re {self.reynolds:g}, Bi {self.bingham:g}"


# The Newtonian and the Bingham fluid, to which the law does not apply (seed A 6.2.1).
WITHOUT_LAW = (Rheology(0.0, 100.0, 0.0), Rheology(0.0, 100.0, 0.1))


def reproduce(workshop: Workshop) -> Report:
    """All twelve rows and the two fluids; quickly one row for each friction coefficient, at three outlets."""
    granular = [_rheology(row) for row in published("beverloo")]
    outlets: tuple[float, ...] = OUTLETS
    if workshop.quick:
        granular, outlets = granular[::4], OUTLETS[::2][:2] + OUTLETS[-1:]
    rheologies = [*granular, *WITHOUT_LAW]
    runs = workshop.run(
        [_job(rheology, outlet, workshop.quick) for rheology in rheologies for outlet in outlets]
    )
    found = {
        rheology: runs[index * len(outlets) : (index + 1) * len(outlets)]
        for index, rheology in enumerate(rheologies)
    }
    discharges = {
        rheology: np.array([steady_value(run) for run in several]) for rheology, several in found.items()
    }
    _write(workshop, outlets, found)
    _draw(workshop, outlets, discharges)
    tables = [_beverloo_table(granular, outlets, discharges), _fluid_table(outlets, discharges)]
    late = sum(run.summary["ended"] != "steady" for run in runs)
    notes = [
        f"{len(runs)} runs, {late} of them ended by the time limit before they were steady.",
        "r2 is the share of the variance of Q that a fit explains; the free exponent is that of Q = C (D - D0)^n.",
    ]
    return Report(tables, notes, all_converged(runs))


def _rheology(row: dict[str, str]) -> Rheology:
    return Rheology(*(float(row[name]) for name in ("mu", "Re", "Bi", "C", "k")))


def _job(rheology: Rheology, outlet: float, quick: bool) -> Job:
    label = f"mu{rheology.mu:g}-Re{rheology.reynolds:g}-Bi{rheology.bingham:g}-D{outlet:g}"
    overrides: dict[str, Any] = {
        **SILO,
        **(QUICK if quick else {}),
        "mu": rheology.mu,
        "reynolds": rheology.reynolds,
        "bingham": rheology.bingham,
        "outlet": outlet,
    }
    return Job(label, "silo", overrides)


def _beverloo_table(
    rheologies: list[Rheology], outlets: tuple[float, ...], discharges: dict[Rheology, np.ndarray]
) -> Table:
    rows = []
    for rheology in rheologies:
        Q = discharges[rheology]
        fit, free = fit_law(outlets, Q), fit_free(outlets, Q)
        assert rheology.C is not None and rheology.k is not None
        rows.append((
            f"{rheology.mu:g}", f"{rheology.reynolds:g}", f"{rheology.bingham:g}",
            f"{rheology.C:.2f}", f"{fit.factor:.3f}", f"{100.0 * (fit.factor / rheology.C - 1.0):+.1f} %",
            f"{rheology.k:.2f}", f"{fit.k:.2f}", f"{fit.k - rheology.k:+.2f}",
            f"{fit.quality:.5f}", f"{100.0 * fit.worst:.1f} %", f"{free.exponent:.2f}",
        ))  # fmt: skip
    columns = (
        "mu", "Re", "Bi", "C", "ours", "deviation", "k", "ours", "difference", "r2", "worst point", "free exponent",
    )  # fmt: skip
    return Table("Q = C (D - k / 11.2)^(3/2), Table 1 beside ours", columns, rows)


def _fluid_table(outlets: tuple[float, ...], discharges: dict[Rheology, np.ndarray]) -> Table:
    rows = []
    for rheology in WITHOUT_LAW:
        Q = discharges[rheology]
        fit, free = fit_law(outlets, Q), fit_free(outlets, Q)
        name = "Newtonian" if rheology.bingham == 0.0 else f"Bingham, Bi = {rheology.bingham:g}"
        rows.append((
            name, f"{fit.factor:.3f}", f"{fit.k:.2f}", f"{100.0 * fit.worst:.1f} %",
            f"{fit_exponent(outlets, Q):.2f}", f"{free.exponent:.2f}", f"{100.0 * free.worst:.1f} %",
        ))  # fmt: skip
    columns = (
        "fluid (mu = 0)", "C of the 3/2 law", "k", "worst point", "n of Q ~ D^n", "free exponent", "its worst point",
    )  # fmt: skip
    return Table(
        "fluids without friction: no 3/2 law (Newtonian: closer to linear in D, says seed A)", columns, rows
    )


def _write(workshop: Workshop, outlets: tuple[float, ...], found: dict[Rheology, list[Finished]]) -> None:
    rows = [
        (
            rheology.mu, rheology.reynolds, rheology.bingham, outlet, steady_value(run), run.summary["end_time"],
            run.summary["ended"], run.summary["steps"], run.summary["worst_certificate"], run.summary["seconds_total"],
        )
        for rheology, runs in found.items()
        for outlet, run in zip(outlets, runs, strict=True)
    ]  # fmt: skip
    columns = (
        "mu",
        "Re",
        "Bi",
        "outlet",
        "discharge",
        "end_time",
        "ended",
        "steps",
        "worst_certificate",
        "seconds",
    )
    workshop.write_csv("discharge.csv", columns, rows)


def _draw(workshop: Workshop, outlets: tuple[float, ...], discharges: dict[Rheology, np.ndarray]) -> None:
    frictions = sorted({rheology.mu for rheology in discharges})
    figure = new_figure(4.0 * len(frictions), 4.2)
    dense = np.linspace(0.0, max(outlets), 200)
    for axis, mu in zip(np.atleast_1d(figure.subplots(1, len(frictions))), frictions, strict=True):
        for rheology, Q in discharges.items():
            if rheology.mu != mu:
                continue
            (marks,) = axis.plot(
                outlets, Q, "o", markersize=4, label=f"Re {rheology.reynolds:g}, Bi {rheology.bingham:g}"
            )
            axis.plot(dense, fit_law(outlets, Q).at(dense), color=marks.get_color(), linewidth=1.0)
            if rheology.C is not None and rheology.k is not None:
                theirs = Fit(rheology.C, rheology.k / 11.2, 1.5, 0.0, 0.0)
                axis.plot(dense, theirs.at(dense), color=marks.get_color(), linewidth=0.8, linestyle=":")
        axis.set(
            xlabel="D / L", ylabel="Q / sqrt(g L^3)", title=f"mu = {mu:g} (lines: fits, dotted: published)"
        )
        axis.title.set_fontsize(8)
        axis.legend(fontsize=7)
        axis.grid(alpha=0.3)
    workshop.save("beverloo.png", figure)
