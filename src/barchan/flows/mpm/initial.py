"""Initial particles: a box filled with matter at its maximal volume fraction (seed B, 7.3 and 7.5.1)."""

from __future__ import annotations

from itertools import pairwise
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.state import State
from barchan.spaces import RegularGrid

# Cells overlapped by less than this share of their edge are not filled: the overlap is a rounding error.
_NEGLIGIBLE_OVERLAP = 1e-6


def fill_box(
    grid: RegularGrid,
    lower: ArrayLike,
    upper: ArrayLike,
    particles_per_cell_per_axis: int,
    material: Material,
) -> State:
    """State at rest filling the box `[lower, upper]` (d,) [m] with a lattice of particles.

    The part of each grid cell inside the box is divided into equal bricks, about `particles_per_cell_per_axis` to a cell
    edge, each with a particle at its centre. This quadrature integrates every shape function exactly over the box: the
    volume fraction is phi_max at inner nodes wherever the box begins in the grid, and no settling shock follows. Volumes
    add up to phi_max times the volume of the box; a box placed symmetrically in the grid gives a symmetric lattice.

    Raises
    ------
    InputError : for a box that is empty or not inside the grid, or fewer than one particle per cell and axis.
    """
    low, high = _corner("lower", lower, grid), _corner("upper", upper, grid)
    slack = _NEGLIGIBLE_OVERLAP * grid.spacing
    if np.any(low < grid.origin - slack) or np.any(high > grid.upper + slack):
        raise InputError(
            "box",
            f"{low.tolist()}..{high.tolist()}",
            f"inside the grid {grid.origin.tolist()}..{grid.upper.tolist()}",
        )
    if np.any(high - low <= slack):
        raise InputError("upper", high.tolist(), f"above the lower corner {low.tolist()} along every axis")
    count = particles_per_cell_per_axis
    if isinstance(count, bool) or not isinstance(count, Integral) or count < 1:
        raise InputError("particles_per_cell_per_axis", count, "a whole number >= 1")
    axes = [_axis_points(grid, axis, low[axis], high[axis], int(count)) for axis in range(grid.dimension)]
    positions = np.stack(np.meshgrid(*(points for points, _ in axes), indexing="ij"), axis=-1)
    volumes = np.full((1,) * grid.dimension, material.max_volume_fraction)
    for axis, (_, widths) in enumerate(axes):
        volumes = volumes * widths.reshape([-1 if k == axis else 1 for k in range(grid.dimension)])
    return State.at_start(positions.reshape(-1, grid.dimension), volumes.reshape(-1))


def _corner(field: str, value: ArrayLike, grid: RegularGrid) -> NDArray[np.float64]:
    corner = np.asarray(value, dtype=np.float64)
    if corner.shape != (grid.dimension,) or not np.all(np.isfinite(corner)):
        raise InputError(field, value, f"{grid.dimension} finite coordinates")
    return corner


def _axis_points(
    grid: RegularGrid, axis: int, low: float, high: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and widths of the bricks along one axis, in cell units of the grid turned back into metres."""
    start, step = grid.origin[axis], grid.spacing[axis]
    begin, end = (low - start) / step, (high - start) / step
    first, last = int(np.floor(begin + _NEGLIGIBLE_OVERLAP)), int(np.ceil(end - _NEGLIGIBLE_OVERLAP))
    cuts = [begin if abs(begin - first) > _NEGLIGIBLE_OVERLAP else float(first)]
    cuts += [float(cell) for cell in range(first + 1, last)]
    cuts.append(end if abs(end - last) > _NEGLIGIBLE_OVERLAP else float(last))
    points: list[float] = []
    widths: list[float] = []
    for left, right in pairwise(cuts):
        bricks = max(1, round(count * (right - left)))
        width = (right - left) / bricks
        points.extend(left + (brick + 0.5) * width for brick in range(bricks))
        widths.extend([width] * bricks)
    return start + step * np.array(points), step * np.array(widths)
