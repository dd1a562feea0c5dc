"""The free surface of a heap of particles along x, and its slope.

The height at the abscissa of a grid node is the volume of the particles around it, shared among nodes by the
linear (hat) shape functions, divided by the ground area of the node and by the packed volume fraction. A
packed lattice gives its exact height wherever it lies in the grid, single flying grains barely count, and the
volume is conserved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_WINDOW = 2  # nodes on each side in the straight-line fit of the local slope


@dataclass(frozen=True)
class Surface:
    """Free surface over x, averaged over the depth in 3D.

    x : (n,) abscissae of the grid nodes (m), equally spaced.
    height : (n,) height of the surface (m).
    """

    x: Vector
    height: Vector

    @property
    def spacing(self) -> float:
        """Distance of two abscissae (m)."""
        return float(self.x[1] - self.x[0])

    def steepest_slope(self, thinnest: float) -> float:
        """Largest angle (degrees) of straight lines fitted to five neighbouring points, all higher than `thinnest` (m).

        The fit smooths grid noise; 0 when nowhere five neighbouring points are that high.
        """
        width = 2 * _WINDOW + 1
        if len(self.x) < width:
            return 0.0
        windows = np.lib.stride_tricks.sliding_window_view(self.height, width)
        offsets = np.arange(-_WINDOW, _WINDOW + 1) * self.spacing
        slopes = np.abs(windows @ offsets) / float(offsets @ offsets)
        thick = windows.min(axis=1) > thinnest
        return float(np.degrees(np.arctan(slopes[thick].max()))) if thick.any() else 0.0

    def mean_slope(self) -> float:
        """Angle (degrees) of the straight line fitted to the points between 5 % and 95 % of the greatest height."""
        greatest = float(self.height.max())
        face = (self.height > 0.05 * greatest) & (self.height < 0.95 * greatest)
        if face.sum() < 2:
            return 90.0 if greatest > 0.0 else 0.0
        return float(abs(np.degrees(np.arctan(np.polyfit(self.x[face], self.height[face], 1)[0]))))


def free_surface(
    positions: Vector, volumes: Vector, size: list[float], cells: list[int], packed_volume_fraction: float
) -> Surface:
    """Free surface of particles at `positions` (P, d) with `volumes` (P,) in a box of `size` (d,) m with `cells` (d,)."""
    count = cells[0]
    spacing = size[0] / count
    place = np.clip(np.asarray(positions[:, 0], dtype=np.float64) / spacing, 0.0, count)
    left = np.minimum(place.astype(np.int64), count - 1)
    share = place - left
    volume = np.bincount(left, (1.0 - share) * volumes, count + 1)
    volume += np.bincount(left + 1, share * volumes, count + 1)
    ground = np.full(count + 1, spacing)
    ground[[0, -1]] *= 0.5
    depth = size[1] if len(size) == 3 else 1.0
    height: Vector = np.divide(volume, ground * depth * packed_volume_fraction)
    return Surface(np.linspace(0.0, size[0], count + 1), height)
