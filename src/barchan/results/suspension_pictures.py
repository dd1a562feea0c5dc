"""Pictures of grains inside a fluid: both phases in the plane, means over layers, the grains in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from barchan.results.figures import new_figure, save_figure
from barchan.results.fluid_sections import FluidArtists, whole_view
from barchan.results.pictures import COLOUR_MAP
from barchan.results.reader import Results
from barchan.results.view import spread_frames

Vector = NDArray[np.float64]

_SHOWN = 6
_SOLID_VIEW = {"elev": 22.0, "azim": -62.0}
LAYER_PANELS = (
    ("profile_fraction", "volume fraction of grains"),
    ("profile_pressure", "pore pressure (Pa)"),
    ("profile_vertical_stress", "vertical contact stress (Pa)"),
)


def draw_phases(path: Path, results: Results, until: float, title: str) -> None:
    """Frames from the start to time `until` (s) and the last: fluid coloured by speed, with arrows, grains by theirs."""
    frames = spread_frames(results, _SHOWN, until)
    view, top = whole_view(results, frames)
    columns = 2 if view.aspect <= 0.8 else 3
    panel = 4.75 if columns == 2 else min(3.6, 3.6 / view.aspect + 0.4)
    rows = -(-len(frames) // columns)
    figure = new_figure(columns * panel + 2.6, rows * (0.88 * panel * view.aspect + 0.42) + 0.75)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    drawn = None
    for axis, frame in zip(axes, frames, strict=False):
        drawn = FluidArtists(axis, results, frame, view, top, panel)
        axis.set_title(f"t = {results.times[frame]:.3g} s", fontsize=9, loc="left")
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    for axis in axes[-columns:]:
        axis.set_xlabel("x (m)")
    for axis in axes[::columns]:
        axis.set_ylabel("z (m)")
    if drawn is not None:
        speed_bars(figure, list(axes), drawn)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def speed_bars(figure: Figure, axes: Sequence[Any], drawn: FluidArtists, **where: Any) -> None:
    """Colour bars of both phases beside `axes`."""
    place = {"shrink": 0.9, "pad": 0.01, "extend": "max", **where}
    for artist, words in (
        (drawn.image, "speed of the fluid (m/s)"),
        (drawn.points, "speed of the grains (m/s)"),
    ):
        bar = figure.colorbar(artist, ax=list(axes), label=words, **place)
        bar.ax.tick_params(labelsize=7)


def draw_layers(
    path: Path,
    shown: Sequence[tuple[str, Mapping[str, Vector]]],
    exact: Mapping[str, Mapping[str, Vector]],
    title: str,
    panels: Sequence[tuple[str, str]] = LAYER_PANELS,
) -> None:
    """Means over layers over height: one panel for each (name of the profile, label).

    shown : words of the legend and arrays, `profile_z` among them.  exact : name of the profile -> words -> theory, dashed.
    """
    figure = new_figure(3.6 * len(panels) + 0.6, 4.4)
    axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    for axis, (name, label) in zip(axes, panels, strict=True):
        for number, (words, lines) in enumerate(shown):
            shade = 0.9 * number / max(len(shown) - 1, 1)
            colour = _colour(shade)
            axis.plot(lines[name], lines["profile_z"], color=colour, label=words, linewidth=1.4)
        for words, values in exact.get(name, {}).items():
            axis.plot(values, shown[-1][1]["profile_z"], "--", color="black", linewidth=1.0, label=words)
        axis.set_xlabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("z (m)")
    for axis in axes:
        axis.legend(fontsize=7)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_solid(path: Path, results: Results, until: float, title: str) -> None:
    """Four frames of a run in space: the particles, coloured by speed, in the edges of the box."""
    frames = spread_frames(results, 4, until)
    box = results.scene["box"]["size"]
    top = max(float(np.quantile(_speeds(results, frame), 0.995)) for frame in frames) or 1.0
    figure = new_figure(10.5, 7.6)
    axes = [figure.add_subplot(2, 2, place + 1, projection="3d") for place in range(len(frames))]
    points = None
    for axis, frame in zip(axes, frames, strict=True):
        particles = results.particles(frame)
        positions, speeds = particles["positions"], _speeds(results, frame)
        side = 190.0 * 1.5 * float(np.median(particles["volumes"])) ** (1.0 / 3.0) / box[0]
        points = axis.scatter(
            *positions.T, c=speeds, s=side**2, marker="o", linewidths=0.0, cmap=COLOUR_MAP, vmin=0.0, vmax=top,
            depthshade=False,
        )  # fmt: skip
        _draw_box(axis, box)
        axis.view_init(**_SOLID_VIEW)
        axis.set_box_aspect(box, zoom=1.12)
        axis.set(xlim=(0.0, box[0]), ylim=(0.0, box[1]), zlim=(0.0, box[2]))
        axis.set_xlabel("x (m)", fontsize=8, labelpad=8.0)
        axis.set_ylabel("y (m)", fontsize=8, labelpad=-4.0)
        axis.set_zlabel("z (m)", fontsize=8)
        axis.set_yticks([0.0, box[1]])
        axis.tick_params(labelsize=7)
        axis.set_title(f"t = {results.times[frame]:.3g} s", fontsize=9, loc="left")
    if points is not None:
        figure.colorbar(
            points, ax=axes, label="speed of the grains (m/s)", extend="max", shrink=0.7, pad=0.04
        )
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def _speeds(results: Results, frame: int) -> Vector:
    return np.asarray(np.linalg.norm(results.particles(frame)["velocities"], axis=1))


def _draw_box(axis: Any, box: Sequence[float]) -> None:
    """The twelve edges of the box."""
    corners = np.array(np.meshgrid(*([0.0, length] for length in box), indexing="ij")).reshape(3, -1).T
    for a in range(8):
        for b in range(a + 1, 8):
            if np.count_nonzero(corners[a] != corners[b]) == 1:
                axis.plot(*np.array([corners[a], corners[b]]).T, color="0.6", linewidth=0.7)


def _colour(shade: float) -> Any:
    from matplotlib import colormaps

    return colormaps[COLOUR_MAP](shade)
