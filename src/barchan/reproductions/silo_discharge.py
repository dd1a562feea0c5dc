"""Discharge of silos by the material point method: constant with friction, and the 5/2 power of the outlet (seed B, Fig. 7.5,
7.18 and 7.19)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.fits import fit_exponent, fit_free, fit_law
from barchan.reproductions.mpm_scenes import job, speed_panels
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure
from barchan.scenes.granular.discharge import mean_discharge

TITLE = "Silos empty: constant discharge and the 5/2 law in 3D (seed B, Fig. 7.5, 7.18-7.19)"

FRICTIONS = (0.0, 0.3, 0.5)
COARSE_2D = {
    "box.cells": [15, 31],
    "bodies.plate.size": [0.45, 0.0485],
    "bodies.plate.position": [0.17682926829268292, 0.03722540983606557],
}
COARSE_3D = {
    "box.cells": [12, 12, 24], "bodies.plate.size": [0.06, 0.06, 0.008333333333333333],
    "bodies.plate.position": [0.025, 0.025, 0.04027777777777778],
}  # fmt: skip
OUTLETS = (0.2, 0.25, 0.3, 0.35, 0.4, 0.5)
"""Of the width of the silo, 0.05 m."""
QUICK_OUTLETS = (0.3, 0.4, 0.5)
WIDTH = 0.05
BEVERLOO_3D = 2.5
STEADY = (0.9, 0.7)
"""Of the initial volume of the square silo: its discharge is measured in between, and the run ends soon after."""


def reproduce(workshop: Workshop) -> Report:
    """The plane silo with three frictions; the square one with six outlets, quickly three."""
    plane = workshop.run([
        job(f"plane-mu{mu:g}", "silo_2d", workshop.quick, COARSE_2D, friction=mu, **_walls(mu)) for mu in FRICTIONS
    ])  # fmt: skip
    outlets = QUICK_OUTLETS if workshop.quick else OUTLETS
    square = workshop.run([
        job(f"square-D{share:g}", "silo_3d", workshop.quick, COARSE_3D, **_outlet(share))
        for share in outlets
    ])  # fmt: skip
    tables = [_constancy(plane), _law(np.array(outlets), square)]
    _draw(workshop, plane, np.array(outlets), square)
    middle = square[len(square) // 2]
    frames = [round(share * (middle.results.frames - 1)) for share in (0.25, 0.6)]
    speed_panels(workshop, "silo_speeds.png", [("square silo", middle, frame) for frame in frames])
    rows = list(zip(outlets, _discharges(square), strict=True))
    workshop.write_csv("discharge.csv", ("outlet / width", "Q, m^3/s"), rows)
    notes = [
        "Plane silo: the window is the volume from 0.9 to 0.2 of the initial one.",
        f"Square silo: Q while the volume falls from {STEADY[0]:g} to {STEADY[1]:g} of the initial one.",
    ]
    return Report(
        tables,
        notes,
        all_converged([*plane, *square]),
    )


def _walls(mu: float) -> dict[str, object]:
    """Walls and plate with the friction of the material, so that without it nothing holds the fluid."""
    return {"walls.x_min": {"friction": mu}, "walls.x_max": {"friction": mu}, "bodies.plate.friction": mu}


def _outlet(share: float) -> dict[str, object]:
    """Outlet of a share of the width, and the end of the run when its discharge is known."""
    return {"bodies.plate.hole": share * WIDTH, "observe.until_share": STEADY[1] - 0.02}


def _discharges(runs: list[Finished]) -> np.ndarray:
    """(runs,) steady discharge [m^3/s], nan where a run ended before."""
    found = [mean_discharge(run.observables["time"], run.observables["volume_above"], STEADY) for run in runs]
    return np.array([np.nan if Q is None else Q for Q in found])


def _constancy(runs: list[Finished]) -> Table:
    rows = []
    for mu, run in zip(FRICTIONS, runs, strict=True):
        figures = run.summary
        if figures["discharge"] is None:
            rows.append((f"{mu:g}", "the run ended before 0.2 of the volume was left", "", ""))
            continue
        rows.append((
            f"{mu:g}", f"{figures['discharge']:.4f}", f"{100.0 * figures['discharge_variation']:.1f} %",
            f"{figures['discharge_trend']:.3f}",
        ))  # fmt: skip
    columns = ("mu", "discharge, m^2/s", "largest deviation in the window", "last quarter / first")
    return Table("plane silo: is the discharge constant?", columns, rows)


def _law(outlets: np.ndarray, runs: list[Finished]) -> Table:
    measured = _discharges(runs)
    known = np.isfinite(measured)
    if known.sum() < 3:
        return Table("square silo: Q = C (D - k)^n", ("", "ours"), [("outlets measured", f"{known.sum()}")])
    D, Q = outlets[known] * WIDTH, measured[known]
    fit, free = fit_law(D, Q, BEVERLOO_3D), fit_free(D, Q)
    cell = float(runs[0].results.scene["box"]["size"][0]) / int(runs[0].results.scene["box"]["cells"][0])
    rows = [
        ("exponent, k left free", "2.5", f"{free.exponent:.2f}"),
        ("exponent with the k of the 5/2 law", "2.5", f"{fit_exponent(D, Q, fit.offset):.2f}"),
        ("k of the 5/2 law, cells", "about 2", f"{fit.offset / cell:.2f}"),
        ("C of the 5/2 law, sqrt(g)", "", f"{fit.factor / np.sqrt(9.81):.3f}"),
        ("worst point of the 5/2 law", "", f"{100.0 * fit.worst:.1f} %"),
    ]
    return Table("square silo: Q = C (D - k)^n", ("", "published", "ours"), rows)


def _draw(workshop: Workshop, plane: list[Finished], outlets: np.ndarray, square: list[Finished]) -> None:
    figure = new_figure(9.5, 4.2)
    volume, law = figure.subplots(1, 2)
    for mu, run in zip(FRICTIONS, plane, strict=True):
        left = run.observables["volume_above"]
        volume.plot(run.observables["time"], left / left[0], label=f"mu = {mu:g}")
    volume.axhspan(0.2, 0.9, color="0.92", zorder=0)
    volume.set(xlabel="time (s)", ylabel="V / V0", title="plane silo")
    Q = _discharges(square)
    law.plot(outlets, 1e6 * Q, "o")
    known = np.isfinite(Q)
    if known.sum() >= 2:
        fit = fit_law(outlets[known] * WIDTH, Q[known], BEVERLOO_3D)
        dense = np.linspace(0.0, outlets.max(), 100)
        law.plot(dense, 1e6 * fit.at(dense * WIDTH), linewidth=1.0, label="C (D - k)^(5/2)")
        law.legend(fontsize=8)
    law.set(xlabel="D / width", ylabel="Q (cm^3/s)", title="square silo")
    volume.legend(fontsize=8)
    for axis in (volume, law):
        axis.grid(alpha=0.3)
    workshop.save("silo_discharge.png", figure)
