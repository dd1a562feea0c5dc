"""Contacts of the vertices of a cloth with driven bodies: signed distances, at most one contact a vertex (seed B, 4.3.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.cloth.contacts import ClothContacts, mixed_friction
from barchan.bodies.cloth.pins import displacement
from barchan.bodies.rigid import Body, BodyState, BodyStates, body_distance, body_normals, moved, to_body

Vector = NDArray[np.float64]


def advanced(bodies: Sequence[Body], states: BodyStates, dt: float, time: float) -> BodyStates:
    """Driven bodies at the end of a step."""
    nothing = np.zeros((2, 3))
    return BodyStates.of(
        [moved(body, states.row(k), nothing, dt, time) for k, body in enumerate(bodies)], states.dimension
    )


class Obstacles:
    """Driven bodies that a cloth of a friction coefficient meets; `clearance` [m] is kept between vertices and surfaces."""

    def __init__(self, bodies: Sequence[Body], friction: float, mixing: str, clearance: float) -> None:
        self._bodies, self._clearance = tuple(bodies), clearance
        self._friction = np.array([mixed_friction(friction, body.friction, mixing) for body in bodies])

    def contacts(
        self, positions: Vector, reach: Vector, before: BodyStates, after: BodyStates, dt: float, loose: NDArray[np.bool_]
    ) -> ClothContacts:  # fmt: skip
        """Contacts of the vertices `loose` (n,) whose gap is at most `reach` (n,) [m], or closes because the body moves.

        Of several bodies a vertex meets the nearest.  before, after : the bodies at the start and the end of the step.
        """
        n = len(positions)
        best, owner = np.full(n, np.inf), np.full(n, -1, dtype=np.int64)
        normals, drift = np.zeros((n, 3)), np.zeros((n, 3))
        for number, body in enumerate(self._bodies):
            one, two = before.row(number), after.row(number)
            near = self._near(body, one, two, positions, reach, loose)
            if len(near) == 0:
                continue
            gap = body_distance(body, one, positions[near]) - self._clearance
            moves = displacement(one, two, positions[near])
            kept = gap <= reach[near] + np.linalg.norm(moves, axis=1)
            kept &= gap < best[near]
            near, gap, moves = near[kept], gap[kept], moves[kept]
            best[near], owner[near] = gap, number
            drift[near] = moves / dt
            normals[near] = body_normals(body, one, positions[near])
        vertices = np.flatnonzero(owner >= 0)
        corners, weights = np.full((len(vertices), 4), -1, dtype=np.int64), np.zeros((len(vertices), 4))
        corners[:, 0], weights[:, 0] = vertices, 1.0
        normal, gaps = normals[vertices], best[vertices]
        return ClothContacts(
            -1 - vertices.astype(np.int64), owner[vertices], corners, weights,
            positions[vertices] - (gaps + self._clearance)[:, None] * normal, normal, gaps, drift[vertices],
            self._friction[owner[vertices]] if len(self._bodies) else np.zeros(0),
        )  # fmt: skip

    def _near(
        self, body: Body, one: BodyState, two: BodyState, positions: Vector, reach: Vector, loose: NDArray[np.bool_]
    ) -> NDArray[np.int64]:  # fmt: skip
        """Numbers of the vertices whose distance is worth computing: those inside the widened bounds of the body."""
        low, high = body.shape.bounds()
        local = to_body(one, positions)
        sweep = np.linalg.norm(displacement(one, two, positions), axis=1)
        wide = (reach + self._clearance + sweep)[:, None]
        inside = np.all((local >= low - wide) & (local <= high + wide), axis=1)
        return np.flatnonzero(inside & loose)
