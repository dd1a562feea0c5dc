"""Bingham Poiseuille flow: profiles against the exact ones, and the order of convergence of four pairs (seed A, Fig. 4-5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure

TITLE = "Bingham Poiseuille flow: velocity profiles and convergence orders (seed A, Fig. 4-5)"

PROFILES = (0.0, 0.1, 0.5, 0.9)
STUDIED = (0.5, 0.9)
PAIRS = (("P2", "P1"), ("P2", "P1d"), ("P3", "P2d"), ("P4", "P1d"))
# Neither 0.5 nor 0.9 is ever a vertex of these: the edge of the plug lies inside a cell, as it does in general.
REFINEMENTS = (5, 9, 17, 33)
CHANNEL = {"length": 0.25, "tolerance": 1e-8}


def reproduce(workshop: Workshop) -> Report:
    """Profiles at four Bingham numbers; errors in the maximum and H1 norms over refinements."""
    cells, refinements = (16, REFINEMENTS[:3]) if workshop.quick else (64, REFINEMENTS)
    profiles = workshop.run(
        [
            Job(f"profile-{bi:g}", "poiseuille_bingham", {"bingham": bi, "cells": cells, **CHANNEL})
            for bi in PROFILES
        ]
    )
    cases = [(bi, pair, n) for bi in STUDIED for pair in PAIRS for n in refinements]
    runs = workshop.run([_refined(*case) for case in cases])
    studied = dict(zip(cases, runs, strict=True))
    _write(workshop, profiles, studied)
    _draw(workshop, profiles, studied, refinements)
    tables = [_profile_table(profiles, cells), *(_order_table(bi, studied, refinements) for bi in STUDIED)]
    notes = [
        "Seed A prints no numbers: it shows profiles on the exact curves, and errors that fall for all four pairs."
    ]
    return Report(tables, notes, all_converged([*profiles, *runs]))


def _refined(bingham: float, pair: tuple[str, str], cells: int) -> Job:
    velocity, stress = pair
    overrides = {"bingham": bingham, "cells": cells, "velocity": velocity, "stress": stress, **CHANNEL}
    return Job(f"order-{bingham:g}-{velocity}-{stress}-{cells}", "poiseuille_bingham", overrides)


def _profile_table(runs: list[Finished], cells: int) -> Table:
    rows = []
    for bingham, run in zip(PROFILES, runs, strict=True):
        s = run.summary
        rows.append((
            f"{bingham:g}", f"{s['peak_exact']:.6g}", f"{s['peak']:.6g}", f"{s['plug_width_exact']:.4g}",
            f"{s['plug_width']:.4g}", f"{100.0 * s['error_max'] / s['peak_exact']:.3g} %",
        ))  # fmt: skip
    columns = ("Bi", "peak, exact", "peak, ours", "plug width, exact", "ours", "largest error, of the peak")
    return Table(f"profiles, P2-P1d, {cells} cells across", columns, rows)


def _order_table(bingham: float, studied: dict[Any, Finished], refinements: tuple[int, ...]) -> Table:
    rows = []
    for pair in PAIRS:
        for norm in ("error_max", "error_h1"):
            errors = [studied[bingham, pair, n].summary[norm] for n in refinements]
            rows.append((
                "-".join(pair), "maximum" if norm == "error_max" else "H1", *(f"{error:.2e}" for error in errors),
                f"{order_of(refinements, errors):.2f}",
            ))  # fmt: skip
    columns = ("pair", "norm", *(f"{n} cells" for n in refinements), "order")
    return Table(f"errors at Bi = {bingham:g}", columns, rows)


def order_of(cells: tuple[int, ...], errors: list[float]) -> float:
    """Slope of log(error) over log(cell size), least squares."""
    sizes = -np.log(np.array(cells, dtype=float))
    return float(np.polyfit(sizes, np.log(np.maximum(errors, 1e-300)), 1)[0])


def _write(workshop: Workshop, profiles: list[Finished], studied: dict[Any, Finished]) -> None:
    columns = ("y", *(f"{kind} Bi={bi:g}" for bi in PROFILES for kind in ("ours", "exact")))
    curves = [run.observables[key] for run in profiles for key in ("profile_ux", "profile_exact")]
    workshop.write_csv(
        "profiles.csv", columns, list(zip(profiles[0].observables["profile_y"], *curves, strict=True))
    )
    rows = [
        (bi, *pair, n, run.summary["error_max"], run.summary["error_h1"])
        for (bi, pair, n), run in studied.items()
    ]
    workshop.write_csv("errors.csv", ("Bi", "velocity", "stress", "cells", "error_max", "error_h1"), rows)


def _draw(
    workshop: Workshop, profiles: list[Finished], studied: dict[Any, Finished], refinements: tuple[int, ...]
) -> None:
    figure = new_figure(11.0, 4.0)
    profile, *panels = figure.subplots(1, 3)
    for bingham, run in zip(PROFILES, profiles, strict=True):
        y, scale = run.observables["profile_y"], max(run.summary["peak_exact"], 1e-300)
        (line,) = profile.plot(run.observables["profile_exact"] / scale, y, linewidth=1.0)
        marks = slice(None, None, 8)
        profile.plot(
            run.observables["profile_ux"][marks] / scale, y[marks], "o", markersize=3, color=line.get_color(),
            label=f"Bi = {bingham:g}",
        )  # fmt: skip
    profile.set(xlabel="velocity / peak (lines: exact)", ylabel="y / L")
    profile.legend(fontsize=7)
    for bingham, panel in zip(STUDIED, panels, strict=True):
        for pair in PAIRS:
            errors = [studied[bingham, pair, n].summary["error_max"] for n in refinements]
            panel.loglog([2.0 / n for n in refinements], errors, "o-", label="-".join(pair))
        panel.set(xlabel="h / L", ylabel="error, maximum norm", title=f"Bi = {bingham:g}")
        panel.grid(alpha=0.3, which="both")
        panel.legend(fontsize=7)
    workshop.save("poiseuille.png", figure)
