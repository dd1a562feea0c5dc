"""The state of a cloth among bodies, complete and immutable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError

Vector = NDArray[np.float64]

SPECK = 1e-9  # of the largest force of all contacts, below which one carries none


@dataclass(frozen=True, eq=False)
class ClothState:
    """A cloth at the end of a step, with the contacts of that step.

    time, step : [s] and number of steps made.  positions, velocities : (n, 3) of the vertices [m], [m/s].  bodies : obstacles.
    contact_keys : (k,) lasting names.  contact_bodies : (k,) number of the obstacle, -1 for the cloth itself.
    points, normals : (k, 3), normals towards the cloth (its first side).  gaps : (k,) [m] at the start of the step.
    forces : (k, 3) mean forces [N] on the cloth (its first side) over the step, world axes.
    side_keys, sides : (j,) pairs of close parts of the cloth and on which side of the second the first lies, 1 or -1.
    """

    time: float
    step: int
    positions: Vector
    velocities: Vector
    bodies: BodyStates
    contact_keys: NDArray[np.int64]
    contact_bodies: NDArray[np.int64]
    points: Vector
    normals: Vector
    gaps: Vector
    forces: Vector
    side_keys: NDArray[np.int64]
    sides: NDArray[np.int64]

    @classmethod
    def at_start(cls, positions: Vector, velocities: Vector, bodies: BodyStates) -> ClothState:
        """At time 0, without contacts known."""
        none, whole = np.zeros((0, 3)), np.zeros(0, np.int64)
        return cls(
            0.0, 0, positions, velocities, bodies, whole, whole, none, none, np.zeros(0), none, whole, whole
        )

    @property
    def pressing(self) -> NDArray[np.bool_]:
        """(k,) contacts that carry force; interior points leave specks of force in open ones."""
        sizes = np.linalg.norm(self.forces, axis=1)
        return np.asarray(sizes > SPECK * np.max(sizes, initial=0.0))

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        own = {name: np.asarray(getattr(self, name)) for name in FIELDS}
        return {**own, **{f"bodies_{name}": array for name, array in self.bodies.arrays().items()}}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> ClothState:
        """State from the arrays of `arrays()`; InputError names a missing field."""
        for name in FIELDS:
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")
        bodies = {
            name.removeprefix("bodies_"): array
            for name, array in arrays.items()
            if name.startswith("bodies_")
        }
        given = {name: np.asarray(arrays[name]) for name in FIELDS}
        return cls(
            time=float(given.pop("time")), step=int(given.pop("step")), bodies=BodyStates.from_arrays(bodies),
            **{name: np.ascontiguousarray(value) for name, value in given.items()},
        )  # fmt: skip


FIELDS = (
    "time", "step", "positions", "velocities", "contact_keys", "contact_bodies", "points", "normals", "gaps", "forces",
    "side_keys", "sides",
)  # fmt: skip
