"""The collapse as an animated GIF, kept below a size that fits a web page.

Frames share one palette so that colours do not flicker; if the file comes out too large it is drawn smaller.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from barchan.results.pictures import COLOUR_MAP, scatter_speed
from barchan.results.reader import Results
from barchan.results.view import SideView, side_points, side_view, spread_frames
from barchan.storage import write_bytes

LARGEST_SIZE = 3_000_000  # bytes
_FRAME_MILLISECONDS = 60
_LAST_FRAME_MILLISECONDS = 1500
_SIZES = ((8.0, 60), (7.0, 45), (5.5, 30), (4.0, 20))  # width in inches at 100 dpi, number of frames


def draw_animation(path: Path, results: Results, until: float, title: str) -> None:
    """Write an endless GIF of the run from its start to time `until` (s) and its last frame, at most 3 MB."""
    content = b""
    for width, count in _SIZES:
        frames = spread_frames(results, count, until)
        content = encode(_images(results, frames, width, title))
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)


def _images(results: Results, frames: list[int], width: float, title: str) -> list[Image.Image]:
    """One RGB picture per frame; the axes are drawn once and only the particles move."""
    view = side_view(results, frames)
    figure, canvas, axis = _stage(width, view, title)
    points = scatter_speed(axis, results, frames[0], view, 0.8 * width)
    colour_bar = figure.colorbar(points, ax=axis, label="speed (m/s)", extend="max", fraction=0.05, pad=0.02)
    colour_bar.ax.tick_params(labelsize=7)
    images = []
    for frame in frames:
        x, z, speeds = side_points(results, frame)
        points.set_offsets(np.column_stack([x, z]))
        points.set_array(speeds)
        axis.set_title(f"t = {results.times[frame]:.2f} s", fontsize=9, loc="right")
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()))
        figure.set_layout_engine("none")  # keep the first layout: nothing may jump
    return images


def _stage(width: float, view: SideView, title: str) -> tuple[Figure, FigureCanvasAgg, Axes]:
    figure = Figure(figsize=(width, 0.8 * width * view.aspect + 1.1), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axis = figure.subplots()
    axis.set(xlabel="x (m)", ylabel="z (m)")
    axis.set_title(title, fontsize=9, loc="left")
    return figure, canvas, axis


def _palette(scales: Sequence[str]) -> Image.Image:
    """The colours of the scales and greys for text and frame, as Pillow wants a palette: in a picture of one pixel."""
    colours = [colormaps[name](np.linspace(0.0, 1.0, 192 // (len(scales) + 1)))[:, :3] for name in scales]
    greys = np.repeat(np.linspace(0.0, 1.0, 32)[:, None], 3, axis=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(255.0 * np.vstack([*colours, greys])).astype(np.uint8).tobytes())
    return palette


def encode(images: list[Image.Image], scales: Sequence[str] = (COLOUR_MAP,)) -> bytes:
    """The GIF file of pictures whose colours are those of matplotlib's `scales`."""
    palette = _palette(scales)
    reduced = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [_FRAME_MILLISECONDS] * (len(reduced) - 1) + [_LAST_FRAME_MILLISECONDS]
    buffer = io.BytesIO()
    reduced[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=durations,
        loop=0,
        optimize=False,
    )
    return buffer.getvalue()
