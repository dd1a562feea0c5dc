"""What the reproductions of grains inside a fluid share: jobs, pictures of both phases at given frames, layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.workshop import Finished, Job, Workshop, new_figure
from barchan.scenes.loading import load_parameters

Vector = NDArray[np.float64]


def job(label: str, scene: str, quick: bool, coarse: Mapping[str, Any], **overrides: Any) -> Job:
    """A run of a scene; quickly, with the coarse settings in the place of its own."""
    return Job(label, scene, {**overrides, **(coarse if quick else {})})


def frame_at(run: Finished, time: float) -> int:
    """The frame nearest to `time` (s)."""
    return int(np.argmin(np.abs(run.results.times - time)))


def parameters_of(run: Finished) -> Any:
    """The parameters of a finished run."""
    assert run.results.folder is not None
    return load_parameters(run.results.folder / "scene.toml", {})


def phase_panels(
    workshop: Workshop,
    name: str,
    rows: Sequence[Sequence[tuple[str, Finished, int]]],
    panel: float = 3.2,
    same_scale: bool = True,
) -> None:
    """A table of pictures: (words, run, frame) of each; the fluid coloured by speed, with arrows, grains by theirs.

    same_scale : one scale of colours for all, else one for each row.
    """
    from dataclasses import replace

    from barchan.results.fluid_sections import FluidArtists, whole_view
    from barchan.results.suspension_pictures import speed_bars

    views = [[whole_view(run.results, [frame]) for _, run, frame in row] for row in rows]
    aspect = views[0][0][0].aspect
    columns = max(len(row) for row in rows)
    figure = new_figure(columns * panel + 2.4, len(rows) * (0.9 * panel * aspect + 0.42) + 0.4)
    axes = figure.subplots(len(rows), columns, sharex=True, sharey=True, squeeze=False)
    everything = [entry for row in views for entry in row]
    for line, (row, seen) in enumerate(zip(rows, views, strict=True)):
        scale = everything if same_scale else seen
        grains = max(view.top_speed for view, _ in scale)
        fluid = max(top for _, top in scale)
        drawn = None
        for axis, (words, run, frame), (view, _) in zip(axes[line], row, seen, strict=False):
            drawn = FluidArtists(axis, run.results, frame, replace(view, top_speed=grains), fluid, panel)
            when = f"t = {run.results.times[frame]:.3g} s"
            axis.set_title(", ".join(filter(None, (words, when))), fontsize=8, loc="left")
        for axis in axes[line][len(row) :]:
            axis.set_visible(False)
        axes[line][0].set_ylabel("z (m)")
        if drawn is not None and not (same_scale and line):
            speed_bars(figure, list(axes.ravel() if same_scale else axes[line]), drawn)
    for axis in axes[-1]:
        axis.set_xlabel("x (m)")
    workshop.save(name, figure)
