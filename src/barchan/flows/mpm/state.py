"""State of a material point simulation, complete and immutable, and the record of a time step (seed B, 7.3.5).

A state holds everything the next step depends on: writing `State.arrays()` and reading them back resumes bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError


@dataclass(frozen=True, eq=False)
class State:
    """Particles, and what the last step left on the grid, at the end of a step.

    time : [s].
    step : number of steps made.
    positions : (P, d) [m].
    velocities : (P, d) [m/s].
    affine : (P, d, d) velocity gradients c_p [1/s], row k being the gradient of component k (seed B, Eq. 7.19).
    volumes : (P,) [m^d]; constant in time.
    node_ids : (n,) int64 flat grid ids of the nodes active in the last step, increasing; empty before the first step.
    node_velocities : (n, d) [m/s] solution of the last step, at its nodes.
    node_stresses : (n, s) [Pa] contact stress lambda, chi coordinates, compression positive (s = 3 in 2D, 6 in 3D).
    node_volume_fractions : (n,) volume fractions at the stress nodes when the last step began.
    node_friction : (n,) physical friction coefficients the last step used.
    wall_keys : (k,) int64 `node id * 2 d + face`, faces ordered x_min, x_max, ..., z_max: contacts with frictional walls.
    wall_tractions : (k, d) [Pa] (normal, tangents), compression positive.
    """

    time: float
    step: int
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    affine: NDArray[np.float64]
    volumes: NDArray[np.float64]
    node_ids: NDArray[np.int64]
    node_velocities: NDArray[np.float64]
    node_stresses: NDArray[np.float64]
    node_volume_fractions: NDArray[np.float64]
    node_friction: NDArray[np.float64]
    wall_keys: NDArray[np.int64]
    wall_tractions: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check shapes and finiteness; InputError names the field."""
        if self.positions.ndim != 2 or self.positions.shape[1] not in (2, 3) or len(self.positions) == 0:
            raise InputError(
                "state.positions", self.positions.shape, "an array of shape (P, 2) or (P, 3) with P > 0"
            )
        for name, shape in self._shapes().items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise InputError(f"state.{name}", value.shape, f"an array of shape {shape}")
            if not np.all(np.isfinite(value)):
                raise InputError(f"state.{name}", "an array with NaN or infinite entries", "finite")
        if not np.all(self.volumes > 0.0):
            raise InputError("state.volumes", float(np.min(self.volumes)), "positive")
        if not np.isfinite(self.time) or self.step < 0:
            raise InputError(
                "state.time", (self.time, self.step), "a finite time after a number of steps >= 0"
            )

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        count, d = self.positions.shape
        nodes, contacts = np.size(self.node_ids), np.size(self.wall_keys)
        return {
            "positions": (count, d),
            "velocities": (count, d),
            "affine": (count, d, d),
            "volumes": (count,),
            "node_ids": (nodes,),
            "node_velocities": (nodes, d),
            "node_stresses": (nodes, d * (d + 1) // 2),
            "node_volume_fractions": (nodes,),
            "node_friction": (nodes,),
            "wall_keys": (contacts,),
            "wall_tractions": (contacts, d),
        }

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return int(self.positions.shape[1])

    @property
    def particle_count(self) -> int:
        """Number of particles P."""
        return len(self.positions)

    @classmethod
    def at_start(
        cls,
        positions: NDArray[np.float64],
        volumes: NDArray[np.float64],
        velocities: NDArray[np.float64] | None = None,
    ) -> State:
        """State at time 0 of particles at `positions` (P, d) with `volumes` (P,) and `velocities` (P, d) (default: rest)."""
        points = np.array(positions, dtype=np.float64, order="C")
        if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) == 0:
            raise InputError("positions", points.shape, "an array of shape (P, 2) or (P, 3) with P > 0")
        count, d = points.shape
        speeds = (
            np.zeros((count, d)) if velocities is None else np.array(velocities, dtype=np.float64, order="C")
        )
        none, ids = np.zeros(0), np.zeros(0, dtype=np.int64)
        return cls(
            0.0, 0, points, speeds, np.zeros((count, d, d)), np.array(volumes, dtype=np.float64), ids,
            np.zeros((0, d)), np.zeros((0, d * (d + 1) // 2)), none, none, ids, np.zeros((0, d)),
        )  # fmt: skip

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array (numbers as 0-d arrays): all that `from_arrays` needs, for checkpoints."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> State:
        """State from the arrays of `arrays()`; InputError names a missing field or one of the wrong shape."""
        values: dict[str, object] = {}
        for field in fields(cls):
            if field.name not in arrays:
                raise InputError(f"state.{field.name}", "missing", "given")
            value = np.asarray(arrays[field.name])
            if field.name in ("time", "step"):
                if value.shape != ():
                    raise InputError(f"state.{field.name}", value.shape, "a single number")
                values[field.name] = float(value) if field.name == "time" else int(value)
            else:
                integer = field.name in ("node_ids", "wall_keys")
                values[field.name] = np.ascontiguousarray(value, dtype=np.int64 if integer else np.float64)
        return cls(**values)  # type: ignore[arg-type]


@dataclass(frozen=True)
class StepRecord:
    """What happened in one time step.

    step, time : number of the step (from 1) and time at its end [s]; dt : its length [s].
    sweeps : iterations of the friction solver.
    residual, law_residual, balance_residual : parts of the certificate of the solution, `residual` being the largest.
    converged : whether the certificate met the tolerance.
    kinetic_energy : sum_i m_i |u_i|^2 / 2 over the grid at the end of the solve [J] (per metre of depth in the plane).
    potential_energy : sum_p m_p g z_p after the move, z_p the height above the floor of the box [J].
    max_speed : largest particle speed [m/s].
    max_volume_fraction : largest volume fraction at a stress node, when the step began.
    total_volume : sum of the particle volumes [m^d].
    active_nodes, blocks : nodes of occupied cells; blocks of the friction problem (with those of frictional walls).
    move_substeps : number of substeps of the particle move.
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
    max_volume_fraction: float
    total_volume: float
    active_nodes: int
    blocks: int
    move_substeps: int
