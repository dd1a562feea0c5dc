"""How far from each body contacts are looked for, and which contacts of a step were not looked for but should have been.

A gap within a step closes at speeds that are known only once it is solved: a body may be stopped by one hit from behind, or be
hit itself. Contacts are looked for as far as bodies could go at the speeds they have; bodies that the step makes faster are
looked at again, and the step is solved again with what they would meet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.contact import ContactGeometry, ContactSet
from barchan.bodies.contact.arrays import BALL
from barchan.bodies.rigid import BodyStates

Vector = NDArray[np.float64]
NEGLIGIBLE = 1e-3  # overlap that a contact which was not looked for may make, over the least half length of both bodies


@dataclass(frozen=True, eq=False)
class Sizes:
    """Lengths (b,) [m] of bodies: how far from the centre of mass turning moves their boundary; their least half extent."""

    arms: Vector
    least: Vector

    @classmethod
    def of(cls, geometry: ContactGeometry) -> Sizes:
        """Those of the bodies of a geometry; unbounded bodies have arms of zero and an infinite least extent."""
        lower, upper = geometry.boxes
        d, body = geometry.dimension, geometry.body
        centres = geometry.centres[body]
        with np.errstate(invalid="ignore"):
            corner = np.maximum(np.abs(lower - centres), np.abs(upper - centres))[:, :d]
            middle = np.linalg.norm((0.5 * (lower + upper) - centres)[:, :d], axis=1)
        arm = np.where(geometry.kind == BALL, middle, np.linalg.norm(corner, axis=1))
        arms, least = np.zeros(len(geometry.bodies)), np.full(len(geometry.bodies), np.inf)
        np.maximum.at(arms, body, np.where(np.isfinite(arm), arm, 0.0))
        np.minimum.at(least, body, 0.5 * np.min((upper - lower)[:, :d], axis=1))
        return cls(arms, least)

    def speeds(self, velocities: Vector, spins: Vector) -> Vector:
        """(b,) bounds [m/s] of the speed of any point of the bodies' boundaries but for round ones' turning."""
        return np.asarray(np.linalg.norm(velocities, axis=1) + self.arms * np.linalg.norm(spins, axis=1))


def missed(
    geometry: ContactGeometry, sizes: Sizes, states: BodyStates, known: ContactSet, middle: tuple[Vector, Vector], dt: float,
) -> bool:  # fmt: skip
    """Whether bodies moving with `middle` velocities and spins (b, ...) overlap after the step where no contact is known.

    Overlaps up to NEGLIGIBLE of the smaller body are left to the next step.
    """
    moving = replace(states, velocities=middle[0], spins=middle[1])
    found = geometry.detect(moving, 0.0, dt)
    new = found.take(~np.isin(found.keys, known.keys, assume_unique=True))
    if len(new) == 0:
        return False
    closing = geometry.closing_speeds(moving, geometry.placed(moving), new)
    allowed = NEGLIGIBLE * np.minimum(sizes.least[new.first], sizes.least[new.second])
    return bool(np.any(new.gaps - dt * closing < -allowed))
