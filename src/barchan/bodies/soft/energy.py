"""Where the energy of soft spheres is: kinetic, elastic, potential, and lost in contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from barchan.bodies.soft._contact_kernels import normal_energy
from barchan.bodies.soft.state import SoftState

if TYPE_CHECKING:
    from barchan.bodies.soft.model import SoftSpheres
    from barchan.bodies.soft.workspace import Workspace


@dataclass(frozen=True)
class Energy:
    """Energies [J], in the plane per metre of depth.

    translation, rotation : kinetic. normal, tangential : in the springs (the rolling ones too). gravity : potential,
    zero at the origin. dissipated : in dashpots and by sliding since the start.
    """

    translation: float
    rotation: float
    normal: float
    tangential: float
    gravity: float
    dissipated: float

    @property
    def total(self) -> float:
        """All of it: constant, but for errors of the time step, unless walls, held grains or the cell move."""
        kept = self.translation + self.rotation + self.normal + self.tangential
        return kept + self.gravity + self.dissipated


def energy_of(model: SoftSpheres, state: SoftState, work: Workspace) -> Energy:
    """Energies of `state`, whose arrays are in `work`."""
    free = ~model.held
    masses, moments = model.masses[free], model.moments[free]
    velocities, spins = state.bodies.velocities[free], state.bodies.spins[free]
    near = work.neighbours
    i, j = near.pairs.T
    branches = work.x[i] - work.x[j] - near.shifts.astype(np.float64) @ work.cell[:, :3]
    overlaps = model.radii[i] + model.radii[j] - np.linalg.norm(branches, axis=1)
    reduced = model.radii[i] * model.radii[j] / (model.radii[i] + model.radii[j])
    touching = np.flatnonzero(overlaps > 0.0)
    normal = sum(normal_energy(work.law, reduced[p], overlaps[p]) for p in touching)
    tangential = float(0.5 * np.sum(work.memory[:, 6] * np.sum(work.memory[:, :6] ** 2, axis=1)))
    for wall in work.walls:
        places = wall[3] + state.time * wall[:3] @ wall[4:7]
        depth = model.radii - (work.x @ wall[:3] - places)
        normal += sum(
            normal_energy(work.law, model.radii[k], depth[k]) for k in np.flatnonzero((depth > 0.0) & free)
        )
    springs = work.wall_memory
    tangential += float(0.5 * np.sum(springs[:, :, 6] * np.sum(springs[:, :, :6] ** 2, axis=2)))
    return Energy(
        float(0.5 * masses @ np.sum(velocities**2, axis=1)),
        float(0.5 * moments @ np.sum(spins**2, axis=1)),
        float(normal),
        tangential,
        float(-masses @ (state.bodies.positions[free] @ model.gravity)),
        state.dissipated,
    )
