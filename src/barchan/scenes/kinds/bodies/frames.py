"""What a frame stores of bodies and contacts: places, turns, shapes in a few numbers, forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import Body, BodyStates, Box, Capsule, HalfSpace, Sphere
from barchan.scenes.model import Arrays

Vector = NDArray[np.float64]

SHAPE_KINDS = {Sphere: 0, Box: 1, Capsule: 2, HalfSpace: 3}
OTHER_SHAPE = 4


def particle_frame(bodies: Sequence[Body], states: BodyStates) -> Arrays:
    """Group "particles": a row for every body, in their order.

    positions, velocities (k, d), rotations (k, 4) or (k, 1), spins (k, 3) or (k, 1), volumes (k,), 0 for driven ones.
    shape_kinds (k,) : 0 sphere, 1 box, 2 capsule, 3 half space, 4 other. shape_sizes (k, 3) [m] : radius; half lengths; radius
    and half length; nothing.
    """
    return {
        "positions": states.positions,
        "velocities": states.velocities,
        "rotations": states.rotations,
        "spins": states.spins,
        "volumes": np.array([0.0 if body.driven else body.volume for body in bodies]),
        "shape_kinds": np.array([SHAPE_KINDS.get(type(body.shape), OTHER_SHAPE) for body in bodies]),
        "shape_sizes": np.array([_sizes(body) for body in bodies]),
    }


def contact_frame(points: Vector, normals: Vector, forces: Vector, pairs: NDArray[np.int32]) -> Arrays:
    """Group "contacts": positions (k, d), normals and forces (k, d) [N] on the first body, pairs (k, 2), -1 for a soft wall."""
    return {"positions": points, "normals": normals, "forces": forces, "pairs": pairs}


def _sizes(body: Body) -> list[float]:
    shape = body.shape
    if isinstance(shape, Sphere):
        return [shape.radius, 0.0, 0.0]
    if isinstance(shape, Box):
        return [*shape.half_extents.tolist(), 0.0][:3]
    if isinstance(shape, Capsule):
        return [shape.radius, shape.half_length, 0.0]
    return [0.0, 0.0, 0.0]
