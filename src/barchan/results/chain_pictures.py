"""Pictures of plane chains by matplotlib: the models of a run over each other, the paths of their tips, an animation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from barchan.bodies.rigid import Body, BodyStates
from barchan.bodies.rigid.rotations import matrix
from barchan.results.animation import LARGEST_SIZE, encode
from barchan.results.body_pictures import DRIVEN_COLOUR, outlines
from barchan.results.figures import new_figure, save_figure
from barchan.results.reader import Results
from barchan.results.view import spread_frames
from barchan.storage import write_bytes

Vector = NDArray[np.float64]

_COLOURS = "tab10"
_STYLES = {"maximal": ("-", 3.5, "C0"), "lumped": ("--", 2.0, "C1"), "reduced": (":", 1.5, "C2")}
_MARGIN = 0.06  # of the window, round where the chains go
_ANIMATIONS = ((5.0, 60), (4.5, 40), (3.5, 25))  # width in inches at 100 dpi, number of frames


class ChainScene:
    """The chains of a stored run: joints of model after model, among fixed `obstacles`."""

    def __init__(self, results: Results, names: Sequence[str], obstacles: Sequence[Body]) -> None:
        self.results, self.names, self.obstacles = results, tuple(names), tuple(obstacles)

    @property
    def times(self) -> Vector:
        """(frames,) [s]."""
        return np.asarray(self.results.times)

    def joints(self, frame: int) -> dict[str, Vector]:
        """Name of a model -> (N + 1, 2) joints [m]."""
        places = np.asarray(self.results.particles(frame)["positions"], dtype=np.float64)
        return dict(zip(self.names, np.split(places, len(self.names)), strict=True))

    @cached_property
    def window(self) -> tuple[Vector, Vector]:
        """Lower and upper corner (2,) [m] that holds all joints at all times."""
        places = np.concatenate([self.results.particles(k)["positions"] for k in range(self.results.frames)])
        lower, upper = (
            np.asarray(ends, dtype=np.float64) for ends in (places.min(axis=0), places.max(axis=0))
        )
        size = np.maximum(upper - lower, 0.4 * np.max(upper - lower))
        middle = 0.5 * (lower + upper)
        half = 0.5 * size + _MARGIN * np.max(size)
        return middle - half, middle + half


def draw_chains(axis: Axes, scene: ChainScene, frame: int) -> list[Any]:
    """Draw a frame; the lines of the models are returned."""
    lower, upper = scene.window
    axis.set(
        xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal", xlabel="x (m)", ylabel="z (m)"
    )
    axis.tick_params(labelsize=8)
    states = BodyStates.at_start(scene.obstacles, 2)
    shapes: list[Vector] = []
    for number, body in enumerate(scene.obstacles):
        state = states.row(number)
        shapes += outlines(body.shape, state.position, matrix(state.rotation), scene.window)
    axis.add_collection(PolyCollection(shapes, facecolors=DRIVEN_COLOUR, edgecolors="0.2", linewidths=0.5))
    lines = []
    for name, places in scene.joints(frame).items():
        style, width, colour = _STYLES[name]
        (line,) = axis.plot(
            *places.T, style, linewidth=width, color=colour, marker="o", markersize=1.5 * width, label=name
        )
        lines.append(line)
    return lines


def draw_strip(path: Path, scene: ChainScene, title: str) -> None:
    """Up to six frames, evenly spread in time."""
    frames = spread_frames(scene.results, 6, float(scene.times[-1]))
    lower, upper = scene.window
    aspect = float((upper - lower)[1] / (upper - lower)[0])
    columns = 3
    rows = -(-len(frames) // columns)
    figure = new_figure(columns * 3.2 + 0.6, rows * (3.2 * aspect + 0.4) + 1.0)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    lines: list[Any] = []
    for axis, frame in zip(axes, frames, strict=False):
        lines = draw_chains(axis, scene, frame)
        axis.set_title(f"t = {scene.times[frame]:.3g} s", fontsize=9, loc="left")
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    if len(lines) > 1:
        figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), fontsize=9)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_tip(path: Path, scene: ChainScene, title: str) -> None:
    """Paths of the last ends over the run, and the exact one where it is known."""
    found = scene.results.observables
    across, up = (max(float(np.ptp(found[f"tip_{axis}_{name}"])) for name in scene.names) for axis in "xz")
    figure = new_figure(6.4, 1.6 + 5.5 * min(max(up / max(across, 1e-12), 0.2), 1.2))
    axis = figure.subplots()
    for name in scene.names:
        style, width, colour = _STYLES[name]
        axis.plot(
            found[f"tip_x_{name}"], found[f"tip_z_{name}"], style, color=colour, linewidth=width, label=name
        )
    if "tip_x_exact" in found:
        axis.plot(found["tip_x_exact"], found["tip_z_exact"], color="black", linewidth=0.8, label="exact")
    axis.set(aspect="equal", xlabel="x (m)", ylabel="z (m)")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    axis.set_title(f"{title}\npath of the tip", fontsize=10, loc="left")
    save_figure(figure, path)


def draw_animation(path: Path, scene: ChainScene, title: str) -> None:
    """An endless GIF of the run, at most 3 MB."""
    content = b""
    for width, count in _ANIMATIONS:
        frames = spread_frames(scene.results, count, float(scene.times[-1]))
        content = encode(_images(scene, frames, width, title), (_COLOURS,))
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)


def _images(scene: ChainScene, frames: Sequence[int], width: float, title: str) -> list[Image.Image]:
    """One RGB picture per frame; the axes are drawn once and only the chains move."""
    lower, upper = scene.window
    aspect = float((upper - lower)[1] / (upper - lower)[0])
    figure = Figure(figsize=(width, 0.85 * width * aspect + 0.9), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.add_axes((0.14, 0.12, 0.82, 0.78))
    lines = draw_chains(axis, scene, frames[0])
    if len(lines) > 1:
        axis.legend(fontsize=7, loc="upper right")
    axis.set_title(title, fontsize=8, loc="left")
    images = []
    for frame in frames:
        for line, places in zip(lines, scene.joints(frame).values(), strict=True):
            line.set_data(places[:, 0], places[:, 1])
        axis.set_title(f"t = {scene.times[frame]:.2f} s", fontsize=8, loc="right")
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
    return images
