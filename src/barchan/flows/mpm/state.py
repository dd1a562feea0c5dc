"""State of a material point simulation, complete and immutable, and the record of a time step (seed B, 7.3.5).

A state holds everything the next step depends on: writing `State.arrays()` and reading them back resumes bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.rigid import BodyStates
from barchan.errors import InputError

PARTICLE_OPTIONS = ("frames", "materials", "cohesions", "orientations", "particle_stresses")
INTEGERS: dict[str, type] = {
    "node_ids": np.int64, "contact_keys": np.int64, "stress_ids": np.int64, "grain_owners": np.int64, "materials": np.int32,
}  # fmt: skip


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
    node_stresses : (n, s) [Pa] contact stress lambda, chi coordinates, compression positive (s = 3 in 2D, 6 in 3D); of
        other than multilinear stresses, their means around the nodes.
    node_volume_fractions : (n,) volume fractions at the nodes when the last step began.
    node_friction : (n,) physical friction coefficients the last step used.
    contact_keys : (k,) int64 names of the contacts with frictional walls (`id * 2 d + face`, faces ordered x_min, x_max, ...,
        z_max) and bodies (negative).
    contact_tractions : (k, d) [Pa] on the matter (normal, tangents), compression positive.

    What only some simulations have, of length 0 in the others:

    frames : (P, d, d) F_p [m^2] of the ellipsoids that particles stand for (seed B, Eq. 7.20).
    materials : (P,) int32 number of each particle's material.
    cohesions : (P,) share of the cohesion that is left.
    orientations : (P, d, d) second moments of the grains' normals (seed B, 7.4.2).
    particle_stresses : (P, s) [Pa] stresses carried with the particles.
    stress_ids, stresses : (q,) int64 names and (q, s) [Pa] stresses of spaces other than the multilinear one.
    grain_positions, grain_owners : (G, d) [m] passive grains for pictures, and (G,) int64 whose particle each belongs to.
    bodies : positions, rotations and velocities of the rigid bodies.
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
    contact_keys: NDArray[np.int64]
    contact_tractions: NDArray[np.float64]
    frames: NDArray[np.float64]
    materials: NDArray[np.int32]
    cohesions: NDArray[np.float64]
    orientations: NDArray[np.float64]
    particle_stresses: NDArray[np.float64]
    stress_ids: NDArray[np.int64]
    stresses: NDArray[np.float64]
    grain_positions: NDArray[np.float64]
    grain_owners: NDArray[np.int64]
    bodies: BodyStates

    def __post_init__(self) -> None:
        """Check shapes and finiteness; InputError names the field."""
        if self.positions.ndim != 2 or self.positions.shape[1] not in (2, 3) or len(self.positions) == 0:
            raise InputError(
                "state.positions", self.positions.shape, "an array of shape (P, 2) or (P, 3) with P > 0"
            )
        for name, shape in self._shapes().items():
            value = np.asarray(getattr(self, name))
            optional = name in PARTICLE_OPTIONS and len(value) == 0
            if value.shape != ((0, *shape[1:]) if optional else shape):
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
        nodes, contacts, stresses = (
            np.size(self.node_ids),
            np.size(self.contact_keys),
            np.size(self.stress_ids),
        )
        size = d * (d + 1) // 2
        return {
            "positions": (count, d),
            "velocities": (count, d),
            "affine": (count, d, d),
            "volumes": (count,),
            "node_ids": (nodes,),
            "node_velocities": (nodes, d),
            "node_stresses": (nodes, size),
            "node_volume_fractions": (nodes,),
            "node_friction": (nodes,),
            "contact_keys": (contacts,),
            "contact_tractions": (contacts, d),
            "frames": (count, d, d),
            "materials": (count,),
            "cohesions": (count,),
            "orientations": (count, d, d),
            "particle_stresses": (count, size),
            "stress_ids": (stresses,),
            "stresses": (stresses, size),
            "grain_positions": (np.size(self.grain_owners), d),
            "grain_owners": (np.size(self.grain_owners),),
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
        square, stress = np.zeros((0, d, d)), np.zeros((0, d * (d + 1) // 2))
        return cls(
            0.0, 0, points, speeds, np.zeros((count, d, d)), np.array(volumes, dtype=np.float64), ids,
            np.zeros((0, d)), stress, none, none, ids, np.zeros((0, d)), square, np.zeros(0, dtype=np.int32), none,
            square, stress, ids, stress, np.zeros((0, d)), ids, BodyStates.none(d),
        )  # fmt: skip

    def particle_fields(self) -> dict[str, NDArray[np.generic]]:
        """Every field that has one row per particle in this simulation."""
        fields_of_all = ("positions", "velocities", "affine", "volumes")
        given = [name for name in PARTICLE_OPTIONS if len(getattr(self, name))]
        return {name: getattr(self, name) for name in (*fields_of_all, *given)}

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Every field as an array (numbers as 0-d arrays): all that `from_arrays` needs, for checkpoints."""
        own = {
            field.name: np.asarray(getattr(self, field.name))
            for field in fields(self)
            if field.name != "bodies"
        }
        return own | {f"bodies_{name}": array for name, array in self.bodies.arrays().items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> State:
        """State from the arrays of `arrays()`; InputError names a missing field or one of the wrong shape."""
        values: dict[str, object] = {}
        for field in fields(cls):
            if field.name == "bodies":
                continue
            if field.name not in arrays:
                raise InputError(f"state.{field.name}", "missing", "given")
            value = np.asarray(arrays[field.name])
            if field.name in ("time", "step"):
                if value.shape != ():
                    raise InputError(f"state.{field.name}", value.shape, "a single number")
                values[field.name] = float(value) if field.name == "time" else int(value)
            else:
                kind = INTEGERS.get(field.name, np.float64)
                values[field.name] = np.ascontiguousarray(value, dtype=kind)
        bodies = {
            name.removeprefix("bodies_"): array
            for name, array in arrays.items()
            if name.startswith("bodies_")
        }
        values["bodies"] = BodyStates.from_arrays(bodies)
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
    max_volume_fraction : largest volume fraction at a node, when the step began.
    total_volume : sum of the particle volumes [m^d].  particles : their number.
    active_nodes, blocks : nodes of occupied cells; blocks of the friction problem (with those of walls and bodies).
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
    particles: int
    active_nodes: int
    blocks: int
    move_substeps: int
