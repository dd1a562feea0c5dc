"""Kernels on small polygons: cutting one by the sides of another, naming the corners, choosing four that span the area.

Polygons lie in rows of scratch arrays. Every side carries the two vertices it runs between, by their numbers, so a corner has
a name made of what it is - a vertex, or the crossing of two edges - which does not depend on the polygon that was cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import Vec, along, cross, dot, put, row, sub

FEATURE_BITS = 21
_FEATURES = 2**FEATURE_BITS - 1
OVERHANG = (
    1e-5  # of the size, by which a corner may stand out of a face before it is cut off: keeps names steady
)
SAME_PLACE = 3e-5  # of the size, within which contacts are one
TIE = 1e-4  # of the size, within which depths count as equal: keeps the choice of corners steady


class Scratch(NamedTuple):
    """Room for one pair: polygon and its copy (m, 3), their sides (m, 2); reference polygon (m, 3), corners (m,); contacts.

    points, normals (r, 3), gaps, features (r,) are the contacts found so far; chosen, heights (r,) for the choice among them.
    """

    polygon: NDArray[np.float64]
    sides: NDArray[np.int64]
    copy: NDArray[np.float64]
    copied_sides: NDArray[np.int64]
    reference: NDArray[np.float64]
    corners: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    gaps: NDArray[np.float64]
    features: NDArray[np.int64]
    chosen: NDArray[np.int64]
    heights: NDArray[np.float64]


@njit(cache=True)
def scratch_for(corners: int, contacts: int) -> Scratch:
    """Room for polygons cut to at most `corners`, and for so many contacts."""
    return Scratch(
        np.empty((corners, 3)), np.empty((corners, 2), dtype=np.int64),
        np.empty((corners, 3)), np.empty((corners, 2), dtype=np.int64),
        np.empty((corners, 3)), np.empty(corners, dtype=np.int64),
        np.empty((contacts, 3)), np.empty((contacts, 3)), np.empty(contacts),
        np.empty(contacts, dtype=np.int64), np.empty(contacts, dtype=np.int64), np.empty(contacts),
    )  # fmt: skip


@njit(cache=True)
def mixed(a: int, b: int) -> int:
    """A number of 21 bits for a pair of numbers, in either order: finalizer of a 64-bit hash."""
    low, high = np.uint64(min(a, b) + 1), np.uint64(max(a, b) + 1)
    h = low * np.uint64(0x9E3779B97F4A7C15) + high * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= h >> np.uint64(31)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(29)
    return int(h & np.uint64(_FEATURES))


@njit(cache=True)
def name_of_vertex(v: int) -> int:
    """Name of a contact at a vertex."""
    return mixed(v, v)


@njit(cache=True)
def name_of_crossing(a: int, b: int, c: int, d: int) -> int:
    """Name of a contact where the edges a-b and c-d cross, or of the vertex they share."""
    if a == c or a == d:
        return name_of_vertex(a)
    if b == c or b == d:
        return name_of_vertex(b)
    return mixed(mixed(a, b), mixed(c, d) + _FEATURES)


@njit(cache=True)
def name_at_corner(v: int, share: float, p: int, q: int) -> int:
    """Name of a contact of vertex v with the edge p-q at `share` of the way: at its ends, that of the two vertices."""
    if share == 0.0:
        return mixed(v, p)
    return mixed(v, q) if share == 1.0 else name_of_vertex(v)


@njit(cache=True)
def outside(s: Scratch, k: int, count: int, n: Vec, x: Vec) -> float:
    """How far x stands out of side k of the reference polygon of `count` corners with the normal n.

    A reference of two corners is a side in the plane: it ends at right angles at each of them.
    """
    p, q = row(s.reference, k), row(s.reference, (k + 1) % count)
    side = sub(q, p)
    outward = cross(side, n)
    if count == 2:
        outward = (-side[0], -side[1], -side[2])
    length = np.sqrt(dot(outward, outward))
    return dot(outward, sub(x, p)) / length if length > 0.0 else 0.0


@njit(cache=True)
def cut_polygon(s: Scratch, count: int, sides: int, n: Vec, slack: float) -> int:
    """Cut the polygon of `count` corners by the sides of the reference, grown by `slack`; the number of corners left."""
    for k in range(sides):
        if count == 0:
            break
        for i in range(count):
            put(s.copy, i, row(s.polygon, i))
            s.copied_sides[i, 0], s.copied_sides[i, 1] = s.sides[i, 0], s.sides[i, 1]
        left = 0
        for i in range(count):
            here, there = row(s.copy, i), row(s.copy, (i + 1) % count)
            out_here, out_there = outside(s, k, sides, n, here), outside(s, k, sides, n, there)
            if out_here <= slack:
                put(s.polygon, left, here)
                s.sides[left, 0], s.sides[left, 1] = s.copied_sides[i, 0], s.copied_sides[i, 1]
                left += 1
            if (out_here <= slack) != (out_there <= slack):
                share = min(max(out_here / (out_here - out_there), 0.0), 1.0)
                put(s.polygon, left, along(here, share, sub(there, here)))
                if out_here <= slack:  # the cut runs on along the side of the reference
                    s.sides[left, 0], s.sides[left, 1] = s.corners[k], s.corners[(k + 1) % sides]
                else:
                    s.sides[left, 0], s.sides[left, 1] = s.copied_sides[i, 0], s.copied_sides[i, 1]
                left += 1
        count = left
    return count


@njit(cache=True)
def name_of_corner(s: Scratch, i: int, count: int) -> int:
    """Name of corner i of a polygon with three corners or more."""
    before = (i - 1) % count
    return name_of_crossing(s.sides[before, 0], s.sides[before, 1], s.sides[i, 0], s.sides[i, 1])


@njit(cache=True)
def cut_segment(s: Scratch, sides: int, n: Vec, slack: float) -> tuple[int, int, int]:
    """Cut the segment in the first two rows by the sides of the reference: number of ends left, and their names."""
    p, q = row(s.polygon, 0), row(s.polygon, 1)
    first, last = s.sides[0, 0], s.sides[0, 1]
    start, end = 0.0, 1.0
    names = (name_of_vertex(first), name_of_vertex(last))
    for k in range(sides):
        out_p, out_q = outside(s, k, sides, n, p), outside(s, k, sides, n, q)
        if out_p > slack and out_q > slack:
            return 0, 0, 0
        if out_p <= slack and out_q <= slack:
            continue
        share = min(max(out_p / (out_p - out_q), 0.0), 1.0)
        if sides == 2:
            name = name_of_vertex(s.corners[k])
        else:
            name = name_of_crossing(first, last, s.corners[k], s.corners[(k + 1) % sides])
        if out_p > slack and share > start:
            start, names = share, (name, names[1])
        elif out_q > slack and share < end:
            end, names = share, (names[0], name)
    if start > end:
        return 0, 0, 0
    way = sub(q, p)
    put(s.polygon, 0, along(p, start, way))
    put(s.polygon, 1, along(p, end, way))
    return (2 if end > start else 1), names[0], names[1]


@njit(cache=True)
def without_twins(s: Scratch, first: int, end: int, size: float) -> int:
    """Keep, of the contacts first .. end, the deepest of those with one name or in one place; the end of what is kept."""
    kept = first
    for j in range(first, end):
        twin = -1
        for k in range(first, kept):
            way = sub(row(s.points, k), row(s.points, j))
            if s.features[k] == s.features[j] or dot(way, way) <= (SAME_PLACE * size) ** 2:
                twin = k
        if twin < 0:
            keep_contact(s, kept, j)
            kept += 1
        elif s.gaps[j] < s.gaps[twin] - SAME_PLACE * size:
            keep_contact(s, twin, j)
    return kept


@njit(cache=True)
def choose_four(s: Scratch, first: int, count: int, n: Vec, size: float) -> int:
    """Keep of the contacts first .. first + count four at most: a deepest one and those that span most area across n."""
    if count <= 4:
        return count
    lowest = np.inf
    for i in range(count):
        lowest = min(lowest, s.gaps[first + i])
    a = 0
    while s.gaps[first + a] > lowest + TIE * size:
        a += 1
    p, b, far = row(s.points, first + a), -1, -1.0
    for i in range(count):
        way = sub(row(s.points, first + i), p)
        if dot(way, way) > far * (1.0 + TIE):
            b, far = i, dot(way, way)
    base = sub(row(s.points, first + b), p)
    c, d, left, right = -1, -1, TIE * far, -TIE * far
    for i in range(count):
        area = dot(n, cross(base, sub(row(s.points, first + i), p)))
        if area > left * (1.0 + TIE):
            c, left = i, area
        elif area < right * (1.0 + TIE):
            d, right = i, area
    kept = 0
    for i in range(count):  # in the order they had
        if i == a or i == b or i == c or i == d:
            keep_contact(s, first + kept, first + i)
            kept += 1
    return kept


@njit(cache=True)
def keep_contact(s: Scratch, to: int, of: int) -> None:
    """Copy one contact to another row."""
    put(s.points, to, row(s.points, of))
    put(s.normals, to, row(s.normals, of))
    s.gaps[to], s.features[to] = s.gaps[of], s.features[of]


@njit(cache=True)
def add_contact(s: Scratch, at: int, point: Vec, normal: Vec, gap: float, feature: int) -> int:
    """Write a contact to row `at` if there is room; the next row."""
    if at >= s.gaps.shape[0]:
        return at
    put(s.points, at, point)
    put(s.normals, at, normal)
    s.gaps[at], s.features[at] = gap, feature
    return at + 1
