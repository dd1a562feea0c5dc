"""Vertices near triangles and edges near edges of one surface: closest points, signed gaps, sides kept from step to step.

A pair counts if its nearest points are inside triangle or edges at the start of the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.contact._vectors import Vec, along, cross, dot, row, scaled, sub

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

INSIDE = 1e-9  # barycentric: rounding
PARALLEL = 1e-3  # sine below which two edges have no common normal


class Surface(NamedTuple):
    """Triangles (m, 3), edges (e, 2) and edges of triangles (m, 3); the triangle that looks after each vertex and edge."""

    triangles: Whole
    edges: Whole
    triangle_edges: Whole
    vertex_owner: Whole
    edge_owner: Whole
    rest: Array


class Memory(NamedTuple):
    """Sorted keys of close pairs and their sides, 1 or -1."""

    keys: Whole
    sides: Whole


class Motion(NamedTuple):
    """Positions and velocities (n, 3) at the start of a step."""

    start: Array
    velocity: Array


class Limits(NamedTuple):
    """Step dt [s], thickness, gap looked at beyond it, and distance beyond which nothing is looked at [m]."""

    dt: float
    thickness: float
    slack: float
    wide: float


class Found(NamedTuple):
    """Contacts: keys, sides (k,), vertices and weights (k, 4), normals (k, 3), gaps (k,)."""

    keys: Whole
    sides: Whole
    vertices: Whole
    weights: Array
    normals: Array
    gaps: Array


@njit(cache=True)
def _side(memory: Memory, key: int, distance: float, thickness: float) -> int:
    """The side remembered, unless the pair is through by more than the thickness; else the side on which it is."""
    here = 1 if distance >= 0.0 else -1
    at = np.searchsorted(memory.keys, key)
    if at < memory.keys.shape[0] and memory.keys[at] == key:
        known = memory.sides[at]
        if known * distance > -thickness:
            return int(known)
    return here


@njit(cache=True)
def _near_at_rest(rest: Array, vertices: Whole, weights: Array, distance: float) -> bool:
    way = (0.0, 0.0, 0.0)
    for j in range(4):
        way = along(way, weights[j], row(rest, vertices[j]))
    return dot(way, way) < distance * distance


@njit(cache=True)
def _keep(
    found: Found, at: int, write: bool, key: int, side: int, vertices: Whole, weights: Array, normal: Vec, gap: float
) -> int:  # fmt: skip
    if write:
        found.keys[at], found.sides[at], found.gaps[at] = key, side, gap
        for j in range(4):
            found.vertices[at, j], found.weights[at, j] = vertices[j], weights[j]
        for i in range(3):
            found.normals[at, i] = normal[i]
    return at + 1


@njit(cache=True)
def _closing(v: Array, vertices: Whole, weights: Array, normal: Vec) -> float:
    way = (0.0, 0.0, 0.0)
    for j in range(4):
        way = along(way, weights[j], row(v, vertices[j]))
    return max(0.0, -dot(way, normal))


@njit(cache=True)
def _on_face(x: Array, vertices: Whole, weights: Array) -> bool:
    """Weights of a vertex and of its foot on a triangle, vertices[1:]; whether the foot is inside."""
    o = row(x, vertices[1])
    one, two, way = sub(row(x, vertices[2]), o), sub(row(x, vertices[3]), o), sub(row(x, vertices[0]), o)
    normal = cross(one, two)
    squared = dot(normal, normal)
    b, c = dot(cross(way, two), normal) / squared, dot(cross(one, way), normal) / squared
    weights[0], weights[1], weights[2], weights[3] = 1.0, b + c - 1.0, -b, -c
    return min(b, c, 1.0 - b - c) >= -INSIDE


@njit(cache=True)
def _on_edges(x: Array, vertices: Whole, weights: Array) -> bool:
    """Weights of the nearest points of two lines; whether they are inside both edges. False for parallel ones."""
    first = sub(row(x, vertices[1]), row(x, vertices[0]))
    second = sub(row(x, vertices[3]), row(x, vertices[2]))
    normal = cross(first, second)
    squared = dot(normal, normal)
    if squared <= PARALLEL * PARALLEL * dot(first, first) * dot(second, second):
        return False
    way = sub(row(x, vertices[2]), row(x, vertices[0]))
    s, t = dot(cross(way, second), normal) / squared, dot(cross(way, first), normal) / squared
    weights[0], weights[1], weights[2], weights[3] = 1.0 - s, s, t - 1.0, -t
    return min(s, 1.0 - s, t, 1.0 - t) >= -INSIDE


@njit(cache=True)
def _vertex_face(
    motion: Motion, surface: Surface, memory: Memory, vertex: int, t: int, limits: Limits, vertices: Whole, weights: Array,
    found: Found, at: int, write: bool,
) -> int:  # fmt: skip
    x = motion.start
    a, b, c = surface.triangles[t, 0], surface.triangles[t, 1], surface.triangles[t, 2]
    if vertex in (a, b, c):
        return at
    normal = cross(sub(row(x, b), row(x, a)), sub(row(x, c), row(x, a)))
    normal = scaled(1.0 / np.sqrt(dot(normal, normal)), normal)
    distance = dot(sub(row(x, vertex), row(x, a)), normal)
    if abs(distance) > limits.wide:
        return at
    vertices[0], vertices[1], vertices[2], vertices[3] = vertex, a, b, c
    if not _on_face(x, vertices, weights):
        return at
    key = 2 * (vertex * surface.triangles.shape[0] + t)
    return _judged(
        motion, surface, memory, key, normal, distance, limits, vertices, weights, found, at, write
    )


@njit(cache=True)
def _edge_edge(
    motion: Motion, surface: Surface, memory: Memory, one: int, two: int, limits: Limits, vertices: Whole, weights: Array,
    found: Found, at: int, write: bool,
) -> int:  # fmt: skip
    x = motion.start
    a, b = surface.edges[one, 0], surface.edges[one, 1]
    c, d = surface.edges[two, 0], surface.edges[two, 1]
    if a in (c, d) or b in (c, d):
        return at
    first, second = sub(row(x, b), row(x, a)), sub(row(x, d), row(x, c))
    normal = cross(first, second)
    squared = dot(normal, normal)
    if squared <= PARALLEL * PARALLEL * dot(first, first) * dot(second, second):
        return at
    normal = scaled(1.0 / np.sqrt(squared), normal)
    distance = dot(sub(row(x, a), row(x, c)), normal)
    if abs(distance) > limits.wide:
        return at
    vertices[0], vertices[1], vertices[2], vertices[3] = a, b, c, d
    if not _on_edges(x, vertices, weights):
        return at
    key = 2 * (one * surface.edges.shape[0] + two) + 1
    return _judged(
        motion, surface, memory, key, normal, distance, limits, vertices, weights, found, at, write
    )


@njit(cache=True)
def _judged(
    motion: Motion, surface: Surface, memory: Memory, key: int, normal: Vec, distance: float, limits: Limits,
    vertices: Whole, weights: Array, found: Found, at: int, write: bool,
) -> int:  # fmt: skip
    """Keep a pair whose gap on its side closes within the step."""
    side = _side(memory, key, distance, limits.thickness)
    normal = scaled(float(side), normal)
    gap = side * distance - limits.thickness
    if gap > limits.slack + limits.dt * _closing(motion.velocity, vertices, weights, normal):
        return at
    if _near_at_rest(surface.rest, vertices, weights, 2.0 * limits.thickness):
        return at
    return _keep(found, at, write, key, side, vertices, weights, normal, gap)


@njit(cache=True)
def collect(
    motion: Motion, surface: Surface, pairs: Whole, memory: Memory, limits: Limits, found: Found, write: bool
) -> int:
    """Number of contacts of the pairs (p, 2) of triangles; written to `found` when asked for.

    Every vertex and edge is looked at with the triangle that owns it, so that a pair of them is found once.
    """
    vertices, weights = np.empty(4, dtype=np.int64), np.empty(4)
    at = 0
    for k in range(pairs.shape[0]):
        for turn in range(2):
            own, other = pairs[k, turn], pairs[k, 1 - turn]
            for corner in range(3):
                vertex = surface.triangles[own, corner]
                if surface.vertex_owner[vertex] == own:
                    at = _vertex_face(
                        motion, surface, memory, vertex, other, limits, vertices, weights, found, at, write
                    )
        for i in range(3):
            one = surface.triangle_edges[pairs[k, 0], i]
            if surface.edge_owner[one] != pairs[k, 0]:
                continue
            for j in range(3):
                two = surface.triangle_edges[pairs[k, 1], j]
                if surface.edge_owner[two] == pairs[k, 1]:
                    low, high = min(one, two), max(one, two)
                    at = _edge_edge(
                        motion, surface, memory, low, high, limits, vertices, weights, found, at, write
                    )
    return at
