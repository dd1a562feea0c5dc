"""Grains and rigid bodies as an animated GIF: the section from the side, in 3D with the relief from above beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from barchan.results.animation import LARGEST_SIZE, encode
from barchan.results.heap_pictures import (
    Heights,
    Silhouettes,
    contour_lines,
    draw_bodies,
    draw_relief,
    view_with_bodies,
)
from barchan.results.pictures import scatter_speed
from barchan.results.reader import Results
from barchan.results.view import SideView, side_points, spread_frames
from barchan.storage import write_bytes

_SIZES = ((8.0, 60), (6.5, 40), (5.0, 25), (4.0, 16))  # width in inches at 100 dpi, number of frames


def draw_heap_animation(
    path: Path,
    results: Results,
    sides: Silhouettes,
    above: tuple[Heights, Silhouettes] | None,
    until: float,
    title: str,
) -> None:
    """Write an endless GIF of the run from its start to time `until` (s) and its last frame, at most 3 MB.

    sides : the bodies in the section.  above : heights and bodies seen from above, in 3D.
    """
    content = b""
    for width, count in _SIZES:
        frames = spread_frames(results, count, until)
        content = encode(_Stage(results, frames, sides, above, width, title).images())
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)


class _Stage:
    """The axes of an animation, drawn once; particles, reliefs and bodies change from frame to frame."""

    def __init__(
        self,
        results: Results,
        frames: list[int],
        sides: Silhouettes,
        above: tuple[Heights, Silhouettes] | None,
        width: float,
        title: str,
    ) -> None:
        self.results, self.frames, self.sides, self.above = results, frames, sides, above
        view = view_with_bodies(results, frames, sides)
        panels = 1 if above is None else 2
        panel = width / panels
        box = results.scene["box"]["size"]
        tallest = max(view.aspect, 0.0 if above is None else box[1] / box[0])
        self.figure = Figure(figsize=(width, 0.8 * panel * tallest + 1.1), dpi=100, layout="constrained")
        self.canvas = FigureCanvasAgg(self.figure)
        axes = np.atleast_1d(self.figure.subplots(1, panels))
        self.side: Axes = axes[0]
        self.top: Axes | None = None if above is None else axes[1]
        self._draw_side(view, 0.8 * panel, title)
        if self.top is not None:
            self._draw_top()

    def _draw_side(self, view: SideView, panel: float, title: str) -> None:
        self.side.set(xlabel="x (m)", ylabel="z (m)")
        self.points = scatter_speed(self.side, self.results, self.frames[0], view, panel)
        bar = self.figure.colorbar(
            self.points,
            ax=self.side,
            label="speed (m/s)",
            extend="max",
            location="bottom",
            pad=0.02,
            fraction=0.06,
        )
        bar.ax.tick_params(labelsize=7)
        self.figure.suptitle(title, fontsize=9)

    def _draw_top(self) -> None:
        assert self.top is not None and self.above is not None
        shown = spread_frames(self.results, 8, float(self.results.times[-1]))
        maps = [self.above[0](frame) for frame in shown]
        self.highest = max(float(np.quantile(one.height, 0.999)) for one in maps) or 1.0
        self.image = draw_relief(self.top, maps[0], self.highest)
        bar = self.figure.colorbar(
            self.image, ax=self.top, label="height (m)", location="bottom", pad=0.02, fraction=0.06
        )
        bar.ax.tick_params(labelsize=7)

    def images(self) -> list[Image.Image]:
        """One RGB picture per frame."""
        pictures = []
        for frame in self.frames:
            artists = self._show(frame)
            self.canvas.draw()
            pictures.append(Image.fromarray(np.asarray(self.canvas.buffer_rgba())[:, :, :3].copy()))
            self.figure.set_layout_engine("none")  # keep the first layout: nothing may jump
            for artist in artists:
                artist.remove()
        return pictures

    def _show(self, frame: int) -> list[Any]:
        """Move everything to a frame; the artists that belong to it alone are returned."""
        x, z, speeds = side_points(self.results, frame)
        self.points.set_offsets(np.column_stack([x, z]))
        self.points.set_array(speeds)
        self.side.set_title(f"t = {self.results.times[frame]:.2f} s", fontsize=9, loc="right")
        artists = draw_bodies(self.side, self.sides(frame))
        if self.top is not None and self.above is not None:
            heights = self.above[0](frame)
            self.image.set_data(heights.height.T)
            artists += contour_lines(self.top, heights, self.highest) + draw_bodies(
                self.top, self.above[1](frame)
            )
        return artists
