"""Kernels of convex cores against closed triangle meshes: each triangle near the core, looked at from outside.

A triangle is held against the core along axes that the mesh allows: its normal, and normals at its edges and corners where they
stand out from the mesh along them. So an edge inside a plane part pushes nothing sideways, and the side of a step is not
what carries a body that lies on top of it. Triangles whose plane has the middle of the core behind it are left out.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from barchan.bodies.contact._axes import PARALLEL, PREFERENCE, ROUNDING, least, share_on_edge
from barchan.bodies.contact._ball_mesh import stands_out
from barchan.bodies.contact._clipping import Scratch, name_at_corner, name_of_crossing
from barchan.bodies.contact._manifolds import (
    against_face,
    between,
    crossing_shares,
    load_incident,
    load_reference,
)
from barchan.bodies.contact._vectors import Vec, along, cross, dot, put, row, scaled, sub
from barchan.bodies.contact.arrays import Cores, Meshes
from barchan.bodies.rigid._kernels import CORNER, SIDE

STANDING_OUT = 1e-3  # sine by which a neighbour may reach further along an axis that still counts
NOTHING, TRIANGLE, CORE_FACE, EDGE_PAIR, CORE_CORNER, MESH_CORNER, BESIDE = range(7)


@njit(cache=True)
def _corner(mesh: Meshes, t: int, k: int) -> Vec:
    return row(mesh.vertices, mesh.triangles[t, k])


@njit(cache=True)
def _gap_along(c: Cores, g: int, mesh: Meshes, t: int, n: Vec) -> float:
    """Room between triangle t and the core along n, from the triangle to the core."""
    top = max(dot(n, _corner(mesh, t, 0)), dot(n, _corner(mesh, t, 1)), dot(n, _corner(mesh, t, 2)))
    return least(c.vertices, c.vertex_start[g], c.vertex_start[g + 1], n) - top


@njit(cache=True)
def _allowed(mesh: Meshes, t: int, n: Vec) -> bool:
    """Whether the part of the triangle that is foremost along n stands out from the mesh along it."""
    heights = (dot(n, _corner(mesh, t, 0)), dot(n, _corner(mesh, t, 1)), dot(n, _corner(mesh, t, 2)))
    side = sub(_corner(mesh, t, 1), _corner(mesh, t, 0))
    top = max(heights[0], heights[1], heights[2])
    level = top - STANDING_OUT * np.sqrt(dot(side, side))
    at_top = (heights[0] >= level, heights[1] >= level, heights[2] >= level)
    if at_top[0] and at_top[1] and at_top[2]:
        return dot(row(mesh.normals, t), n) > 0.0
    for k in range(3):
        if at_top[k] and at_top[(k + 1) % 3]:
            return stands_out(mesh, t, SIDE + k, n, STANDING_OUT)
    for k in range(3):
        if at_top[k]:
            return stands_out(mesh, t, CORNER + k, n, STANDING_OUT)
    return False


@njit(cache=True)
def _face_axes(c: Cores, g: int, mesh: Meshes, t: int, limit: float) -> tuple[int, float, Vec, int]:
    """Best allowed axis among the normals of the triangle, of its neighbours over edges that stand out, and of the core."""
    n = row(mesh.normals, t)
    kind, best, which = TRIANGLE, _gap_along(c, g, mesh, t, n), -1
    if best > limit:
        return NOTHING, best, n, -1
    slack = PREFERENCE * c.size[g]
    for k in range(3):
        other = mesh.beside[t, k]
        if other >= 0:
            m = row(mesh.normals, other)
            gap = _gap_along(c, g, mesh, t, m)
            if gap > limit:
                return NOTHING, gap, m, -1
            if gap > best + slack and stands_out(mesh, t, SIDE + k, m, STANDING_OUT):
                kind, best, n, which = BESIDE, gap, m, other
    for f in range(c.face_start[g], c.face_start[g + 1]):
        m = scaled(-1.0, row(c.normals, f))
        gap = _gap_along(c, g, mesh, t, m)
        if gap > limit:
            return NOTHING, gap, m, -1
        if gap > best + slack and _allowed(mesh, t, m):
            kind, best, n, which = CORE_FACE, gap, m, f
    return kind, best, n, which


@njit(cache=True)
def _edge_axis(
    c: Cores, g: int, mesh: Meshes, t: int, best: float, limit: float
) -> tuple[int, float, Vec, int, int]:
    """Best allowed axis better than `best` among products of edges: kind, gap, axis, side of the triangle, edge of the core."""
    kind, axis, side, edge, foremost = -1, (0.0, 0.0, 0.0), -1, -1, False
    slack = ROUNDING * c.size[g]
    for k in range(3):
        p = _corner(mesh, t, k)
        d = sub(_corner(mesh, t, (k + 1) % 3), p)
        for e in range(c.edge_start[g], c.edge_start[g + 1]):
            q = row(c.vertices, c.edges[e, 0])
            own = sub(row(c.vertices, c.edges[e, 1]), q)
            n = cross(d, own)
            square = dot(n, n)
            if square <= PARALLEL * dot(d, d) * dot(own, own):
                continue
            n = scaled(1.0 / np.sqrt(square), n)
            of_edges, of_centre = dot(n, sub(q, p)), dot(n, sub(row(c.centre, g), p))
            for sign in (1.0, -1.0):
                if min(sign * of_edges, sign * of_centre - c.inner[g]) < best - slack:
                    continue
                m = scaled(sign, n)
                gap = _gap_along(c, g, mesh, t, m)
                if gap > limit:
                    return NOTHING, gap, m, -1, -1
                own = sign * of_edges <= gap + slack
                better = gap > best + slack or (kind >= 0 and own and not foremost and gap >= best - slack)
                if better and stands_out(mesh, t, SIDE + k, m, STANDING_OUT):
                    kind, best, axis, side, edge, foremost = EDGE_PAIR, gap, m, k, e, own
    return kind, best, axis, side, edge


@njit(cache=True)
def _corner_axis(c: Cores, g: int, mesh: Meshes, t: int) -> tuple[int, float, Vec, int, int]:
    """Nearest corner and edge, one of the triangle and one of the core: kind, distance, way to the core, numbers."""
    kind, best, way, i, j = NOTHING, np.inf, (0.0, 0.0, 0.0), -1, -1
    for k in range(3):
        p, q = _corner(mesh, t, k), _corner(mesh, t, (k + 1) % 3)
        for v in range(c.vertex_start[g], c.vertex_start[g + 1]):
            x = row(c.vertices, v)
            d = sub(x, along(p, share_on_edge(x, p, q), sub(q, p)))
            if dot(d, d) < best:
                kind, best, way, i, j = CORE_CORNER, dot(d, d), d, k, v
        for e in range(c.edge_start[g], c.edge_start[g + 1]):
            a, b = row(c.vertices, c.edges[e, 0]), row(c.vertices, c.edges[e, 1])
            d = sub(along(a, share_on_edge(p, a, b), sub(b, a)), p)
            if dot(d, d) < best:
                kind, best, way, i, j = MESH_CORNER, dot(d, d), d, k, e
    return kind, np.sqrt(best), way, i, j


@njit(cache=True)
def triangle_contacts(
    c: Cores, g: int, mesh: Meshes, t: int, first_name: int, limit: float, s: Scratch, at: int
) -> int:
    """Contacts of the core with triangle t, normals away from the mesh, written from row `at` on; the next free row.

    All in the frame of the mesh. `first_name` is the number of vertices of cores: names of the mesh's own begin there.
    """
    n, radius = row(mesh.normals, t), c.radius[g]
    if dot(n, sub(row(c.centre, g), _corner(mesh, t, 0))) < 0.0:
        return at
    far = limit + radius
    kind, best, n, which = _face_axes(c, g, mesh, t, far)
    if kind == NOTHING:
        return at
    side, edge = -1, -1
    found, gap, axis, k, e = _edge_axis(c, g, mesh, t, best + PREFERENCE * c.size[g], far)
    if found == NOTHING:
        return at
    if found == EDGE_PAIR:
        kind, best, n, side, edge = EDGE_PAIR, gap, axis, k, e
    found, distance, way, i, j = _corner_axis(c, g, mesh, t)
    if distance > ROUNDING * c.size[g]:
        m = scaled(1.0 / distance, way)
        gap = _gap_along(c, g, mesh, t, m)
        if gap > max(best, 0.0) + ROUNDING * c.size[g]:
            if not _allowed(mesh, t, m):  # a neighbour is nearer
                return at
            kind, best, n, side, edge = found, distance, m, i, j
    if best > far or kind == BESIDE:
        return at
    if kind == TRIANGLE:
        return _on_triangle(c, g, mesh, t, first_name, limit, s, at)
    if kind == CORE_FACE:
        return _on_core_face(c, g, mesh, t, which, first_name, limit, s, at)
    if kind == EDGE_PAIR:
        return _on_edges(c, g, mesh, t, side, edge, n, first_name, limit, s, at)
    p, q = _corner(mesh, t, side), _corner(mesh, t, (side + 1) % 3)
    if kind == CORE_CORNER:
        x = row(c.vertices, edge)
        share, first, last = (
            share_on_edge(x, p, q),
            mesh.triangles[t, side],
            mesh.triangles[t, (side + 1) % 3],
        )
        name = name_at_corner(edge, share, first_name + first, first_name + last)
        return between(s, at, along(p, share, sub(q, p)), x, n, 0.0, radius, limit, name)
    a, b = row(c.vertices, c.edges[edge, 0]), row(c.vertices, c.edges[edge, 1])
    share = share_on_edge(p, a, b)
    name = name_at_corner(first_name + mesh.triangles[t, side], share, c.edges[edge, 0], c.edges[edge, 1])
    return between(s, at, p, along(a, share, sub(b, a)), n, 0.0, radius, limit, name)


@njit(cache=True)
def _on_triangle(
    c: Cores, g: int, mesh: Meshes, t: int, first_name: int, limit: float, s: Scratch, at: int
) -> int:
    """The core's lowest face, segment or corner against the triangle."""
    n = row(mesh.normals, t)
    for k in range(3):
        put(s.reference, k, _corner(mesh, t, k))
        s.corners[k] = first_name + mesh.triangles[t, k]
    count = load_incident(c, g, n, s)
    base = dot(n, _corner(mesh, t, 0))
    return against_face(s, at, count, 3, n, base, c.size[g], 0.0, c.radius[g], limit, 1.0)


@njit(cache=True)
def _on_core_face(
    c: Cores, g: int, mesh: Meshes, t: int, face: int, first_name: int, limit: float, s: Scratch, at: int
) -> int:
    """The triangle against a face of the core."""
    n = row(c.normals, face)
    sides = load_reference(c, face, s)
    for k in range(3):
        put(s.polygon, k, _corner(mesh, t, k))
        s.sides[k, 0] = first_name + mesh.triangles[t, k]
        s.sides[k, 1] = first_name + mesh.triangles[t, (k + 1) % 3]
    base = dot(n, row(s.reference, 0))
    return against_face(s, at, 3, sides, n, base, c.size[g], c.radius[g], 0.0, limit, -1.0)


@njit(cache=True)
def _on_edges(
    c: Cores, g: int, mesh: Meshes, t: int, side: int, edge: int, n: Vec, first_name: int,
    limit: float, s: Scratch, at: int,
) -> int:  # fmt: skip
    """The crossing of a side of the triangle with an edge of the core; nothing when it lies beyond their ends."""
    p, q = _corner(mesh, t, side), row(c.vertices, c.edges[edge, 0])
    d, own = sub(_corner(mesh, t, (side + 1) % 3), p), sub(row(c.vertices, c.edges[edge, 1]), q)
    share, share_own = crossing_shares(p, d, q, own)
    if min(share, share_own) < -1e-6 or max(share, share_own) > 1.0 + 1e-6:
        return at
    a, b = first_name + mesh.triangles[t, side], first_name + mesh.triangles[t, (side + 1) % 3]
    name = name_of_crossing(a, b, c.edges[edge, 0], c.edges[edge, 1])
    return between(s, at, along(p, share, d), along(q, share_own, own), n, 0.0, c.radius[g], limit, name)
