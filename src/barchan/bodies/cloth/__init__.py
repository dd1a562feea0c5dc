"""Cloth by discrete shells in frictional contact (seed B, 4.3; Grinspun et al. 2003): meshes, energies, implicit steps.

mesh = rectangle(1.0, 1.0, 0.05)
cloth = Cloth(mesh, ClothMaterial(), start=mesh.vertices + (0.0, 0.0, 0.5))
assembly = ClothAssembly(cloth, [Body(Sphere(0.3), motion=Fixed())])
state, record = assembly.advance(assembly.started(), 0.005)
"""

from __future__ import annotations

from barchan.bodies.cloth.assembly import ClothAssembly
from barchan.bodies.cloth.contacts import ClothContacts
from barchan.bodies.cloth.energy import ShellEnergy
from barchan.bodies.cloth.makers import conical_skirt, disc, rectangle
from barchan.bodies.cloth.material import ClothMaterial
from barchan.bodies.cloth.mesh import ClothMesh
from barchan.bodies.cloth.model import Cloth
from barchan.bodies.cloth.options import ClothOptions
from barchan.bodies.cloth.pins import Pins, carried_by
from barchan.bodies.cloth.state import ClothState

__all__ = [
    "Cloth",
    "ClothAssembly",
    "ClothContacts",
    "ClothMaterial",
    "ClothMesh",
    "ClothOptions",
    "ClothState",
    "Pins",
    "ShellEnergy",
    "carried_by",
    "conical_skirt",
    "disc",
    "rectangle",
]
