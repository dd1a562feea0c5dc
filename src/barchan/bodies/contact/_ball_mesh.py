"""Kernels of balls against closed triangle meshes: the nearest point of the mesh, and every other place that is nearest nearby.

Outside, a place on the mesh touches the ball when no neighbouring place is nearer to its middle: inside a triangle, on an
edge or a corner that stands out towards it. Two neighbours in one plane give one contact, a ball in a groove several. Inside
the mesh the nearest place alone counts.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from barchan.bodies.contact._clipping import (
    Scratch,
    add_contact,
    mixed,
    name_of_vertex,
    scratch_for,
)
from barchan.bodies.contact._manifolds import CHUNKS, write_slots
from barchan.bodies.contact._vectors import Vec, along, dot, put, row, scaled, sub, turn, turn_back
from barchan.bodies.contact.arrays import Cores, Meshes, Slots
from barchan.bodies.rigid._kernels import CORNER, FACE, SIDE, closest_on_triangle

Array = NDArray[np.float64]
SAME_DIRECTION = 0.999  # cosine between the normals of contacts that are taken for one
ALIGNED = 1.0 - 1e-9  # cosine between normals that are one
LEVEL = 1e-6  # sine by which a neighbour may seem to stand out: rounding
CONTACTS = 8  # of a ball with one mesh


@njit(cache=True)
def node_distance(mesh: Meshes, node: int, x: Vec) -> float:
    """Square of the distance of x from the box of a node."""
    square = 0.0
    for k in range(3):
        over = max(mesh.node_lower[node, k] - x[k], 0.0, x[k] - mesh.node_upper[node, k])
        square += over * over
    return square


@njit(cache=True)
def closest_on(mesh: Meshes, t: int, x: Vec) -> tuple[float, float, float, int]:
    """Point of triangle t nearest to x, and its region."""
    return closest_on_triangle(
        x, row(mesh.vertices, mesh.triangles[t, 0]), row(mesh.vertices, mesh.triangles[t, 1]),
        row(mesh.vertices, mesh.triangles[t, 2]),
    )  # fmt: skip


@njit(cache=True)
def nearest_place(mesh: Meshes, m: int, x: Vec, reach: float) -> tuple[int, int, Vec, float]:
    """Triangle of mesh m nearest to x within `reach`, region, point and square of the distance; (-1, ...) for none."""
    best, triangle, region, place = reach * reach, -1, 0, (0.0, 0.0, 0.0)
    node, last = mesh.node_start[m], mesh.node_start[m + 1]
    while node < last:
        if node_distance(mesh, node, x) > best:
            node = mesh.skip[node]
            continue
        for n in range(mesh.leaf_first[node], mesh.leaf_first[node] + mesh.leaf_count[node]):
            t = mesh.order[n]
            px, py, pz, where = closest_on(mesh, t, x)
            way = sub(x, (px, py, pz))
            square = dot(way, way)
            if square < best or (square == best and triangle < 0):
                best, triangle, region, place = square, t, where, (px, py, pz)
        node += 1
    return triangle, region, place, best


@njit(cache=True)
def outward_at(mesh: Meshes, t: int, region: int) -> Vec:
    """A vector that looks out of the mesh at a place: its sign against the way to a point tells outside from inside."""
    if region >= SIDE:
        other = mesh.beside[t, region - SIDE]
        return (
            along(row(mesh.normals, t), 1.0, row(mesh.normals, other)) if other >= 0 else row(mesh.normals, t)
        )
    if region >= CORNER:
        return row(mesh.spread, mesh.triangles[t, region - CORNER])
    return row(mesh.normals, t)


@njit(cache=True)
def stands_out(mesh: Meshes, t: int, region: int, n: Vec, slack: float) -> bool:
    """Whether no neighbour of this place reaches further along the unit vector n, but for `slack` times its distance."""
    if region == FACE:
        return dot(row(mesh.normals, t), n) > 0.0
    if region >= SIDE:
        k = region - SIDE
        p = row(mesh.vertices, mesh.triangles[t, k])
        for corner in (mesh.triangles[t, (k + 2) % 3], mesh.across[t, k]):
            if corner >= 0:
                way = sub(row(mesh.vertices, corner), p)
                if dot(n, way) > slack * np.sqrt(dot(way, way)):
                    return False
        return True
    v = mesh.triangles[t, region - CORNER]
    for k in range(mesh.near_start[v], mesh.near_start[v + 1]):
        way = sub(row(mesh.vertices, mesh.near[k]), row(mesh.vertices, v))
        if dot(n, way) > slack * np.sqrt(dot(way, way)):
            return False
    return True


@njit(cache=True)
def name_of_place(mesh: Meshes, t: int, region: int, n: Vec) -> int:
    """Name of a place with the normal n: plane parts keep theirs from triangle to triangle, edges and corners in them too."""
    if region == FACE or dot(n, row(mesh.normals, t)) > ALIGNED:
        return mixed(mesh.patch[t], -2)
    if region >= SIDE:
        k = region - SIDE
        return mixed(mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3])
    return name_of_vertex(mesh.triangles[t, region - CORNER])


@njit(cache=True)
def _add_place(s: Scratch, found: int, x: Vec, n: Vec, distance: float, radius: float, name: int) -> int:
    """Write a contact unless a deeper one has its direction or there are deeper ones for every row; the number of contacts."""
    gap = distance - radius
    point = along(x, -0.5 * (distance + radius), n)
    worst = -1
    for k in range(found):
        if dot(row(s.normals, k), n) > SAME_DIRECTION:
            if gap < s.gaps[k]:
                add_contact(s, k, point, n, gap, name)
            return found
        if worst < 0 or s.gaps[k] > s.gaps[worst]:
            worst = k
    if found < CONTACTS:
        return add_contact(s, found, point, n, gap, name)
    if gap < s.gaps[worst]:
        add_contact(s, worst, point, n, gap, name)
    return found


@njit(cache=True)
def ball_mesh_contacts(mesh: Meshes, m: int, x: Vec, radius: float, limit: float, s: Scratch) -> int:
    """Contacts of a ball about x with mesh m, in its frame, normals from the mesh to the ball."""
    outside = False
    for k in range(3):
        outside |= x[k] < mesh.lower[m, k] or x[k] > mesh.upper[m, k]
    reach = radius + limit
    t, region, place, square = nearest_place(mesh, m, x, reach if outside else np.inf)
    if t < 0:
        return 0
    distance, way = np.sqrt(square), sub(x, place)
    size = abs(x[0]) + abs(x[1]) + abs(x[2]) + radius
    if distance <= 1e-12 * size:
        n = row(mesh.normals, t)
        return _add_place(s, 0, x, n, 0.0, radius, name_of_place(mesh, t, region, n))
    if dot(way, outward_at(mesh, t, region)) < 0.0:
        n = scaled(-1.0 / distance, way)
        return _add_place(s, 0, x, n, -distance, radius, name_of_place(mesh, t, region, n))
    if distance > reach:
        return 0
    n = scaled(1.0 / distance, way)
    found = _add_place(s, 0, x, n, distance, radius, name_of_place(mesh, t, region, n))
    node, last = mesh.node_start[m], mesh.node_start[m + 1]
    while node < last:
        if node_distance(mesh, node, x) > reach * reach:
            node = mesh.skip[node]
            continue
        for i in range(mesh.leaf_first[node], mesh.leaf_first[node] + mesh.leaf_count[node]):
            t = mesh.order[i]
            px, py, pz, region = closest_on(mesh, t, x)
            way = sub(x, (px, py, pz))
            distance = np.sqrt(dot(way, way))
            if distance > reach or distance <= 1e-12 * size:
                continue
            n = scaled(1.0 / distance, way)
            if stands_out(mesh, t, region, n, LEVEL):
                found = _add_place(s, found, x, n, distance, radius, name_of_place(mesh, t, region, n))
        node += 1
    return found


@njit(cache=True)
def contacts_to_world(s: Scratch, found: int, matrix: Array, place: Vec, sign: float) -> None:
    """Contacts of the scratch from the frame of a body to the world, normals times `sign`."""
    for k in range(found):
        put(s.points, k, along(place, 1.0, turn(matrix, row(s.points, k))))
        put(s.normals, k, scaled(sign, turn(matrix, row(s.normals, k))))


@njit(cache=True, parallel=True)
def ball_mesh_pairs(
    c: Cores,
    turns: Array,
    places: Array,
    body: NDArray[np.int64],
    mesh: Meshes,
    pairs: NDArray[np.int64],
    limits: Array,
    slots: Slots,
) -> None:
    """Contacts of pairs (p, 2) of a ball and a mesh; gaps up to limits (p,)."""
    for chunk in prange(CHUNKS):
        s = scratch_for(CONTACTS, CONTACTS)
        for p in range(chunk * pairs.shape[0] // CHUNKS, (chunk + 1) * pairs.shape[0] // CHUNKS):
            g, h = pairs[p, 0], pairs[p, 1]
            matrix, place = turns[body[h]], row(places, body[h])
            x = turn_back(matrix, sub(row(c.centre, g), place))
            found = ball_mesh_contacts(mesh, mesh.of_piece[h], x, c.radius[g], limits[p], s)
            contacts_to_world(s, found, matrix, place, -1.0)
            write_slots(s, found, p, slots)
