"""Dense granular and viscoplastic flows by nonsmooth finite elements, in 2D and 3D (seed A; seed B, chapter 6).

space = MixedSpace(mesh, velocity="P2", stress="P1d")
flow = DenseFlow(space, Material.dimensionless(reynolds=1.0, bingham=0.1, mu=0.5), {"bottom": NoSlip()})
state = flow.solve(tolerance=1e-4)                      # steady, creeping
state = flow.step(flow.at_rest(), dt=0.05)              # with inertia
"""

from __future__ import annotations

from barchan.flows.dense.conditions import (
    Condition,
    FreeSlip,
    FrictionalWall,
    NoSlip,
    Pressure,
    Stress,
    Symmetry,
    Velocity,
)
from barchan.flows.dense.flow import DenseFlow
from barchan.flows.dense.material import Material, MuI, RateViscosity
from barchan.flows.dense.state import DenseState

__all__ = [
    "Condition",
    "DenseFlow",
    "DenseState",
    "FreeSlip",
    "FrictionalWall",
    "Material",
    "MuI",
    "NoSlip",
    "Pressure",
    "RateViscosity",
    "Stress",
    "Symmetry",
    "Velocity",
]
