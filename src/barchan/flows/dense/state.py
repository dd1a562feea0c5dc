"""State of a dense flow: what a step starts from and what a solve returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from barchan.errors import InputError
from barchan.friction import Certificate


def _unproven() -> Certificate:
    return Certificate(np.inf, np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class DenseState:
    """Velocities and stresses of a dense flow at one time.

    time : of the state; 0 for steady flows.
    velocity : (size,) unknowns of the space, prescribed ones included.
    forces : (blocks, s) stresses lambda at the points of the law in cone coordinates (compression positive), then tractions
        of frictional walls (normal; tangents).
    reactions : (size,) forces by which the boundary holds prescribed velocities, zero elsewhere up to the residual.
    certificate : of the last solve.  iterations : its iterations, summed over a fixed point.
    converged : whether the certificate, and the fixed point if there is one, meet their tolerances.
    sweeps : solves of the fixed point on friction or viscosity; 1 without one.
    """

    time: float
    velocity: np.ndarray
    forces: np.ndarray
    reactions: np.ndarray
    certificate: Certificate = field(default_factory=_unproven)
    iterations: int = 0
    converged: bool = True
    sweeps: int = 0

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything as arrays by name, for a checkpoint; `from_arrays` restores the same bytes."""
        proof = self.certificate
        return {
            "time": np.array(self.time),
            "velocity": self.velocity,
            "forces": self.forces,
            "reactions": self.reactions,
            "certificate": np.array([proof.law, proof.balance, proof.bilateral]),
            "counts": np.array([self.iterations, int(self.converged), self.sweeps], dtype=np.int64),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> DenseState:
        """The state whose `arrays()` these are; InputError when one is missing."""
        try:
            iterations, converged, sweeps = (int(value) for value in arrays["counts"])
            return cls(
                float(arrays["time"]),
                np.array(arrays["velocity"], dtype=float),
                np.array(arrays["forces"], dtype=float),
                np.array(arrays["reactions"], dtype=float),
                Certificate(*(float(value) for value in arrays["certificate"])),
                iterations,
                bool(converged),
                sweeps,
            )
        except KeyError as missing:
            raise InputError("state", ", ".join(arrays), f"arrays with {missing.args[0]}") from None
