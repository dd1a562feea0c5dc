"""Pictures of plane bodies by matplotlib: to scale, coloured by speed or size, force chains, an animation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from barchan.bodies.rigid import Box, Capsule, HalfSpace, Moved, Polygon, Shape, Sphere, Union
from barchan.bodies.rigid.rotations import matrix
from barchan.results.animation import LARGEST_SIZE, encode
from barchan.results.body_scenes import BodyScene, Window
from barchan.results.figures import new_figure, save_figure
from barchan.results.pictures import COLOUR_MAP
from barchan.results.view import spread_frames
from barchan.storage import write_bytes

Vector = NDArray[np.float64]

DRIVEN_COLOUR = "0.55"
FORCE_MAP = "inferno_r"
_EDGE = "0.2"
_WIDEST = 5.0  # points, of the largest force
_THIN = 0.01  # thickness of a body over the window, below which its edge would hide it
_ROUND = 24  # corners of a round end
_ANIMATIONS = ((7.0, 60), (6.0, 40), (4.5, 25))  # width in inches at 100 dpi, number of frames


def draw_strip(path: Path, scene: BodyScene, title: str) -> None:
    """Up to six frames, evenly spread in time."""
    frames = spread_frames(scene.results, 6, float(scene.times[-1]))
    lower, upper = scene.window
    aspect = float((upper - lower)[1] / (upper - lower)[0])
    columns = 2 if aspect <= 1.0 else 3
    rows = -(-len(frames) // columns)
    panel = 4.75 if aspect <= 1.0 else max(4.75 / aspect, 2.2)
    figure = new_figure(columns * panel + 1.9, rows * ((panel - 0.5) * aspect + 0.75) + 0.5)
    figure.set_layout_engine("compressed")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    shown: Any = None
    for axis, frame in zip(axes, frames, strict=False):
        shown = draw_bodies(axis, scene, frame, scene.window)
        axis.set_title(f"t = {scene.times[frame]:.3g} s", fontsize=9, loc="left")
    for axis in axes[len(frames) :]:
        axis.set_visible(False)
    figure.colorbar(shown, ax=list(axes), label=scene.label, extend="max", shrink=0.9, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_forces(path: Path, scene: BodyScene, title: str) -> None:
    """Force chains of the last frame: lines through contacts between centres, as wide and as dark as the force is large."""
    frame = scene.results.frames - 1
    window = scene.window_of([frame])
    lower, upper = window
    aspect = float((upper - lower)[1] / (upper - lower)[0])
    width = min(9.0, 8.0 / aspect)
    figure = new_figure(width + 1.8, width * aspect + 1.0)
    figure.set_layout_engine("compressed")
    axis: Axes = figure.subplots()
    draw_bodies(axis, scene, frame, window, plain=True)
    lines = chain_lines(axis, scene, frame)
    figure.colorbar(lines, ax=axis, label="contact force (N/m)", shrink=0.9)
    axis.set_title(f"{title}\nforces, t = {scene.times[frame]:.3g} s", fontsize=10, loc="left")
    save_figure(figure, path)


def draw_animation(path: Path, scene: BodyScene, title: str) -> None:
    """An endless GIF of the run, at most 3 MB."""
    content = b""
    for width, count in _ANIMATIONS:
        frames = spread_frames(scene.results, count, float(scene.times[-1]))
        content = encode(_images(scene, frames, width, title))
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)


def draw_bodies(axis: Axes, scene: BodyScene, frame: int, window: Window, plain: bool = False) -> Any:
    """Draw what a window shows of a frame; `plain` without colours. The coloured artist, for a colour bar, is returned."""
    lower, upper = window
    axis.set(
        xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]), aspect="equal", xlabel="x (m)", ylabel="z (m)"
    )
    axis.tick_params(labelsize=8)
    places, turns, values = scene.places(frame), scene.turns(frame), scene.values(frame)
    norm = Normalize(*scene.scale)
    thick: dict[bool, list[int]] = {
        True: [],
        False: [],
    }  # of free bodies, and whether an edge can be seen beside the face
    fixed: list[Vector] = []
    free: list[Vector] = []
    tones: list[float] = []
    for number, body in enumerate(scene.bodies):
        if isinstance(body.shape, Sphere):
            continue
        for corners in outlines(body.shape, places[number], turns[number], window):
            if not scene.free[number]:
                fixed.append(corners)
                continue
            thick[_area(corners) > _THIN * scene.radii[number] * float(np.max(upper - lower))].append(
                len(free)
            )
            free.append(corners)
            tones.append(float(values[number]))
    axis.add_collection(PolyCollection(fixed, facecolors=DRIVEN_COLOUR, edgecolors=_EDGE, linewidths=0.5))
    shown: Any = None
    for visible, chosen in thick.items():
        style: dict[str, Any] = {"facecolors": "0.9", "edgecolors": "0.6"}
        if not plain:
            style = {"array": np.array([tones[k] for k in chosen]), "cmap": COLOUR_MAP, "norm": norm,
                     "edgecolors": _EDGE if visible else "face"}  # fmt: skip
        shown = PolyCollection([free[k] for k in chosen], linewidths=0.5 if visible else 1.5, **style)
        axis.add_collection(shown)
    discs = _discs(axis, scene, places, turns, values, norm, plain)
    return shown if free else discs


def _area(corners: Vector) -> float:
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _discs(
    axis: Axes, scene: BodyScene, places: Vector, turns: Sequence[Vector], values: Vector, norm: Normalize, plain: bool
) -> Any:  # fmt: skip
    """Discs, with a radius each that shows how they turn."""
    discs, shown = scene.spheres, None
    for chosen, free in ((discs[~scene.free[discs]], False), (discs[scene.free[discs]], True)):
        size = 2.0 * scene.radii[chosen]
        style: dict[str, Any] = {"facecolors": "0.9" if free else DRIVEN_COLOUR}
        if free and not plain:
            style = {"array": values[chosen], "cmap": COLOUR_MAP, "norm": norm}
        shown = EllipseCollection(
            size, size, np.zeros(len(chosen)), units="xy", offsets=places[chosen], offset_transform=axis.transData,
            edgecolors=_EDGE, linewidths=0.3, **style,
        )  # fmt: skip
        axis.add_collection(shown)
    free_discs = discs[scene.free[discs]]
    if len(free_discs) and not plain:
        tips = np.array([turns[k][:, 0] * scene.radii[k] for k in free_discs])
        marks = np.stack([places[free_discs], places[free_discs] + tips], axis=1)
        axis.add_collection(LineCollection(list(marks), colors=_EDGE, linewidths=0.3))
    return shown


def outlines(shape: Shape, place: Vector, turn: Vector, window: Window) -> list[Vector]:
    """Filled polygons (n, 2) in the world that show a shape; of a half space what the window shows."""
    if isinstance(shape, Union):
        return [corners for part in shape.parts for corners in outlines(part, place, turn, window)]
    if isinstance(shape, Moved):
        return outlines(shape.shape, place + turn @ shape.offset, turn @ matrix(shape.rotation), window)
    if isinstance(shape, HalfSpace):
        return _half_plane(shape, place, turn, window)
    return [place + _corners(shape) @ turn.T]


def _corners(shape: Shape) -> Vector:
    """Corners (n, 2) of a shape in its frame."""
    if isinstance(shape, Polygon):
        return shape.vertices
    if isinstance(shape, Box):
        return np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * shape.half_extents
    if isinstance(shape, Sphere):
        return _arc(shape.radius, 0.0, 2.0 * np.pi)
    if isinstance(shape, Capsule):
        along = float(np.arctan2(shape.axis[1], shape.axis[0]))
        ends = [
            sign * shape.half_length * shape.axis + _arc(shape.radius, along + start, along + start + np.pi)
            for sign, start in ((1.0, -0.5 * np.pi), (-1.0, 0.5 * np.pi))
        ]
        return np.concatenate(ends)
    lower, upper = shape.bounds()
    segments = shape.facets(float(np.max(upper - lower)), lower, upper)
    return np.asarray(segments[:, 0])


def _arc(radius: float, start: float, end: float) -> Vector:
    angles = np.linspace(start, end, _ROUND)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _half_plane(shape: HalfSpace, place: Vector, turn: Vector, window: Window) -> list[Vector]:
    """The window cut by a half plane."""
    normal = turn @ shape.normal
    offset = shape.offset + float(normal @ place)
    (x0, y0), (x1, y1) = window
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    depth = corners @ normal - offset
    kept = []
    for k in range(4):
        a, b, da, db = corners[k], corners[(k + 1) % 4], depth[k], depth[(k + 1) % 4]
        if da <= 0.0:
            kept.append(a)
        if da * db < 0.0:
            kept.append(a + da / (da - db) * (b - a))
    return [np.array(kept)] if len(kept) > 2 else []


def chain_lines(axis: Axes, scene: BodyScene, frame: int) -> Any:
    """Lines from centre to contact to centre; only to the contact where a body is driven."""
    segments, strengths = scene.chains(frame)
    largest = max(float(np.max(strengths, initial=0.0)), 1e-300)
    order = np.argsort(strengths)
    lines = LineCollection(
        list(segments[order]), array=strengths[order], linewidths=0.3 + _WIDEST * strengths[order] / largest,
        cmap=FORCE_MAP, norm=Normalize(0.0, largest), capstyle="round", zorder=5,
    )  # fmt: skip
    axis.add_collection(lines)
    return lines


def _images(scene: BodyScene, frames: Sequence[int], width: float, title: str) -> list[Image.Image]:
    """One RGB picture per frame, all of the same layout."""
    lower, upper = scene.window
    aspect = float((upper - lower)[1] / (upper - lower)[0])
    width = min(width, 1.0 + 0.8 * width / aspect)
    images = []
    for frame in frames:
        figure = Figure(figsize=(width, 0.8 * width * aspect + 1.1), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axis = figure.add_axes((0.12, 0.1, 0.74, 0.8))
        shown = draw_bodies(axis, scene, frame, scene.window)
        bar = figure.colorbar(
            shown, cax=figure.add_axes((0.88, 0.2, 0.02, 0.6)), label=scene.label, extend="max"
        )
        bar.ax.tick_params(labelsize=7)
        axis.set_title(title, fontsize=8, loc="left")
        axis.set_title(f"t = {scene.times[frame]:.2f} s", fontsize=8, loc="right")
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
    return images
