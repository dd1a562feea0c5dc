"""Kernels of point location: straight walks from cell to cell, search by bins, nearest boundary points, field values.

A cell is convex, bounded by planes: row (n, c) of `planes[cell, facet]` gives g(x) = n.x + c, which is 0 on the facet,
positive inside and 1 at the corner farthest from it. Each point is independent of the others, hence deterministic.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

INSIDE, LEFT, LOST = 0, 1, 2

# A point may lie outside a plane by this fraction of the cell's height and still count as inside.
_OUTSIDE = 1e-10
# Two facets met within this fraction of the path are met together: the path goes through their common corner.
_TIE = 1e-10


@njit(cache=True)
def plane_value(
    planes: NDArray[np.float64], cell: int, facet: int, points: NDArray[np.float64], p: int
) -> float:
    """g of one facet of one cell at point `p` of points (n, d)."""
    dimension = points.shape[1]
    value = planes[cell, facet, dimension]
    for k in range(dimension):
        value += planes[cell, facet, k] * points[p, k]
    return value


@njit(cache=True)
def walk(
    planes: NDArray[np.float64],
    neighbours: NDArray[np.int64],
    origins: NDArray[np.float64],
    targets: NDArray[np.float64],
    cells: NDArray[np.int64],
    ends: NDArray[np.float64],
    states: NDArray[np.int64],
    most_steps: int,
) -> None:
    """Follow the segments from origins (n, d), in `cells` (n,), to targets (n, d); overwrite `cells`, `ends`, `states`.

    `ends` (n, d) is the target, or where the segment first leaves the domain; `states` (n,) is INSIDE, LEFT or LOST.
    """
    for p in range(targets.shape[0]):
        cell, previous = cells[p], -1
        states[p] = LOST
        for k in range(targets.shape[1]):
            ends[p, k] = targets[p, k]
        for _ in range(most_steps):
            best, fraction = -1, np.inf
            inside = True
            for facet in range(planes.shape[1]):
                at_target = plane_value(planes, cell, facet, targets, p)
                if at_target >= -_OUTSIDE:
                    continue
                inside = False
                beyond = neighbours[cell, facet]
                if beyond >= 0 and beyond == previous:
                    continue
                at_origin = plane_value(planes, cell, facet, origins, p)
                if at_origin <= at_target:
                    continue
                met = max(0.0, at_origin / (at_origin - at_target))
                # Through a corner, stay inside the domain as long as some cell there can be entered.
                tied = best >= 0 and abs(met - fraction) <= _TIE and neighbours[cell, best] < 0 <= beyond
                if met < fraction - _TIE or tied:
                    best, fraction = facet, met
            if inside:
                states[p] = INSIDE
                break
            if best < 0:
                break
            if neighbours[cell, best] < 0:
                states[p] = LEFT
                for k in range(targets.shape[1]):
                    ends[p, k] = origins[p, k] + fraction * (targets[p, k] - origins[p, k])
                break
            previous, cell = cell, neighbours[cell, best]
        cells[p] = cell


@njit(cache=True)
def bin_of(
    points: NDArray[np.float64],
    p: int,
    lower: NDArray[np.float64],
    spacing: NDArray[np.float64],
    bins: NDArray[np.int64],
) -> int:
    """Flat C-order index of the bin holding a point, clamped to the grid of bins."""
    flat = 0
    for k in range(bins.size):
        index = int(np.floor((points[p, k] - lower[k]) / spacing[k]))
        flat = flat * bins[k] + min(max(index, 0), bins[k] - 1)
    return flat


@njit(cache=True)
def fill_bins(
    first: NDArray[np.int64], last: NDArray[np.int64], bins: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Compressed lists (starts, cells) of the cells that reach into each bin; first, last (c, d) bins of each cell."""
    total = 1
    for k in range(bins.size):
        total *= bins[k]
    starts = np.zeros(total + 1, np.int64)
    members = np.empty(0, np.int64)
    depth = 1 if bins.size == 2 else bins[2]
    for filling in range(2):
        for cell in range(first.shape[0]):
            z_first, z_last = (0, 0) if bins.size == 2 else (first[cell, 2], last[cell, 2])
            for i in range(first[cell, 0], last[cell, 0] + 1):
                for j in range(first[cell, 1], last[cell, 1] + 1):
                    for k in range(z_first, z_last + 1):
                        flat = (i * bins[1] + j) * depth + k
                        if filling:
                            members[starts[flat]] = cell
                            starts[flat] += 1
                        else:
                            starts[flat + 1] += 1
        if not filling:
            for flat in range(total):
                starts[flat + 1] += starts[flat]
            members = np.empty(starts[total], np.int64)
    # Filling moved each start to the next one.
    for flat in range(total, 0, -1):
        starts[flat] = starts[flat - 1]
    starts[0] = 0
    return starts, members


@njit(cache=True)
def search(
    planes: NDArray[np.float64],
    points: NDArray[np.float64],
    lower: NDArray[np.float64],
    spacing: NDArray[np.float64],
    bins: NDArray[np.int64],
    starts: NDArray[np.int64],
    members: NDArray[np.int64],
) -> NDArray[np.int64]:
    """(n,) cell that holds each of the points (n, d), the one it lies deepest in; -1 outside the domain."""
    cells = np.full(points.shape[0], -1, np.int64)
    for p in range(points.shape[0]):
        deepest = -_OUTSIDE
        flat = bin_of(points, p, lower, spacing, bins)
        for member in range(starts[flat], starts[flat + 1]):
            cell = members[member]
            depth = np.inf
            for facet in range(planes.shape[1]):
                depth = min(depth, plane_value(planes, cell, facet, points, p))
                if depth < deepest:
                    break
            if depth >= deepest and (cells[p] < 0 or depth > deepest):
                cells[p], deepest = cell, depth
    return cells


@njit(cache=True)
def nearest_on_boundary(
    points: NDArray[np.float64], corners: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Nearest boundary facet (n,) and the nearest point (n, d) on it; corners (f, d, d) are the vertices of each facet."""
    count, dimension = points.shape
    nearest = np.zeros(count, np.int64)
    ends = np.empty((count, dimension))
    candidate = np.empty(dimension)
    for p in range(count):
        least = np.inf
        for facet in range(corners.shape[0]):
            if dimension == 2:
                _on_segment(points[p], corners[facet, 0], corners[facet, 1], candidate)
            else:
                _on_triangle(points[p], corners[facet], candidate)
            distance = 0.0
            for k in range(dimension):
                distance += (candidate[k] - points[p, k]) ** 2
            if distance < least:
                least, nearest[p] = distance, facet
                ends[p] = candidate
    return nearest, ends


@njit(cache=True)
def _on_segment(
    x: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Point of the segment a b nearest to x."""
    along, length = 0.0, 0.0
    for k in range(x.size):
        along += (x[k] - a[k]) * (b[k] - a[k])
        length += (b[k] - a[k]) ** 2
    t = min(max(along / length, 0.0), 1.0)
    for k in range(x.size):
        out[k] = a[k] + t * (b[k] - a[k])


@njit(cache=True)
def _on_triangle(x: NDArray[np.float64], corners: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Point of a triangle (3, 3) in space nearest to x: its foot when that lies in the triangle, else on a side."""
    a, b, c = corners[0], corners[1], corners[2]
    u, v, w = b - a, c - a, x - a
    uu, uv, vv, wu, wv = np.sum(u * u), np.sum(u * v), np.sum(v * v), np.sum(w * u), np.sum(w * v)
    area = uu * vv - uv * uv
    s, t = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
        for k in range(3):
            out[k] = a[k] + s * u[k] + t * v[k]
        return
    least = np.inf
    trial = np.empty(3)
    for side in range(3):
        _on_segment(x, corners[side], corners[(side + 1) % 3], trial)
        distance = np.sum((trial - x) ** 2)
        if distance < least:
            least = distance
            for k in range(3):
                out[k] = trial[k]


@njit(cache=True)
def affine_reference(
    points: NDArray[np.float64],
    cells: NDArray[np.int64],
    corners: NDArray[np.float64],
    inverses: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Reference coordinates (n, d) in simplices: inverses (c, d, d) of the edge matrices, first corners (c, d)."""
    result = np.zeros(points.shape)
    for p in range(points.shape[0]):
        cell = cells[p]
        for i in range(points.shape[1]):
            for j in range(points.shape[1]):
                result[p, i] += inverses[cell, i, j] * (points[p, j] - corners[cell, j])
    return result


@njit(cache=True)
def bilinear_reference(
    points: NDArray[np.float64], cells: NDArray[np.int64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Reference coordinates (n, 2) in convex quadrilaterals with corners (c, 4, 2) in circular order, by Newton's method."""
    result = np.empty(points.shape)
    for p in range(points.shape[0]):
        q = corners[cells[p]]
        x, y = 0.5, 0.5
        for _ in range(30):
            # Residual and derivatives of the bilinear map at (x, y).
            r0, r1 = 0.0, 0.0
            a00, a01, a10, a11 = 0.0, 0.0, 0.0, 0.0
            for k in range(4):
                sx = x if k == 1 or k == 2 else 1.0 - x
                sy = y if k >= 2 else 1.0 - y
                dx = sy if k == 1 or k == 2 else -sy
                dy = sx if k >= 2 else -sx
                r0 += sx * sy * q[k, 0]
                r1 += sx * sy * q[k, 1]
                a00 += dx * q[k, 0]
                a01 += dy * q[k, 0]
                a10 += dx * q[k, 1]
                a11 += dy * q[k, 1]
            r0 -= points[p, 0]
            r1 -= points[p, 1]
            determinant = a00 * a11 - a01 * a10
            step_x = (a11 * r0 - a01 * r1) / determinant
            step_y = (a00 * r1 - a10 * r0) / determinant
            x -= step_x
            y -= step_y
            if abs(step_x) + abs(step_y) < 1e-14:
                break
        result[p, 0], result[p, 1] = x, y
    return result


@njit(cache=True)
def field_values(
    coefficients: NDArray[np.float64],
    exponents: NDArray[np.int64],
    element_dofs: NDArray[np.int32],
    values: NDArray[np.float64],
    cells: NDArray[np.int64],
    reference: NDArray[np.float64],
    components: int,
) -> NDArray[np.float64]:
    """(n, components) field at reference coordinates (n, d): shape function i is sum_k coefficients[i, k] X^exponents[k].

    Unknown i components + c of a cell, element_dofs[i components + c, cell], belongs to component c of shape function i.
    """
    shapes, terms = coefficients.shape
    dimension = reference.shape[1]
    degree = np.max(exponents)
    powers = np.ones((dimension, degree + 1))
    monomials = np.empty(terms)
    result = np.zeros((cells.size, components))
    for p in range(cells.size):
        for k in range(dimension):
            for e in range(degree):
                powers[k, e + 1] = powers[k, e] * reference[p, k]
        for m in range(terms):
            monomials[m] = powers[0, exponents[m, 0]]
            for k in range(1, dimension):
                monomials[m] *= powers[k, exponents[m, k]]
        for i in range(shapes):
            shape = 0.0
            for m in range(terms):
                shape += coefficients[i, m] * monomials[m]
            for c in range(components):
                result[p, c] += shape * values[element_dofs[i * components + c, cells[p]]]
    return result
