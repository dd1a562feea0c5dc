"""Kernels of shapes: distance to a plane polygon, to a convex polyhedron, and from a table interpolated in its cells.

Every parallel loop writes one row per iteration: results do not depend on the thread count.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray


@njit(cache=True, parallel=True)
def polygon_distances(
    points: NDArray[np.float64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    counted: NDArray[np.bool_],
    distances: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> None:
    """Signed distances (n,) of points (n, 2) and their gradients (n, 2).

    A counter-clockwise polygon has edges `starts` -> `ends` (e, 2). Inside is where a ray crosses an odd number of edges;
    only `counted` edges make distance. On an edge the gradient is the normal of the edge.
    """
    for n in prange(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        inside = False
        nearest = np.inf
        gx, gy, ox, oy = 0.0, 1.0, 0.0, 1.0
        for e in range(starts.shape[0]):
            ax, ay, bx, by = starts[e, 0], starts[e, 1], ends[e, 0], ends[e, 1]
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside = not inside
            if not counted[e]:
                continue
            tx, ty = bx - ax, by - ay
            length2 = tx * tx + ty * ty
            t = min(max(((x - ax) * tx + (y - ay) * ty) / length2, 0.0), 1.0)
            px, py = x - ax - t * tx, y - ay - t * ty
            square = px * px + py * py
            if square < nearest:
                nearest = square
                gx, gy = px, py
                ox, oy = ty / np.sqrt(length2), -tx / np.sqrt(length2)
        distance = np.sqrt(nearest)
        sign = -1.0 if inside else 1.0
        distances[n] = sign * distance
        size = abs(x) + abs(y) + abs(gx) + abs(gy)
        if distance > 1e-12 * size:
            normals[n, 0], normals[n, 1] = sign * gx / distance, sign * gy / distance
        else:
            normals[n, 0], normals[n, 1] = ox, oy


@njit(cache=True, parallel=True)
def table_distances(
    points: NDArray[np.float64],
    table: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    distances: NDArray[np.float64],
    gradients: NDArray[np.float64],
) -> None:
    """Trilinear interpolation (n,) of a table of distances at points (n, 3), and its gradient (n, 3).

    Outside the table, at distance a from its nearest point c, the value is sqrt(d(c)^2 + a^2): the solid lies inside the
    box of the table, so the angle at c is never acute and this is never more than the distance.
    """
    cells = (table.shape[0] - 1, table.shape[1] - 1, table.shape[2] - 1)
    for n in prange(points.shape[0]):
        fx = (points[n, 0] - origin[0]) / cell
        fy = (points[n, 1] - origin[1]) / cell
        fz = (points[n, 2] - origin[2]) / cell
        cx, cy, cz = min(max(fx, 0.0), cells[0]), min(max(fy, 0.0), cells[1]), min(max(fz, 0.0), cells[2])
        i, j, k = min(int(cx), cells[0] - 1), min(int(cy), cells[1] - 1), min(int(cz), cells[2] - 1)
        tx, ty, tz = cx - i, cy - j, cz - k
        value, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
        for a in range(2):
            wx, sx = (tx, 1.0) if a == 1 else (1.0 - tx, -1.0)
            for b in range(2):
                wy, sy = (ty, 1.0) if b == 1 else (1.0 - ty, -1.0)
                for c in range(2):
                    wz, sz = (tz, 1.0) if c == 1 else (1.0 - tz, -1.0)
                    q = table[i + a, j + b, k + c]
                    value += wx * wy * wz * q
                    gx += sx * wy * wz * q
                    gy += wx * sy * wz * q
                    gz += wx * wy * sz * q
        ox, oy, oz = (fx - cx) * cell, (fy - cy) * cell, (fz - cz) * cell
        away = ox * ox + oy * oy + oz * oz
        gx, gy, gz = gx / cell, gy / cell, gz / cell
        if away > 0.0:
            whole = np.sqrt(value * value + away)
            gx = ((value * gx if ox == 0.0 else 0.0) + ox) / whole
            gy = ((value * gy if oy == 0.0 else 0.0) + oy) / whole
            gz = ((value * gz if oz == 0.0 else 0.0) + oz) / whole
            value = whole
        distances[n] = value
        gradients[n, 0], gradients[n, 1], gradients[n, 2] = gx, gy, gz


FACE, CORNER, SIDE = (
    0,
    1,
    4,
)  # regions of a triangle: its inside; corners 1, 2, 3; sides 4 (0-1), 5 (1-2), 6 (2-0)


@njit(cache=True)
def closest_on_triangle(
    x: tuple[float, float, float],
    a: tuple[float, float, float],
    b: tuple[float, float, float],
    c: tuple[float, float, float],
) -> tuple[float, float, float, int]:
    """Point of the triangle (a, b, c) nearest to x, and the region of the triangle it lies in, by Voronoi regions."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ax, ay, az = x[0] - a[0], x[1] - a[1], x[2] - a[2]
    d1, d2 = abx * ax + aby * ay + abz * az, acx * ax + acy * ay + acz * az
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2], CORNER
    bx, by, bz = x[0] - b[0], x[1] - b[1], x[2] - b[2]
    d3, d4 = abx * bx + aby * by + abz * bz, acx * bx + acy * by + acz * bz
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2], CORNER + 1
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return a[0] + t * abx, a[1] + t * aby, a[2] + t * abz, SIDE
    cx, cy, cz = x[0] - c[0], x[1] - c[1], x[2] - c[2]
    d5, d6 = abx * cx + aby * cy + abz * cz, acx * cx + acy * cy + acz * cz
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2], CORNER + 2
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return a[0] + t * acx, a[1] + t * acy, a[2] + t * acz, SIDE + 2
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return b[0] + t * (c[0] - b[0]), b[1] + t * (c[1] - b[1]), b[2] + t * (c[2] - b[2]), SIDE + 1
    whole = va + vb + vc
    v, w = vb / whole, vc / whole
    return a[0] + v * abx + w * acx, a[1] + v * aby + w * acy, a[2] + v * abz + w * acz, FACE


@njit(cache=True, parallel=True)
def hull_distances(
    points: NDArray[np.float64],
    triangles: NDArray[np.float64],
    unit_normals: NDArray[np.float64],
    distances: NDArray[np.float64],
    gradients: NDArray[np.float64],
) -> None:
    """Signed distances (n,) of points (n, 3) and their gradients (n, 3) to a convex solid.

    Its boundary is `triangles` (t, 3, 3) with outward `unit_normals` (t, 3). Inside, the plane of least depth decides;
    outside, the nearest point lies on a triangle that the point sees.
    """
    for n in prange(points.shape[0]):
        x = (points[n, 0], points[n, 1], points[n, 2])
        highest, face = -np.inf, 0
        nearest, gx, gy, gz = np.inf, 0.0, 0.0, 0.0
        for t in range(triangles.shape[0]):
            p = triangles[t]
            above = (
                (x[0] - p[0, 0]) * unit_normals[t, 0]
                + (x[1] - p[0, 1]) * unit_normals[t, 1]
                + (x[2] - p[0, 2]) * unit_normals[t, 2]
            )
            if above > highest:
                highest, face = above, t
            if above <= 0.0 or above * above >= nearest:
                continue
            qx, qy, qz, _ = closest_on_triangle(
                x, (p[0, 0], p[0, 1], p[0, 2]), (p[1, 0], p[1, 1], p[1, 2]), (p[2, 0], p[2, 1], p[2, 2])
            )
            square = (x[0] - qx) ** 2 + (x[1] - qy) ** 2 + (x[2] - qz) ** 2
            if square < nearest:
                nearest, gx, gy, gz = square, x[0] - qx, x[1] - qy, x[2] - qz
        size = abs(x[0]) + abs(x[1]) + abs(x[2]) + abs(gx) + abs(gy) + abs(gz)
        if highest > 1e-12 * size:
            distance = np.sqrt(nearest)
            distances[n] = distance
            gradients[n, 0], gradients[n, 1], gradients[n, 2] = gx / distance, gy / distance, gz / distance
        else:
            distances[n] = highest
            for k in range(3):
                gradients[n, k] = unit_normals[face, k]
