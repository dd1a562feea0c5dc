"""Flow past a cylinder in a channel, the DFG benchmark 2D-1 with four fluids (seed C, chapter 5): drag and lift.

Channel 2.2 m x 0.41 m, cylinder of diameter 0.1 m at (0.2, 0.2), a parabola of greatest velocity 0.3 m/s at the inflow, a free
outflow; density 1 kg/m^3. eps is added to |g|^2 as it is (seed C 5.2, ERRATA 6): the regularisation of the rate is sqrt(eps).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import observables
from barchan.flows.quasi_newtonian.conditions import Condition, NoSlip, Velocity
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import Bingham, Newtonian, PowerLaw, ViscosityModel
from barchan.flows.quasi_newtonian.newton import FlowSolution
from barchan.scenes.continuum import Curve
from barchan.scenes.fluids import (
    FluidElementsGroup,
    FluidModel,
    FluidParameters,
    FluidShown,
    FluidSolverGroup,
    FluidState,
    FluidTimeGroup,
    Level,
    fluid_kind,
)
from barchan.scenes.parameters import Group, NotNegative, Positive, SceneHeader
from barchan.spaces.meshes import dfg_channel
from barchan.spaces.meshes.dfg_channel import CENTRE, RADIUS, WIDTH
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace, refinements

Vector = NDArray[np.float64]

DENSITY = 1.0
DEFAULTS: Mapping[str, Mapping[str, float]] = {
    "newtonian": {"eta0": 1e-3},
    "shear-thinning": {"eta0": 1e-3, "exponent": 1.5, "eps": 0.1},
    "shear-thickening": {"eta0": 1e-3, "exponent": 3.0, "eps": 0.1},
    "bingham": {"eta0": 1.0, "tau0": 0.5, "eps": 0.01},
}
"""The fluids of seed C 5.2; keys that a fluid lacks mean nothing to it."""


class CylinderDfgHeader(SceneHeader):
    """[scene]"""

    kind: Literal["cylinder_dfg"] = Field(description="what is simulated: flow past a cylinder, DFG 2D-1")


class FluidGroup(Group):
    """[material]: what is left out is that of the fluid in seed C 5.2."""

    fluid: Literal["newtonian", "shear-thinning", "shear-thickening", "bingham"] = Field(
        default="newtonian", description="law of the viscosity eta(|g|), |g|^2 = D(u):D(u)"
    )
    eta0: Positive | None = Field(
        default=None, description="viscosity (Pa s), of power laws at (|g|^2 + eps) = 1; 1e-3, of bingham 1"
    )
    tau0: NotNegative | None = Field(default=None, description="yield stress of bingham (Pa); 0.5")
    exponent: Positive | None = Field(
        default=None, description="m of the power laws (|g|^2 + eps)^(m/2 - 1); 1.5 thinning, 3 thickening"
    )
    eps: Positive | None = Field(
        default=None, description="added to |g|^2 (1/s²); 0.1 in power laws, 0.01 in bingham"
    )


class GeometryGroup(Group):
    """[geometry]"""

    level: Level = Field(
        default=3, description="refinement of the mesh; level 1 has 130 cells, each level 4 times as many"
    )


class ConditionsGroup(Group):
    """[conditions]"""

    velocity: Positive = Field(default=0.3, description="greatest velocity at the inflow (m/s)")


class CylinderDfgParameters(FluidParameters):
    """A complete scene of kind "cylinder_dfg"."""

    scene: CylinderDfgHeader
    material: FluidGroup = FluidGroup()
    geometry: GeometryGroup = GeometryGroup()
    conditions: ConditionsGroup = ConditionsGroup()
    elements: FluidElementsGroup = FluidElementsGroup()
    time: FluidTimeGroup = FluidTimeGroup()
    solver: FluidSolverGroup = FluidSolverGroup()

    @property
    def size(self) -> str:
        """The level."""
        return f"level {self.geometry.level}, {self.cells} cells"

    @property
    def cells(self) -> int:
        """Number of cells."""
        return 130 * 4 ** (self.geometry.level - 1) * self.elements.pieces

    @classmethod
    def completed(cls, tables: dict[str, Any]) -> dict[str, Any]:
        """What the fluid has by default."""
        given = tables.get("material", {})
        if isinstance(given, Mapping):
            defaults = DEFAULTS.get(str(given.get("fluid", "newtonian")), {})
            tables["material"] = {**defaults, **given}
        return tables

    def check(self) -> None:
        """Raise InputError for what the fluid does not have."""
        super().check()
        material = self.material
        for key in ("tau0", "exponent", "eps"):
            value = getattr(material, key)
            if value is not None and key not in DEFAULTS[material.fluid]:
                raise InputError(f"material.{key}", value, f"left out of a fluid that is {material.fluid}")


class CylinderDfgModel(FluidModel):
    """The model of the channel."""

    parameters: CylinderDfgParameters

    def hierarchy(self) -> list[QuadraticMesh]:
        """The channel of all levels."""
        return refinements(dfg_channel(1, self.parameters.elements.shape), self.parameters.geometry.level)

    def build(self, space: QuadraticSpace) -> QuasiNewtonianFlow:
        """A parabola at the inflow, no slip on walls and cylinder."""
        top = self.parameters.conditions.velocity

        def parabola(x: Vector) -> Vector:
            return np.stack([4.0 * top * x[:, 1] * (WIDTH - x[:, 1]) / WIDTH**2, np.zeros(len(x))], axis=1)

        conditions: dict[str, Condition] = {
            "inflow": Velocity(parabola),
            "walls": NoSlip(),
            "cylinder": NoSlip(),
        }
        return QuasiNewtonianFlow(space, self._law(), conditions, density=DENSITY)

    def scalars(self, state: FluidState) -> dict[str, float]:
        """C_D = 2 F_D / (rho U^2 L), C_L, U the mean inflow velocity; pressure ahead of the cylinder less that behind."""
        solution = state.solution
        mean = 2.0 / 3.0 * self.parameters.conditions.velocity
        force = observables.drag_lift(self.flow, solution, "cylinder", mean, 2.0 * RADIUS, state.inertia)
        ahead, behind = (
            self.cut(
                solution,
                (CENTRE[0] + side * RADIUS, CENTRE[1]),
                (CENTRE[0] + 2.0 * side * RADIUS, CENTRE[1]),
                2,
            )
            for side in (-1.0, 1.0)
        )
        return {
            "drag": force.drag,
            "lift": force.lift,
            "pressure_difference": float(ahead.pressure[0] - behind.pressure[0]),
        }

    def lines(self, solution: FlowSolution) -> dict[str, Vector]:
        """The velocity along x behind the cylinder, at its height."""
        cut = self.cut(solution, (CENTRE[0] + RADIUS, CENTRE[1]), (2.2, CENTRE[1]))
        return {
            "behind_x": cut.points[:, 0],
            "behind_ux": cut.velocity[:, 0],
            "behind_pressure": cut.pressure,
        }

    def _law(self) -> ViscosityModel:
        given = self.parameters.material
        eta0, rate = given.eta0 or 1.0, math.sqrt(given.eps or 0.0)
        if given.fluid == "newtonian":
            return Newtonian(eta0)
        if given.fluid == "bingham":
            return Bingham(eta0, given.tau0 or 0.0, rate)
        return PowerLaw(eta0, given.exponent or 2.0, rate)


KIND = fluid_kind(
    "cylinder_dfg",
    CylinderDfgParameters,
    CylinderDfgModel,
    FluidShown(
        figures=(
            ("drag", "drag coefficient"),
            ("lift", "lift coefficient"),
            ("pressure_difference", "pressure ahead less that behind (Pa)"),
        ),
        curves=(
            (
                "behind",
                Curve("behind_x", "x (m)", (("behind_ux", "u_x behind the cylinder"),), "velocity (m/s)"),
            ),
        ),
    ),
)
