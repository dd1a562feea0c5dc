"""Sand settles in water: layers at several instants, and the final state against statics (seed B, Fig. 8.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.suspension_runs import frame_at, job, parameters_of
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure

Vector = NDArray[np.float64]

TITLE = "Sedimentation of 0.5 mm grains: volume fraction, pore pressure, contact stress (seed B, Fig. 8.3)"

COARSE = {"box.cells": [20, 20], "time.step": 0.04}
MOMENTS = (0.5, 4.0, 8.0, 12.0, 16.0)
"""In H / sqrt(alpha / (alpha + 1) g H); the last frame follows."""
PUBLISHED_DURATION = 17.0
OFF = "{}, over that at the floor"
PROFILES = ("profile_fraction", "profile_pressure", "profile_vertical_stress")


def reproduce(workshop: Workshop) -> Report:
    """One run of `sedimentation`."""
    (run,) = workshop.run([job("sand", "sedimentation", workshop.quick, COARSE)])
    from barchan.scenes.kinds.suspension.profiles import at_rest

    parameters, summary = parameters_of(run), run.summary
    unit = summary["time_unit"]
    frames = [frame_at(run, moment * unit) for moment in MOMENTS] + [run.results.frames - 1]
    exact = at_rest(parameters, run.results.lines(-1), summary["volume"])
    _draw(workshop, run, frames, exact, unit)
    rows = [
        (run.results.times[frame] / unit, *values)
        for frame in frames
        for values in zip(
            run.results.lines(frame)["profile_z"],
            *(run.results.lines(frame)[name] for name in PROFILES),
            run.results.lines(frame)["profile_effective_stress"],
            strict=True,
        )
    ]
    workshop.write_csv(
        "layers.csv",
        (
            "t / unit",
            "z, m",
            "volume fraction",
            "pore pressure, Pa",
            "vertical contact stress, Pa",
            "phi Tr(lambda)/d, Pa",
        ),
        rows,
    )
    settled = summary["settling_duration"]
    table = [
        (OFF.format("pore pressure off hydrostatic"), "< 1 %", _percent(summary["pressure_deviation"])),
        (OFF.format("contact stress off the buoyant weight"), "< 1 %", _percent(summary["stress_deviation"])),
        (
            "duration, H / sqrt(alpha / (alpha + 1) g H)", f"{PUBLISHED_DURATION:g}",
            "not ended" if settled is None else f"{settled:.1f}",
        ),
        ("drift of the grains' volume", "", f"{summary['volume_drift']:.1e}"),
        ("largest divergence of u_v, 1/s", "", f"{summary['largest_divergence']:.1e}"),
        ("largest rise of the energy in a step", "", f"{summary['largest_energy_rise']:.1e}"),
    ]  # fmt: skip
    notes = [
        "The seed calls the state where it stops final and does not say when; here grains have settled when the potential "
        f"energy is within {100.0 * parameters.observe.settled_share:g} % of its whole drop of its last value, for good.",
    ]
    return Report(
        [Table("final state", ("", "published or wanted", "ours"), table)], notes, all_converged([run])
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3f} %"


def _draw(
    workshop: Workshop, run: Finished, frames: list[int], exact: dict[str, Vector], unit: float
) -> None:
    """Six panels, one for each instant, as the seed's: all three profiles over height, dimensionless."""
    scene = run.results.scene
    height, gravity = scene["box"]["size"][-1], scene["scene"]["gravity"]
    light, heavy = scene["fluid"]["density"], scene["grains"]["density"]
    scales = (1.0, light * gravity * height, (heavy - light) * gravity * height)
    words = ("volume fraction", "pore pressure / (rho_f g H)", "contact stress / (alpha rho_f g H)")
    figure = new_figure(9.6, 6.4)
    axes = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for axis, frame in zip(axes, frames, strict=True):
        lines = run.results.lines(frame)
        for number, (name, scale, label) in enumerate(zip(PROFILES, scales, words, strict=True)):
            axis.plot(
                lines[name] / scale,
                lines["profile_z"] / height,
                ".",
                markersize=3,
                color=f"C{number}",
                label=label,
            )
            if frame == frames[-1]:
                axis.plot(
                    exact[name] / scale, lines["profile_z"] / height, "-", linewidth=0.9, color=f"C{number}"
                )
        axis.set_title(f"t = {run.results.times[frame] / unit:.1f}", fontsize=9, loc="left")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=7)
    for axis in axes[3:]:
        axis.set_xlabel("dimensionless value")
    for axis in axes[::3]:
        axis.set_ylabel("z / H")
    figure.suptitle(
        "time in H / sqrt(alpha / (alpha + 1) g H); lines in the last panel: at rest", fontsize=10
    )
    workshop.save("sedimentation.png", figure)
