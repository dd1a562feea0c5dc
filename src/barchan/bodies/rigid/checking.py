"""Bodies that a simulation can start from: apart from each other and inside the box."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid.body import Body
from barchan.bodies.rigid.combined import turned_box
from barchan.bodies.rigid.dynamics import centre_of
from barchan.bodies.rigid.motions import Fixed
from barchan.bodies.rigid.placement import body_distance, body_surface
from barchan.bodies.rigid.rotations import matrix
from barchan.bodies.rigid.states import BodyState, BodyStates
from barchan.bodies.rigid.surfaces import Surface
from barchan.errors import InputError

FACETS_ACROSS = 32  # a body, when its boundary is searched for points inside another
TOLERATED_SHARE = (
    2e-3  # of the smaller body, by which two may overlap: touching bodies do, with curved facets
)


def check_bodies(
    bodies: Sequence[Body],
    lower: ArrayLike,
    upper: ArrayLike,
    states: BodyStates | None = None,
    tolerance: float | None = None,
) -> None:
    """Refuse bodies that overlap, or that are not in the box `lower` .. `upper` (d,): InputError names them.

    A fixed body may stick out of the box, but not be outside altogether; any other has its centre inside. Two bodies
    overlap when one has a boundary point deeper than `tolerance` [m] in the other (default: 0.2 % of the smaller one).
    """
    low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
    d = len(low)
    for body in bodies:
        if body.dimension != d:
            raise InputError(f"body {_name(body, bodies)}", body.dimension, f"of dimension {d}, like the box")
    if not bodies:
        return
    rows = BodyStates.at_start(bodies, d) if states is None else states
    if len(rows) != len(bodies):
        raise InputError("states", len(rows), f"those of the {len(bodies)} bodies")
    placed = [rows.row(number) for number in range(len(bodies))]
    boxes = [_world_box(body, state) for body, state in zip(bodies, placed, strict=True)]
    sizes = [_extent(box, low, high) for box in boxes]
    surfaces = []
    for body, state, size in zip(bodies, placed, sizes, strict=True):
        surface = _searched_surface(body, state, size, low, high)
        _check_inside(body, state, surface, low, high, _name(body, bodies))
        surfaces.append(surface)
    for i, j in itertools.combinations(range(len(bodies)), 2):
        if np.any(boxes[i][0] > boxes[j][1]) or np.any(boxes[j][0] > boxes[i][1]):
            continue
        allowed = TOLERATED_SHARE * min(sizes[i], sizes[j]) if tolerance is None else tolerance
        depth = max(
            _depth(bodies[i], placed[i], surfaces[j], allowed),
            _depth(bodies[j], placed[j], surfaces[i], allowed),
        )
        if depth > allowed:
            names = f"{_name(bodies[i], bodies)} and {_name(bodies[j], bodies)}"
            raise InputError("bodies", f"{names}, {depth:.3g} m one in the other", "apart")


def _check_inside(
    body: Body,
    state: BodyState,
    surface: Surface,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    name: str,
) -> None:
    box = f"from {lower.tolist()} to {upper.tolist()}"
    # a body meets the box where its boundary does
    if not np.any(np.all((surface.points >= lower) & (surface.points <= upper), axis=1)):
        middle = 0.5 * (lower + upper)
        if body_distance(body, state, middle[None])[0] < 0.0:
            raise InputError(f"body {name}", "fills the box", f"smaller than the box {box}")
        raise InputError(f"body {name}", f"at {state.position.tolist()}, outside", f"in the box {box}")
    centre = centre_of(body, state)
    if not isinstance(body.motion, Fixed) and not (np.all(centre >= lower) and np.all(centre <= upper)):
        raise InputError(
            f"body {name}", f"at {state.position.tolist()}", f"one with its centre in the box {box}"
        )


def _searched_surface(
    body: Body, state: BodyState, size: float, lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> Surface:
    """The boundary, with its nearest surroundings of the box where it has no end."""
    if body.shape.bounded:
        return body_surface(body, state, size / FACETS_ACROSS)
    return body_surface(body, state, size / FACETS_ACROSS, lower, upper)


def _depth(body: Body, state: BodyState, surface: Surface, allowed: float) -> float:
    """How deep points of another boundary lie in a body, or points just inside it: two may coincide."""
    if not len(surface):
        return 0.0
    points = np.concatenate([surface.points, surface.points - 1.5 * allowed * surface.normals])
    return -float(np.min(body_distance(body, state, points)))


def _world_box(body: Body, state: BodyState) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return turned_box(*body.shape.bounds(), matrix(state.rotation), state.position)


def _extent(
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> float:
    """Longest side of a body, or of the part of the simulation's box about an unbounded one."""
    if not np.all(np.isfinite(box[0])) or not np.all(np.isfinite(box[1])):
        box = lower, upper
    return float(np.max(box[1] - box[0]))


def _name(body: Body, bodies: Sequence[Body]) -> str:
    return body.name or f"number {next(n for n, other in enumerate(bodies) if other is body)}"
