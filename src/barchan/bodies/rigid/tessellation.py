"""Facets of round surfaces, vertices moved out a little so that circles keep their length and spheres their area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid.surfaces import MOST_FACETS, facet_vectors
from barchan.errors import InputError

FEWEST_SIDES = 8  # of a circle, however large the spacing


def circle_sides(radius: float, spacing: float) -> int:
    """Number of sides of a regular polygon about a circle, each no longer than `spacing`; a multiple of four."""
    return max(FEWEST_SIDES, 4 * int(np.ceil(0.5 * np.pi * radius / spacing)))


def stretch(sides: int) -> float:
    """Radius of the regular polygon with the perimeter of the unit circle."""
    return float((np.pi / sides) / np.sin(np.pi / sides))


def disk_facets(radius: float, spacing: float) -> NDArray[np.float64]:
    """Segments (F, 2, 2) of a circle, counter-clockwise."""
    sides = circle_sides(radius, spacing)
    if sides > MOST_FACETS:
        raise InputError("spacing", spacing, f"larger: the circle has more than {MOST_FACETS} sides")
    angles = 2.0 * np.pi / sides * np.arange(sides)
    corners = radius * stretch(sides) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def geodesic_sphere(radius: float, spacing: float) -> NDArray[np.float64]:
    """Triangles (F, 3, 3) of a sphere: the faces of an icosahedron cut into n^2 and pushed out, of the exact total area."""
    frequency = max(
        2, int(np.ceil(1.25 * radius / spacing))
    )  # the longest edge is about 1.18 radius / frequency
    if 20 * frequency**2 > MOST_FACETS:
        raise InputError("spacing", spacing, f"larger: the sphere has more than {MOST_FACETS} facets")
    facets = _cut_triangles(_icosahedron(), frequency)
    facets /= np.linalg.norm(facets, axis=2, keepdims=True)
    area = float(np.sum(np.linalg.norm(facet_vectors(facets), axis=1)))
    return radius * np.sqrt(4.0 * np.pi / area) * facets


def revolved_facets(profile: NDArray[np.float64], spacing: float, is_closed: bool) -> NDArray[np.float64]:
    """Triangles (F, 3, 3) of the surface swept by a polyline (n, 2) of (r, z) about the z axis.

    The profile runs counter-clockwise about the solid, from the axis to the axis unless `is_closed`.
    """
    segments = np.stack([profile, np.roll(profile, -1, axis=0)], axis=1)
    if not is_closed:
        segments = segments[:-1]
    segments = segments[np.any(segments[:, :, 0] > 0.0, axis=1)]  # those on the axis sweep no area
    sides = circle_sides(float(np.max(profile[:, 0])), spacing)
    angles = 2.0 * np.pi / sides * np.arange(sides + 1)
    c, s = np.cos(angles) * stretch(sides), np.sin(angles) * stretch(sides)
    c[-1], s[-1] = c[0], s[0]
    pieces = _ordered_pieces(segments, spacing)
    r, z = pieces[:, :, 0], pieces[:, :, 1]

    def ring(end: int, shift: int) -> NDArray[np.float64]:
        """Corners (segments, sides, 3) of one end of the segments."""
        turn = slice(shift, sides + shift)
        height = np.broadcast_to(z[:, end, None], (len(r), sides))
        return np.stack([r[:, end, None] * c[turn], r[:, end, None] * s[turn], height], axis=2)

    a, b, a_next, b_next = ring(0, 0), ring(1, 0), ring(0, 1), ring(1, 1)
    triangles = np.concatenate([np.stack([a, a_next, b_next], axis=2), np.stack([a, b_next, b], axis=2)])
    triangles = triangles.reshape(-1, 3, 3)
    kept = np.linalg.norm(facet_vectors(triangles), axis=1) > 0.0
    return triangles[kept]


def _ordered_pieces(segments: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Segments (n, 2, 2) cut into equal pieces no longer than `spacing`."""
    pieces = []
    for start, end in segments:
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / spacing)))
        knots = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
        knots[-1] = end
        pieces.append(np.stack([knots[:-1], knots[1:]], axis=1))
    return np.concatenate(pieces)


def _icosahedron() -> NDArray[np.float64]:
    """Faces (20, 3, 3), outward: the triples of vertices at the shortest distance from each other."""
    g = 0.5 * (1.0 + np.sqrt(5.0))
    vertices = []
    for a in (-1.0, 1.0):
        for b in (-g, g):
            vertices += [[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]
    points = np.array(vertices)
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                corners = points[[i, j, k]]
                sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
                if np.all(np.abs(sides - 2.0) < 1e-9):
                    outward = np.linalg.det(corners) > 0.0
                    faces.append(corners if outward else corners[::-1])
    return np.array(faces)


def _cut_triangles(facets: NDArray[np.float64], frequency: int) -> NDArray[np.float64]:
    """Each triangle cut into frequency^2 similar ones."""
    n = frequency
    corners = []
    for i in range(n):
        for j in range(n - i):
            corners.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < n - 1:
                corners.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    ij = np.array(corners, dtype=np.float64) / n
    weights = np.concatenate([1.0 - np.sum(ij, axis=2, keepdims=True), ij], axis=2)
    return np.einsum("tvw,fwx->ftvx", weights, facets).reshape(-1, 3, 3)
