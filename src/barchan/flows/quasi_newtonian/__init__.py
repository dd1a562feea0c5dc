"""Generalised Newtonian fluids on finite elements: viscosities of shear rate and pressure, regularised yield stress (seed C).

meshes = refinements(annulus(1, 0.019, 0.024), 4)
spaces = [QuadraticSpace(mesh) for mesh in meshes]
flow = QuasiNewtonianFlow(spaces[-1], Bingham(1.0, 0.5, eps=1e-2), {"inner": Velocity(turning), "outer": NoSlip()})
solution = solve(flow, linear_solver="multigrid", spaces=spaces, nested=True)
"""

from __future__ import annotations

from barchan.flows.quasi_newtonian.conditions import (
    ChannelEnd,
    Condition,
    FreeSlip,
    NoSlip,
    Pressure,
    Slip,
    Stress,
    Symmetry,
    Velocity,
)
from barchan.flows.quasi_newtonian.continuation import solve_continued
from barchan.flows.quasi_newtonian.direct import DirectSolver
from barchan.flows.quasi_newtonian.flow import Inertia, QuasiNewtonianFlow, Weights
from barchan.flows.quasi_newtonian.models import (
    Bingham,
    HerschelBulkley,
    ModifiedPoliquen,
    Newtonian,
    Poliquen,
    PowerLaw,
    Schaeffer,
    Tardos,
    UserModel,
    ViscosityModel,
    check_derivatives,
)
from barchan.flows.quasi_newtonian.multigrid import MultigridSolver
from barchan.flows.quasi_newtonian.newton import METHODS, FlowSolution, NonlinearOptions, solve_flow
from barchan.flows.quasi_newtonian.solving import LINEAR_SOLVERS, solve
from barchan.flows.quasi_newtonian.temperature import Arrhenius, WilliamsLandelFerry, WithTemperature
from barchan.flows.quasi_newtonian.time_stepping import SCHEMES, backward_difference
from barchan.flows.quasi_newtonian.weights import STRATEGIES

__all__ = [
    "LINEAR_SOLVERS",
    "METHODS",
    "SCHEMES",
    "STRATEGIES",
    "Arrhenius",
    "Bingham",
    "ChannelEnd",
    "Condition",
    "DirectSolver",
    "FlowSolution",
    "FreeSlip",
    "HerschelBulkley",
    "Inertia",
    "ModifiedPoliquen",
    "MultigridSolver",
    "Newtonian",
    "NoSlip",
    "NonlinearOptions",
    "Poliquen",
    "PowerLaw",
    "Pressure",
    "QuasiNewtonianFlow",
    "Schaeffer",
    "Slip",
    "Stress",
    "Symmetry",
    "Tardos",
    "UserModel",
    "Velocity",
    "ViscosityModel",
    "Weights",
    "WilliamsLandelFerry",
    "WithTemperature",
    "backward_difference",
    "check_derivatives",
    "solve",
    "solve_continued",
    "solve_flow",
]
