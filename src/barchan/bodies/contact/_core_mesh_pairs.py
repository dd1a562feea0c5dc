"""Kernel over pairs of a convex core and a triangle mesh: walk the tree of boxes, gather, thin out to a few manifolds."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._axes import least
from barchan.bodies.contact._ball_mesh import contacts_to_world
from barchan.bodies.contact._clipping import Scratch, choose_four, keep_contact, scratch_for, without_twins
from barchan.bodies.contact._core_mesh import triangle_contacts
from barchan.bodies.contact._manifolds import CHUNKS, write_slots
from barchan.bodies.contact._vectors import Vec, along, dot, put, row, sub, turn_back
from barchan.bodies.contact.arrays import Cores, Meshes, Slots

Array = NDArray[np.float64]
MESH_WIDTH = 16  # contacts of a core with one mesh
ROOM = 128  # contacts of single triangles before they are thinned out
SAME_DIRECTION = 0.999  # cosine between normals of contacts that make one manifold
DEEPER = 2e-3  # of the size, by which a contact beyond a ridge must be deeper to be left out


@njit(cache=True)
def _room_for_core(vertices: int, faces: int, ring: int, edges: int) -> Cores:
    """A single core with room for so many of each."""
    return Cores(
        np.empty(1), np.empty(1), np.empty(1), np.empty((1, 3)), np.zeros(2, dtype=np.int64), np.empty((vertices, 3)),
        np.zeros(2, dtype=np.int64), np.empty((faces, 3)), np.empty(faces), np.zeros(faces + 1, dtype=np.int64),
        np.empty(ring, dtype=np.int64), np.zeros(2, dtype=np.int64), np.empty((edges, 2), dtype=np.int64),
        np.empty((edges, 2), dtype=np.int64),
    )  # fmt: skip


@njit(cache=True)
def _load_core(c: Cores, g: int, matrix: Array, place: Vec, own: Cores) -> None:
    """Copy core g into `own`, number 0, seen from the frame of the mesh."""
    own.radius[0], own.size[0], own.inner[0] = c.radius[g], c.size[g], c.inner[g]
    put(own.centre, 0, turn_back(matrix, sub(row(c.centre, g), place)))
    v0, f0, e0 = c.vertex_start[g], c.face_start[g], c.edge_start[g]
    vertices, faces, edges = c.vertex_start[g + 1] - v0, c.face_start[g + 1] - f0, c.edge_start[g + 1] - e0
    own.vertex_start[1], own.face_start[1], own.edge_start[1] = vertices, faces, edges
    for v in range(vertices):
        put(own.vertices, v, turn_back(matrix, sub(row(c.vertices, v0 + v), place)))
    r0 = c.ring_start[f0]
    for f in range(faces):
        put(own.normals, f, turn_back(matrix, row(c.normals, f0 + f)))
        own.areas[f] = c.areas[f0 + f]
        own.ring_start[f + 1] = c.ring_start[f0 + f + 1] - r0
    for k in range(c.ring_start[f0 + faces] - r0):
        own.ring[k] = c.ring[r0 + k] - v0
    for e in range(edges):
        own.edge_faces[e, 0], own.edge_faces[e, 1] = (
            c.edge_faces[e0 + e, 0] - f0,
            c.edge_faces[e0 + e, 1] - f0,
        )
        own.edges[e, 0], own.edges[e, 1] = c.edges[e0 + e, 0] - v0, c.edges[e0 + e, 1] - v0


@njit(cache=True)
def _swap(s: Scratch, i: int, j: int) -> None:
    """Exchange two contacts."""
    if i == j:
        return
    for k in range(3):
        s.points[i, k], s.points[j, k] = s.points[j, k], s.points[i, k]
        s.normals[i, k], s.normals[j, k] = s.normals[j, k], s.normals[i, k]
    s.gaps[i], s.gaps[j] = s.gaps[j], s.gaps[i]
    s.features[i], s.features[j] = s.features[j], s.features[i]


@njit(cache=True)
def thinned(s: Scratch, found: int, size: float) -> int:
    """Keep four contacts at most of those with about the same normal, and the deepest of all that are left; their number."""
    first = 0
    while first < found:
        n, end = row(s.normals, first), first
        for j in range(first, found):
            if dot(row(s.normals, j), n) >= SAME_DIRECTION:
                _swap(s, end, j)
                end += 1
        kept = first + choose_four(s, first, without_twins(s, first, end, size) - first, n, size)
        for j in range(end, found):
            keep_contact(s, kept + j - end, j)
        found -= end - kept
        first = kept
    if found > MESH_WIDTH:
        for k in range(MESH_WIDTH):
            deepest = k
            for j in range(k + 1, found):
                if s.gaps[j] < s.gaps[deepest]:
                    deepest = j
            _swap(s, k, deepest)
        found = MESH_WIDTH
    return found


@njit(cache=True)
def _beyond_ridge(s: Scratch, i: int, j: int) -> bool:
    """Whether the places of two contacts on the mesh lie each behind the plane of the other."""
    to = sub(
        along(row(s.points, j), -0.5 * s.gaps[j], row(s.normals, j)),
        along(row(s.points, i), -0.5 * s.gaps[i], row(s.normals, i)),
    )
    if dot(row(s.normals, i), row(s.normals, j)) > SAME_DIRECTION:
        return False
    return dot(row(s.normals, i), to) <= 0.0 and dot(row(s.normals, j), to) >= 0.0


@njit(cache=True)
def without_far_sides(own: Cores, s: Scratch, found: int) -> int:
    """Leave out contacts with triangles on the far side of a ridge: a shallower one on the near side frees them as well.

    What counts on the near side is the height of the lowest point of the core above the plane of the contact.
    """
    kept = 0
    for j in range(found):
        n = row(s.normals, j)
        base = dot(n, row(s.points, j)) - 0.5 * s.gaps[j]
        height = least(own.vertices, 0, own.vertex_start[1], n) - own.radius[0] - base
        s.heights[j] = height
    for i in range(found):
        s.chosen[i] = 1
        for j in range(found):
            if s.gaps[i] < s.heights[j] - DEEPER * own.size[0] and _beyond_ridge(s, i, j):
                s.chosen[i] = 0
                break
    for i in range(found):
        if s.chosen[i] == 1:
            keep_contact(s, kept, i)
            kept += 1
    return kept


@njit(cache=True)
def _core_mesh_contacts(own: Cores, mesh: Meshes, m: int, first_name: int, limit: float, s: Scratch) -> int:
    """Contacts of the loaded core with mesh m, in the frame of the mesh, normals from the mesh to the core."""
    lower = (np.inf, np.inf, np.inf)
    upper = (-np.inf, -np.inf, -np.inf)
    far = own.radius[0] + limit
    for v in range(own.vertex_start[1]):
        x = row(own.vertices, v)
        lower = (min(lower[0], x[0] - far), min(lower[1], x[1] - far), min(lower[2], x[2] - far))
        upper = (max(upper[0], x[0] + far), max(upper[1], x[1] + far), max(upper[2], x[2] + far))
    found = 0
    node, last = mesh.node_start[m], mesh.node_start[m + 1]
    while node < last:
        meets = True
        for k in range(3):
            meets &= mesh.node_lower[node, k] <= upper[k] and mesh.node_upper[node, k] >= lower[k]
        if not meets:
            node = mesh.skip[node]
            continue
        for i in range(mesh.leaf_first[node], mesh.leaf_first[node] + mesh.leaf_count[node]):
            if found > ROOM // 2:
                found = thinned(s, found, own.size[0])
            found = triangle_contacts(own, 0, mesh, mesh.order[i], first_name, limit, s, found)
        node += 1
    return without_far_sides(own, s, thinned(s, found, own.size[0]))


@njit(cache=True, parallel=True)
def core_mesh_pairs(
    c: Cores, turns: Array, places: Array, body: NDArray[np.int64],
    mesh: Meshes, pairs: NDArray[np.int64], limits: Array,
    vertices: int, faces: int, ring: int, edges: int, slots: Slots,
) -> None:  # fmt: skip
    """Contacts of pairs (p, 2) of a core and a mesh; most vertices, faces, ring entries and edges of a core."""
    for chunk in prange(CHUNKS):
        s = scratch_for(max(ROOM, 2 * vertices + 8), ROOM + 2 * vertices + 8)
        own = _room_for_core(vertices, faces, ring, edges)
        for p in range(chunk * pairs.shape[0] // CHUNKS, (chunk + 1) * pairs.shape[0] // CHUNKS):
            g, h = pairs[p, 0], pairs[p, 1]
            matrix, place = turns[body[h]], row(places, body[h])
            _load_core(c, g, matrix, place, own)
            found = _core_mesh_contacts(own, mesh, mesh.of_piece[h], vertices, limits[p], s)
            contacts_to_world(s, found, matrix, place, -1.0)
            write_slots(s, found, p, slots)
