"""Neighbour list of spheres: all pairs nearer than a skin, found in a time linear in their number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.soft import _neighbour_kernels as kernels
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]
_CELLS_PER_GRAIN = 4
_FEWEST = 3  # cells along a periodic axis, below which a grain would meet a pair of images


@dataclass(frozen=True, eq=False)
class Neighbours:
    """k pairs (k, 2), first < second, sorted; shifts (k, 3) to the image of the second that is near.

    rows (n + 1,) : the pairs whose first is i are rows[i] .. rows[i + 1]. second (n + 1,), second_rows (k,) : those
    whose second is.
    """

    pairs: Whole
    shifts: NDArray[np.int8]
    rows: Whole
    second: Whole
    second_rows: Whole


def check_cell(lengths: Vector, height: float, sheared: bool, reach: float, dimension: int) -> None:
    """InputError when a grain would have two images within `reach`. lengths (3,) : 0 along axes that are not periodic."""
    for axis in range(dimension):
        width = lengths[axis]
        if axis == 0 and sheared:
            width /= np.hypot(1.0, 0.5 * width / height)
        if 0.0 < width < _FEWEST * reach:
            allowed = f"at least {lengths[axis] * _FEWEST * reach / width:g} along axis {axis}"
            raise InputError("cell.lengths", float(lengths[axis]), allowed)


def find_neighbours(x: Vector, grains: Vector, skin: float, cell: Vector, dimension: int) -> Neighbours:
    """Pairs of grains whose surfaces are nearer than `skin`; x (n, 3) in the cell (3, 6), see `cell_rows`."""
    n = len(x)
    periodic = np.array([cell[axis, axis] > 0.0 for axis in range(3)])
    reach = 2.0 * float(np.max(grains[:, 0])) + skin if n else 1.0
    lower, edges = np.zeros(3), np.ones(3)
    for axis in range(3):
        if periodic[axis]:
            edges[axis] = cell[axis, axis]
        elif n and axis < dimension:
            lower[axis] = np.min(x[:, axis])
            edges[axis] = max(float(np.max(x[:, axis])) - lower[axis], 1e-9 * reach)
    upright = dimension - 1
    tilt = cell[upright, 0] / cell[upright, upright] if periodic[upright] and periodic[0] else 0.0
    widths = edges / np.array([np.hypot(1.0, tilt), 1.0, 1.0])
    counts = np.maximum(np.floor(np.minimum(widths / reach, 1e6)).astype(np.int64), 1)
    counts[dimension:] = 1
    fewest = np.where(periodic, _FEWEST, 1)
    while np.prod(counts.astype(float)) > _CELLS_PER_GRAIN * n + 64 and np.any(counts > fewest):
        counts = np.maximum(counts * 3 // 4, np.minimum(fewest, counts))
    if np.any(periodic & (counts < _FEWEST)):
        raise InputError(
            "cell.lengths", edges[:dimension].tolist(), f"at least {_FEWEST * reach:g} wherever periodic"
        )
    cells, order, starts = kernels.bin_grains(x, lower, edges, tilt, upright, counts)
    rows = np.zeros(n + 1, dtype=np.int64)
    kernels.count_neighbours(x, grains, skin, cell, counts, periodic, cells, order, starts, rows)
    rows = np.cumsum(rows)
    pairs = np.empty((rows[-1], 2), dtype=np.int64)
    shifts = np.empty((rows[-1], 3), dtype=np.int8)
    kernels.fill_neighbours(
        x, grains, skin, cell, counts, periodic, cells, order, starts, rows, pairs, shifts
    )
    second, second_rows = kernels.incident_pairs(pairs, n)
    return Neighbours(pairs, shifts, rows, second, second_rows)
