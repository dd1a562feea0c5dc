"""Kernels of balls and capsules among themselves: closed forms of the nearest points of two segments."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import Vec, along, cross, dot, put, row, scaled, sub
from barchan.bodies.contact.arrays import Cores, Slots

PARALLEL = 4e-4  # square of the sine below which segments touch along a line


@njit(cache=True)
def _ball_pair(c: Cores, a: int, b: int, limit: float, p: int, slots: Slots) -> None:
    """Contact of two balls closer than the limit; balls with one middle part along the second axis."""
    way = sub(row(c.centre, b), row(c.centre, a))
    square, reach = dot(way, way), c.radius[a] + c.radius[b] + limit
    if square > reach * reach:
        return
    distance = np.sqrt(square)
    n = (0.0, 1.0, 0.0)
    if distance > 0.0:
        n = scaled(1.0 / distance, way)
    gap = distance - c.radius[a] - c.radius[b]
    put(slots.points[p], 0, along(row(c.centre, a), c.radius[a] + 0.5 * gap, n))
    put(slots.normals[p], 0, n)
    slots.gaps[p, 0], slots.features[p, 0] = gap, 0
    slots.used[p] = 1


@njit(cache=True, parallel=True)
def ball_pairs(c: Cores, pairs: NDArray[np.int64], limits: NDArray[np.float64], slots: Slots) -> None:
    """Contact of each pair (p, 2) of balls with a gap up to limits (p,)."""
    for p in prange(pairs.shape[0]):
        _ball_pair(c, pairs[p, 0], pairs[p, 1], limits[p], p, slots)


@njit(cache=True)
def nearest_shares(pa: Vec, da: Vec, pb: Vec, db: Vec) -> tuple[float, float]:
    """Shares of the nearest points of the segments pa + [0, 1] da and pb + [0, 1] db; a segment may be a point."""
    w, aa, bb, ab = sub(pa, pb), dot(da, da), dot(db, db), dot(da, db)
    wa, wb = dot(w, da), dot(w, db)
    if aa == 0.0:
        return 0.0, min(max(wb / bb, 0.0), 1.0) if bb > 0.0 else 0.0
    if bb == 0.0:
        return min(max(-wa / aa, 0.0), 1.0), 0.0
    whole = aa * bb - ab * ab
    s = min(max((ab * wb - bb * wa) / whole, 0.0), 1.0) if whole > 1e-14 * aa * bb else 0.0
    t = (ab * s + wb) / bb
    if t < 0.0:
        return min(max(-wa / aa, 0.0), 1.0), 0.0
    if t > 1.0:
        return min(max((ab - wa) / aa, 0.0), 1.0), 1.0
    return s, t


@njit(cache=True)
def _ends(c: Cores, g: int) -> tuple[Vec, Vec]:
    """First end of a core of one or two corners, and the way to the last."""
    p, q = row(c.vertices, c.vertex_start[g]), row(c.vertices, c.vertex_start[g + 1] - 1)
    return p, sub(q, p)


@njit(cache=True)
def _direction(way: Vec, da: Vec, db: Vec, centres: Vec) -> Vec:
    """Unit normal: along the way between the nearest points; where the segments cross, across both."""
    square = dot(way, way)
    if square > 0.0:
        return scaled(1.0 / np.sqrt(square), way)
    n = cross(da, db)
    if dot(n, n) <= 1e-24 * dot(da, da) * dot(db, db):
        d = da if dot(da, da) > dot(db, db) else db
        # in the plane the first two components alone differ from zero
        n = (-d[1], d[0], 0.0) if d[0] != 0.0 or d[1] != 0.0 else (0.0, 1.0, 0.0)
    n = scaled(1.0 / np.sqrt(dot(n, n)), n)
    return scaled(-1.0, n) if dot(n, centres) < 0.0 else n


@njit(cache=True, parallel=True)
def segment_pairs(c: Cores, pairs: NDArray[np.int64], limits: NDArray[np.float64], slots: Slots) -> None:
    """Contacts of pairs (p, 2) of capsules and balls: two at the ends of the common part of parallel ones, else one."""
    for p in prange(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        radii = c.radius[a] + c.radius[b]
        pa, da = _ends(c, a)
        pb, db = _ends(c, b)
        s, t = nearest_shares(pa, da, pb, db)
        way = sub(along(pb, t, db), along(pa, s, da))
        if np.sqrt(dot(way, way)) - radii > limits[p]:
            continue
        n = _direction(way, da, db, sub(row(c.centre, b), row(c.centre, a)))
        turned, aa, bb = cross(da, db), dot(da, da), dot(db, db)
        if aa > 0.0 and bb > 0.0 and dot(turned, turned) <= PARALLEL * aa * bb:
            _along_both(c.radius[a], c.radius[b], pa, da, pb, db, n, p, limits[p], slots)
        if slots.used[p] == 0:
            _write(c.radius[a], c.radius[b], along(pa, s, da), along(pb, t, db), n, p, limits[p], 8, slots)


@njit(cache=True)
def _along_both(
    ra: float, rb: float, pa: Vec, da: Vec, pb: Vec, db: Vec, n: Vec, p: int, limit: float, slots: Slots
) -> None:
    """Contacts at the ends of the common part of two nearly parallel segments, if it is longer than nothing."""
    square = dot(da, da)
    at_p, at_q = dot(sub(pb, pa), da) / square, dot(sub(along(pb, 1.0, db), pa), da) / square
    low, high = max(0.0, min(at_p, at_q)), min(1.0, max(at_p, at_q))
    if high - low <= 1e-5:
        return
    for end in range(2):
        share = low if end == 0 else high
        name = 2 if share == at_p else 3 if share == at_q else end
        on_b = along(pb, (share - at_p) / (at_q - at_p), db)
        _write(ra, rb, along(pa, share, da), on_b, n, p, limit, name, slots)


@njit(cache=True)
def _write(
    ra: float, rb: float, on_a: Vec, on_b: Vec, n: Vec, p: int, limit: float, name: int, slots: Slots
) -> None:
    """Write the contact of two points of the segments to the next slot of the pair."""
    gap = dot(n, sub(on_b, on_a)) - ra - rb
    if gap > limit:
        return
    k = slots.used[p]
    put(slots.points[p], k, scaled(0.5, along(along(on_a, 1.0, on_b), ra - rb, n)))
    put(slots.normals[p], k, n)
    slots.gaps[p, k], slots.features[p, k] = gap, name
    slots.used[p] = k + 1
