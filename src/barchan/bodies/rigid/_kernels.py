"""Kernels of shapes: distance to the edges of a plane polygon, and a tabulated distance interpolated in its cells.

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
