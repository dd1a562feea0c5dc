"""What the pictures look at: the vertical x-z plane of a run, cropped to where the material ever is.

A 3D run is seen from the side through a slab around the mid plane, so that inner speeds show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barchan.results.reader import Results

_SLAB_FRACTION = 0.2  # of the depth of a 3D box, centred
_MARGIN = 1.08
_OVERLAP = {2: 1.35, 3: 1.8}  # side of a drawn particle over its own, by dimension


@dataclass(frozen=True)
class SideView:
    """A window on the x-z plane.

    Attributes
    ----------
    width, height : extent of the window (m), from the lower left corner of the box.
    top_speed : speed (m/s) at the upper end of the colour scale.
    grain : side (m) of the square drawn for one particle: larger than the particle, so that sheared matter and the
        layers of a slab show no gaps.
    """

    width: float
    height: float
    top_speed: float
    grain: float

    @property
    def aspect(self) -> float:
        """Height over width."""
        return self.height / self.width


def side_view(results: Results, frames: list[int]) -> SideView:
    """A window that holds the particles of all given frames, clipped to the box."""
    box = results.scene["box"]["size"]
    reach, top, speed = 0.0, 0.0, 0.0
    for frame in frames:
        x, z, speeds = side_points(results, frame)
        reach, top = max(reach, float(x.max())), max(top, float(z.max()))
        speed = max(speed, float(np.quantile(speeds, 0.995)))
    particles = results.particles(0)
    dimension = particles["positions"].shape[1]
    grain = _OVERLAP[dimension] * float(np.median(particles["volumes"])) ** (1.0 / dimension)
    return SideView(min(box[0], _MARGIN * reach), min(box[-1], _MARGIN * top), max(speed, 1e-12), grain)


def side_points(results: Results, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x (m), z (m) and speed (m/s) of the particles seen from the side, the fastest last."""
    particles = results.particles(frame)
    positions, velocities = particles["positions"], particles["velocities"]
    if positions.shape[1] == 3:
        depth = results.scene["box"]["size"][1]
        seen = np.abs(positions[:, 1] - 0.5 * depth) <= 0.5 * _SLAB_FRACTION * depth
        if seen.any():
            positions, velocities = positions[seen], velocities[seen]
    speeds = np.linalg.norm(velocities, axis=1)
    order = np.argsort(speeds, kind="stable")
    return positions[order, 0], positions[order, -1], speeds[order]


def spread_frames(results: Results, count: int, until: float) -> list[int]:
    """At most `count` frame numbers, evenly spread in time from the start to time `until` (s), plus the last frame."""
    end = float(results.times[-1])
    wanted = np.linspace(0.0, end, count) if until >= end else [*np.linspace(0.0, until, count - 1), end]
    return sorted({int(np.argmin(np.abs(results.times - time))) for time in wanted})
