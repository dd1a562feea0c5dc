"""A heavy viscous fluid above a light one: growth of the interface against linear theory, and the plumes (seed B, Fig. 8.2).

Grains so small that they never leave the fluid, at half of phi_max, make it heavy; both layers have the fluid's viscosity. The
amplitude of the interface is that of the wave in the thickness of the heavy layer, a sum over particles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.suspension_runs import job, parameters_of, phase_panels
from barchan.reproductions.two_fluids import TwoFluids
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, new_figure

Vector = NDArray[np.float64]

TITLE = "Rayleigh-Taylor instability of two viscous fluids: growth rate and plumes (seed B, Fig. 8.2)"

COARSE = {"box.cells": [24, 24], "time.step": 0.04}
EXCESSES = (1.0, 10.0, 1000.0)
"""alpha; the viscosity is in proportion, so that the times are about the same. The last is the seed's."""
VISCOSITY_PER_EXCESS = 100.0
WINDOW = (1.5, 4.0)
"""Amplitudes over the first one between which the growth rate is taken."""


def reproduce(workshop: Workshop) -> Report:
    """Three density ratios; the seed's beyond the linear regime."""
    runs = workshop.run([
        job(
            f"alpha{alpha:g}", "rayleigh_taylor", workshop.quick, COARSE,
            **{
                "grains.density": 1000.0 * (alpha + 1.0), "fluid.viscosity": VISCOSITY_PER_EXCESS * alpha,
                "matter.heavy.ripple": 0.004,
            },
        )
        for alpha in EXCESSES
    ])  # fmt: skip
    rows, curves = [], []
    for alpha, run in zip(EXCESSES, runs, strict=True):
        theory, k = theory_of(run)
        expected, (measured, span) = theory.growth_rate(k), growth(run)
        curves.append((alpha, run, expected, span))
        rows.append((
            f"{alpha:g}", f"{theory.above / theory.below:.4g}", f"{expected:.4f}", f"{measured:.4f}",
            f"{100.0 * (measured / expected - 1.0):+.1f} %",
        ))  # fmt: skip
    columns = ("alpha", "density above / below", "theory, 1/s", "ours, 1/s", "deviation")
    workshop.write_csv("growth.csv", columns, rows)
    _draw(workshop, curves)
    last = runs[-1]
    frames = np.linspace(0, last.results.frames - 1, 6).round().astype(int)
    panels = [("", last, int(frame)) for frame in frames]
    phase_panels(workshop, "rayleigh_taylor.png", [panels[:3], panels[3:]])
    notes = [
        f"Growth rate: a line through log amplitude between {WINDOW[0]:g} and {WINDOW[1]:g} times the first one.",
        "Theory: two layers between plates that stick, cubic finite elements, sides that slip.",
    ]
    return Report([Table("growth of the wave", columns, rows)], notes, all_converged(runs))


def theory_of(run: Finished) -> tuple[TwoFluids, float]:
    """The two fluids of a run and the wave number of its interface [1/m]."""
    parameters = parameters_of(run)
    ((_, piece),) = parameters.pieces()
    fraction = piece.packing * parameters.grains.max_volume_fraction
    light, grains = parameters.fluid.density, parameters.grains.density
    theory = TwoFluids(
        height=parameters.height, interface=piece.position[-1] - 0.5 * piece.size[-1], below=light,
        above=light + fraction * (grains - light), viscosity=parameters.fluid.viscosity,
        gravity=parameters.scene.gravity, stick_below=parameters.sides.z_min == "stick",
        stick_above=parameters.sides.z_max == "stick",
    )  # fmt: skip
    return theory, piece.half_waves * np.pi / parameters.box.size[0]


def growth(run: Finished) -> tuple[float, Vector]:
    """Growth rate [1/s] of the interface in the window, and which frames are in it; NaN when fewer than three are."""
    times, amplitude = run.observables["time"], np.abs(run.observables["ripple"])
    inside = (amplitude >= WINDOW[0] * amplitude[0]) & (amplitude <= WINDOW[1] * amplitude[0])
    inside &= np.arange(len(times)) <= int(np.argmax(amplitude > WINDOW[1] * amplitude[0]) or len(times))
    if inside.sum() < 3:
        return float("nan"), inside
    return float(np.polyfit(times[inside], np.log(amplitude[inside]), 1)[0]), inside


def _draw(workshop: Workshop, curves: list[tuple[float, Finished, float, Vector]]) -> None:
    figure = new_figure(7.0, 4.4)
    axis = figure.subplots()
    for number, (alpha, run, expected, span) in enumerate(curves):
        times, amplitude = run.observables["time"], np.abs(run.observables["ripple"])
        axis.semilogy(
            times, amplitude / amplitude[0], ".", markersize=4, color=f"C{number}", label=f"alpha = {alpha:g}"
        )
        if span.any():
            first = int(np.flatnonzero(span)[0])
            line = amplitude[first] / amplitude[0] * np.exp(expected * (times - times[first]))
            shown = line < 1.5 * amplitude.max() / amplitude[0]
            axis.semilogy(times[shown], line[shown], "--", linewidth=1.0, color=f"C{number}")
    axis.axhspan(*WINDOW, color="0.92", zorder=0)
    axis.set(xlabel="time (s)", ylabel="amplitude / first amplitude")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, title="dashed: linear theory", title_fontsize=8)
    workshop.save("growth.png", figure)
