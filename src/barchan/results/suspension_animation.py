"""Grains inside a fluid as an animated GIF: both phases in the x-z plane, kept below a size that fits a web page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from barchan.results.animation import LARGEST_SIZE, encode
from barchan.results.fluid_sections import FLUID_MAP, FluidArtists, whole_view
from barchan.results.pictures import COLOUR_MAP
from barchan.results.reader import Results
from barchan.results.suspension_pictures import speed_bars
from barchan.results.view import spread_frames
from barchan.storage import write_bytes

_SIZES = ((8.0, 60), (7.0, 40), (5.5, 30), (4.5, 18))  # width in inches at 100 dpi, number of frames


def draw_suspension_animation(path: Path, results: Results, until: float, title: str) -> None:
    """Write an endless GIF of the run from its start to time `until` (s) and its last frame, at most 3 MB."""
    content = b""
    for width, count in _SIZES:
        frames = spread_frames(results, count, until)
        content = encode(_images(results, frames, width, title), (COLOUR_MAP, FLUID_MAP))
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)


def _images(results: Results, frames: list[int], width: float, title: str) -> list[Image.Image]:
    """One RGB picture per frame; the axes are drawn once and only colours, arrows and grains change."""
    view, top = whole_view(results, frames)
    panel = min(0.75 * width, 0.75 * width / view.aspect)
    figure = Figure(figsize=(width, panel * view.aspect + 1.0), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axis = figure.subplots()
    drawn = FluidArtists(axis, results, frames[0], view, top, panel)
    axis.set(xlabel="x (m)", ylabel="z (m)")
    speed_bars(figure, [axis], drawn, fraction=0.05)
    figure.suptitle(title, fontsize=9)
    images = []
    for frame in frames:
        drawn.show(frame)
        axis.set_title(f"t = {results.times[frame]:.2f} s", fontsize=9, loc="right")
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
        figure.set_layout_engine("none")  # keep the first layout: nothing may jump
    return images
