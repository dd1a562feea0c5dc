"""A body where its state puts it: distances, normals and boundary quadrature in the world frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs, rotations
from barchan.bodies.rigid.body import Body
from barchan.bodies.rigid.combined import Moved
from barchan.bodies.rigid.states import BodyState
from barchan.bodies.rigid.surfaces import Surface


def to_body(state: BodyState, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """World points (n, d) in the frame of the body's shape."""
    d = len(state.position)
    local: NDArray[np.float64] = (inputs.points(points, d) - state.position) @ rotations.matrix(
        state.rotation
    )
    return local


def to_world(state: BodyState, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, d) of the body's frame in the world."""
    d = len(state.position)
    placed: NDArray[np.float64] = (
        inputs.points(points, d) @ rotations.matrix(state.rotation).T + state.position
    )
    return placed


def body_distance(body: Body, state: BodyState, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed distance (n,) [m] of world points (n, d), negative inside the body."""
    return body.shape.signed_distance(to_body(state, points))


def body_normals(body: Body, state: BodyState, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit outward normals (n, d) at world points (n, d), in the world frame."""
    normals: NDArray[np.float64] = (
        body.shape.normals(to_body(state, points)) @ rotations.matrix(state.rotation).T
    )
    return normals


def body_surface(
    body: Body,
    state: BodyState,
    spacing: float,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> Surface:
    """Quadrature of the boundary in the world frame, cut off at the world box `lower` .. `upper`; see `Shape.surface`."""
    return Moved(body.shape, state.position, state.rotation).surface(spacing, lower, upper)
