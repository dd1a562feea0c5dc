"""Pictures of finite-element fields in the plane: colours with a labelled bar, stream lines, plugs hatched, many panels.

Half domains may be shown whole (`mirror=True`: about their part "axis"). Drawn with matplotlib's Agg canvas.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.tri import Triangulation
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh

from barchan.errors import InputError
from barchan.results.field_files import write_series, write_vtu
from barchan.results.field_views import View, make_view, stream_grid
from barchan.results.figures import new_figure, save_figure

__all__ = [
    "DIMENSIONLESS",
    "KINEMATIC",
    "SI",
    "Panel",
    "draw_field",
    "draw_flow_fields",
    "draw_panels",
    "write_series",
    "write_vtu",
]

SI: Mapping[str, str] = {
    "x": "x (m)",
    "y": "y (m)",
    "speed": "speed (m/s)",
    "pressure": "pressure (Pa)",
    "shear stress": "shear stress (Pa)",
    "shear rate": "shear rate (1/s)",
    "viscosity": "viscosity (Pa s)",
}
"""Labels of axes and colour bars in SI units."""

DIMENSIONLESS: Mapping[str, str] = {
    "x": "x / L",
    "y": "y / L",
    "speed": "speed / U",
    "pressure": "pressure / P",
    "shear stress": "shear stress / P",
    "shear rate": "shear rate L / U",
    "viscosity": "viscosity / (P L / U)",
}
"""Labels of axes and colour bars for scales L, U and P (seed A: U = sqrt(g L), P = rho g L)."""

KINEMATIC: Mapping[str, str] = {
    **SI,
    "pressure": "pressure / density (m²/s²)",
    "shear stress": "shear stress / density (m²/s²)",
    "viscosity": "viscosity / density (m²/s)",
}
"""Labels of axes and colour bars in SI units with stresses over the density (seed C 6.2.2)."""

_PANEL_INCHES = 3.6
_LEAST_LOGARITHMIC = 1e-4
_HATCH = "////"


@dataclass(frozen=True)
class Panel:
    """One field of a figure.

    Parameters
    ----------
    values : (vertices,) or (cells,) numbers, or (vertices, 2) vectors, of which the length is shown; NaN is left blank.
    label : of the colour bar, with the unit.
    title : above the panel.
    colours : name of matplotlib's colour map.
    limits : ends of the colour bar; from the values when None.
    clip : fraction of the area whose largest values, and negative ones whose lowest values, may lie beyond the bar (singular
        corners would use it up).
    logarithmic : colours by order of magnitude, four of them below the largest value.
    lines : number of iso-lines over the colours.
    velocity : (vertices, 2) velocities whose stream lines are drawn.
    rigid : (cells,) or (vertices,) true where the matter is not sheared; hatched.
    odd : the mirror image has the opposite sign (a shear stress component, say).
    """

    values: ArrayLike
    label: str
    title: str = ""
    colours: str = "viridis"
    limits: tuple[float, float] | None = None
    clip: float = 0.0
    logarithmic: bool = False
    lines: int = 0
    velocity: ArrayLike | None = None
    rigid: ArrayLike | None = None
    odd: bool = False


def draw_field(
    path: str | Path,
    mesh: Mesh,
    values: ArrayLike,
    label: str,
    *,
    mirror: bool = False,
    units: Mapping[str, str] = SI,
    **options: Any,
) -> None:
    """Picture (PNG) of one field on a mesh of the plane; `options` are those of `Panel`.

    Raises InputError for a mesh in space, values of another length, or a place that cannot be written.
    """
    draw_panels(path, mesh, [Panel(values, label, **options)], mirror=mirror, units=units)


def draw_flow_fields(
    path: str | Path,
    mesh: Mesh,
    velocity: ArrayLike,
    pressure: ArrayLike | None = None,
    shear_stress: ArrayLike | None = None,
    shear_rate: ArrayLike | None = None,
    rigid: ArrayLike | None = None,
    *,
    viscosity: ArrayLike | None = None,
    title: str = "",
    mirror: bool = False,
    units: Mapping[str, str] = SI,
) -> None:
    """Picture (PNG) of a flow: speed with stream lines, then pressure, shear stress, viscosity, shear rate with plugs hatched.

    Parameters
    ----------
    velocity : (vertices, 2).
    pressure, shear_stress, shear_rate, viscosity : (vertices,) or (cells,); a field that is None has no panel.
    rigid : (cells,) or (vertices,) true in plugs, hatched over the shear rate (over the speed without it).
    mirror : show both halves of a mesh with a part "axis".
    units : labels, `SI`, `DIMENSIONLESS` or `KINEMATIC`.

    Raises InputError as `draw_field`.
    """
    over_speed = rigid if shear_rate is None else None
    panels = [Panel(velocity, units["speed"], "velocity", velocity=velocity, rigid=over_speed)]
    if pressure is not None:
        panels.append(Panel(pressure, units["pressure"], "pressure", "magma", clip=0.005, lines=12))
    if shear_stress is not None:
        panels.append(Panel(shear_stress, units["shear stress"], "shear stress", "magma", clip=0.005))
    if viscosity is not None:
        panels.append(Panel(viscosity, units["viscosity"], "viscosity", "magma", logarithmic=True))
    if shear_rate is not None:
        panels.append(
            Panel(shear_rate, units["shear rate"], "shear rate", "cividis", logarithmic=True, rigid=rigid)
        )
    draw_panels(path, mesh, panels, title=title, mirror=mirror, units=units)


def draw_panels(
    path: str | Path,
    mesh: Mesh,
    panels: Sequence[Panel],
    *,
    title: str = "",
    mirror: bool = False,
    columns: int | None = None,
    units: Mapping[str, str] = SI,
) -> None:
    """Picture (PNG) of several fields side by side, axes equal; `columns` to a row, chosen from the shape when None.

    Raises InputError as `draw_field`, and for no panel at all.
    """
    if len(panels) == 0:
        raise InputError("panels", "none", "at least one field")
    view = make_view(mesh, mirror)
    width, height = view.size
    if columns is None:
        columns = max(1, round(np.sqrt(len(panels) * height / width * 1.4)))
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    # The longer side of a panel has the fixed length; its colour bar and labels come on top.
    scale = _PANEL_INCHES / max(width, 0.7 * height)
    figure = new_figure(columns * (scale * width + 1.5), rows * (scale * height + 0.55) + 0.4 * bool(title))
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axis, panel in zip(axes, panels, strict=False):
        _draw(figure, axis, view, panel)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for number, axis in enumerate(axes[: len(panels)]):
        if number + columns >= len(panels):
            axis.set_xlabel(units["x"])
            axis.tick_params(labelbottom=True)
        if number % columns == 0:
            axis.set_ylabel(units["y"])
    if title:
        figure.suptitle(title, fontsize=11)
    save_figure(figure, Path(path))


def _draw(figure: Figure, axis: Axes, view: View, panel: Panel) -> None:
    """One panel: colours, iso-lines, hatches, stream lines, colour bar."""
    values, at_vertices = view.scalars(panel.label, panel.values, panel.odd)
    low, high, extend = _ends(panel, values, view.weights(at_vertices))
    norm = (LogNorm if panel.logarithmic and low > 0.0 else Normalize)(low, high)
    triangulation = Triangulation(view.points[:, 0], view.points[:, 1], view.triangles)
    # On a logarithmic bar what is too small, zero above all, has the lowest colour; elsewhere the bar does it.
    shown = np.where(np.isfinite(values), np.maximum(values, low) if panel.logarithmic else values, np.nan)
    if at_vertices:
        triangulation.set_mask(~np.all(np.isfinite(shown[view.triangles]), axis=1))
        colours: Any = axis.tripcolor(
            triangulation, np.nan_to_num(shown), shading="gouraud", cmap=panel.colours, norm=norm
        )
        if panel.lines:
            levels = np.linspace(low, high, panel.lines + 2)[1:-1]
            axis.tricontour(
                triangulation, np.nan_to_num(shown), levels=levels, colors="white", linewidths=0.5
            )
    else:
        colours = axis.tripcolor(
            triangulation, facecolors=np.ma.masked_invalid(shown), cmap=panel.colours, norm=norm
        )
    axis.add_collection(LineCollection(list(view.points[view.outline]), colors="0.25", linewidths=0.8))
    if panel.rigid is not None:
        _hatch(axis, view, panel.rigid)
    if panel.velocity is not None:
        _stream_lines(axis, view, panel.velocity)
    axis.set_aspect("equal")
    axis.set_xlim(view.lower[0], view.upper[0])
    axis.set_ylim(view.lower[1], view.upper[1])
    axis.set_title(panel.title, fontsize=10, loc="left")
    figure.colorbar(colours, ax=axis, label=panel.label, extend=extend, shrink=0.9, pad=0.02)


def _ends(
    panel: Panel, values: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[float, float, str]:
    """Ends of the colour bar, and at which of them values lie beyond."""
    known = np.isfinite(values)
    if not np.any(known):
        return 0.0, 1.0, "neither"
    least, most = float(np.min(values[known])), float(np.max(values[known]))
    low, high = (
        panel.limits
        if panel.limits is not None
        else (least, _below(values[known], weights[known], panel.clip))
    )
    if panel.limits is None and least < 0.0:
        low = -_below(-values[known], weights[known], panel.clip)
    if panel.logarithmic and high > 0.0:
        low = max(low, _LEAST_LOGARITHMIC * high)
    if not high > low:
        # A field without contrast: a bar around its value.
        low, high = low - 0.5 * max(abs(low), 1e-300), low + 0.5 * max(abs(low), 1.0)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(
        (least < low, most > high), "neither"
    )
    return low, high, extend


def _below(values: NDArray[np.float64], weights: NDArray[np.float64], clip: float) -> float:
    """The value that only the fraction `clip` of the weight exceeds."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / np.sum(weights)
    place = min(int(np.searchsorted(share, 1.0 - clip)), len(order) - 1)
    return float(values[order[place]])


def _hatch(axis: Axes, view: View, rigid: ArrayLike) -> None:
    """Hatch the rigid cells as one shape."""
    chosen = view.marked(rigid)
    if not np.any(chosen):
        return
    corners = view.points[view.triangles[chosen]]
    corners = np.concatenate([corners, corners[:, :1]], axis=1)
    codes = np.tile([Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY], len(corners))
    shape = Outline(corners.reshape(-1, 2), codes)
    axis.add_patch(
        PathPatch(shape, facecolor=(1.0, 1.0, 1.0, 0.25), edgecolor="0.2", hatch=_HATCH, linewidth=0.0)
    )


def _stream_lines(axis: Axes, view: View, velocity: ArrayLike) -> None:
    """Stream lines of vertex velocities, where they are not negligible."""
    x, y, u, w = stream_grid(view, velocity)
    if np.ma.count(u) and float(np.ma.max(np.hypot(u, w))) > 0.0:
        axis.streamplot(x, y, u, w, color="white", linewidth=0.6, arrowsize=0.6, density=1.2)
