"""Contacts of a cloth with itself: vertices with triangles, edges with edges, sides kept from step to step (seed B, 4.3.3).

A pair that came close on one side stays on it: when it is found through the surface in the next step, its gap is negative and
it is pushed back. That holds as long as it is through by less than the thickness; detection reaches as far as a step goes.
Parts of the cloth that are within two thicknesses of each other at rest do not touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.cloth._broad import close_triangles
from barchan.bodies.cloth._self_kernels import Found, Limits, Memory, Motion, Surface, collect
from barchan.bodies.cloth.contacts import ClothContacts
from barchan.bodies.cloth.mesh import ClothMesh

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


class SelfContact:
    """Finds where a cloth comes within `thickness` [m] of itself; `friction` of its surface."""

    def __init__(self, mesh: ClothMesh, thickness: float, friction: float) -> None:
        self._thickness, self._friction = thickness, friction
        hinges, triangles = mesh.hinges, mesh.triangles
        vertex_owner = np.full(len(mesh.vertices), -1, dtype=np.int64)
        vertex_owner[triangles[::-1].ravel()] = np.repeat(np.arange(len(triangles))[::-1], 3)
        edge_owner = np.ascontiguousarray(hinges.beside[:, 0])
        self._surface = Surface(
            triangles, hinges.edges, hinges.triangle_edges, vertex_owner, edge_owner, mesh.vertices
        )

    def contacts(
        self, positions: Vector, velocities: Vector, dt: float, margin: float, keys: Whole, sides: Whole
    ) -> tuple[ClothContacts, Whole, Whole]:
        """Contacts within the thickness, the margin [m] and what closes in a step of `dt`; keys and sides to remember.

        keys, sides : those of the step before.
        """
        apart = velocities - np.mean(velocities, axis=0)
        fastest = float(np.max(np.linalg.norm(apart, axis=1)))
        slack = self._thickness + margin
        wide = self._thickness + slack + 2.0 * dt * fastest
        pairs = close_triangles(positions, self._surface.triangles, wide)
        motion = Motion(*(np.ascontiguousarray(a) for a in (positions, velocities)))
        found = self._collected(motion, pairs, Memory(keys, sides), Limits(dt, self._thickness, slack, wide))
        order = np.argsort(found.keys)
        kept = _one_face_a_side(found, self._vertex_normals(positions))
        return self._arrays(found, positions, kept), found.keys[order], found.sides[order]

    def _collected(self, motion: Motion, pairs: Whole, memory: Memory, limits: Limits) -> Found:
        given = (motion, self._surface, pairs, memory, limits)
        found = _room(collect(*given, _room(0), False))
        collect(*given, found, True)
        return found

    def _vertex_normals(self, positions: Vector) -> Vector:
        """(n, 3) sums of the normals of the triangles around vertices, times areas."""
        triangles = self._surface.triangles
        corner = positions[triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        sums = [np.bincount(triangles.ravel(), np.repeat(normal[:, i], 3), len(positions)) for i in range(3)]
        return np.stack(sums, axis=1)

    def _arrays(self, found: Found, positions: Vector, kept: Whole) -> ClothContacts:
        vertices, weights = found.vertices[kept], found.weights[kept]
        # the point of the second side: what has a negative weight
        points = np.einsum("kj,kji->ki", -np.minimum(weights, 0.0), positions[vertices])
        k = len(kept)
        return ClothContacts(
            found.keys[kept], np.full(k, -1, dtype=np.int64), vertices, weights, points, found.normals[kept], found.gaps[kept],
            np.zeros((k, 3)), np.full(k, self._friction),
        )  # fmt: skip


def _room(count: int) -> Found:
    whole = np.empty(count, dtype=np.int64)
    return Found(
        whole, whole.copy(), np.empty((count, 4), dtype=np.int64), np.empty((count, 4)), np.empty((count, 3)), np.empty(count)
    )  # fmt: skip


def _one_face_a_side(found: Found, normals: Vector) -> Whole:
    """Numbers of the contacts kept: a vertex touches at most one triangle, the nearest, on each of its two sides."""
    of_face = found.keys % 2 == 0
    faces = np.flatnonzero(of_face)
    vertex = found.vertices[faces, 0]
    facing = np.einsum("ki,ki->k", found.normals[faces], normals[vertex]) >= 0.0
    group = 2 * vertex + facing
    order = np.lexsort((found.keys[faces], found.gaps[faces], group))
    first = np.ones(len(order), dtype=bool)
    first[1:] = group[order][1:] != group[order][:-1]
    return np.sort(np.concatenate([np.flatnonzero(~of_face), faces[order[first]]]))
