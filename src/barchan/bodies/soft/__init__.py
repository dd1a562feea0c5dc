"""Soft spheres (seed C, 3.2): discs and balls on springs and dashpots, the counterpart of rigid bodies in contact.

spheres = SoftSpheres(radii, densities, Hookean.of_restitution(stiffness, 0.7), friction, walls, gravity)
state = spheres.advance(spheres.start(positions), spheres.time_step(), steps)
grains, forces = spheres.grains(state)  # for barchan.bodies.coarse_graining
"""

from __future__ import annotations

from barchan.bodies.soft.cell import Cell, CellState, Piston
from barchan.bodies.soft.collisions import Collision, calibrated, collision
from barchan.bodies.soft.energy import Energy
from barchan.bodies.soft.from_bodies import from_bodies
from barchan.bodies.soft.laws import Hertzian, Hookean
from barchan.bodies.soft.model import SoftSpheres
from barchan.bodies.soft.packing import lattice_packing
from barchan.bodies.soft.shear import PlaneShear, ShearAverage
from barchan.bodies.soft.state import SoftState
from barchan.bodies.soft.walls import Wall

__all__ = [
    "SoftSpheres", "SoftState", "Energy", "Hookean", "Hertzian", "Collision", "collision", "calibrated",
    "Wall", "Cell", "CellState", "Piston", "from_bodies", "lattice_packing", "PlaneShear", "ShearAverage",
]  # fmt: skip
