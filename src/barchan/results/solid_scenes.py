"""Bodies that move as given in the frames of a stored run, and strips and animations of them and of what they touch.

`SolidScene` is the base of the scenes of fibres and of cloth; what draws a frame is given to `draw_strip` and `draw_animation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from barchan.bodies.rigid import Body, Prescribed
from barchan.bodies.rigid.rotations import matrix
from barchan.results.animation import LARGEST_SIZE, encode
from barchan.results.figures import new_figure, save_figure
from barchan.results.pictures import COLOUR_MAP
from barchan.results.reader import Results
from barchan.results.view import spread_frames
from barchan.storage import write_bytes

Vector = NDArray[np.float64]
Pixels = tuple[int, int]

_FRAMES_LOOKED_AT = 12
_PIXELS: Pixels = (900, 800)
_ANIMATIONS = (((520, 460), 60), ((420, 380), 40), ((320, 280), 24))  # pixels, number of frames


class SolidScene:
    """`bodies` that move as given, and what else a subclass shows, in the frames of `results`; `colour` says of what."""

    def __init__(self, bodies: Sequence[Body], results: Results, colour: str = "speed") -> None:
        self.bodies, self.results, self.colour = bodies, results, colour

    @property
    def times(self) -> Vector:
        """(frames,) [s]."""
        return np.asarray(self.results.times)

    @property
    def looked_at(self) -> list[int]:
        """Frames that the window and the colours are made for."""
        count = min(self.results.frames, _FRAMES_LOOKED_AT)
        return np.unique(np.linspace(0, self.results.frames - 1, count).astype(int)).tolist()

    @property
    def label(self) -> str:
        """What the colours mean."""
        return "speed (m/s)"

    @property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale over the frames that pictures show."""
        return 0.0, 1.0

    def pose(self, number: int, time: float) -> tuple[Vector, Vector]:
        """Position (3,) and rotation matrix (3, 3) of a body at `time` [s]."""
        body = self.bodies[number]
        if not isinstance(body.motion, Prescribed):
            return body.position, matrix(body.rotation)
        turn = body.motion.rotation_at(time)
        return body.motion.position_at(time), matrix(body.rotation if turn is None else turn)


class ShownScene(Protocol):
    """What strips and animations ask of a scene."""

    @property
    def results(self) -> Results:
        """The stored run."""

    @property
    def times(self) -> Vector:
        """(frames,) [s]."""

    @property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale."""

    @property
    def label(self) -> str:
        """What the colours mean."""


Shown = TypeVar("Shown", bound=ShownScene)
Painter = Callable[[Shown, int, Pixels], NDArray[np.uint8]]
"""(scene, frame, pixels) -> RGB image."""


def painter(solid: Painter[Shown], flat: Painter[Shown]) -> Painter[Shown]:
    """What draws a frame: `solid` where PyVista is, else `flat`."""
    try:
        import pyvista  # noqa: F401
    except ImportError:
        return flat
    return solid


def draw_strip(path: Path, scene: Shown, title: str, draw: Painter[Shown]) -> None:
    """Up to six frames, evenly spread in time."""
    frames = spread_frames(scene.results, 6, float(scene.times[-1]))
    columns = min(3, len(frames))
    rows = -(-len(frames) // columns)
    figure = new_figure(columns * 3.6 + 1.4, rows * 3.4 + 0.7)
    axes: Any = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, frame in zip(axes, frames, strict=False):
        axis.imshow(draw(scene, frame, _PIXELS))
        axis.set_title(f"t = {scene.times[frame]:.3g} s", fontsize=9, loc="left")
    shown = ScalarMappable(Normalize(*scene.scale), COLOUR_MAP)
    figure.colorbar(shown, ax=list(axes), label=scene.label, extend="max", shrink=0.8, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_animation(path: Path, scene: Shown, title: str, draw: Painter[Shown]) -> None:
    """An endless GIF of the run, at most 3 MB."""
    content = b""
    for pixels, count in _ANIMATIONS:
        images = []
        for frame in spread_frames(scene.results, count, float(scene.times[-1])):
            image = Image.fromarray(draw(scene, frame, pixels))
            words = f"{title}   t = {scene.times[frame]:.2f} s"
            ImageDraw.Draw(image).text((6, 4), words, fill=(0, 0, 0))
            images.append(image)
        content = encode(images)
        if len(content) <= LARGEST_SIZE:
            break
    write_bytes(path, content)
