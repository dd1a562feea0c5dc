"""Initial particles: boxes and shapes filled with matter at its maximal volume fraction (seed B, 7.3 and 7.5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from numbers import Integral
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.flows.mpm.frames import initial_frames
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.state import State
from barchan.spaces import RegularGrid

# Cells overlapped by less than this share of their edge are not filled: the overlap is a rounding error.
_NEGLIGIBLE_OVERLAP = 1e-6
# Parts per axis into which a brick is cut to find out how much of it lies inside a shape.
_PARTS = 4


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
    widths = np.stack(np.meshgrid(*(edges for _, edges in axes), indexing="ij"), axis=-1).reshape(
        -1, grid.dimension
    )
    volumes = material.max_volume_fraction * np.prod(widths, axis=1)
    state = State.at_start(positions.reshape(-1, grid.dimension), volumes)
    return replace(state, frames=initial_frames(widths))


class Solid(Protocol):
    """What is asked of a shape, in the coordinates of the box (the shapes of `barchan.bodies.rigid` have it)."""

    def signed_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]: ...

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...


def fill_shape(
    grid: RegularGrid,
    shape: Solid,
    particles_per_cell_per_axis: int,
    material: Material,
    outside: Sequence[Solid] = (),
) -> State:
    """State at rest filling a `shape` in the box, without what lies inside the shapes `outside`.

    The bricks of `fill_box` over the bounds of the shape; of those that its boundary cuts the part inside is kept, at its
    centre, so that the volume is that of the shape to second order in the size of the bricks.

    Raises
    ------
    InputError : as `fill_box`, and for a shape that holds no brick.
    """
    low, high = shape.bounds()
    bricks = fill_box(
        grid, np.clip(low, grid.origin, grid.upper), np.clip(high, grid.origin, grid.upper),
        particles_per_cell_per_axis, material,
    )  # fmt: skip
    d, parts = grid.dimension, _PARTS
    edges = 2.0 * np.sqrt(np.diagonal(bricks.frames, axis1=1, axis2=2))
    middle = (np.arange(parts) + 0.5) / parts - 0.5
    offsets = np.stack(np.meshgrid(*[middle] * d, indexing="ij"), axis=-1).reshape(-1, d)
    reach = 0.5 * np.linalg.norm(edges, axis=1)

    def depth(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.max(
            [shape.signed_distance(points)] + [-other.signed_distance(points) for other in outside], axis=0
        )

    distance = depth(bricks.positions)
    share, places = (distance < 0.0).astype(np.float64), bricks.positions.copy()
    cut = np.flatnonzero(np.abs(distance) < reach)
    points = places[cut][:, None, :] + edges[cut][:, None, :] * offsets
    inside = (depth(points.reshape(-1, d)) < 0.0).reshape(len(cut), parts**d)
    share[cut] = np.mean(inside, axis=1)
    some = share[cut] > 0.0
    places[cut[some]] = (
        np.sum(np.where(inside[some][..., None], points[some], 0.0), axis=1)
        / np.sum(inside[some], axis=1)[:, None]
    )
    kept = share > 0.0
    if not np.any(kept):
        raise InputError(
            "shape", type(shape).__name__, "with some of its inside in the box, outside of the other shapes"
        )
    state = State.at_start(places[kept], bricks.volumes[kept] * share[kept])
    return replace(state, frames=bricks.frames[kept] * (share[kept] ** (2.0 / d))[:, None, None])


def joined(states: Sequence[State]) -> State:
    """First states put together; `materials` of each part is its place in the sequence unless it says itself.

    Raises InputError for none, states of different dimensions, or frames, cohesions or orientations that only some have.
    """
    if not states or len({state.dimension for state in states}) > 1:
        raise InputError("states", [state.dimension for state in states], "at least one, of one dimension")
    first = State.at_start(
        *(
            np.concatenate([getattr(s, name) for s in states])
            for name in ("positions", "volumes", "velocities")
        )
    )
    numbers = [
        s.materials if len(s.materials) else np.full(s.particle_count, place, dtype=np.int32)
        for place, s in enumerate(states)
    ]
    given: dict[str, Any] = {}
    for name in ("frames", "cohesions", "orientations"):
        values = np.concatenate([getattr(s, name) for s in states])
        if len(values) not in (0, first.particle_count):
            raise InputError(f"states.{name}", "given for some of the states only", "given for all or none")
        given[name] = values
    return replace(
        first,
        affine=np.concatenate([s.affine for s in states]),
        materials=np.concatenate(numbers).astype(np.int32),
        **given,
    )


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
