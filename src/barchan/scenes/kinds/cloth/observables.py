"""What is measured of a cloth at each frame: energies, contacts, sliding, extent, stretch, how fast it and its hem turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.cloth import ClothAssembly, ClothState
from barchan.bodies.cloth.contacts import mixed_friction
from barchan.bodies.moreau import AssemblyRecord

Vector = NDArray[np.float64]

_AT_THE_CONE = 1e-3  # share of mu r_N that a friction force may miss and still count as sliding


class Observer:
    """Measures states of a cloth."""

    def __init__(self, assembly: ClothAssembly) -> None:
        self._assembly = assembly
        self._cloth = assembly.cloth
        mesh, material = self._cloth.mesh, self._cloth.material
        low = mesh.vertices[mesh.boundary, 2]
        lowest = low.min() + 1e-6 * float(np.max(np.ptp(mesh.vertices, axis=0)))
        self._hem = mesh.boundary[low <= lowest]
        """The lowest part of the boundary at rest: of a flat cloth all of it."""
        rule = assembly.options.mixing
        frictions = [mixed_friction(material.friction, body.friction, rule) for body in assembly.bodies]
        self._friction = np.array([*frictions, material.friction])  # the last: the cloth on itself

    def observed(self, state: ClothState, record: AssemblyRecord | None) -> dict[str, float]:
        """Scalars of a state; lengths in m, speeds in m/s, spins in rad/s about the vertical through the centre of mass."""
        cloth, gravity = self._cloth, self._assembly.acceleration
        masses, x, v = cloth.masses, state.positions, state.velocities
        share = masses / masses.sum()
        centre = share @ x
        pressing = state.pressing
        own = state.contact_bodies == -1
        elastic = cloth.energy.value(x)
        normal = np.einsum("ki,ki->k", state.forces, state.normals)
        return {
            "time": state.time,
            "kinetic_energy": cloth.kinetic_energy(v),
            "potential_energy": cloth.potential_energy(x, gravity),
            "elastic_energy": elastic,
            "max_speed": float(np.max(np.linalg.norm(v, axis=1))),
            "mean_speed": float(share @ np.linalg.norm(v, axis=1)),
            "contacts": float(np.count_nonzero(pressing)),
            "self_contacts": float(np.count_nonzero(pressing & own)),
            "sliding_share": self._sliding(state, normal),
            "normal_force": float(np.sum(normal[~own])),
            "weight": float(masses.sum() * np.linalg.norm(gravity)),
            "deepest_overlap": 0.0 if record is None else record.deepest,
            **{f"centre_{axis}": float(c) for axis, c in zip("xyz", centre, strict=True)},
            "lowest": float(x[:, 2].min()),
            "highest": float(x[:, 2].max()),
            "hem_spin": self._spin(x[self._hem] - centre, v[self._hem]),
            "cloth_spin": self._spin(x - centre, v),
            "largest_stretch": self._stretch(x),
            "sweeps": 0.0 if record is None else float(record.sweeps),
            "certificate": 0.0 if record is None else record.residual,
        }

    def _sliding(self, state: ClothState, normal: Vector) -> float:
        """Share of the contacts with force whose friction is all there can be."""
        pressing = state.pressing
        if not np.any(pressing):
            return 0.0
        mu = self._friction[state.contact_bodies]
        tangential = np.linalg.norm(state.forces - normal[:, None] * state.normals, axis=1)
        slides = tangential >= (1.0 - _AT_THE_CONE) * mu * normal
        return float(np.count_nonzero(slides & pressing)) / float(np.count_nonzero(pressing))

    def _spin(self, arms: Vector, velocities: Vector) -> float:
        """Angular velocity about the vertical that fits best."""
        squared = float(np.sum(arms[:, :2] ** 2))
        turning = float(np.sum(arms[:, 0] * velocities[:, 1] - arms[:, 1] * velocities[:, 0]))
        return turning / squared if squared > 0.0 else 0.0

    def _stretch(self, x: Vector) -> float:
        """Largest strain of an edge."""
        mesh = self._cloth.mesh
        ends = x[mesh.hinges.edges]
        return float(np.max(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / mesh.edge_lengths)) - 1.0
