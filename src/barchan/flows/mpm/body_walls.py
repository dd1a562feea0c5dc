"""Free rigid bodies against the faces of the box: contacts that hold them inside (seed B, 2.1 and 7.4.1).

A body touches a face with its outermost boundary points, at most one for each of eight directions along the face (two in the
plane). Their velocities into the face obey Signorini's condition with the gap that is left, gap + dt u_N >= 0, and Coulomb's
law with the body's own coefficient.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, BodyState, contact_columns, generalised_masses
from barchan.flows.mpm.contacts import Contacts
from barchan.flows.mpm.walls import Walls
from barchan.linalg.frames import contact_frames
from barchan.spaces import RegularGrid

Vector = NDArray[np.float64]

# Points within this share of a cell of the outermost one may touch as well: flat faces stand on their corners.
LEVEL = 0.05
SLOTS = 8
# Names of these contacts lie below those of bodies with matter.
FIRST_NAME = -(2**62)


def contacts_with_walls(
    grid: RegularGrid,
    walls: Walls,
    body: Body,
    state: BodyState,
    points: Vector,
    number: int,
    place: int,
    dt: float,
) -> list[Contacts]:
    """Contacts of a free body, `number` of all and `place` of the free ones, whose boundary points are `points` (m, d) [m].

    A face is left out where the body cannot reach it within two steps at its present speed, and where it is open.
    """
    d = grid.dimension
    found = []
    for face, wall in enumerate(walls.on(d)):
        if wall.kind == "open":
            continue
        axis, upper = divmod(face, 2)
        gaps = grid.upper[axis] - points[:, axis] if upper else points[:, axis] - grid.origin[axis]
        nearest = float(np.min(gaps))
        reach = 2.0 * dt * float(np.linalg.norm(state.velocity)) + float(grid.spacing[axis])
        if nearest > reach:
            continue
        level = np.flatnonzero(gaps <= nearest + LEVEL * grid.spacing[axis])
        chosen = _outermost(np.delete(points[level], axis, axis=1))
        normal = np.zeros(d)
        normal[axis] = -1.0 if upper else 1.0
        room = np.maximum(gaps[level[chosen]], 0.0) / dt  # a body that starts half outside is not thrown in
        names = FIRST_NAME + (number * 2 * d + face) * SLOTS + np.arange(len(chosen))
        found.append(_contacts(grid, body, state, points[level[chosen]], room, normal, names, place))
    return found


def _contacts(
    grid: RegularGrid, body: Body, state: BodyState, points: Vector, speeds: Vector, normal: Vector,
    names: NDArray[np.int64], place: int,
) -> Contacts:  # fmt: skip
    """Contacts at `points` (k, d) that may close at the `speeds` (k,) [m/s]; each stands for a face of a cell."""
    count, d = points.shape
    area = float(np.prod(grid.spacing)) ** ((d - 1.0) / d)
    held = np.isinf(generalised_masses(body, state))
    columns = np.where(held[None, :, None, :], 0.0, contact_columns(body, state, points))
    return Contacts(
        names, np.full(count, area), contact_frames(np.broadcast_to(normal, (count, d)).copy()),
        np.full(count, float(body.friction)), np.zeros(count + 1, dtype=np.int32), np.zeros(0, dtype=np.int32),
        np.zeros(0), np.full(count, place), -area * columns, -area * speeds[:, None] * normal,
    )  # fmt: skip


def _outermost(places: Vector) -> NDArray[np.int64]:
    """Numbers of the points (m, d - 1) that lie farthest along each of the directions (+-1, 0, ..) and (+-1, +-1)."""
    directions = np.array([s for s in product((-1.0, 0.0, 1.0), repeat=places.shape[1]) if any(s)])
    return np.unique(np.argmax(places @ directions.T, axis=0))
