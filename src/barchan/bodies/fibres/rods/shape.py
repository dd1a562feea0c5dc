"""Configuration and velocities of discrete elastic rods at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError

Vector = NDArray[np.float64]
FIELDS = ("nodes", "directors", "curvatures", "twists", "motion", "velocities")


@dataclass(frozen=True, eq=False)
class RodShape:
    """Fibres with p nodes, q edges and k inner nodes in all.

    time : [s].
    nodes : (p, 3) [m].  directors : (q, 3) first material direction of each edge, a unit vector normal to it.
    curvatures : (k, 2) integrated material curvatures, 2 tan(half the turning angle).
    twists : (k,) integrated twist [rad], without jumps in time.
    motion : (4 p - f,) velocities of all displacements [m/s]: of node 0, edge 0, node 1, ... of each fibre; an edge's is its
        spin times the radius of the fibre.
    velocities : (m,) those of them that are not given by roots or tips.
    """

    time: float
    nodes: Vector
    directors: Vector
    curvatures: Vector
    twists: Vector
    motion: Vector
    velocities: Vector

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array, for checkpoints."""
        return {"time": np.array([self.time]), **{name: getattr(self, name) for name in FIELDS}}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> RodShape:
        """Shape from the arrays of `arrays()`; InputError names a missing field."""
        read = {}
        for name in ("time", *FIELDS):
            if name not in arrays:
                raise InputError(f"fibres.{name}", "missing", "given")
            read[name] = np.ascontiguousarray(arrays[name], dtype=np.float64)
        return cls(float(read["time"][0]), *(read[name] for name in FIELDS))
