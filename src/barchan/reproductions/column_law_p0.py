"""Run-out of plane columns against their aspect ratio, by the mesh-based model with mu(I) friction (seed B, Fig. 7.6)."""

from __future__ import annotations

import numpy as np

from barchan.reproductions.fits import fit_exponent
from barchan.reproductions.workshop import Finished, Job, Report, Table, Workshop, all_converged, new_figure

TITLE = "Run-out of plane columns on a mesh against their aspect ratio (seed B, Fig. 7.6)"

LOW = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
HIGH = (3.0, 4.0, 5.0, 7.0, 10.0)
"""Aspect ratios of the two regimes; they share the critical one."""
PUBLISHED = {"low": (1.82, 1.1), "high": (2.8, 0.73)}
"""Factor and exponent of the run-out (L - L0)/L0 = factor a^exponent (seed B 7.2.3)."""
LABORATORY = {"low": 1.0, "high": 2.0 / 3.0}
CELLS, QUICK_CELLS = 16, 8
"""Cells on the length L0 of the column."""
READINGS = {"grains of L0 / 40": 1.0 / 40.0, "grains of H0 / 25": None}
"""What is taken for the grain diameter, which seed B does not give: columns of one length and different heights, or of one
height and different lengths, made of the same grains. None: 1/25 of the height."""
OF_HEIGHT = 1.0 / 25.0


def reproduce(workshop: Workshop) -> Report:
    """Ten columns in two readings, quickly six on coarser meshes; exponents by least squares of the logarithms."""
    ratios = sorted({*LOW, *HIGH}) if not workshop.quick else [0.5, 1.0, 2.0, 3.0, 5.0, 10.0]
    cells = QUICK_CELLS if workshop.quick else CELLS
    cases = [(reading, a) for reading in READINGS for a in ratios]
    runs = workshop.run([_job(a, cells, READINGS[reading]) for reading, a in cases])
    rows, laws = [], {}
    for number, reading in enumerate(READINGS):
        mine = runs[number * len(ratios) : (number + 1) * len(ratios)]
        found = {a: float(run.summary["run_out"]) for a, run in zip(ratios, mine, strict=True)}
        fits = {
            "low": _law([a for a in ratios if a <= LOW[-1]], found),
            "high": _law([a for a in ratios if a >= HIGH[0]], found),
        }
        laws[reading] = (found, fits)
        for name, words in (("low", "a <= 3"), ("high", "a >= 3")):
            (factor, exponent), (theirs, power) = fits[name], PUBLISHED[name]
            rows.append((
                reading, words, f"{theirs:.2f}", f"{factor:.2f}", f"{power:.2f}", f"{exponent:.2f}",
                f"{LABORATORY[name]:.2f}",
            ))  # fmt: skip
    columns = (
        "reading", "aspect ratio", "factor, seed B", "factor", "exponent, seed B", "exponent",
        "exponent, laboratory",
    )  # fmt: skip
    _write(workshop, cases, runs)
    _draw(workshop, laws)
    notes = [
        "The front is where the layer gets thinner than half a cell. Seed B gives neither its mesh nor the grain diameter, "
        "hence two readings, and says itself that transport schemes leave their mark on the law.",
        f"Matter conserved to {max(run.summary['volume_drift'] for run in runs):.1e}; volume fractions between "
        f"{min(run.summary['min_volume_fraction'] for run in runs):.3g} and "
        f"{max(run.summary['max_volume_fraction'] for run in runs):.9g}.",
    ]
    return Report([Table("(L - L0)/L0 = factor a^exponent", columns, rows)], notes, all_converged(runs))


def _job(ratio: float, cells: int, diameter: float | None) -> Job:
    """A box one and a half times as long as the published run-out, and the time of fall and spreading several times over."""
    factor, exponent = PUBLISHED["low" if ratio <= 3.0 else "high"]
    length = float(np.ceil(1.0 + 1.5 * factor * ratio**exponent))
    height = ratio + max(0.1 * ratio, 2.0 / cells)
    rows = int(np.ceil(height * cells))
    overrides = {
        "mesh.size": [length, rows / cells],
        "mesh.cells": [int(length) * cells, rows],
        "fill.height": ratio,
        "time.end": float(np.ceil(4.0 + 4.0 * np.sqrt(ratio))),
        "time.frame_rate": 2.0,
    }
    if diameter is None:
        return Job(
            f"height-a{ratio:g}", "collapse_p0", {**overrides, "material.grain_diameter": OF_HEIGHT * ratio}
        )
    return Job(f"a{ratio:g}", "collapse_p0", {**overrides, "material.grain_diameter": diameter})


def _law(ratios: list[float], found: dict[float, float]) -> tuple[float, float]:
    """Factor and exponent of the power law through the run-outs of these aspect ratios."""
    run_outs = np.array([found[a] for a in ratios])
    exponent = fit_exponent(ratios, run_outs)
    return float(np.exp(np.mean(np.log(run_outs) - exponent * np.log(ratios)))), exponent


def _write(workshop: Workshop, cases: list[tuple[str, float]], runs: list[Finished]) -> None:
    names = (
        "run_out", "run_out_bulk", "height_ratio", "max_speed", "volume_drift", "max_volume_fraction", "excess",
        "worst_certificate", "steps", "seconds_total",
    )  # fmt: skip
    rows = [(*case, *(run.summary[name] for name in names)) for case, run in zip(cases, runs, strict=True)]
    workshop.write_csv("run_out.csv", ("reading", "aspect_ratio", *names), rows)


def _draw(
    workshop: Workshop, laws: dict[str, tuple[dict[float, float], dict[str, tuple[float, float]]]]
) -> None:
    figure = new_figure(5.0 * len(laws), 4.4)
    regimes = (("low", (LOW[0], LOW[-1]), "tab:blue"), ("high", (HIGH[0], HIGH[-1]), "tab:red"))
    for axis, (reading, (found, fits)) in zip(
        np.atleast_1d(figure.subplots(1, len(laws))), laws.items(), strict=True
    ):
        axis.loglog(list(found), list(found.values()), "o", color="black", label="ours")
        for name, ends, colour in regimes:
            a = np.geomspace(*ends, 50)
            (factor, exponent), (theirs, power) = fits[name], PUBLISHED[name]
            axis.loglog(a, factor * a**exponent, color=colour, label=f"{factor:.2f} a^{exponent:.2f}")
            axis.loglog(a, theirs * a**power, ":", color=colour, label=f"seed B: {theirs:.2f} a^{power:.2f}")
        axis.set(xlabel="aspect ratio a = H0 / L0", ylabel="run-out (L - L0) / L0", title=reading)
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize=8)
    workshop.save("column_law_p0.png", figure)
