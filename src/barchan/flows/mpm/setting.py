"""What stays the same from step to step: box, materials, walls, bodies, gravity and options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import Body
from barchan.errors import InputError
from barchan.flows.mpm.bases import VelocityBasis
from barchan.flows.mpm.coupling import Coupling
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.options import Options
from barchan.flows.mpm.state import State
from barchan.flows.mpm.walls import Walls
from barchan.spaces import RegularGrid


@dataclass(frozen=True, eq=False)
class Setting:
    """The constant part of a simulation.

    grid, walls, options, bodies : see `Stepper`.
    materials : at least one; `State.materials` numbers them when there are several.
    gravity : (d,) [m/s^2].
    """

    grid: RegularGrid
    materials: tuple[Material, ...]
    walls: Walls
    gravity: NDArray[np.float64]
    options: Options
    bodies: tuple[Body, ...] = ()
    coupling: Coupling | None = field(default=None)

    @cached_property
    def basis(self) -> VelocityBasis:
        """The velocity basis."""
        return VelocityBasis(self.grid, self.options.velocity)

    @cached_property
    def weight(self) -> float:
        """|g| [m/s^2]."""
        return float(np.linalg.norm(self.gravity))

    @cached_property
    def upwards(self) -> NDArray[np.float64]:
        """(d,) unit vector against gravity; the last axis without gravity."""
        if self.weight == 0.0:
            return np.eye(self.grid.dimension)[-1]
        return np.asarray(-self.gravity / self.weight)

    def densities(self, state: State) -> NDArray[np.float64] | float:
        """Density of every particle (P,), or the one density [kg/m^3]."""
        if len(self.materials) == 1:
            return float(self.materials[0].density)
        return np.array([material.density for material in self.materials])[state.materials]

    def masses(self, state: State) -> NDArray[np.float64]:
        """(P,) masses of the particles [kg]."""
        return np.asarray(self.densities(state) * state.volumes)

    def mean_height(self, state: State) -> float:
        """Height [m] of the centre of volume above the lowest particle, against gravity."""
        height = state.positions @ self.upwards
        return float(np.sum(state.volumes * height) / np.sum(state.volumes) - np.min(height))


def gravity_vector(value: ArrayLike, dimension: int) -> NDArray[np.float64]:
    """(d,) from a number >= 0, downwards along the last axis, or a vector. Raises InputError."""
    allowed = f"a finite number >= 0 (m/s^2, downwards) or a vector of {dimension}"
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("gravity", value, allowed) from None
    if not np.all(np.isfinite(vector)):
        raise InputError("gravity", value, allowed)
    if vector.shape == () and float(vector) >= 0.0:
        return np.asarray(-float(vector) * np.eye(dimension)[-1])
    if vector.shape != (dimension,):
        raise InputError("gravity", value, allowed)
    return vector


def checked_materials(materials: Material | Sequence[Material]) -> tuple[Material, ...]:
    """The materials as a tuple. Raises InputError for none, or parameters that the materials of a scene must share."""
    found = (materials,) if isinstance(materials, Material) else tuple(materials)
    if not found or not all(isinstance(material, Material) for material in found):
        raise InputError("materials", materials, "a Material, or several")
    for name in ("max_volume_fraction", "packing_tolerance", "anisotropy", "elongation"):
        values = [getattr(material, name) for material in found]
        if len(set(values)) > 1:
            raise InputError(f"materials.{name}", values, "the same for all materials of a scene")
    return found
