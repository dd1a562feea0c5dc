"""Means over a whole volume: virial stress, fabric, coordination number and granular temperature (seed C, 3.2.1 and 3.2.2).

Compression is positive, as in seed C: sigma = (1/V) (sum over contacts of F_ij r_ij + sum over grains of m v' v').
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.coarse_graining.interactions import Grains, Interactions
from barchan.bodies.rigid import inputs

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VolumeMean:
    """Means over a volume.

    contact_stress, kinetic_stress (d, d) [Pa], compression positive, first index that of the force. fabric (d, d) :
    mean of n n minus 1/d of the identity. coordination : contacts per grain, a contact with a wall counting once.
    volume_fraction : of the grains.
    temperature : m^2/s^2, tr(kinetic stress) / (d rho).
    """

    contact_stress: Vector
    kinetic_stress: Vector
    fabric: Vector
    coordination: float
    volume_fraction: float
    temperature: float

    @property
    def stress(self) -> Vector:
        """Contact and kinetic stress together (d, d) [Pa]."""
        return self.contact_stress + self.kinetic_stress


def volume_mean(
    grains: Grains, interactions: Interactions, volume: float, gradient: Vector | None = None
) -> VolumeMean:
    """Means over a `volume` [m^d] that holds all grains and contacts.

    gradient (d, d) : dv_i/dx_j [1/s] of the flow that velocities are measured against, besides their mean (default: none).
    """
    volume = inputs.positive("volume", volume)
    d = grains.dimension
    mass = float(np.sum(grains.masses))
    flow = np.zeros_like(grains.velocities) if gradient is None else grains.positions @ np.asarray(gradient).T
    relative = grains.velocities - flow
    relative = relative - grains.masses @ relative / mass
    kinetic = (grains.masses[:, None] * relative).T @ relative / volume
    contact = interactions.forces.T @ interactions.branches / volume
    count = len(interactions)
    normals = interactions.normals
    fabric = normals.T @ normals / count - np.eye(d) / d if count else np.zeros((d, d))
    ends = count + int(np.sum(interactions.second >= 0))
    temperature = float(np.trace(kinetic)) * volume / (d * mass)
    filled = float(np.sum(grains.volumes)) / volume
    return VolumeMean(contact, kinetic, fabric, ends / len(grains), filled, temperature)
