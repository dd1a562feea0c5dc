"""Viscous forces on the volume average: the weak derivative of the weak derivative (seed B, 7.2.2 and a_2 of 8.3.2).

The strain operator is that of the dry model for equal fractions, so that a side has the mean velocity of its cells; at walls
the fluid sticks to, it has the wall's velocity along it. The power dissipated is sum_K 2 eta_K |K| D_K : D_K.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import strain_tensor
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.strain import strain_operator
from barchan.flows.suspension.p0.boundaries import Sides

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Viscosity:
    """What does not change from step to step: 2 |K| chi^-1(D(v)_K) = (strain v + walls)_K.

    strain : (c s, c d).  walls : (c s,) part of the moving walls.  volumes : (c,).
    """

    strain: sp.bsr_array
    transposed: sp.csr_array
    squares: Any
    walls: Vector
    volumes: Vector

    @classmethod
    def of(cls, cells: Cells, sides: Sides) -> Viscosity:
        """Of all cells; the viscosity comes later."""
        everywhere = np.ones(cells.count, dtype=bool)
        strain = strain_operator(cells, np.ones(cells.count), everywhere, sides.stick)
        squares = strain.copy()
        squares.data **= 2
        along = np.where(sides.stick[:, :, None], sides.sliding(cells), 0.0)
        walls = np.einsum("sij,cki,ckj->cs", strain_tensor(cells.dimension), along, cells.faces)
        return cls(strain, strain.T.tocsr(), squares.T.tocsr(), walls.reshape(-1), cells.volumes)

    def weights(self, viscosity: Vector) -> Vector:
        """(c s,) eta / |K|, whose weighted squares are the power dissipated, from viscosities (c,) [Pa s]."""
        return np.repeat(viscosity / self.volumes, self.strain.blocksize[0])

    def diagonal(self, weights: Vector) -> Vector:
        """(c d,) diagonal of the stiffness."""
        return np.asarray(self.squares @ weights)

    def forces(self, weights: Vector, velocities: Vector, with_walls: bool) -> Vector:
        """(c d,) stiffness times velocities (c d,), the opposite of the viscous forces; `with_walls` adds what walls do."""
        rates = self.strain @ velocities
        if with_walls:
            rates = rates + self.walls
        return np.asarray(self.transposed @ (weights * rates))
