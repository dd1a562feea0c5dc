"""Deposits seen from above: the height of the matter over the ground, and its outline along rays from a centre.

The height over a ground node is the volume of the particles around it, shared among nodes by the bilinear shape functions,
divided by the node's ground area and the packed volume fraction: what lies packed has its exact height, flying grains
barely count, and the volume is conserved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

RAYS = 180
_STEPS_PER_CELL = 8  # points along a ray


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Height of the matter over the ground nodes of a box.

    x : (n,), y : (m,) coordinates of the nodes (m), equally spaced.  height : (n, m) m.
    """

    x: Vector
    y: Vector
    height: Vector

    @property
    def cell(self) -> float:
        """Shorter edge of a ground cell (m)."""
        return float(min(self.x[1] - self.x[0], self.y[1] - self.y[0]))

    def smoothed(self, passes: int = 2) -> HeightMap:
        """The map with each height averaged with its neighbours, weights 1, 2, 1 along both axes, `passes` times."""
        heights = self.height
        for _ in range(passes):
            for axis in (0, 1):
                padded = np.pad(heights, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
                before, middle, after = (
                    np.take(padded, np.arange(heights.shape[axis]) + shift, axis) for shift in (0, 1, 2)
                )
                heights = 0.25 * before + 0.5 * middle + 0.25 * after
        return HeightMap(self.x, self.y, heights)

    def at(self, points: Vector) -> Vector:
        """Bilinear heights (k,) at `points` (k, 2) m, those outside the box taken at its edge."""
        place = []
        for axis, nodes in enumerate((self.x, self.y)):
            inside = np.clip(points[:, axis], nodes[0], nodes[-1])
            place.append((inside - nodes[0]) / (nodes[1] - nodes[0]))
        i, j = (np.minimum(p.astype(np.int64), n - 2) for p, n in zip(place, self.height.shape, strict=True))
        s, t = place[0] - i, place[1] - j
        h = self.height
        low = (1.0 - t) * h[i, j] + t * h[i, j + 1]
        high = (1.0 - t) * h[i + 1, j] + t * h[i + 1, j + 1]
        return np.asarray((1.0 - s) * low + s * high)


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed line around a centre, seen from above.

    angles : (k,) rad, equally spaced.  radii : (k,) m; NaN where a ray never meets the line.
    """

    angles: Vector
    radii: Vector

    @property
    def whole(self) -> bool:
        """Whether every ray meets the line."""
        return bool(np.all(np.isfinite(self.radii)))

    @property
    def mean_radius(self) -> float:
        """Mean radius (m); NaN for a line that is not whole."""
        return float(self.radii.mean())

    @property
    def circularity(self) -> float:
        """Largest over smallest radius, 1 of a circle; NaN for a line that is not whole."""
        return float(self.radii.max() / self.radii.min())

    def harmonic(self, order: int) -> float:
        """Amplitude of the wave of the radii with `order` crests, relative to the mean radius: 4 shows a square's corners."""
        wave = 2.0 * np.abs(np.mean(self.radii * np.exp(1j * order * self.angles)))
        return float(wave / self.radii.mean())


def height_map(
    positions: Vector, volumes: Vector, size: list[float], cells: list[int], packed_volume_fraction: float
) -> HeightMap:
    """Heights of particles at `positions` (P, 3) m with `volumes` (P,) m^3 in a box of `size` (3,) m with `cells` (3,)."""
    shape = (cells[0] + 1, cells[1] + 1)
    left, share = [], []
    for axis in (0, 1):
        place = np.clip(
            np.asarray(positions[:, axis], dtype=np.float64) * cells[axis] / size[axis], 0.0, cells[axis]
        )
        left.append(np.minimum(place.astype(np.int64), cells[axis] - 1))
        share.append(place - left[-1])
    volume = np.zeros(shape[0] * shape[1])
    for a in (0, 1):
        for b in (0, 1):
            weight = (share[0] if a else 1.0 - share[0]) * (share[1] if b else 1.0 - share[1])
            numbers = (left[0] + a) * shape[1] + left[1] + b
            volume += np.bincount(numbers, weight * volumes, len(volume))
    widths = [np.full(n, length / (n - 1)) for n, length in zip(shape, size, strict=False)]
    for width in widths:
        width[[0, -1]] *= 0.5
    ground = widths[0][:, None] * widths[1][None, :]
    x, y = (np.linspace(0.0, length, n) for n, length in zip(shape, size, strict=False))
    return HeightMap(x, y, volume.reshape(shape) / (ground * packed_volume_fraction))


def outline_of(
    heights: HeightMap, centre: tuple[float, float], level: float, kind: Literal["heap", "crater"]
) -> Outline:
    """Where rays from `centre` (m) first fall below `level` (m), of a heap, or first rise above it, of a crater."""
    angles: Vector = np.linspace(0.0, 2.0 * np.pi, RAYS, endpoint=False)
    reach = float(np.hypot(heights.x[-1] - heights.x[0], heights.y[-1] - heights.y[0]))
    count = int(np.ceil(_STEPS_PER_CELL * reach / heights.cell)) + 1
    along = np.linspace(0.0, reach, count)
    points = np.stack(
        [centre[0] + np.outer(np.cos(angles), along), centre[1] + np.outer(np.sin(angles), along)], axis=-1
    )
    inside = (points >= [heights.x[0], heights.y[0]]) & (points <= [heights.x[-1], heights.y[-1]])
    above = heights.at(points.reshape(-1, 2)).reshape(RAYS, count) - level
    if kind == "heap":
        above = -above
    crossing = np.all(inside, axis=-1) & (above >= 0.0)
    first = np.argmax(crossing, axis=1)
    found = crossing.any(axis=1) & (first > 0)
    before = np.maximum(first - 1, 0)
    rows = np.arange(RAYS)
    low, high = above[rows, before], above[rows, first]
    part = np.divide(-low, high - low, out=np.zeros(RAYS), where=high > low)
    radii = along[before] + part * (along[first] - along[before])
    radii[~found] = np.nan
    return Outline(angles, radii)
