"""State of fibres in contact, complete and immutable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.contact import FibreContacts
from barchan.bodies.fibres.model import FibreModel, Shape
from barchan.bodies.fibres.obstacles import empty_contacts
from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FibreState(Generic[Shape]):
    """Fibres at the end of a step, and the contacts of that step.

    time, step : [s] and number of steps made.  shape : the fibres.  bodies : `BodyStates` of what they touch.
    contacts : `FibreContacts` (k).  friction : (k,) coefficients.  forces : (k, 3) mean forces [N] (normal; tangents) on the
    first fibre, in the frames of `barchan.linalg.frames.contact_frames`.
    """

    time: float
    step: int
    shape: Shape
    bodies: BodyStates
    contacts: FibreContacts
    friction: Vector
    forces: Vector

    @classmethod
    def at_start(cls, shape: Shape, bodies: BodyStates) -> FibreState[Shape]:
        """At the time of the shape, without contacts known."""
        return cls(shape.time, 0, shape, bodies, empty_contacts(), np.zeros(0), np.zeros((0, 3)))

    def world_forces(self) -> Vector:
        """(k, 3) forces [N] on the first fibre of each contact, world frame."""
        return np.asarray(np.einsum("kij,ki->kj", contact_frames(self.contacts.normals), self.forces))

    def sliding(self, tolerance: float = 1e-3) -> NDArray[np.bool_]:
        """(k,) contacts that carry force on the boundary of their cone, to a relative `tolerance`."""
        normal = self.forces[:, 0]
        tangential = np.linalg.norm(self.forces[:, 1:], axis=1)
        return np.asarray((normal > 0.0) & (tangential >= (1.0 - tolerance) * self.friction * normal))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every field as an array, for checkpoints."""
        found: dict[str, NDArray[Any]] = {
            "time": np.asarray(self.time), "step": np.asarray(self.step), "friction": self.friction, "forces": self.forces,
        }  # fmt: skip
        parts = {"shape": self.shape.arrays(), "bodies": self.bodies.arrays()}
        parts["contacts"] = {f.name: getattr(self.contacts, f.name) for f in fields(FibreContacts)}
        for part, own in parts.items():
            found |= {f"{part}_{name}": array for name, array in own.items()}
        return found

    @classmethod
    def from_arrays(cls, model: FibreModel[Shape], arrays: Mapping[str, NDArray[Any]]) -> FibreState[Shape]:
        """The state that `arrays()` wrote; InputError names a missing field."""
        needed = ["time", "step", "friction", "forces"]
        needed += [f"contacts_{f.name}" for f in fields(FibreContacts)]
        for name in needed:
            if name not in arrays:
                raise InputError(f"state.{name}", "missing", "given")

        def part(prefix: str) -> dict[str, NDArray[Any]]:
            chosen = {name: value for name, value in arrays.items() if name.startswith(prefix)}
            return {name.removeprefix(prefix): np.array(value, order="C") for name, value in chosen.items()}

        return cls(
            float(arrays["time"]), int(arrays["step"]), model.restored(part("shape_")),
            BodyStates.from_arrays(part("bodies_")),
            FibreContacts(**part("contacts_")), np.array(arrays["friction"]), np.array(arrays["forces"]),
        )  # fmt: skip
