"""Pictures of a finished run, drawn with matplotlib's Agg canvas: strip of frames, free surface, curves over time.

Axes are in metres with equal aspect; every colour bar and curve names its unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from barchan.results.figures import new_figure, save_figure
from barchan.results.reader import Results
from barchan.results.view import SideView, side_points, side_view, spread_frames

COLOUR_MAP = "viridis"


def draw_strip(path: Path, results: Results, until: float, title: str) -> None:
    """Six frames from the start to time `until` (s) and the last one, particles coloured by speed."""
    frames = spread_frames(results, 6, until)
    view = side_view(results, frames)
    rows = -(-len(frames) // 2)
    panel_width = 4.75
    figure = new_figure(2 * panel_width + 1.9, rows * (panel_width * view.aspect + 0.42) + 0.75)
    axes = np.atleast_1d(figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)).ravel()
    points = None
    for axis, frame in zip(axes, frames, strict=False):
        points = scatter_speed(axis, results, frame, view, panel_width)
        axis.set_title(f"t = {results.times[frame]:.3g} s", fontsize=9, loc="left")
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    for axis in axes[-2:]:
        axis.set_xlabel("x (m)")
    for axis in axes[::2]:
        axis.set_ylabel("z (m)")
    if points is not None:
        figure.colorbar(points, ax=list(axes), label="speed (m/s)", extend="max", shrink=0.9, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def scatter_speed(
    axis: Axes, results: Results, frame: int, view: SideView, width_inches: float
) -> PathCollection:
    """Draw the particles of a frame as overlapping squares coloured by speed; the artist is returned."""
    x, z, speeds = side_points(results, frame)
    side_in_points = view.grain / view.width * width_inches * 72.0
    points = axis.scatter(
        x, z, c=speeds, s=side_in_points**2, marker="s", linewidths=0.0, cmap=COLOUR_MAP,
        vmin=0.0, vmax=view.top_speed,
    )  # fmt: skip
    axis.set(xlim=(0.0, view.width), ylim=(0.0, view.height), aspect="equal")
    axis.tick_params(labelsize=8)
    return points


def draw_profile(
    path: Path, x: np.ndarray, initial: np.ndarray, final: np.ndarray, box: tuple[float, float], title: str
) -> None:
    """Initial and final free surface z(x) in the box.

    Parameters
    ----------
    x, initial, final : abscissae and the two surface heights (m), each of shape (n,).
    box : length and height of the box (m).
    """
    width = 9.0
    figure = new_figure(width, max(width * 0.85 * box[1] / box[0] + 1.3, 2.6))
    axis = figure.subplots()
    axis.fill_between(x, final, color="#d9b26f", label="heap at the end", linewidth=0.0)
    axis.plot(x, final, color="#7a4e12", linewidth=1.2)
    axis.plot(x, initial, color="black", linewidth=1.0, linestyle="--", label="initial free surface")
    axis.plot(
        [0.0, 0.0, box[0], box[0]], [box[1], 0.0, 0.0, box[1]], color="0.35", linewidth=2.0, label="box"
    )
    margin = 0.01 * box[0]
    axis.set(
        xlim=(-margin, box[0] + margin), ylim=(-margin, box[1] + margin), aspect="equal", xlabel="x (m)",
        ylabel="height (m)",
    )  # fmt: skip
    axis.legend(loc="upper right", bbox_to_anchor=(0.97, 0.96), fontsize=8, framealpha=1.0)
    axis.set_title(title, fontsize=11, loc="left")
    save_figure(figure, path)


def draw_observables(
    path: Path,
    steps: Mapping[str, np.ndarray],
    observables: Mapping[str, np.ndarray],
    dimension: int,
    title: str,
) -> None:
    """Energies of every step, front and height of every frame over time (s).

    `steps` and `observables` both hold time, kinetic_energy and potential_energy, of shapes (steps,) and (frames,);
    `observables` also front, front_bulk and height. Energies are joules, in 2D joules per metre of depth.
    """
    unit = "J/m" if dimension == 2 else "J"
    figure = new_figure(8.0, 6.4)
    energy, place = figure.subplots(2, 1, sharex=True)
    time, kinetic, potential = (
        np.concatenate([observables[name][:1], steps[name]])
        for name in ("time", "kinetic_energy", "potential_energy")
    )
    energy.plot(time, kinetic + potential, color="black", label="kinetic + potential")
    energy.plot(time, potential, color="tab:blue", label="potential")
    energy.plot(time, kinetic, color="tab:red", label="kinetic")
    energy.set(ylabel=f"energy ({unit})", ylim=(0.0, None))
    place.plot(observables["time"], observables["front"], color="tab:brown", label="front, farthest particle")
    place.plot(
        observables["time"],
        observables["front_bulk"],
        color="tab:brown",
        linestyle="--",
        label="front of 99.5 % of the volume",
    )
    place.plot(observables["time"], observables["height"], color="tab:green", label="greatest height")
    place.set(xlabel="time (s)", ylabel="front, height (m)", ylim=(0.0, None), xlim=(0.0, None))
    for axis in (energy, place):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, loc="best")
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)
