"""Pictures of a campaign, drawn with matplotlib's Agg canvas: performance profiles, and residual against time.

Profiles as seed B, Figures 4.8 and 4.13; both axes of time are logarithmic.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from barchan.bench.measurement import Measurement
from barchan.bench.profile import cost_table, performance_profile
from barchan.storage import replacing

MOST_PANELS = 12
FLOOR, TOP = 1e-3, 1e3  # of the residuals drawn, the former relative to the tolerance
LINES = ("-", "--", ":")
_DPI = 150


def draw_profile(path: Path, measurements: Sequence[Measurement], tolerance: float) -> None:
    """Share of the problems solved to `tolerance` within a multiple of the time of the fastest solver."""
    problems, solvers, costs = cost_table(measurements)
    x, share = performance_profile(costs)
    figure = Figure(figsize=(7.5, 4.8), layout="constrained")
    axis = figure.subplots()
    end = max(2.0, 1.1 * float(x[-1]))
    for k, solver in enumerate(solvers):
        axis.step(
            np.append(x, end),
            100.0 * np.append(share[:, k], share[-1, k]),
            where="post",
            label=solver,
            **_style(k),
        )
    axis.set(xscale="log", xlim=(1.0, end), ylim=(0.0, 103.0))
    axis.set_xlabel("time / time of the fastest solver of the problem")
    axis.set_ylabel("problems solved (%)")
    axis.set_title(f"{len(problems)} problems, certificate {tolerance:g}", fontsize=10)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))
    _save(figure, path)


def draw_residuals(path: Path, measurements: Sequence[Measurement], tolerance: float) -> None:
    """Residual against time, a panel for each problem; at most MOST_PANELS of them, evenly spread over the list."""
    problems = list(dict.fromkeys(entry.problem for entry in measurements))
    solvers = list(dict.fromkeys(entry.solver for entry in measurements))
    spread = np.unique(np.linspace(0, len(problems) - 1, min(MOST_PANELS, len(problems))).round().astype(int))
    shown = [problems[k] for k in spread]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(4.2 * columns + 1.6, 2.7 * rows + 0.8), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis, problem in zip(axes.ravel(), shown, strict=False):
        for entry in measurements:
            if entry.problem == problem:
                _draw_history(axis, entry, FLOOR * tolerance, _style(solvers.index(entry.solver)))
        axis.axhline(tolerance, color="black", linewidth=0.6)
        axis.set(xscale="log", yscale="log")
        axis.set_ylim(bottom=0.7 * FLOOR * tolerance)
        _label_times(axis)
        axis.set_title(problem[:48], fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.3)
    for axis in axes.ravel()[len(shown) :]:
        axis.set_visible(False)
    figure.supxlabel("time (ms)", fontsize=9)
    figure.supylabel("residual of the friction law, relative (-)", fontsize=9)
    handles = [axes[0, 0].plot([], [], label=solver, **_style(k))[0] for k, solver in enumerate(solvers)]
    figure.legend(handles=handles, loc="outside right upper", fontsize=8)
    _save(figure, path)


def _draw_history(axis: Axes, entry: Measurement, floor: float, style: dict[str, Any]) -> None:
    """The best residual so far over time, its end marked; what is below `floor` is drawn there."""
    points = [(1e3 * seconds, residual) for seconds, residual in entry.history if seconds > 0.0]
    if not points:
        return
    times, residuals = np.array(sorted(points)).T
    axis.plot(times, np.minimum.accumulate(np.clip(residuals, floor, TOP)), **style)
    axis.plot(times[-1], np.clip(residuals.min(), floor, TOP), marker=".", color=style["color"])


def _label_times(axis: Axes) -> None:
    """Plain numbers on the axis of time, more of them where it spans less than two decades."""
    low, high = axis.get_xlim()
    axis.xaxis.set_major_locator(
        LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,), numticks=12)
    )
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _style(k: int) -> dict[str, Any]:
    palette = colormaps["tab10"]
    return {"color": palette(k % 10), "linestyle": LINES[(k // 10) % len(LINES)], "linewidth": 1.3}


def _save(figure: Figure, path: Path) -> None:
    with replacing(path) as temporary:
        FigureCanvasAgg(figure)
        figure.savefig(temporary, dpi=_DPI, format="png")
