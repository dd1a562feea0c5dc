"""Summary, first figures and pictures of dry grains on a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from barchan.results import Results
from barchan.scenes.kinds.dry_p0.parameters import DryParameters

REST_SPEED = 1e-2
"""Matter is at rest when nothing is faster than this share of sqrt(g H0)."""
HOURGLASS = (0.9, 0.2)
"""Shares of the initial volume between which an hourglass runs evenly (seed B, Fig. 7.5)."""


def summarise(parameters: DryParameters, results: Results) -> dict[str, Any]:
    """Figures for summary.json; the discharge is None without an outlet or before it is over."""
    observables, steps = results.observables, results.steps
    final = {name: float(values[-1]) for name, values in observables.items()}
    rest = REST_SPEED * float(np.sqrt(parameters.scene.gravity * parameters.fill.height))
    rates = discharge_by_tenths(steps["time"], steps["volume"], float(observables["volume"][0]))
    return {
        "end_time": final.pop("time"),
        **final,
        "at_rest": final["max_speed"] < rest,
        "volume_drift": float(
            np.abs((steps["volume"] + steps["left"]) / observables["volume"][0] - 1.0).max()
        ),
        "min_volume_fraction": float(steps["min_volume_fraction"].min()),
        "max_volume_fraction": float(steps["max_volume_fraction"].max()),
        "excess": float(steps["excess"].sum() / observables["volume"][0]),
        "mean_discharge": float(np.mean(rates)) if len(rates) else None,
        "discharge_deviation": float(np.max(np.abs(rates / np.mean(rates) - 1.0))) if len(rates) else None,
        "cells": len(results.mesh["cells"]),
        "worst_certificate": float(steps["residual"].max()),
        "tolerance": parameters.solver.tolerance,
        "converged": bool(np.all(steps["converged"])),
        "unconverged_steps": int(np.sum(~steps["converged"].astype(bool))),
        "steps": len(steps["time"]),
        "sweeps": int(steps["sweeps"].sum()),
    }


def discharge_by_tenths(times: np.ndarray, volumes: np.ndarray, initial: float) -> np.ndarray:
    """(7,) discharge while each tenth of the volume leaves, from 0.9 to 0.2 of the initial one; empty unless all have.

    times, volumes : (steps,) at the end of each step, volumes not increasing.
    """
    first, last = HOURGLASS
    if len(times) == 0 or volumes[-1] > last * initial:
        return np.zeros(0)
    levels = initial * np.linspace(first, last, round(10 * (first - last)) + 1)
    when = np.interp(-levels, -np.concatenate([[initial], volumes]), np.concatenate([[0.0], times]))
    return np.asarray(-np.diff(levels) / np.diff(when))


def figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Run-out, height, discharge, bounds and conservation."""
    found = [
        ("front", f"{summary['front']:.4g}, 99.5 % of the matter {summary['front_bulk']:.4g}"),
        ("run-out (L - L0)/L0", f"{summary['run_out']:.3g}"),
        ("height H/H0", f"{summary['height_ratio']:.3g}"),
        ("matter inside, gone", f"{summary['volume']:.4g}, {summary['left']:.4g}"),
        ("volume drift", f"{summary['volume_drift']:.1e}"),
        ("volume fractions", f"{summary['min_volume_fraction']:.3g} to {summary['max_volume_fraction']:.6g}"),
        ("at rest", "yes" if summary["at_rest"] else "no"),
    ]
    if summary["mean_discharge"] is not None:
        words = f"{summary['mean_discharge']:.4g}, within {100.0 * summary['discharge_deviation']:.1f} %"
        found.insert(0, ("discharge, 0.9 to 0.2 V0", words))
    return found


def draw(parameters: DryParameters, results: Results, summary: dict[str, Any], folder: Path) -> None:
    """strip.png (the volume fraction over time), fields.png, profile.png and volume.png or front.png in `folder`."""
    from barchan.results.fields import SI, Panel, draw_panels
    from barchan.results.lines import draw_lines
    from barchan.results.stored_meshes import mesh_from

    title = parameters.scene.description or parameters.scene.name
    units = {**SI, "x": "x", "y": "z"}
    mesh, last = mesh_from(results.mesh), results.frames - 1
    packed = parameters.material.max_volume_fraction
    shown = sorted({round(share * last) for share in (0.0, 0.1, 0.2, 0.35, 0.6, 1.0)})
    strip = [
        Panel(
            results.fields(frame)["volume_fractions"], "volume fraction", f"t = {results.times[frame]:.3g}",
            "YlOrBr", limits=(0.0, packed),
        )
        for frame in shown
    ]  # fmt: skip
    draw_panels(folder / "strip.png", mesh, strip, title=title, units=units)
    middle = shown[len(shown) // 2]
    fields = results.fields(middle)
    there = fields["volume_fractions"] > 0.05 * packed
    speed = np.where(there, np.linalg.norm(fields["velocities"], axis=1), np.nan)
    panels = [
        Panel(speed, "speed", f"speed, t = {results.times[middle]:.3g}"),
        Panel(
            np.where(there, fields["pressures"], np.nan), "pressure", "contact pressure", "magma", clip=0.005
        ),
    ]
    draw_panels(folder / "fields.png", mesh, panels, title=title, units=units)
    first_line, last_line = results.lines(0), results.lines(-1)
    draw_lines(
        folder / "profile.png", first_line["surface_x"],
        {"at the start": first_line["surface_height"], "at the end": last_line["surface_height"]},
        ("x", "height of the matter"), title=title,
    )  # fmt: skip
    observables = results.observables
    if parameters.outlet.width > 0.0:
        volume = observables["volume"] / observables["volume"][0]
        drawn, words, name = {"every frame": volume}, "V / V0", "volume.png"
    else:
        drawn, words, name = (
            {"front": observables["front"], "height": observables["height"]},
            "length",
            "front.png",
        )
    draw_lines(folder / name, results.times, drawn, ("time", words), title=title)
