"""State of bodies in contact, complete and immutable, and the record of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames


@dataclass(frozen=True, eq=False)
class AssemblyState:
    """Bodies at the end of a step, with the impulses of its contacts.

    time, step : [s] and number of steps made.  bodies : `BodyStates`.
    contact_keys : (k,) int64 names of the contacts.  forces : (k, d) mean forces [N] (normal; tangents) on the first body.
    pairs : (k, 2) int32 the bodies.  points, normals : (k, d), from the second body to the first.  gaps : (k,) [m].
    """

    time: float
    step: int
    bodies: BodyStates
    contact_keys: NDArray[np.int64]
    pairs: NDArray[np.int32]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    gaps: NDArray[np.float64]
    forces: NDArray[np.float64]

    @classmethod
    def at_start(cls, bodies: BodyStates) -> AssemblyState:
        """At time 0, without contacts known."""
        d = bodies.dimension
        none = np.zeros((0, d))
        return cls(
            0.0, 0, bodies, np.zeros(0, np.int64), np.zeros((0, 2), np.int32), none, none, np.zeros(0), none
        )

    def world_forces(self) -> NDArray[np.float64]:
        """(k, d) forces [N] on the first body of each contact, world frame."""
        return np.asarray(np.einsum("kij,ki->kj", contact_frames(self.normals), self.forces))

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array: all that `from_arrays` needs, for checkpoints."""
        own = {name: np.asarray(getattr(self, name)) for name in FIELDS}
        return {**own, **{f"bodies_{name}": array for name, array in self.bodies.arrays().items()}}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> AssemblyState:
        """State from the arrays of `arrays()`; InputError names a missing field."""
        for name in FIELDS:
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")
        own = {
            name.removeprefix("bodies_"): value
            for name, value in arrays.items()
            if name.startswith("bodies_")
        }
        given = {name: np.asarray(arrays[name]) for name in FIELDS}
        return cls(
            float(given.pop("time")), int(given.pop("step")), BodyStates.from_arrays(own),
            **{name: np.ascontiguousarray(value) for name, value in given.items()},
        )  # fmt: skip


FIELDS = ("time", "step", "contact_keys", "pairs", "points", "normals", "gaps", "forces")


@dataclass(frozen=True)
class AssemblyRecord:
    """What happened in one step.

    contacts, candidates : contacts that carry force, and those looked at.  sweeps : iterations of the friction solver.
    residual : the certificate, the largest of `law_residual`, `balance_residual`, `bilateral_residual`.
    kinetic_energy, potential_energy : at the end of the step [J].  max_speed : of a centre [m/s].
    deepest : the largest overlap when the step began [m].  joint_error : largest violation of a joint [m or rad].
    detection_seconds, solve_seconds : wall-clock times; records of equal steps are equal whatever they took.
    """

    step: int
    time: float
    dt: float
    candidates: int
    contacts: int
    sweeps: int
    residual: float
    law_residual: float
    balance_residual: float
    bilateral_residual: float
    converged: bool
    kinetic_energy: float
    potential_energy: float
    max_speed: float
    deepest: float
    joint_error: float
    detection_seconds: float = field(compare=False)
    solve_seconds: float = field(compare=False)
