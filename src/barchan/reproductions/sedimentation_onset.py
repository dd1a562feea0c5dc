"""How grains of three diameters begin to settle, how long it takes, and that they end alike (seed B, Fig. 8.4 and 8.4.2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.reproductions.suspension_runs import frame_at, job, parameters_of
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure

TITLE = "Onset and duration of sedimentation for grains of 0.3, 0.5 and 5 mm (seed B, Fig. 8.4)"

COARSE = {"box.cells": [20, 20], "time.step": 0.04}
LINEAR, QUADRATIC = "richardson_zaki", "quadratic"
GRAINS = (
    (3e-4, LINEAR, 30.0, 26.0),
    (5e-4, LINEAR, 17.0, 12.0),
    (5e-3, LINEAR, 6.5, 6.0),
    (5e-3, QUADRATIC, 6.5, 6.0),
)
"""Diameter (m), drag, published duration in H / sqrt(alpha / (alpha + 1) g H), simulated time (s)."""
LEAST = 1e-3
"""Speed (m/s) below which nothing is drawn brighter: layers that settle evenly have none."""
STEPS = 2000
"""Of the fall of a layer."""
ONSETS = (23.0, 16.0, 1.0, 5.0)
"""When the velocities of each are shown, in the same unit: the flow is then no longer one of layers."""


def reproduce(workshop: Workshop) -> Report:
    """Three runs of `sedimentation` with the seed's linear drag, and the large grains again with quadratic drag."""
    runs = workshop.run([
        job(
            f"D{1e3 * diameter:g}mm-{drag}", "sedimentation", workshop.quick, COARSE,
            **{"grains.diameter": diameter, "drag.law": drag, "time.end": end},
        )
        for diameter, drag, _, end in GRAINS
    ])  # fmt: skip
    rows = []
    for (diameter, drag, published, _), run in zip(GRAINS, runs, strict=True):
        duration = run.summary["settling_duration"]
        shown = "not ended" if duration is None else f"{duration:.1f}"
        deviation = "" if duration is None else f"{100.0 * (duration / published - 1.0):+.0f} %"
        rows.append((
            f"{1e3 * diameter:g}", drag, f"{published:g}", shown, deviation,
            f"{free_settling(run):.1f}", f"{run.summary['centre_z']:.4f}", f"{run.summary['top_bulk']:.3f}",
            f"{100.0 * run.summary['stress_deviation']:.2f} %",
        ))  # fmt: skip
    columns = (
        "D, mm", "drag", "duration published", "ours", "deviation", "of layers, by the balances",
        "final height of the centre, m", "final top, m", "contact stress off weight",
    )  # fmt: skip
    workshop.write_csv("durations.csv", columns, rows)
    _draw_onset(workshop, runs)
    _draw_heights(workshop, runs)
    ends = np.array([run.summary["centre_z"] for run in runs])
    notes = [
        f"The final heights of the centres differ by {100.0 * np.ptp(ends) / ends.mean():.2f} %.",
        "Grains have settled when the potential energy is within 1 % of its drop of its last value, for good.",
        "Of layers: grains that never leave their layer, from rest, by the balances at the initial volume fraction. "
        "Linear drag hardly acts on 5 mm grains within their fall: no closure of that kind takes as long as the seed says.",
    ]
    return Report([Table("durations and final states", columns, rows)], notes, all_converged(runs))


def free_settling(run: Finished) -> float:
    """How long the top layer falls to the height of the packed bed, from rest at the initial volume fraction, over the unit.

    With u_v = 0, w = u / (1 - phi) and (8.8)-(8.9) leave, integrated with small steps,
    (rho_g + rho_f phi / (1 - phi)) du/dt = (rho_g - rho_f) g - xi w / (phi (1 - phi)).
    """
    from barchan.scenes.kinds.suspension.building import build_mixture

    parameters = parameters_of(run)
    mixture, ((_, piece),) = build_mixture(parameters), parameters.pieces()
    phi = np.array([piece.packing * parameters.grains.max_volume_fraction])
    light, heavy, gravity = mixture.fluid_density, mixture.grains.density, parameters.scene.gravity
    inertia = heavy + light * float(phi[0] / (1.0 - phi[0]))
    way, pull = piece.size[-1] * (1.0 - piece.packing), (heavy - light) * gravity
    steady = float(mixture.drag.settling_velocity(phi, mixture, gravity)[0])
    dt = max(way / steady, (2.0 * way * inertia / pull) ** 0.5) / STEPS
    time, speed, fallen = 0.0, 0.0, 0.0
    while fallen < way:
        slip = np.array([speed / (1.0 - phi[0])])
        xi = float((mixture.drag.coefficient(phi, slip, mixture) / (phi * (1.0 - phi)))[0])
        speed = (speed + dt * pull / inertia) / (1.0 + dt * xi / ((1.0 - phi[0]) * inertia))
        fallen += dt * speed
        time += dt
    return float(time / run.summary["time_unit"])


def _draw_onset(workshop: Workshop, runs: list[Finished]) -> None:
    """Stream lines of the volume-averaged velocity; hue its direction, brightness its amplitude."""
    from barchan.results.line_convolution import direction_image

    figure = new_figure(3.1 * len(runs) + 0.6, 4.0)
    axes: Any = figure.subplots(1, len(runs), sharey=True)
    for axis, onset, (diameter, drag, _, _), run in zip(axes, ONSETS, GRAINS, runs, strict=True):
        frame = frame_at(run, onset * run.summary["time_unit"])
        x, z, along, upwards = mean_velocity(run, frame)
        top = max(float(np.quantile(np.hypot(along, upwards), 0.995)), LEAST)
        axis.imshow(
            direction_image(along, upwards, top), origin="lower", extent=(x[0], x[-1], z[0], z[-1]),
        )  # fmt: skip
        words = f"D = {1e3 * diameter:g} mm, {drag.replace('_', ' ')}\nt = {onset:g}, up to {top:.2g} m/s"
        axis.set_title(words, fontsize=8, loc="left")
        axis.set_xlabel("x (m)")
    axes[0].set_ylabel("z (m)")
    figure.suptitle(
        "volume-averaged velocity; hue its direction, brightness its speed; times in H / sqrt(alpha / (alpha + 1) g H)",
        fontsize=10,
    )
    workshop.save("onset.png", figure)


def mean_velocity(run: Finished, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x (n,), z (m,) [m] and the components (n, m) [m/s] of phi u_g + (1 - phi) u_f of a plane run."""
    from barchan.results.fluid_sections import fluid_section

    section, grid = fluid_section(run.results, frame), run.results.grid(frame)
    parts = []
    for axis, fluid in ((0, section.along), (-1, section.upwards)):
        mean = fluid.copy().reshape(-1)
        there = mean[grid["node_ids"]]  # fractions are those of the step that made the velocities
        mean[grid["node_ids"]] = there + grid["volume_fractions"] * (grid["velocities"][:, axis] - there)
        parts.append(mean.reshape(fluid.shape))
    return section.x, section.z, parts[0], parts[1]


def _draw_heights(workshop: Workshop, runs: list[Finished]) -> None:
    figure = new_figure(6.4, 4.0)
    axis = figure.subplots()
    for (diameter, drag, _, _), run in zip(GRAINS, runs, strict=True):
        times = run.observables["time"] / run.summary["time_unit"]
        axis.plot(times, run.observables["centre_z"], label=f"D = {1e3 * diameter:g} mm, {drag}")
    axis.set(
        xlabel="t / (H / sqrt(alpha / (alpha + 1) g H))", ylabel="height of the centre of the grains (m)"
    )
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    workshop.save("centres.png", figure)
