"""Rigid bodies as soft spheres: the same list of bodies serves both methods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from barchan.bodies.rigid import Body, BodyStates, Fixed, Free, HalfSpace, Sphere, inputs
from barchan.bodies.rigid.motions import held_components
from barchan.bodies.rigid.rotations import matrix
from barchan.bodies.soft.cell import Cell
from barchan.bodies.soft.laws import ContactLaw
from barchan.bodies.soft.model import SoftSpheres
from barchan.bodies.soft.state import SoftState
from barchan.bodies.soft.walls import Wall
from barchan.errors import InputError


def from_bodies(
    bodies: Sequence[Body],
    contact: ContactLaw,
    gravity: ArrayLike,
    cell: Cell | None = None,
    rolling_friction: float = 0.0,
) -> tuple[SoftSpheres, SoftState]:
    """Spheres and their first state, grains in the order of the spheres among `bodies`; fixed half spaces become walls.

    Spheres are free or fixed. InputError for other shapes, prescribed motions, held components and loads.
    """
    grains = [body for body in bodies if isinstance(body.shape, Sphere)]
    walls = []
    for body in bodies:
        if isinstance(body.shape, HalfSpace) and isinstance(body.motion, Fixed):
            normal = matrix(body.rotation) @ body.shape.normal
            offset = body.shape.offset + float(normal @ body.position)
            walls.append(Wall(normal, offset, body.friction))
        elif isinstance(body.shape, Sphere):
            _check(body)
        else:
            raise InputError(
                f"body.{body.name}.shape", type(body.shape).__name__, "Sphere, or a fixed HalfSpace"
            )
    held = [body.driven for body in grains]
    radii = [body.shape.radius for body in grains if isinstance(body.shape, Sphere)]
    densities = [1.0 if body.density is None else body.density for body in grains]
    friction = [body.friction for body in grains]
    spheres = SoftSpheres(
        radii, densities, contact, friction, walls, gravity, cell, rolling_friction, np.array(held)
    )
    return spheres, spheres.start(BodyStates.at_start(grains))


def _check(body: Body) -> None:
    field = f"body.{body.name}.motion"
    if not isinstance(body.motion, Free | Fixed):
        raise InputError(field, type(body.motion).__name__, "Free() or Fixed()")
    moves, spins = held_components(body.motion, body.dimension)
    loads = isinstance(body.motion, Free) and (
        body.motion.force is not None or body.motion.torque is not None
    )
    if np.any(moves) or np.any(spins) or loads or np.any(body.force) or np.any(body.torque):
        raise InputError(field, body.motion, "without held components and loads")
    inputs.not_negative(f"body.{body.name}.friction", body.friction)
