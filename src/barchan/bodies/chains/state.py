"""State of a chain, complete and immutable, in the coordinates of its model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

FIELDS = ("time", "step", "coordinates", "velocities", "contact_keys", "points", "normals", "forces")


@dataclass(frozen=True, eq=False)
class ChainState:
    """A chain at the end of a step, with the forces of its contacts.

    time, step : [s] and number of steps made.  coordinates, velocities : (m,), see the model.
    contact_keys : (k,) int64 names of the contacts, joint times number of obstacles plus obstacle.
    points, normals : (k, 2), normals out of the obstacles.  forces : (k, 2) mean forces [N] (normal; tangent) on the chain.
    """

    time: float
    step: int
    coordinates: NDArray[np.float64]
    velocities: NDArray[np.float64]
    contact_keys: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    forces: NDArray[np.float64]

    @classmethod
    def at_start(cls, coordinates: NDArray[np.float64], velocities: NDArray[np.float64]) -> ChainState:
        """At time 0, without contacts known."""
        none = np.zeros((0, 2))
        return cls(0.0, 0, coordinates, velocities, np.zeros(0, np.int64), none, none, none)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        return {name: np.asarray(getattr(self, name)) for name in FIELDS}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ChainState:
        """State from the arrays of `arrays()`; InputError names a missing field."""
        for name in FIELDS:
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")
        given = {name: np.ascontiguousarray(arrays[name]) for name in FIELDS[2:]}
        return cls(float(arrays["time"]), int(arrays["step"]), **given)
