"""Pictures of numbers over one variable: profiles across a flow, histories, fits; lines and points with named axes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from barchan.results.figures import new_figure, save_figure


def draw_lines(
    path: Path,
    abscissa: np.ndarray,
    drawn: Mapping[str, np.ndarray],
    labels: tuple[str, str],
    *,
    title: str = "",
    upright: bool = False,
    logarithmic: bool = False,
) -> None:
    """Write a PNG with one line for each entry of `drawn`, atomically.

    Parameters
    ----------
    abscissa : (n,).  drawn : words of the legend -> (n,); those with "exact" in them are drawn dashed.
    labels : of the abscissa and of the values, with units.  upright : the abscissa is drawn upwards.
    logarithmic : the values by order of magnitude; those that are not positive are left out.
    """
    figure = new_figure(6.4, 4.8)
    axis = figure.subplots()
    for words, values in drawn.items():
        style: dict[str, Any] = {"linestyle": "--", "color": "black"} if "exact" in words else {}
        axis.plot(*((values, abscissa) if upright else (abscissa, values)), label=words, **style)
    along, values_label = labels
    axis.set(xlabel=values_label if upright else along, ylabel=along if upright else values_label)
    if logarithmic:
        (axis.set_xscale if upright else axis.set_yscale)("log", nonpositive="mask")
    axis.set_title(title, fontsize=10, loc="left")
    axis.grid(alpha=0.3)
    if len(drawn) > 1:
        axis.legend(fontsize=8)
    save_figure(figure, path)
