"""The fluid around grains in the plane of a picture: speeds as colours, velocities as arrows, the grains on top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from barchan.results.pictures import scatter_speed
from barchan.results.reader import Results
from barchan.results.view import SideView, side_points, side_view

Vector = NDArray[np.float64]

FLUID_MAP = "Blues"
_DARKEST = 0.75  # of the map that the fluid's colours reach: arrows stay visible
_ARROWS = 26  # along the longer side of a picture
_LONGEST = 1.6  # arrow of the top speed, in distances of two arrows


@dataclass(frozen=True, eq=False)
class FluidSection:
    """The fluid in the x-z plane, in 3D on the layer of nodes nearest to the middle.

    x : (n,) m.  z : (m,) m.  along, upwards : (n, m) velocity components in the plane (m/s).  fractions : (n, m) of grains.
    pressures : (n, m) Pa.
    """

    x: Vector
    z: Vector
    along: Vector
    upwards: Vector
    fractions: Vector
    pressures: Vector

    @property
    def speeds(self) -> Vector:
        """(n, m) speeds in the plane (m/s)."""
        return np.asarray(np.hypot(self.along, self.upwards))


def fluid_section(results: Results, frame: int) -> FluidSection:
    """The fluid of a frame of a run on a regular grid with the group `fields` at all of its nodes."""
    box, fields = results.scene["box"], results.fields(frame)
    shape = tuple(count + 1 for count in box["cells"])
    x, z = (np.linspace(0.0, box["size"][axis], shape[axis]) for axis in (0, -1))
    middle = () if len(shape) == 2 else (slice(None), shape[1] // 2)

    def cut(values: Vector) -> Vector:
        return np.asarray(values.reshape(shape)[middle] if middle else values.reshape(shape), np.float64)

    velocities = fields["velocities"]
    return FluidSection(
        x, z, cut(velocities[:, 0]), cut(velocities[:, -1]), cut(fields["volume_fractions"]), cut(fields["pressures"])
    )  # fmt: skip


def whole_view(results: Results, frames: list[int]) -> tuple[SideView, float]:
    """A window on the whole box for the grains of the given frames, and the top of the scale of the fluid's speed (m/s)."""
    box = results.scene["box"]["size"]
    fastest = max(float(np.quantile(fluid_section(results, frame).speeds, 0.998)) for frame in frames)
    seen = side_view(results, frames)
    densest = results.scene["grains"]["max_volume_fraction"]
    grain = seen.grain / densest ** (1.0 / len(box))  # as large as packed: a bed has no gaps
    return SideView(box[0], box[-1], seen.top_speed, grain), max(fastest, 1e-12)


class FluidArtists:
    """Colours, arrows and grains of one pair of axes, moved from frame to frame."""

    def __init__(
        self, axis: Axes, results: Results, frame: int, view: SideView, top: float, width: float
    ) -> None:
        self.results = results
        section = fluid_section(results, frame)
        self.image = axis.imshow(
            section.speeds.T, origin="lower", cmap=fluid_colours(), vmin=0.0, vmax=top, interpolation="bilinear",
            extent=(section.x[0], section.x[-1], section.z[0], section.z[-1]), zorder=0,
        )  # fmt: skip
        self.points = scatter_speed(axis, results, frame, view, width)
        self.points.set_zorder(1)
        self._rows = _places(section, view)
        step = max(view.width, view.height) / _ARROWS
        i, j = self._rows
        self.arrows = axis.quiver(
            section.x[i], section.z[j], *self._components(section), angles="xy", scale_units="xy",
            scale=top / (_LONGEST * step), width=0.0022, color="0.15", zorder=2, minlength=0.4,
        )  # fmt: skip

    def show(self, frame: int) -> None:
        """Move to a frame."""
        section = fluid_section(self.results, frame)
        self.image.set_data(section.speeds.T)
        x, z, speeds = side_points(self.results, frame)
        self.points.set_offsets(np.column_stack([x, z]))
        self.points.set_array(speeds)
        self.arrows.set_UVC(*self._components(section))

    def _components(self, section: FluidSection) -> tuple[Vector, Vector]:
        i, j = self._rows
        return section.along[i, j], section.upwards[i, j]


def _places(section: FluidSection, view: SideView) -> tuple[Any, Any]:
    """Rows and columns of the nodes that carry arrows: about `_ARROWS` along the longer side."""
    step = max(view.width, view.height) / _ARROWS
    chosen = []
    for along in (section.x, section.z):
        stride = max(1, round(step / float(along[1] - along[0])))
        chosen.append(np.arange(stride // 2, len(along), stride))
    i, j = np.meshgrid(*chosen, indexing="ij")
    return i.ravel(), j.ravel()


def fluid_colours() -> ListedColormap:
    """The light part of the map of the fluid."""
    return ListedColormap(colormaps[FLUID_MAP](np.linspace(0.0, _DARKEST, 128)), name="fluid")
