"""What the reproductions of the material point method share: jobs of sand scenes, coarse grids of the quick mode, sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.reproductions.workshop import Finished, Job, Workshop, new_figure
from barchan.results.heaps import HeightMap, height_map
from barchan.scenes.granular.surface import Surface, free_surface

Vector = NDArray[np.float64]


def job(label: str, scene: str, quick: bool, coarse: Mapping[str, Any], **overrides: Any) -> Job:
    """A run of a scene; quickly, on the coarse grid that replaces its own."""
    return Job(label, scene, {**overrides, **(coarse if quick else {})})


def surface_at(run: Finished, frame: int) -> Surface:
    """The free surface over x of a frame of a run."""
    particles, box = run.results.particles(frame), run.results.scene["box"]
    packed = run.results.scene["material"]["max_volume_fraction"]
    return free_surface(particles["positions"], particles["volumes"], box["size"], box["cells"], packed)


def heights_at(run: Finished, frame: int) -> HeightMap:
    """The matter of a frame of a run seen from above, smoothed as the scene's own outline is."""
    particles, box = run.results.particles(frame), run.results.scene["box"]
    packed = run.results.scene["material"]["max_volume_fraction"]
    return height_map(
        particles["positions"], particles["volumes"], box["size"], box["cells"], packed
    ).smoothed()


def draw_surfaces(
    workshop: Workshop, name: str, runs: Sequence[tuple[str, Finished]], frame: int = -1
) -> None:
    """The free surfaces of several runs at a frame in one picture, the initial one of the first dashed."""
    figure = new_figure(9.0, 3.6)
    axis = figure.subplots()
    start = surface_at(runs[0][1], 0)
    axis.plot(start.x, start.height, "--", color="black", linewidth=1.0, label="initial")
    for words, run in runs:
        surface = surface_at(run, frame)
        axis.plot(surface.x, surface.height, label=words)
    axis.set(xlabel="x (m)", ylabel="height (m)", ylim=(0.0, None))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    workshop.save(name, figure)


def speed_panels(workshop: Workshop, name: str, runs: Sequence[tuple[str, Finished, int]]) -> None:
    """Sections through runs at frames, particles coloured by their speed over the greatest of all."""
    from barchan.results.view import side_points

    figure = new_figure(9.0, 2.6 * len(runs) + 0.6)
    axes = np.atleast_1d(figure.subplots(len(runs), 1, sharex=True))
    seen = [side_points(run.results, frame) for _, run, frame in runs]
    top = max(float(np.quantile(speeds, 0.995)) for _, _, speeds in seen) or 1.0
    points = None
    for axis, (words, run, frame), (x, z, speeds) in zip(axes, runs, seen, strict=True):
        points = axis.scatter(x, z, c=speeds, s=2.0, linewidths=0.0, cmap="viridis", vmin=0.0, vmax=top)
        axis.set(aspect="equal", ylabel="z (m)")
        axis.set_title(f"{words}, t = {run.results.times[frame]:.2f} s", fontsize=9, loc="left")
    axes[-1].set_xlabel("x (m)")
    figure.colorbar(points, ax=list(axes), label="speed (m/s)", extend="max")
    workshop.save(name, figure)
