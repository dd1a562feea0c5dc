"""State of a simulation of soft spheres: immutable, and all that the next step needs to go on with the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import BodyStates
from barchan.bodies.soft.cell import CellState
from barchan.errors import InputError

Vector = NDArray[np.float64]
_CELL = ("height", "height_rate", "offset", "stress")


@dataclass(frozen=True, eq=False)
class SoftState:
    """n grains and w walls.

    bodies : places, rotations, velocities and spins (n rows).
    time : [s]. cell : of the periodic cell.
    accelerations (n, 6) : of the last step, linear and angular.
    pairs (k, 2), memory (k, 7) : contacts in touch, first < second, and their springs.
    wall_memory (n, w, 7) : the same of the walls.
    dissipated : energy lost in contacts since the start [J].
    """

    bodies: BodyStates
    time: float
    cell: CellState
    accelerations: Vector
    pairs: NDArray[np.int64]
    memory: Vector
    wall_memory: Vector
    dissipated: float

    def __len__(self) -> int:
        return len(self.bodies)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        own = {
            name: np.asarray(getattr(self, name))
            for name in ("accelerations", "pairs", "memory", "wall_memory")
        }
        cell = np.array([getattr(self.cell, name) for name in _CELL])
        scalars = {"time": np.array([self.time]), "dissipated": np.array([self.dissipated]), "cell": cell}
        return {**self.bodies.arrays(), **own, **scalars}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> SoftState:
        """State from the arrays of `arrays()`; InputError names a missing field."""
        read: dict[str, Vector] = {}
        for name in ("time", "dissipated", "cell", "accelerations", "memory", "wall_memory", "pairs"):
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")
            read[name] = np.ascontiguousarray(arrays[name], dtype=np.float64)
        cell = CellState(**dict(zip(_CELL, read["cell"].tolist(), strict=True)))
        bodies = BodyStates.from_arrays(arrays)
        rest = (read["pairs"].astype(np.int64), read["memory"], read["wall_memory"])
        return cls(
            bodies, float(read["time"][0]), cell, read["accelerations"], *rest, float(read["dissipated"][0])
        )
