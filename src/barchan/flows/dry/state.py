"""State of the mesh-based model, and the record of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError


@dataclass(frozen=True, eq=False)
class StoredState:
    """What states of cells share: every field as an array for a checkpoint, and back."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything as arrays by name, for a checkpoint; `from_arrays` restores the same bytes."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The state whose `arrays()` these are; InputError when one is missing."""
        names = [field.name for field in fields(cls)]
        try:
            found: dict[str, Any] = {name: np.array(arrays[name]) for name in names}
        except KeyError as missing:
            raise InputError("state", ", ".join(arrays), f"arrays with {missing.args[0]}") from None
        return cls(**{
            **found, "time": float(found["time"]), "step": int(found["step"]), "left": float(found["left"])
        })  # fmt: skip


@dataclass(frozen=True, eq=False)
class DryState(StoredState):
    """Everything the next step depends on; c cells with k sides in d dimensions.

    time : [s].  step : steps taken.
    fractions : (c,) volume fractions in [0, phi_max].
    velocities : (c, d) at the end of the last step, zero in empty cells [m/s].
    carried : (c, d) velocities that the matter now in each cell brings into the next step: `velocities`, advected [m/s].
    stresses : (c, s) contact stresses lambda in cone coordinates, compression positive [Pa].
    tractions : (c, k, d) forces of walls on cells by area (normal; tangents), zero elsewhere [Pa].
    frictions : (c,) physical friction coefficients of the last step.
    left : volume of matter that has left through free boundaries [m^d].
    """

    time: float
    step: int
    fractions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    carried: NDArray[np.float64]
    stresses: NDArray[np.float64]
    tractions: NDArray[np.float64]
    frictions: NDArray[np.float64]
    left: float


@dataclass(frozen=True)
class DryRecord:
    """One step.

    step, time, dt : its number from 1, the time at its end, its length.
    sweeps : iterations of the friction solver.  residual, law_residual, balance_residual : its certificate.
    converged : whether the tolerance is met.
    kinetic_energy, potential_energy : of the matter at the end [J; by metre of depth in the plane].
    max_speed : greatest speed of cells at least a tenth full [m/s].
    min_volume_fraction, max_volume_fraction : over all cells, after the step.
    volume, left : matter inside, and gone through free boundaries since the start [m^d].
    excess : matter that transport put above phi_max and that was moved to the nearest room [m^d].
    active_cells, blocks : size of the friction problem.
    """

    step: int
    time: float
    dt: float
    sweeps: int
    residual: float
    law_residual: float
    balance_residual: float
    converged: bool
    kinetic_energy: float
    potential_energy: float
    max_speed: float
    min_volume_fraction: float
    max_volume_fraction: float
    volume: float
    left: float
    excess: float
    active_cells: int
    blocks: int
