"""Run-out of plane columns: against the aspect ratio with mu(I) friction, and against friction (seed B 7.2.3, Figure 7.6).

    python examples/column_run_out.py [--quick]

Writes run_out.png beside a table of figures: seed B found 1.82 a^1.1 (a < 3), laboratories 1.2 a.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import barchan as bc

HEIGHT = 0.2
CELLS_IN_HEIGHT = 20
RATE_LAW = {"friction": 0.32, "friction_increment": 0.28, "inertial_reference": 0.4, "grain_diameter": 0.002}


def column_scene(
    aspect_ratio: float, material: dict[str, float], cells_in_height: int = CELLS_IN_HEIGHT
) -> bc.scenes.Scene:
    """A plane column of height HEIGHT on a rough floor, in a box long enough for its run-out.

    aspect_ratio : a = height / length.  material : keys of [material] besides the density.
    """
    cell = HEIGHT / cells_in_height
    length = max(2, round(HEIGHT / aspect_ratio / cell)) * cell
    across = math.ceil(length * (2.0 + 3.0 * aspect_ratio**1.1) / cell)
    return bc.scenes.load(
        "collapse_2d",
        scene={"name": "column"},
        box={"size": [across * cell, HEIGHT + 2 * cell], "cells": [across, cells_in_height + 2]},
        column={"length": length, "height": HEIGHT},
        material={"density": 1500.0, "viscosity": 0.0, **material},
        time={"end": 10.0 * math.sqrt(HEIGHT / 9.81), "frame_rate": 20.0, "step": 1.0 / 480.0},
    )


def run_out(
    aspect_ratio: float, material: dict[str, float], cells_in_height: int = CELLS_IN_HEIGHT
) -> dict[str, float]:
    """Run-out (L - L0) / L0 of the bulk and of the furthest grain, and the final slopes in degrees."""
    scene = column_scene(aspect_ratio, material, cells_in_height)
    summary = scene.run(progress=False).summary
    return {
        key: summary[key]
        for key in (
            "run_out",
            "run_out_bulk",
            "slope_steepest",
            "slope_mean",
            "worst_certificate",
            "final_speed",
        )
    }


def main() -> None:
    """Run all columns, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coarser columns")
    parser.add_argument("--out", type=Path, default=Path("run_out.png"))
    arguments = parser.parse_args()
    cells = 12 if arguments.quick else CELLS_IN_HEIGHT
    ratios = [0.5, 1.0, 2.0]
    by_ratio = [run_out(a, RATE_LAW, cells) for a in ratios]
    for a, found in zip(ratios, by_ratio, strict=True):
        print(f"a = {a}: seed {1.82 * a**1.1:.2f}, laboratory {1.2 * a:.2f}, {found}")
    frictions = [0.3, 0.45, 0.6]
    by_friction = [run_out(1.0, {"friction": mu}, cells) for mu in frictions]
    for mu, found in zip(frictions, by_friction, strict=True):
        print(f"mu = {mu} (angle {math.degrees(math.asin(mu)):.1f} deg): {found}")
    draw(arguments.out, ratios, by_ratio, frictions, by_friction)


def draw(
    path: Path,
    ratios: list[float],
    by_ratio: list[dict[str, float]],
    frictions: list[float],
    by_friction: list[dict[str, float]],
) -> None:
    """Run-out against the aspect ratio with both laws, and against friction."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    a = np.linspace(0.4, 2.2, 100)
    left.plot(a, 1.82 * a**1.1, "k-", label="seed B: 1.82 a^1.1")
    left.fill_between(a, 0.8 * 1.82 * a**1.1, 1.2 * 1.82 * a**1.1, color="0.9", label="within 20 %")
    left.plot(a, 1.2 * a, "k--", label="laboratory: 1.2 a")
    left.plot(ratios, [f["run_out"] for f in by_ratio], "o", label="furthest grain")
    left.plot(ratios, [f["run_out_bulk"] for f in by_ratio], "s", mfc="none", label="99.5 % of the volume")
    left.set(
        xlabel="aspect ratio a = H0 / L0 (-)", ylabel="run-out (L - L0) / L0 (-)", title="mu(I): 0.32 to 0.6"
    )
    left.legend()
    right.plot(frictions, [f["run_out"] for f in by_friction], "o-", label="furthest grain")
    right.plot(
        frictions, [f["run_out_bulk"] for f in by_friction], "s--", mfc="none", label="99.5 % of the volume"
    )
    right.set(
        xlabel="friction coefficient (-)",
        ylabel="run-out (L - L0) / L0 (-)",
        title="a = 1, constant friction",
    )
    right.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
