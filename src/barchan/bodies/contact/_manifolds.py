"""Kernels that turn a contact axis of two convex cores into contacts: a face against a face, an edge against an edge, a corner.

Where two faces lie nearly on each other, the corners of their overlap become contacts with gaps of their own, apart or not;
where two edges run nearly side by side, the ends of their common part; else the two nearest points.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._axes import (
    APART,
    CORNER_A,
    CORNER_B,
    EDGES,
    FACE_A,
    FACE_B,
    contact_axis,
    least,
    share_on_edge,
)
from barchan.bodies.contact._clipping import (
    OVERHANG,
    Scratch,
    add_contact,
    choose_four,
    cut_polygon,
    cut_segment,
    name_at_corner,
    name_of_corner,
    name_of_crossing,
    name_of_vertex,
    scratch_for,
    without_twins,
)
from barchan.bodies.contact._vectors import Vec, along, cross, dot, put, row, scaled, sub
from barchan.bodies.contact.arrays import Cores, Slots

FLAT = 0.9998  # cosine (1.1 degrees) above which a face counts as lying across the normal
SIDE_BY_SIDE = 4e-4  # square of the sine below which edges count as parallel
LARGER = 1.0 + 1e-6
CHUNKS = 128  # of pairs, each with its own scratch


@njit(cache=True)
def flattest(c: Cores, g: int, n: Vec) -> tuple[float, int]:
    """Cosine of the face of g that looks most along n, and the face; of a bare segment, how much it lies across n."""
    best, face = -1.0, -1
    for f in range(c.face_start[g], c.face_start[g + 1]):
        cosine = dot(row(c.normals, f), n)
        if cosine > best:
            best, face = cosine, f
    if face < 0 and c.edge_start[g + 1] - c.edge_start[g] == 1:
        e = c.edge_start[g]
        d = sub(row(c.vertices, c.edges[e, 1]), row(c.vertices, c.edges[e, 0]))
        best = np.sqrt(max(0.0, 1.0 - dot(d, n) ** 2 / dot(d, d)))
    return best, face


@njit(cache=True)
def reference_face(c: Cores, a: int, b: int, kind: int, i: int, n: Vec) -> tuple[int, int]:
    """The core, a or b, and its face that others are held against; (-1, -1) when no face lies across the normal.

    Of two flat faces it is the larger, or that of a: the choice does not change from step to step.
    """
    flat_a, face_a = flattest(c, a, n)
    flat_b, face_b = flattest(c, b, scaled(-1.0, n))
    if flat_a > FLAT and flat_b > FLAT and (face_a >= 0 or face_b >= 0):
        if face_a < 0:
            return b, face_b
        if face_b >= 0 and c.areas[face_b] > c.areas[face_a] * LARGER:
            return b, face_b
        return a, face_a
    if kind == FACE_A:
        return a, i
    if kind == FACE_B:
        return b, i
    return -1, -1


@njit(cache=True)
def load_reference(c: Cores, face: int, s: Scratch) -> int:
    """Put a face into the scratch as reference; the number of its corners."""
    count = c.ring_start[face + 1] - c.ring_start[face]
    for k in range(count):
        v = c.ring[c.ring_start[face] + k]
        put(s.reference, k, row(c.vertices, v))
        s.corners[k] = v
    return count


@njit(cache=True)
def load_incident(c: Cores, g: int, n: Vec, s: Scratch) -> int:
    """Put what core g turns against n into the scratch: a face through its lowest corner, a segment or a point; corners.

    A face must hold the lowest corner along n: a face that looks more against n may lie higher up.
    """
    first, last = c.vertex_start[g], c.vertex_start[g + 1]
    if c.face_start[g + 1] > c.face_start[g]:
        low = least(c.vertices, first, last, n) + 1e-9 * c.size[g]
        face, most_against = -1, np.inf
        for f in range(c.face_start[g], c.face_start[g + 1]):
            against = dot(row(c.normals, f), n)
            if against >= most_against:
                continue
            for k in range(c.ring_start[f], c.ring_start[f + 1]):
                if dot(n, row(c.vertices, c.ring[k])) <= low:
                    face, most_against = f, against
                    break
        start = c.ring_start[face]
        count = c.ring_start[face + 1] - start
        for k in range(count):
            v = c.ring[start + k]
            put(s.polygon, k, row(c.vertices, v))
            s.sides[k, 0], s.sides[k, 1] = v, c.ring[start + (k + 1) % count]
        return count
    for v in range(first, last):
        put(s.polygon, v - first, row(c.vertices, v))
        s.sides[v - first, 0], s.sides[v - first, 1] = v, last - 1
    return last - first


@njit(cache=True)
def against_face(
    s: Scratch, at: int, count: int, sides: int, n: Vec, base: float, size: float,
    radius: float, radius_incident: float, limit: float, sign: float,
) -> int:  # fmt: skip
    """Contacts of the loaded polygon with the loaded reference, whose plane is n . x = base; `sides` = 0: all of the plane.

    Written from row `at` on, gaps up to `limit`, normals sign * n; the next free row.
    """
    names = (name_of_vertex(s.sides[0, 0]), name_of_vertex(s.sides[0, 1]))
    if sides > 0 and count == 2:
        count, first, last = cut_segment(s, sides, n, OVERHANG * size)
        names = (first, last)
    elif sides > 0 and count > 2:
        count = cut_polygon(s, count, sides, n, OVERHANG * size)
    for i in range(count):
        x = row(s.polygon, i)
        height = dot(n, x) - base
        gap = height - radius - radius_incident
        if gap > limit:
            continue
        if count > 2:
            name = name_of_corner(s, i, count)
        else:
            name = names[0] if i == 0 else names[1]
        middle = along(x, -0.5 * (height - radius + radius_incident), n)
        at = add_contact(s, at, middle, scaled(sign, n), gap, name)
    return at


@njit(cache=True)
def side_by_side(
    c: Cores, edge_a: int, edge_b: int, n: Vec, radius_a: float, radius_b: float, limit: float, s: Scratch
) -> int:
    """Contacts at the ends of the common part of two nearly parallel edges; 0 when they have none."""
    pa, qa = row(c.vertices, c.edges[edge_a, 0]), row(c.vertices, c.edges[edge_a, 1])
    pb, qb = row(c.vertices, c.edges[edge_b, 0]), row(c.vertices, c.edges[edge_b, 1])
    da, db = sub(qa, pa), sub(qb, pb)
    square = dot(da, da)
    at_p, at_q = dot(sub(pb, pa), da) / square, dot(sub(qb, pa), da) / square
    low, high = max(0.0, min(at_p, at_q)), min(1.0, max(at_p, at_q))
    if (high - low) * np.sqrt(square) <= OVERHANG * np.sqrt(square + dot(db, db)):
        return 0
    found = 0
    for end in range(2):
        share = low if end == 0 else high
        on_a = along(pa, share, da)
        on_b = along(pb, (share - at_p) / (at_q - at_p), db)
        if share == at_p:
            name = name_of_vertex(c.edges[edge_b, 0])
        elif share == at_q:
            name = name_of_vertex(c.edges[edge_b, 1])
        else:
            name = name_of_vertex(c.edges[edge_a, end])
        found = between(s, found, on_a, on_b, n, radius_a, radius_b, limit, name)
    return found


@njit(cache=True)
def between(
    s: Scratch,
    at: int,
    on_a: Vec,
    on_b: Vec,
    n: Vec,
    radius_a: float,
    radius_b: float,
    limit: float,
    name: int,
) -> int:
    """Write the contact of two points of the cores with the normal n from a to b; the next free row."""
    gap = dot(n, sub(on_b, on_a)) - radius_a - radius_b
    if gap > limit:
        return at
    middle = scaled(0.5, along(along(on_a, 1.0, on_b), radius_a - radius_b, n))
    return add_contact(s, at, middle, n, gap, name)


@njit(cache=True)
def crossing_shares(pa: Vec, da: Vec, pb: Vec, db: Vec) -> tuple[float, float]:
    """Shares along two lines that are not parallel of the points where they are nearest to each other."""
    w, aa, bb, ab = sub(pa, pb), dot(da, da), dot(db, db), dot(da, db)
    wa, wb = dot(w, da), dot(w, db)
    whole = aa * bb - ab * ab
    return (ab * wb - bb * wa) / whole, (aa * wb - ab * wa) / whole


@njit(cache=True)
def parallel_edge(c: Cores, corner: int, g: int, edge: int, n: Vec) -> int:
    """Edge of g from `corner` that runs across n beside `edge` of another core; -1 when there is none."""
    d = sub(row(c.vertices, c.edges[edge, 1]), row(c.vertices, c.edges[edge, 0]))
    for e in range(c.edge_start[g], c.edge_start[g + 1]):
        if c.edges[e, 0] != corner and c.edges[e, 1] != corner:
            continue
        own = sub(row(c.vertices, c.edges[e, 1]), row(c.vertices, c.edges[e, 0]))
        turned, square = cross(own, d), dot(own, own)
        if dot(own, n) ** 2 <= SIDE_BY_SIDE * square and dot(turned, turned) <= SIDE_BY_SIDE * square * dot(
            d, d
        ):
            return e
    return -1


@njit(cache=True)
def at_edges(
    c: Cores, a: int, b: int, kind: int, i: int, j: int, n: Vec, limit: float, plane: bool, s: Scratch
) -> int:
    """Contacts of edges and corners: two where edges run side by side, else one."""
    ra, rb = c.radius[a], c.radius[b]
    edge_a, edge_b = i, j
    if kind == CORNER_A:
        edge_a = parallel_edge(c, i, a, j, n)
    elif kind == CORNER_B:
        edge_a, edge_b = j, parallel_edge(c, i, b, j, n)
    if edge_a >= 0 and edge_b >= 0 and not plane:
        da = sub(row(c.vertices, c.edges[edge_a, 1]), row(c.vertices, c.edges[edge_a, 0]))
        db = sub(row(c.vertices, c.edges[edge_b, 1]), row(c.vertices, c.edges[edge_b, 0]))
        turned = cross(da, db)
        if dot(turned, turned) <= SIDE_BY_SIDE * dot(da, da) * dot(db, db):
            found = side_by_side(c, edge_a, edge_b, n, ra, rb, limit, s)
            if found > 0:
                return found
    if kind == EDGES:
        pa, pb = row(c.vertices, c.edges[i, 0]), row(c.vertices, c.edges[j, 0])
        da, db = sub(row(c.vertices, c.edges[i, 1]), pa), sub(row(c.vertices, c.edges[j, 1]), pb)
        share_a, share_b = crossing_shares(pa, da, pb, db)
        on_a, on_b = along(pa, min(max(share_a, 0.0), 1.0), da), along(pb, min(max(share_b, 0.0), 1.0), db)
        name = name_of_crossing(c.edges[i, 0], c.edges[i, 1], c.edges[j, 0], c.edges[j, 1])
        return between(s, 0, on_a, on_b, n, ra, rb, limit, name)
    corner = row(c.vertices, i)
    p, q = row(c.vertices, c.edges[j, 0]), row(c.vertices, c.edges[j, 1])
    share = share_on_edge(corner, p, q)
    foot = along(p, share, sub(q, p))
    name = name_at_corner(i, share, c.edges[j, 0], c.edges[j, 1])
    if kind == CORNER_A:
        return between(s, 0, corner, foot, n, ra, rb, limit, name)
    return between(s, 0, foot, corner, n, ra, rb, limit, name)


@njit(cache=True)
def lowest_corner(c: Cores, g: int, n: Vec) -> int:
    """Number of the corner of g with the least n . x."""
    best, corner = np.inf, -1
    for v in range(c.vertex_start[g], c.vertex_start[g + 1]):
        height = dot(n, row(c.vertices, v))
        if height < best:
            best, corner = height, v
    return corner


@njit(cache=True)
def core_contacts(c: Cores, a: int, b: int, limit: float, plane: bool, s: Scratch) -> int:
    """Contacts of two cores with gaps up to `limit`, four at most, in the first rows of the scratch; normals from a to b."""
    ra, rb = c.radius[a], c.radius[b]
    kind, apart, n, i, j = contact_axis(c, a, b, limit + ra + rb, plane)
    if kind == APART or apart > limit + ra + rb:
        return 0
    holder, face = reference_face(c, a, b, kind, i, n)
    if face >= 0:
        other, sign = (b, 1.0) if holder == a else (a, -1.0)
        m = row(c.normals, face)
        sides = load_reference(c, face, s)
        base = dot(m, row(s.reference, 0))
        count = load_incident(c, other, m, s)
        size = c.size[a] + c.size[b]
        found = against_face(
            s, 0, count, sides, m, base, size, c.radius[holder], c.radius[other], limit, sign
        )
        if found > 0:
            return choose_four(s, 0, without_twins(s, 0, found, size), m, size)
    if (
        kind == FACE_A or kind == FACE_B
    ):  # the faces do not overlap: the lowest corner stands for the other core
        other, m = (b, n) if kind == FACE_A else (a, scaled(-1.0, n))
        v = lowest_corner(c, other, m)
        x = row(c.vertices, v)
        middle = along(x, -0.5 * (apart - c.radius[a + b - other] + c.radius[other]), m)
        return add_contact(s, 0, middle, n, apart - ra - rb, name_of_vertex(v))
    return at_edges(c, a, b, kind, i, j, n, limit, plane, s)


@njit(cache=True)
def write_slots(s: Scratch, found: int, p: int, slots: Slots) -> None:
    """Contacts of one pair from the scratch to its slots, with names that differ."""
    width = slots.gaps.shape[1]
    found = min(found, width)
    slots.used[p] = found
    for i in range(found):
        name = s.features[i]
        fresh = False
        while not fresh:
            fresh = True
            for k in range(i):
                if slots.features[p, k] == name:
                    name, fresh = (name + 1) & 0x1FFFFF, False
        slots.features[p, i], slots.gaps[p, i] = name, s.gaps[i]
        for k in range(3):
            slots.points[p, i, k], slots.normals[p, i, k] = s.points[i, k], s.normals[i, k]


@njit(cache=True, parallel=True)
def core_pairs(
    c: Cores,
    pairs: NDArray[np.int64],
    limits: NDArray[np.float64],
    corners: int,
    plane: bool,
    slots: Slots,
) -> None:
    """Contacts of pairs (p, 2) of cores of which one has faces; gaps up to limits (p,)."""
    for chunk in prange(CHUNKS):
        s = scratch_for(corners, corners)
        for p in range(chunk * pairs.shape[0] // CHUNKS, (chunk + 1) * pairs.shape[0] // CHUNKS):
            found = core_contacts(c, pairs[p, 0], pairs[p, 1], limits[p], plane, s)
            write_slots(s, found, p, slots)


@njit(cache=True, parallel=True)
def plane_pairs(
    c: Cores,
    normal: NDArray[np.float64],
    offset: NDArray[np.float64],
    pairs: NDArray[np.int64],
    limits: NDArray[np.float64],
    corners: int,
    slots: Slots,
) -> None:
    """Contacts of pairs (p, 2) of a core and a plane: the corners of the face, segment or point that the plane sees.

    Planes normal . x = offset, normals (g, 3) and offsets (g,) by piece.
    """
    for chunk in prange(CHUNKS):
        s = scratch_for(corners, corners)
        for p in range(chunk * pairs.shape[0] // CHUNKS, (chunk + 1) * pairs.shape[0] // CHUNKS):
            g, h = pairs[p, 0], pairs[p, 1]
            n, base = row(normal, h), offset[h]
            count = load_incident(c, g, n, s)
            radius = c.radius[g]
            size = c.size[g]
            found = against_face(s, 0, count, 0, n, base, size, 0.0, radius, limits[p], -1.0)
            write_slots(s, choose_four(s, 0, found, n, size), p, slots)
