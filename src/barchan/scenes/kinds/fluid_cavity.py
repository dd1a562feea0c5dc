"""Regularised yield-stress fluid in a unit square whose lid moves along x with unit speed (the cavity of kind "cavity", but
with a viscosity): seed C, Eq. 3.5, and any power law beyond the yield stress.

Lengths are in units of the side L, speeds of that of the lid V, stresses of eta V / L: bingham = tau0 L / (eta V), eps in
units of V / L. The lid's corners belong to the side walls, which do not slip.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import observables
from barchan.flows.quasi_newtonian.conditions import Condition, NoSlip, Velocity
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import HerschelBulkley
from barchan.flows.quasi_newtonian.newton import FlowSolution
from barchan.results.fields import DIMENSIONLESS
from barchan.scenes.fluids import (
    FluidElementsGroup,
    FluidModel,
    FluidParameters,
    FluidShown,
    FluidSolverGroup,
    FluidState,
    FluidTimeGroup,
    fluid_kind,
)
from barchan.scenes.fluids.stream import vortex
from barchan.scenes.kinds.cavity import CENTRELINE
from barchan.scenes.parameters import Group, NotNegative, Positive, SceneHeader
from barchan.spaces.meshes import rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace, refinements

Vector = NDArray[np.float64]

COARSEST = 4
"""The coarsest mesh has at least so many cells along each side."""


class FluidCavityHeader(SceneHeader):
    """[scene]"""

    kind: Literal["fluid_cavity"] = Field(
        description="what is simulated: a lid-driven cavity, regularised fluid"
    )
    dimensionless: Literal[True] = Field(default=True, description="lengths, speeds, stresses have no units")


class MaterialGroup(Group):
    """[material]"""

    bingham: NotNegative = Field(
        default=2.0, description="Bi = tau0 L / (eta V), L the side, V speed of the lid"
    )
    exponent: Positive = Field(
        default=2.0, description="m of the viscosity |g|^(m-2) beyond the yield stress; 2: Bingham"
    )
    eps: Positive = Field(default=1e-3, description="regularisation of the shear rate / (V / L)")
    reynolds: NotNegative = Field(default=0.0, description="Re = rho V L / eta; 0: no inertia")


class GeometryGroup(Group):
    """[geometry]"""

    cells: Annotated[int, Field(ge=2, le=1024)] = Field(default=32, description="cells along each side")
    grading: Positive = Field(
        default=2.0, description="width of the cells in the middle over that at the sides"
    )


class FluidCavityParameters(FluidParameters):
    """A complete scene of kind "fluid_cavity"."""

    units: ClassVar[str] = "dimensionless"
    time_unit: ClassVar[str] = ""

    scene: FluidCavityHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    elements: FluidElementsGroup = FluidElementsGroup()
    time: FluidTimeGroup = FluidTimeGroup()
    solver: FluidSolverGroup = FluidSolverGroup()

    @property
    def size(self) -> str:
        """The cells of the square."""
        return f"{self.geometry.cells} x {self.geometry.cells} cells"

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.geometry.cells**2 * self.elements.pieces

    def check(self) -> None:
        """Raise InputError for a flow without inertia that is stepped in time."""
        super().check()
        if not self.steady and self.material.reynolds == 0.0:
            raise InputError(
                "time.end", self.time.end, "0 for reynolds = 0: without inertia a flow is steady at once"
            )


class FluidCavityModel(FluidModel):
    """The model of the cavity."""

    parameters: FluidCavityParameters

    def hierarchy(self) -> list[QuadraticMesh]:
        """Squares of half, a quarter ... of the cells, graded like the coarsest."""
        geometry = self.parameters.geometry
        count, levels = geometry.cells, 1
        while count % 2 == 0 and count // 2 >= COARSEST:
            count, levels = count // 2, levels + 1
        mesh = rectangle(
            (0.0, 0.0), (1.0, 1.0), (count, count), self.parameters.elements.shape, grading=geometry.grading
        )
        return refinements(QuadraticMesh.of(mesh), levels)

    def build(self, space: QuadraticSpace) -> QuasiNewtonianFlow:
        """A closed box with a moving lid."""
        given = self.parameters.material
        law = HerschelBulkley(1.0, given.exponent, given.bingham, given.eps)
        conditions: dict[str, Condition] = {
            "top": Velocity((1.0, 0.0)),
            "left": NoSlip(),
            "right": NoSlip(),
            "bottom": NoSlip(),
        }
        return QuasiNewtonianFlow(
            space, law, conditions, density=given.reynolds, convection=given.reynolds > 0.0
        )

    def scalars(self, state: FluidState) -> dict[str, float]:
        """Centre and strength of the vortex, area below the yield stress, slowest u_x on x = 1/2 and its height."""
        solution = state.solution
        centre, strength = vortex(self.space, solution.velocity)
        lines = self.lines(solution)
        low = int(np.argmin(lines["centreline_ux"]))
        return {
            "vortex_x": centre[0],
            "vortex_y": centre[1],
            "vortex_strength": strength,
            "plug_area": float(self.space.weights[observables.rigid_points(self.flow, solution)].sum()),
            "centreline_min": float(lines["centreline_ux"][low]),
            "centreline_min_y": float(lines["centreline_y"][low]),
        }

    def lines(self, solution: FlowSolution) -> dict[str, Vector]:
        """u_x along x = 1/2 and u_y along y = 1/2."""
        upright = self.cut(solution, (0.5, 0.0), (0.5, 1.0))
        across = self.cut(solution, (0.0, 0.5), (1.0, 0.5))
        return {
            "centreline_y": upright.points[:, 1],
            "centreline_ux": upright.velocity[:, 0],
            "centreline_x": across.points[:, 0],
            "centreline_uy": across.velocity[:, 1],
        }


KIND = fluid_kind(
    "fluid_cavity",
    FluidCavityParameters,
    FluidCavityModel,
    FluidShown(
        figures=(
            ("vortex_x", "vortex centre x"),
            ("vortex_y", "vortex centre y"),
            ("centreline_min", "slowest u_x on x = 1/2"),
            ("plug_area", "area below the yield stress"),
        ),
        curves=(CENTRELINE,),
        units={
            **DIMENSIONLESS,
            "speed": "speed / V",
            "pressure": "pressure L / (eta V)",
            "shear rate": "shear rate L / V",
            "viscosity": "viscosity / eta",
        },
    ),
)
