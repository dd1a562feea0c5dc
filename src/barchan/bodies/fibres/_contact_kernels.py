"""Kernels of contact between fibres: boxes about segments, pairs that are near, nearest points, and the rows of H.

Segment g goes from node first[g] of the centre lines to the next one and belongs to fibre[g]; end[g] tells whether it is the
first (1), the last (2) or both (3) of its fibre.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._round import nearest_shares
from barchan.bodies.contact._vectors import Vec, along, cross, dot, put, row, scaled, sub

Array = NDArray[np.float64]
Numbers = NDArray[Any]

ROOT, TIP = 1, 2
_PARALLEL = 1e-14  # square of the sine below which two segments touch along a line
_SAME = 0.5  # of a radius: places of contact nearer than this are one
_SLANT = 0.1  # cosine of the way between nearest points with the next segment, from which that one has a nearer point


class Segments(NamedTuple):
    """Segments and the nodes (p, 3) they join, with their velocities; arc (g,) is where on its fibre a segment begins [m]."""

    first: Numbers
    fibre: Numbers
    end: Numbers
    arc: Array
    radius: Array
    nodes: Array
    velocities: Array


@njit(cache=True, parallel=True)
def segment_boxes(
    s: Segments, drift: Array, dt: float, slack: float, middle: Array, half: Array, radius: Array
) -> None:
    """Box and ball about each segment and where it is after dt [s] if all move slower by `drift` (3,), wider by slack / 2."""
    for g in prange(len(s.first)):
        wider = s.radius[g] + 0.5 * slack
        for k in range(3):
            low, high = np.inf, -np.inf
            for e in range(2):
                x = s.nodes[s.first[g] + e, k]
                y = x + dt * (s.velocities[s.first[g] + e, k] - drift[k])
                low, high = min(low, min(x, y)), max(high, max(x, y))
            middle[g, k], half[g, k] = 0.5 * (low + high), 0.5 * (high - low) + wider
        square = 0.0
        for e in range(2):
            x = sub(row(s.nodes, s.first[g] + e), row(middle, g))
            v = row(s.velocities, s.first[g] + e)
            y = along(x, dt, (v[0] - drift[0], v[1] - drift[1], v[2] - drift[2]))
            square = max(square, max(dot(x, x), dot(y, y)))
        radius[g] = np.sqrt(square) + wider


@njit(cache=True)
def _shares(pa: Vec, da: Vec, pb: Vec, db: Vec) -> tuple[float, float]:
    """Shares of nearest points of two segments; of parallel ones the middle of what lies side by side."""
    aa, bb, turned = dot(da, da), dot(db, db), cross(da, db)
    if dot(turned, turned) > _PARALLEL * aa * bb:
        return nearest_shares(pa, da, pb, db)
    at_p, at_q = dot(sub(pb, pa), da) / aa, dot(sub(along(pb, 1.0, db), pa), da) / aa
    low, high = max(0.0, min(at_p, at_q)), min(1.0, max(at_p, at_q))
    if high <= low:
        return nearest_shares(pa, da, pb, db)
    s = 0.5 * (low + high)
    return s, (s - at_p) / (at_q - at_p)


@njit(cache=True)
def _is_elsewhere(s: Segments, g: int, share: float, way: Vec, distance: float, other: Vec) -> bool:
    """Whether a contact at an end of segment g is found, the same or nearer, on its neighbour.

    `way` leads to the other side, a segment along `other`. At a node that two segments share the contact belongs to the later
    one, unless the fibre comes nearer beside the node.
    """
    if 0.0 < share < 1.0:
        return False
    last = share == 1.0
    if s.end[g] & (TIP if last else ROOT):
        return False
    node = s.first[g] + 1 if last else s.first[g]
    d = sub(row(s.nodes, node + 1 if last else node - 1), row(s.nodes, node))
    size = np.sqrt(dot(d, d))
    slant = dot(d, way) / (size * distance)
    if slant <= 0.0:
        return last
    # the nearest place on the neighbour is this far along it, on long segments
    across = cross(d, other)
    turned = dot(across, across) / (size * size * dot(other, other))
    return slant > _SLANT or slant * distance <= _SAME * s.radius[g] * turned


@njit(cache=True)
def _touch(
    s: Segments, a: int, b: int, dt: float, slack: float, bare: float
) -> tuple[bool, float, float, float, Vec]:
    """Whether two segments may touch within dt; shares of their nearest points, gap [m], unit normal from b to a."""
    p, q = s.first[a], s.first[b]
    none = (0.0, 0.0, 0.0)
    if s.fibre[a] == s.fibre[b] and abs(a - b) < 2:
        return False, 0.0, 0.0, 0.0, none
    pa, pb = row(s.nodes, p), row(s.nodes, q)
    da, db = sub(row(s.nodes, p + 1), pa), sub(row(s.nodes, q + 1), pb)
    x, y = _shares(pa, da, pb, db)
    way = sub(along(pa, x, da), along(pb, y, db))
    distance = np.sqrt(dot(way, way))
    gap = distance - s.radius[a] - s.radius[b]
    va, vb = row(s.velocities, p), row(s.velocities, q)
    va, vb = along(va, x, sub(row(s.velocities, p + 1), va)), along(vb, y, sub(row(s.velocities, q + 1), vb))
    apart = dot(sub(va, vb), way)
    closing = -apart / distance if apart < 0.0 and distance > 0.0 else 0.0
    if gap > slack + dt * closing:
        return False, 0.0, 0.0, 0.0, none
    at_a, at_b = s.arc[a] + x * np.sqrt(dot(da, da)), s.arc[b] + y * np.sqrt(dot(db, db))
    if at_a < bare or at_b < bare:
        return False, 0.0, 0.0, 0.0, none
    if s.fibre[a] == s.fibre[b] and abs(at_a - at_b) <= 2.0 * (s.radius[a] + s.radius[b]):
        return False, 0.0, 0.0, 0.0, none
    if distance > 0.0:
        if _is_elsewhere(s, a, x, scaled(-1.0, way), distance, db):
            return False, 0.0, 0.0, 0.0, none
        if _is_elsewhere(s, b, y, way, distance, da):
            return False, 0.0, 0.0, 0.0, none
        return True, x, y, gap, scaled(1.0 / distance, way)
    return True, x, y, gap, _across(da, db)


@njit(cache=True)
def _across(da: Vec, db: Vec) -> Vec:
    """A unit vector across two segments that cross."""
    n = cross(da, db)
    if dot(n, n) <= 1e-24 * dot(da, da) * dot(db, db):
        n = cross(da, (1.0, 0.0, 0.0)) if abs(da[0]) <= abs(da[1]) else cross(da, (0.0, 1.0, 0.0))
    return scaled(1.0 / np.sqrt(dot(n, n)), n)


@njit(cache=True, parallel=True)
def near_pairs(
    s: Segments, pairs: Numbers, dt: float, slack: float, bare: float, near: NDArray[np.bool_]
) -> None:
    """near (p,): whether the segments of each pair (p, 2) may touch within dt [s]; see `_is_elsewhere`."""
    for k in prange(len(pairs)):
        near[k] = _touch(s, pairs[k, 0], pairs[k, 1], dt, slack, bare)[0]


@njit(cache=True)
def write_contacts(
    s: Segments, pairs: Numbers, dt: float, slack: float, bare: float, share: Array, gaps: Array, normals: Array, points: Array
) -> None:  # fmt: skip
    """Shares (k, 2), gaps (k,), normals and points (k, 3), in the middle of the gap, of near pairs (k, 2)."""
    for k in range(len(pairs)):
        a, b = pairs[k, 0], pairs[k, 1]
        _, x, y, gap, n = _touch(s, a, b, dt, slack, bare)
        share[k, 0], share[k, 1], gaps[k] = x, y, gap
        put(normals, k, n)
        pb = row(s.nodes, s.first[b])
        on_b = along(pb, y, sub(row(s.nodes, s.first[b] + 1), pb))
        put(points, k, along(on_b, s.radius[b] + 0.5 * gap, n))


@njit(cache=True)
def count_columns(fibres: Numbers, offsets: Numbers, values: Array, starts: Numbers, counts: Numbers) -> None:
    """counts (k,): velocities that points of contacts between `fibres` (k, 2), -1 for a body, depend on.

    values, starts : of `PointRows` for the 2 k points, those of the first fibres first.
    """
    k = len(fibres)
    for i in range(k):
        found = 0
        for side in range(2):
            f = fibres[i, side]
            if f < 0 or (side == 1 and f == fibres[i, 0]):
                continue
            m = offsets[f + 1] - offsets[f]
            one, two = starts[side * k + i], starts[k + i]
            twice = side == 0 and f == fibres[i, 1]
            for j in range(m):
                for a in range(3):
                    if values[one + a * m + j] != 0.0 or (twice and values[two + a * m + j] != 0.0):
                        found += 1
                        break
        counts[i] = found


@njit(cache=True)
def write_rows(
    fibres: Numbers, offsets: Numbers, values: Array, starts: Numbers, turns: Array, indptr: Numbers, indices: Numbers,
    data: Array,
) -> None:  # fmt: skip
    """Three compressed rows a contact, in the frames `turns` (k, 3, 3): velocity of the first point less that of the second."""
    k = len(fibres)
    for i in range(k):
        begin, width = indptr[3 * i], indptr[3 * i + 1] - indptr[3 * i]
        at = begin
        for side in range(2):
            f = fibres[i, side]
            if f < 0 or (side == 1 and f == fibres[i, 0]):
                continue
            m = offsets[f + 1] - offsets[f]
            one, two = starts[side * k + i], starts[k + i]
            twice = side == 0 and f == fibres[i, 1]
            sign = 1.0 if side == 0 else -1.0
            for j in range(m):
                x, y, z = values[one + j], values[one + m + j], values[one + 2 * m + j]
                x, y, z = sign * x, sign * y, sign * z
                here = x != 0.0 or y != 0.0 or z != 0.0
                if twice:
                    x2, y2, z2 = values[two + j], values[two + m + j], values[two + 2 * m + j]
                    here = here or x2 != 0.0 or y2 != 0.0 or z2 != 0.0
                    x, y, z = x - x2, y - y2, z - z2
                if not here:
                    continue
                for a in range(3):
                    indices[at + a * width] = offsets[f] + j
                    data[at + a * width] = turns[i, a, 0] * x + turns[i, a, 1] * y + turns[i, a, 2] * z
                at += 1
