"""Pictures of grains and rigid bodies: sections seen from the side, reliefs seen from above, curves over time.

Bodies are given as level sets on the plane of the picture, one list for each frame; they are drawn filled where negative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from barchan.results.figures import new_figure, save_figure
from barchan.results.heaps import HeightMap, Outline
from barchan.results.pictures import COLOUR_MAP, scatter_speed
from barchan.results.reader import Results
from barchan.results.view import SideView, side_view, spread_frames

Vector = NDArray[np.float64]

BODY_COLOUR = "0.62"
_EDGE_COLOUR = "0.15"
_CONTOURS = 12
_BODY_MARGIN = 1.03


@dataclass(frozen=True, eq=False)
class LevelSet:
    """A body cut by, or projected on, the plane of a picture: `values` (n, m) m, negative inside, at `x` (n,), `y` (m,) m."""

    x: Vector
    y: Vector
    values: Vector


Silhouettes = Callable[[int], Sequence[LevelSet]]
Heights = Callable[[int], HeightMap]


def draw_bodies(axis: Axes, silhouettes: Sequence[LevelSet]) -> list[Any]:
    """Draw the bodies of a frame; the artists are returned, to be removed before the next frame."""
    artists: list[Any] = []
    for body in silhouettes:
        if not np.any(body.values < 0.0):
            continue
        inside = [min(float(body.values.min()), -1e-12) * 2.0, 0.0]
        artists.append(
            axis.contourf(body.x, body.y, body.values.T, levels=inside, colors=[BODY_COLOUR], zorder=3)
        )
        artists.append(
            axis.contour(
                body.x, body.y, body.values.T, levels=[0.0], colors=[_EDGE_COLOUR], linewidths=0.8, zorder=4
            )
        )
    return artists


def view_with_bodies(results: Results, frames: list[int], bodies: Silhouettes) -> SideView:
    """A window on the x-z plane that holds the particles and the bodies of all given frames, clipped to the box."""
    view, box = side_view(results, frames), results.scene["box"]["size"]
    width, height = view.width, view.height
    for body in (body for frame in frames for body in bodies(frame)):
        inside = body.values < 0.0
        if np.any(inside):
            width = max(width, float(body.x[np.any(inside, axis=1)].max()))
            height = max(height, _BODY_MARGIN * float(body.y[np.any(inside, axis=0)].max()))
    return replace(view, width=min(width, box[0]), height=min(height, box[-1]))


def draw_sections(path: Path, results: Results, bodies: Silhouettes, until: float, title: str) -> None:
    """Six frames from the start to time `until` (s) and the last, particles coloured by speed, with the bodies."""
    frames = spread_frames(results, 6, until)
    view = view_with_bodies(results, frames, bodies)
    columns, panel = (
        (2, 4.75) if view.aspect <= 1.0 else (3, max(4.75 / view.aspect, 2.0))
    )  # of a tall box, more beside
    rows = -(-len(frames) // columns)
    figure = new_figure(columns * panel + 1.9, rows * (panel * view.aspect + 0.42) + 0.75)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    points = None
    for axis, frame in zip(axes, frames, strict=False):
        points = scatter_speed(axis, results, frame, view, panel)
        draw_bodies(axis, bodies(frame))
        axis.set_title(f"t = {results.times[frame]:.3g} s", fontsize=9, loc="left")
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    for axis in axes[-columns:]:
        axis.set_xlabel("x (m)")
    for axis in axes[::columns]:
        axis.set_ylabel("z (m)")
    if points is not None:
        figure.colorbar(points, ax=list(axes), label="speed (m/s)", extend="max", shrink=0.9, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_field(path: Path, results: Results, name: str, label: str, bodies: Silhouettes, title: str) -> None:
    """A nodal scalar of the last frame in the plane of the picture; in 3D on the layer of nodes nearest to the middle."""
    grid = results.grid(-1)
    if len(grid["positions"]) == 0 or name not in grid:
        return
    positions, values = grid["positions"], grid[name]
    box = results.scene["box"]["size"]
    if positions.shape[1] == 3:
        layer = positions[np.argmin(np.abs(positions[:, 1] - 0.5 * box[1])), 1]
        chosen = np.isclose(positions[:, 1], layer)
        positions, values = positions[chosen], values[chosen]
    width = 9.0
    figure = new_figure(width, max(width * 0.85 * box[-1] / box[0] + 1.0, 2.6))
    axis = figure.subplots()
    cells = results.scene["box"]["cells"]
    side = box[0] / cells[0] / box[0] * width * 0.85 * 72.0
    points = axis.scatter(
        positions[:, 0], positions[:, -1], c=values, s=side**2, marker="s", linewidths=0.0, cmap=COLOUR_MAP
    )
    draw_bodies(axis, bodies(results.frames - 1))
    axis.set(xlim=(0.0, box[0]), ylim=(0.0, box[-1]), aspect="equal", xlabel="x (m)", ylabel="z (m)")
    figure.colorbar(points, ax=axis, label=label, shrink=0.9)
    axis.set_title(f"{title}, t = {results.times[-1]:.3g} s", fontsize=11, loc="left")
    save_figure(figure, path)


def draw_relief(axis: Axes, heights: HeightMap, top: float) -> Any:
    """The matter seen from above: heights as colours up to `top` (m), with contour lines; the coloured image is returned."""
    image = axis.imshow(
        heights.height.T, origin="lower", cmap=COLOUR_MAP, vmin=0.0, vmax=top, interpolation="bilinear",
        extent=(heights.x[0], heights.x[-1], heights.y[0], heights.y[-1]),
    )  # fmt: skip
    axis.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axis.tick_params(labelsize=8)
    return image


def contour_lines(axis: Axes, heights: HeightMap, top: float) -> list[Any]:
    """Lines of equal height, `_CONTOURS` up to `top` (m)."""
    levels = np.linspace(0.0, top, _CONTOURS + 1)[1:]
    if not heights.height.min() < levels[-1] or heights.height.max() <= levels[0]:
        return []
    lines = axis.contour(
        heights.x, heights.y, heights.height.T, levels=levels, colors="white", linewidths=0.5, alpha=0.7
    )
    return [lines]


def draw_reliefs(
    path: Path,
    results: Results,
    heights: Heights,
    bodies: Silhouettes,
    until: float,
    title: str,
    outline: tuple[tuple[float, float], Outline] | None = None,
) -> None:
    """Four frames seen from above; the last with its outline (centre, line), when there is one."""
    frames = spread_frames(results, 4, until)
    maps = [heights(frame) for frame in frames]
    top = max(float(np.quantile(one.height, 0.999)) for one in maps) or 1.0
    aspect = (maps[0].y[-1] - maps[0].y[0]) / (maps[0].x[-1] - maps[0].x[0])
    columns = 2
    rows = -(-len(frames) // columns)
    panel = 4.2
    figure = new_figure(columns * panel + 1.6, rows * (panel * aspect + 0.5) + 0.7)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    image = None
    for axis, frame, one in zip(axes, frames, maps, strict=False):
        image = draw_relief(axis, one, top)
        contour_lines(axis, one, top)
        draw_bodies(axis, bodies(frame))
        axis.set_title(f"t = {results.times[frame]:.3g} s", fontsize=9, loc="left")
    if outline is not None:
        (x, y), line = outline
        axes[len(frames) - 1].plot(
            x + line.radii * np.cos(line.angles),
            y + line.radii * np.sin(line.angles),
            color="tab:red",
            linewidth=1.0,
        )
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    if image is not None:
        figure.colorbar(image, ax=list(axes), label="height (m)", shrink=0.9, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_curves(
    path: Path, time: Vector, panels: Sequence[tuple[str, Mapping[str, Vector]]], title: str
) -> None:
    """Curves over time (s): one panel for each (label of the values, words of the legend -> values (frames,))."""
    shown = [(label, curves) for label, curves in panels if curves]
    figure = new_figure(8.0, 1.1 + 2.3 * len(shown))
    axes = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True, squeeze=False)).ravel()
    for axis, (label, curves) in zip(axes, shown, strict=True):
        for words, values in curves.items():
            axis.plot(time, values, label=words)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, loc="best")
    axes[-1].set_xlabel("time (s)")
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)
