"""Pieces of cloth: rectangles, discs, and skirts cut as the frustum of a cone, meshed as regularly as their outline allows."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from barchan.bodies.cloth.mesh import ClothMesh
from barchan.bodies.rigid import inputs
from barchan.errors import InputError

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]
Pattern = Literal["equilateral", "squares", "crossed", "unstructured"]
PATTERNS = ("equilateral", "squares", "crossed", "unstructured")

_JITTER = 0.25  # of the spacing, of the points of an unstructured mesh
_CLEARANCE = 0.55  # of the spacing, between points inside an outline and the outline


def rectangle(
    width: float, depth: float, spacing: float, pattern: Pattern = "equilateral", seed: int = 0
) -> ClothMesh:
    """Cloth of `width` along x and `depth` along y about the origin, in the plane z = 0, facing +z.

    spacing : length of edges aimed at [m].
    pattern : "equilateral" rows of triangles (bends alike in all directions), "squares" cut along one diagonal, "crossed"
        squares cut along alternating ones, "unstructured" a Delaunay mesh of random points (`seed`).
    """
    inputs.positive("width", width)
    inputs.positive("depth", depth)
    _check_spacing(spacing, min(width, depth))
    if pattern not in PATTERNS:
        raise InputError("pattern", pattern, "one of " + ", ".join(PATTERNS))
    if pattern == "unstructured":
        corners = 0.5 * np.array([[-width, -depth], [width, -depth], [width, depth], [-width, depth]])
        return _filled(_along(corners, spacing), spacing, seed)
    rows = max(1, round(depth / (spacing * (math.sqrt(0.75) if pattern == "equilateral" else 1.0))))
    columns = max(1, round(width / spacing))
    if pattern == "crossed":
        rows, columns = 2 * math.ceil(rows / 2), 2 * math.ceil(columns / 2)
    if pattern == "equilateral":
        points, triangles = _brick_rows(columns, rows)
    else:
        points, triangles = _square_rows(columns, rows, pattern == "crossed")
    flat = (points - 0.5) * np.array([width, depth])
    return _flat(flat, triangles)


def disc(radius: float, spacing: float, seed: int = 0) -> ClothMesh:
    """A round cloth about the origin in the plane z = 0, facing +z: a Delaunay mesh of random points (`seed`)."""
    inputs.positive("radius", radius)
    _check_spacing(spacing, radius)
    count = max(6, round(2.0 * math.pi * radius / spacing))
    angle = 2.0 * math.pi * np.arange(count) / count
    return _filled(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), spacing, seed)


def conical_skirt(waist_radius: float, hem_radius: float, length: float, spacing: float) -> ClothMesh:
    """The frustum of a cone about the z axis, its waist in the plane z = 0 and its hem below, facing outward.

    length : from waist to hem along the cloth [m], at least the difference of the radii.  Rows run round the axis with the
    same number of vertices in each, so many that edges have the `spacing` half-way down; a row is turned by half an edge
    against the one above.
    """
    for name, value in (("waist_radius", waist_radius), ("hem_radius", hem_radius), ("length", length)):
        inputs.positive(name, value)
    if abs(hem_radius - waist_radius) > length * (1.0 + 1e-12):
        raise InputError(
            "length", length, f"at least {abs(hem_radius - waist_radius):g}, between waist and hem"
        )
    _check_spacing(spacing, min(length, waist_radius))
    around = max(6, round(math.pi * (waist_radius + hem_radius) / spacing))
    rows = max(1, round(length / (spacing * math.sqrt(0.75))))
    drop = math.sqrt(max(0.0, length**2 - (hem_radius - waist_radius) ** 2))
    down, k = np.divmod(np.arange((rows + 1) * around), around)
    radius = waist_radius + (hem_radius - waist_radius) * down / rows
    angle = 2.0 * math.pi * (k + 0.5 * (down % 2)) / around
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), -drop * down / rows], axis=1)
    return ClothMesh(points, _rings(rows, around))


def _rings(rows: int, around: int) -> Whole:
    triangles = []
    k = np.arange(around)
    following = (k + 1) % around
    for row in range(rows):
        top, bottom = row * around, (row + 1) * around
        if row % 2 == 0:  # the row below lies half an edge ahead
            triangles += [
                [top + k, bottom + k, top + following],
                [top + following, bottom + k, bottom + following],
            ]
        else:
            triangles += [
                [top + k, bottom + k, bottom + following],
                [top + k, bottom + following, top + following],
            ]
    return np.concatenate([np.stack(corners, axis=1) for corners in triangles])


def _square_rows(columns: int, rows: int, crossed: bool) -> tuple[Vector, Whole]:
    """Points (n, 2) of the unit square and triangles, two a square."""
    j, i = np.divmod(np.arange((rows + 1) * (columns + 1)), columns + 1)
    points = np.stack([i / columns, j / rows], axis=1)
    row, column = np.divmod(np.arange(rows * columns), columns)
    a = row * (columns + 1) + column
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    other = (row + column) % 2 == 1 if crossed else np.zeros(len(a), dtype=bool)
    first = np.where(other[:, None], np.stack([a, b, d], axis=1), np.stack([a, b, c], axis=1))
    second = np.where(other[:, None], np.stack([b, c, d], axis=1), np.stack([a, c, d], axis=1))
    return points, np.concatenate([first, second])


def _brick_rows(columns: int, rows: int) -> tuple[Vector, Whole]:
    """Points (n, 2) of the unit square in rows, every other one half an edge aside with an end at both sides."""
    points: list[tuple[float, float]] = []
    starts = []
    for row in range(rows + 1):
        starts.append(len(points))
        across = np.arange(columns + 1.0)
        if row % 2:
            across = np.concatenate([[0.0], np.arange(columns) + 0.5, [columns]])
        points += [(x / columns, row / rows) for x in across]
    triangles = []
    for row in range(rows):
        even, odd = (starts[row], starts[row + 1]) if row % 2 == 0 else (starts[row + 1], starts[row])
        low = row % 2 == 0
        for k in range(columns):
            triangles.append((even + k, even + k + 1, odd + k + 1)[:: 1 if low else -1])
        for k in range(columns + 1):
            triangles.append((even + k, odd + k + 1, odd + k)[:: 1 if low else -1])
    return np.array(points), np.array(triangles, dtype=np.int64)


def _filled(outline: Vector, spacing: float, seed: int) -> ClothMesh:
    """A Delaunay mesh of a convex `outline` (k, 2) with points off the nodes of an equilateral lattice inside."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    height = spacing * math.sqrt(0.75)
    j = np.arange(math.ceil((high - low)[1] / height) + 1)
    lattice = [
        np.stack([low[0] + spacing * (np.arange(math.ceil((high - low)[0] / spacing) + 2) - 0.5 * (row % 2)),
                  np.full(math.ceil((high - low)[0] / spacing) + 2, low[1] + row * height)], axis=1) for row in j
    ]  # fmt: skip
    points = np.concatenate(lattice)
    points += _JITTER * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, points.shape)
    following = np.roll(outline, -1, axis=0)
    edge = (following - outline) / np.linalg.norm(following - outline, axis=1)[:, None]
    ways = points[:, None, :] - outline[None, :, :]
    inside = edge[None, :, 0] * ways[:, :, 1] - edge[None, :, 1] * ways[:, :, 0]
    points = points[np.min(inside, axis=1) > _CLEARANCE * spacing]
    flat = np.concatenate([outline, points])
    triangles = Delaunay(flat).simplices.astype(np.int64)
    corner = flat[triangles]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    double = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    triangles[double < 0.0] = triangles[double < 0.0][:, ::-1]
    kept = np.abs(double) > 1e-3 * spacing**2  # slivers between points of a straight side
    return _flat(flat, triangles[kept])


def _along(corners: Vector, spacing: float) -> Vector:
    """Points of a closed polygon, evenly spread over each side."""
    parts = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(1, round(float(np.linalg.norm(end - start)) / spacing))
        parts.append(start + np.arange(count)[:, None] / count * (end - start))
    return np.concatenate(parts)


def _flat(points: Vector, triangles: Whole) -> ClothMesh:
    return ClothMesh(np.column_stack([points, np.zeros(len(points))]), triangles)


def _check_spacing(spacing: float, size: float) -> None:
    inputs.positive("spacing", spacing)
    if spacing > size:
        raise InputError("spacing", spacing, f"at most {size:g}, the size of the cloth")
