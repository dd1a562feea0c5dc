"""Mesh of a channel around a cylinder (seed A, Fig. 14): body-fitted rings near the cylinder joined to structured rows.

The flow runs along +x ("downstream"), the channel spans -width/2 <= y <= width/2, the cylinder is centred at the origin.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes._cells import (
    best_diagonals,
    count,
    cut,
    everywhere,
    grid_quadrilaterals,
    number,
    plane,
    triangle_mesh,
)

_FEWEST_VERTICES = 40


def channel_with_cylinder(
    diameter: float,
    width: float,
    length_before: float,
    length_after: float,
    vertices: int,
    half: bool = False,
) -> MeshTri:
    """Triangles of the channel -length_before <= x <= length_after, |y| <= width/2, without the disc at the origin.

    Parameters
    ----------
    diameter : of the cylinder, at most 0.9 of the width.
    width : of the whole channel.
    length_before, length_after : from the centre of the cylinder to the upstream and downstream ends.
    vertices : about how many the mesh should have, of the whole channel or of the half.
    half : only y >= 0, with the part "axis" on y = 0; otherwise the mesh is symmetric about the axis.

    Parts: inflow (upstream), outflow (downstream), sides, cylinder, and axis for the half channel.

    Raises InputError for lengths that are not positive, a cylinder that does not fit, fewer than 40 vertices.
    """
    width = number("channel.width", width)
    diameter = number("channel.diameter", diameter)
    if diameter > 0.9 * width:
        raise InputError("channel.diameter", diameter, f"at most 0.9 of the width of the channel ({width:g})")
    before = _length("channel.length_before", length_before, diameter)
    after = _length("channel.length_after", length_after, diameter)
    wanted = count("channel.vertices", vertices, _FEWEST_VERTICES)
    shape = _shape(diameter / 2, width / 2, before, after, wanted, half)
    points, triangles = _half_channel(diameter / 2, width / 2, before, after, shape)
    size = max(width, before + after)
    if not half:
        points, triangles = _with_mirror_image(points, triangles, 1e-9 * size)
    parts = {
        "inflow": plane(0, -before, size),
        "outflow": plane(0, after, size),
        "sides": lambda x: np.abs(np.abs(x[1]) - width / 2) <= 1e-9 * size,
    }
    if half:
        parts["axis"] = plane(1, 0.0, size)
    parts["cylinder"] = everywhere
    return triangle_mesh(points, triangles, parts)


def _length(field: str, value: float, diameter: float) -> float:
    length = number(field, value)
    if length <= 0.6 * diameter:
        raise InputError(field, value, f"above 0.6 diameters ({0.6 * diameter:g}), measured from the centre")
    return length


def _shape(
    radius: float, half_width: float, before: float, after: float, wanted: int, half: bool
) -> tuple[int, int, int, int]:
    """Numbers of cells (per eighth of a turn, per ring's depth, in the rows before and after) nearest to `wanted`."""
    best: tuple[float, tuple[int, int, int, int]] = (np.inf, (1, 1, 0, 0))
    for around in range(2, 400):
        # Rings keep their cells as deep as wide: their radii grow geometrically.
        natural = np.log(1.15 * half_width / radius) / np.log1p(np.pi / (4 * around))
        depths = range(max(2, round(0.8 * natural)), max(3, round(1.3 * natural) + 1) + 1)
        for stretch, depth in product((1.0, 0.9, 1.1, 0.8, 1.2), depths):
            rows = [_rows(length, half_width, stretch * half_width / around) for length in (before, after)]
            vertices = (depth + 1) * (4 * around + 1) + sum(rows) * (around + 1)
            if not half:
                vertices = 2 * vertices - 2 * (depth + 1) - sum(rows)
            miss = (
                abs(vertices / wanted - 1.0) + 0.1 * abs(np.log(depth / natural)) + 0.02 * abs(stretch - 1.0)
            )
            if miss < best[0]:
                best = (miss, (around, depth, rows[0], rows[1]))
        if around * around > wanted:
            break
    return best[1]


def _rows(length: float, block: float, cell: float) -> int:
    """Number of rows of cells between the rings, which end at `block` if there is room, and the end of the channel."""
    return max(1, round((length - block) / cell)) if length > block + 0.25 * cell else 0


def _half_channel(
    radius: float, half_width: float, before: float, after: float, shape: tuple[int, int, int, int]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (m, 2) and triangles (n, 3) of the half y >= 0."""
    around, depth, rows_before, rows_after = shape
    left = half_width if rows_before else before
    right = half_width if rows_after else after
    turn = np.linspace(0.0, 1.0, around + 1)
    # The outer rim: up the right side, along the wall, down the left side; vertices spread between equal lengths
    # and equal angles, so that rings meet both the cylinder and the rows at fair angles.
    rise = half_width * (0.5 * turn + 0.5 * np.tan(np.pi / 4 * turn))
    rim = np.concatenate([
        np.stack([np.full(around + 1, right), rise], axis=1),
        np.stack([right * rise[-2::-1] / half_width, np.full(around, half_width)], axis=1),
        np.stack([-left * rise[1:] / half_width, np.full(around, half_width)], axis=1),
        np.stack([np.full(around, -left), rise[-2::-1]], axis=1),
    ])  # fmt: skip
    angles = np.pi * np.linspace(0.0, 1.0, 4 * around + 1)
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    circle[0], circle[-1] = (radius, 0.0), (-radius, 0.0)
    # Depths between circle and rim grow geometrically, ray by ray: longer rays grow faster.
    growth = np.maximum(np.linalg.norm(rim, axis=1) / radius, 1.02)
    step = np.linspace(0.0, 1.0, depth + 1)[:, None]
    fraction = (growth**step - 1.0) / (growth - 1.0)
    rings = circle + fraction[:, :, None] * (rim - circle)
    points = rings.reshape(-1, 2)
    blocks = [grid_quadrilaterals(depth + 1, 4 * around + 1)]
    outer = depth * (4 * around + 1)
    sides = ((right, after, rows_after, outer + np.arange(around + 1)),
             (-left, -before, rows_before, outer + np.arange(4 * around, 3 * around - 1, -1)))  # fmt: skip
    for start, end, rows, joint in sides:
        if rows == 0:
            continue
        x = np.linspace(start, end, rows + 1)[1:]
        height = np.linspace(0.0, 1.0, rows + 1)[1:, None]
        # Rows relax from the spacing of the rim to an even one.
        y = (1.0 - height) * rise + height * half_width * turn
        added = np.stack([np.broadcast_to(x[:, None], y.shape), y], axis=2).reshape(-1, 2)
        index = np.vstack([joint, len(points) + np.arange(rows * (around + 1)).reshape(rows, -1)])
        corners = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=2).reshape(
            -1, 4
        )
        blocks.append(corners if end > start else corners[:, ::-1])
        points = np.concatenate([points, added])
    quadrilaterals = np.concatenate(blocks)
    return points, cut(quadrilaterals, _diagonals(points, quadrilaterals, before, after, half_width))


def _diagonals(
    points: NDArray[np.float64],
    quadrilaterals: NDArray[np.int64],
    before: float,
    after: float,
    half_width: float,
) -> NDArray[np.bool_]:
    """(n,) best diagonals, but through the corner in the two cells at the corners of the channel."""
    first = best_diagonals(points, quadrilaterals)
    for x in (-before, after):
        corner = int(np.argmin(np.sum((points - np.array([x, half_width])) ** 2, axis=1)))
        cell, place = np.nonzero(quadrilaterals == corner)
        if len(cell) == 1:
            first[cell[0]] = place[0] % 2 == 0
    return first


def _with_mirror_image(
    points: NDArray[np.float64], triangles: NDArray[np.int64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and triangles together with their mirror image about y = 0, vertices on the axis shared."""
    on_axis = np.abs(points[:, 1]) <= tolerance
    image = np.where(on_axis, np.arange(len(points)), len(points) + np.cumsum(~on_axis) - 1)
    mirrored = points[~on_axis] * np.array([1.0, -1.0])
    return np.concatenate([points, mirrored]), np.concatenate([triangles, image[triangles][:, ::-1]])
