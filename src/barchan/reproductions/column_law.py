"""Run-out of plane columns against their aspect ratio by the material point method (seed B 7.2.3, Fig. 7.6)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.fits import fit_exponent
from barchan.reproductions.workshop import Job, Report, Table, Workshop, all_converged, new_figure

TITLE = "Run-out of plane columns, a = 0.5 to 10, material points (seed B, Fig. 7.6)"

LENGTH = 0.1
"""L0 (m)."""
RATIOS = (0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.5, 4.5, 6.0, 8.0, 10.0)
QUICK_RATIOS = (0.5, 1.0, 2.0, 4.0, 8.0)
CRITICAL = 3.0
"""Where seed B changes from one power to the other."""
MATERIAL = {
    "material.friction": 0.32,
    "material.friction_increment": 0.28,
    "material.inertial_reference": 0.4,
    "material.grain_diameter": LENGTH / 20.0,
    "material.static_excess": 0.03,
    "material.static_shear_rate": 1.0,
}
PUBLISHED = {"below": (1.82, 1.1), "above": (2.8, 0.73)}
LABORATORY = {"below": 1.0, "above": 2.0 / 3.0}


def reproduce(workshop: Workshop) -> Report:
    """Eleven columns, quickly five on a coarse grid."""
    ratios = QUICK_RATIOS if workshop.quick else RATIOS
    runs = workshop.run([column_job(ratio, workshop.quick) for ratio in ratios])
    a = np.array(ratios)
    found = {name: np.array([run.summary[name] for run in runs]) for name in ("run_out", "run_out_bulk")}
    rows = []
    for part, chosen in (("below", a < CRITICAL), ("above", a > CRITICAL)):
        factor, exponent = PUBLISHED[part]
        own = [fit_exponent(a[chosen], values[chosen]) for values in found.values()]
        factors = [
            math.exp(float(np.mean(np.log(v[chosen]) - n * np.log(a[chosen]))))
            for v, n in zip(found.values(), own, strict=True)
        ]
        rows.append((
            f"a {'<' if part == 'below' else '>'} {CRITICAL:g}", f"{LABORATORY[part]:.2f}", f"{factor:g} a^{exponent:g}",
            *(f"{c:.2f} a^{n:.2f}" for c, n in zip(factors, own, strict=True)),
        ))  # fmt: skip
    columns = (
        "",
        "exponent, laboratory",
        "seed B, P0-P0",
        "ours, farthest particle",
        "ours, 99.5 % of the volume",
    )
    workshop.write_csv("column_law.csv", ("a", *found), list(zip(a, *found.values(), strict=True)))
    _draw(workshop, a, found)
    notes = [f"mu(I): 0.32 to 0.60, I0 = 0.4, grains of L0 / 20; {_cells(workshop.quick)} cells to L0."]
    return Report([Table("(L - L0) / L0", columns, rows)], notes, all_converged(runs))


def column_job(ratio: float, quick: bool) -> Job:
    """A column of aspect ratio `ratio` in a box that holds its whole run-out."""
    cells, height = _cells(quick), ratio * LENGTH
    expected = PUBLISHED["below"][0] * ratio**1.1 if ratio < CRITICAL else 2.8 * ratio**0.73
    across = math.ceil(cells * (1.6 + 1.5 * expected))
    # a low column needs as many cells over its height as a high one over its length
    up = max(math.ceil(cells * ratio), cells)
    overrides: dict[str, Any] = {
        **MATERIAL,
        "box.size": [across * LENGTH / cells, height],
        "box.cells": [across, up],
        "column.length": LENGTH,
        "column.height": height,
        "time.end": round(7.0 * math.sqrt(2.0 * height / 9.81) + 0.3, 2),
        "time.frame_rate": 10.0,
        "time.adaptive": True,
        "particles.per_cell": 2 if quick else 3,
    }
    return Job(f"a{ratio:g}", "collapse_2d", overrides)


def _cells(quick: bool) -> int:
    """Cells along L0."""
    return 8 if quick else 16


def _draw(workshop: Workshop, a: NDArray[np.float64], found: dict[str, NDArray[np.float64]]) -> None:
    figure = new_figure(6.4, 4.8)
    axis = figure.subplots()
    axis.loglog(a, found["run_out"], "o", label="farthest particle")
    axis.loglog(a, found["run_out_bulk"], "s", markersize=4, label="99.5 % of the volume")
    dense = np.geomspace(a.min(), a.max(), 200)
    low, high = PUBLISHED["below"], PUBLISHED["above"]
    law = np.where(dense < CRITICAL, low[0] * dense ** low[1], high[0] * dense ** high[1])
    axis.loglog(dense, law, ":", color="black", label="seed B, P0-P0")
    axis.set(xlabel="a = H0 / L0", ylabel="(L - L0) / L0")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=8)
    workshop.save("column_law.png", figure)
