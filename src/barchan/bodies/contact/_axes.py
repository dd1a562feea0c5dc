"""Kernels that find how far two convex cores are apart, and along which axis: exact, apart or one in the other.

The support gap along a unit vector n, min over b of n . x - max over a of n . x, never exceeds the distance and is largest
along the normal of the contact. Candidates: face normals, products of edges, and, where the cores are apart, the way from a
corner to the nearest point of an edge. Among them is the normal (separating axis theorem; faces of the Minkowski difference).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import Vec, along, cross, dot, row, scaled, sub
from barchan.bodies.contact.arrays import Cores

APART, FACE_A, FACE_B, EDGES, CORNER_A, CORNER_B = range(6)
ROUNDING = 1e-12  # of the size of the cores
PREFERENCE = 1e-9  # of their size, by which faces win over edges
PARALLEL = 1e-12  # square of the sine between edges that make no axis


@njit(cache=True)
def least(vertices: NDArray[np.float64], first: int, last: int, n: Vec) -> float:
    """Least n . x of the rows first .. last."""
    lowest = np.inf
    for v in range(first, last):
        lowest = min(lowest, n[0] * vertices[v, 0] + n[1] * vertices[v, 1] + n[2] * vertices[v, 2])
    return lowest


@njit(cache=True)
def most(vertices: NDArray[np.float64], first: int, last: int, n: Vec) -> float:
    """Greatest n . x of the rows first .. last."""
    highest = -np.inf
    for v in range(first, last):
        highest = max(highest, n[0] * vertices[v, 0] + n[1] * vertices[v, 1] + n[2] * vertices[v, 2])
    return highest


@njit(cache=True)
def support_gap(c: Cores, a: int, b: int, n: Vec) -> float:
    """Room between core a and core b along n, from a to b."""
    low = least(c.vertices, c.vertex_start[b], c.vertex_start[b + 1], n)
    return low - most(c.vertices, c.vertex_start[a], c.vertex_start[a + 1], n)


@njit(cache=True)
def best_face(c: Cores, a: int, b: int, limit: float) -> tuple[float, int]:
    """Greatest height of core b above a face of core a, and that face; stops beyond `limit`."""
    best, face = -np.inf, -1
    for f in range(c.face_start[a], c.face_start[a + 1]):
        n = row(c.normals, f)
        base = dot(n, row(c.vertices, c.ring[c.ring_start[f]]))
        height = least(c.vertices, c.vertex_start[b], c.vertex_start[b + 1], n) - base
        if height > best:
            best, face = height, f
        if best > limit:
            break
    return best, face


@njit(cache=True)
def _crossing_arcs(c: Cores, i: int, da: Vec, j: int, db: Vec) -> bool:
    """Whether edges i and j make a face of the Minkowski difference: a direction normal to both bodies at these edges.

    The normals at an edge are the arc between those of its two faces; that of i must cross the opposite of that of j. At a
    bare segment they are the whole circle.
    """
    a, b = c.edge_faces[i, 0], c.edge_faces[i, 1]
    e, f = c.edge_faces[j, 0], c.edge_faces[j, 1]
    if a >= 0:
        over_a, over_b = dot(row(c.normals, a), db), dot(row(c.normals, b), db)
        if over_a * over_b >= 0.0:
            return False
    if e >= 0:
        over_e, over_f = dot(row(c.normals, e), da), dot(row(c.normals, f), da)
        if over_e * over_f >= 0.0:
            return False
    if a < 0 or e < 0:
        return True
    n = cross(da, db)
    out_a = dot(n, row(c.normals, a)) + dot(n, row(c.normals, b))
    out_b = dot(n, row(c.normals, e)) + dot(n, row(c.normals, f))
    return out_a * out_b < 0.0


@njit(cache=True)
def best_edges(c: Cores, a: int, b: int, best: float) -> tuple[float, int, int, Vec]:
    """Support gap greater than `best` along the product of an edge of a and one of b, with both edges and the axis.

    Where the arcs of their normals cross, the gap along the product is that between the edges themselves.
    """
    edge_a, edge_b, axis = -1, -1, (0.0, 0.0, 0.0)
    for i in range(c.edge_start[a], c.edge_start[a + 1]):
        pa = row(c.vertices, c.edges[i, 0])
        da = sub(row(c.vertices, c.edges[i, 1]), pa)
        for j in range(c.edge_start[b], c.edge_start[b + 1]):
            pb = row(c.vertices, c.edges[j, 0])
            db = sub(row(c.vertices, c.edges[j, 1]), pb)
            if not _crossing_arcs(c, i, da, j, db):
                continue
            n = cross(da, db)
            square = dot(n, n)
            if square <= PARALLEL * dot(da, da) * dot(db, db):
                continue
            n = scaled(1.0 / np.sqrt(square), n)
            f = c.edge_faces[i, 0]
            if f >= 0:  # outward at the edge of a, inward at that of b
                outward = dot(n, row(c.normals, f)) + dot(n, row(c.normals, c.edge_faces[i, 1]))
            else:
                f = c.edge_faces[j, 0]
                outward = -dot(n, row(c.normals, f)) - dot(n, row(c.normals, c.edge_faces[j, 1]))
            if outward < 0.0:
                n = scaled(-1.0, n)
            gap = dot(n, sub(pb, pa))
            if gap > best:
                best, edge_a, edge_b, axis = gap, i, j, n
    return best, edge_a, edge_b, axis


@njit(cache=True)
def share_on_edge(x: Vec, p: Vec, q: Vec) -> float:
    """Share of the way from p to q of the point nearest to x."""
    d = sub(q, p)
    square = dot(d, d)
    return min(max(dot(sub(x, p), d) / square, 0.0), 1.0) if square > 0.0 else 0.0


@njit(cache=True)
def nearest_corner(c: Cores, a: int, b: int) -> tuple[float, int, int, Vec]:
    """Least square of the distance of a corner of a from an edge of b; corner, edge, and the way from corner to edge."""
    best, corner, edge, way = np.inf, -1, -1, (0.0, 0.0, 0.0)
    for v in range(c.vertex_start[a], c.vertex_start[a + 1]):
        x = row(c.vertices, v)
        for e in range(c.edge_start[b], c.edge_start[b + 1]):
            p, q = row(c.vertices, c.edges[e, 0]), row(c.vertices, c.edges[e, 1])
            d = sub(along(p, share_on_edge(x, p, q), sub(q, p)), x)
            square = dot(d, d)
            if square < best:
                best, corner, edge, way = square, v, e, d
    return best, corner, edge, way


@njit(cache=True)
def contact_axis(c: Cores, a: int, b: int, limit: float, plane: bool) -> tuple[int, float, Vec, int, int]:
    """How cores a and b meet: kind, signed distance, unit normal from a to b, and the numbers of what touches.

    Kinds: FACE_A, FACE_B (a face of a, of b), EDGES (an edge of each), CORNER_A (a corner of a, an edge of b), CORNER_B (a
    corner of b, an edge of a); APART for a distance beyond `limit`. In the `plane` scene edges make no axes.
    """
    none = (0.0, 0.0, 0.0)
    over_a, face_a = best_face(c, a, b, limit)
    if over_a > limit:
        return APART, over_a, none, -1, -1
    over_b, face_b = best_face(c, b, a, limit)
    if over_b > limit:
        return APART, over_b, none, -1, -1
    size = c.size[a] + c.size[b]
    kind, best, n, i, j = FACE_A, over_a, none, face_a, -1
    if over_b > over_a + PREFERENCE * size:
        kind, best, i = FACE_B, over_b, face_b
        n = scaled(-1.0, row(c.normals, face_b))
    elif face_a >= 0:
        n = row(c.normals, face_a)
    if not plane:
        gap, edge_a, edge_b, axis = best_edges(c, a, b, best + PREFERENCE * size)
        if edge_a >= 0:
            kind, best, n, i, j = EDGES, gap, axis, edge_a, edge_b
            if best > limit:
                return APART, best, none, -1, -1
    if best <= ROUNDING * size:
        return kind, best, n, i, j
    square, corner, edge, way = nearest_corner(c, a, b)
    candidate = CORNER_A
    other, corner_b, edge_b, way_b = nearest_corner(c, b, a)
    if other < square:
        candidate, square, corner, edge, way = CORNER_B, other, corner_b, edge_b, scaled(-1.0, way_b)
    if square < np.inf and square > (ROUNDING * size) ** 2:
        distance = np.sqrt(square)
        m = scaled(1.0 / distance, way)
        gap = support_gap(c, a, b, m)
        if gap > best + ROUNDING * size:
            # equal to the distance of the two features but for rounding, when they are the nearest ones
            best = distance if distance - gap <= 1e-6 * distance else gap
            kind, n, i, j = candidate, m, corner, edge
    if best > limit:
        return APART, best, none, -1, -1
    return kind, best, n, i, j
