"""Granular matter between a turning cylinder and one at rest, seen from above: the Couette device of seed C, chapter 6.

The modified Poliquen viscosity under one pressure P, stresses and viscosities divided by the density (seed C 6.2.2), so that
the viscosity of the seed's parameters is 0.1487 / |g| + 0.26766 / (59.7394 + |g|), |g| regularised by eps. Beside the flow
stands the exact axisymmetric one (`barchan.flows.quasi_newtonian.couette`) with the same regularisation.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import observables
from barchan.flows.quasi_newtonian.conditions import Condition, NoSlip, Velocity
from barchan.flows.quasi_newtonian.couette import couette_profile
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import ModifiedPoliquen
from barchan.flows.quasi_newtonian.newton import FlowSolution
from barchan.results.fields import KINEMATIC
from barchan.scenes.continuum import Curve
from barchan.scenes.fluids import (
    FluidElementsGroup,
    FluidModel,
    FluidParameters,
    FluidShown,
    FluidState,
    FluidTimeGroup,
    GranularFluidSolverGroup,
    Level,
    fluid_kind,
)
from barchan.scenes.parameters import Group, NotNegative, Positive, SceneHeader
from barchan.spaces.meshes import annulus
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace, refinements

Vector = NDArray[np.float64]

AROUND, ACROSS = 16, 2


class CouetteHeader(SceneHeader):
    """[scene]"""

    kind: Literal["couette"] = Field(description="what is simulated: granular matter between two cylinders")


class MaterialGroup(Group):
    """[material]: the mu(I) rheology under one pressure (seed C 6.2.1)."""

    alpha: Positive = Field(default=0.15, description="friction of slow flow")
    beta: NotNegative = Field(default=0.27, description="its growth to fast flow")
    delta: Positive = Field(default=0.06, description="inertial number at half of the growth")
    grain_diameter: Positive = Field(default=0.001, description="d (m)")
    density: Positive = Field(default=1500.0, description="rho (kg/m³)")
    pressure: Positive = Field(default=1487.0, description="P (Pa)")
    eps: Positive = Field(default=0.01, description="regularisation of the shear rate (1/s)")


class GeometryGroup(Group):
    """[geometry]"""

    level: Level = Field(
        default=4, description="refinement; level l has 16 2^(l-1) cells around and 2 2^(l-1) across"
    )
    inner: Positive = Field(default=0.019, description="radius of the cylinder that turns (m)")
    outer: Positive = Field(default=0.024, description="radius of the cylinder at rest (m)")


class ConditionsGroup(Group):
    """[conditions]"""

    speed: Annotated[float, Field(gt=0.0)] = Field(
        default=0.019886667, description="speed of the inner wall (m/s); the default is 10 rpm with pi = 3.14"
    )


class CouetteParameters(FluidParameters):
    """A complete scene of kind "couette"."""

    units: ClassVar[str] = "SI units"

    scene: CouetteHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    conditions: ConditionsGroup = ConditionsGroup()
    elements: FluidElementsGroup = FluidElementsGroup()
    time: FluidTimeGroup = FluidTimeGroup()
    solver: GranularFluidSolverGroup = GranularFluidSolverGroup()

    @property
    def size(self) -> str:
        """The level."""
        return f"level {self.geometry.level}, {self.cells} cells"

    @property
    def cells(self) -> int:
        """Number of cells."""
        return AROUND * ACROSS * 4 ** (self.geometry.level - 1) * self.elements.pieces

    def check(self) -> None:
        """Raise InputError for radii out of order."""
        super().check()
        geometry = self.geometry
        if geometry.outer <= geometry.inner:
            raise InputError("geometry.outer", geometry.outer, f"above the inner radius {geometry.inner:g}")


class CouetteModel(FluidModel):
    """The model of the gap. Raises InputError for a speed that no shear rate up to 1e12 speed / gap gives."""

    parameters: CouetteParameters

    def hierarchy(self) -> list[QuadraticMesh]:
        """The gap of all levels."""
        geometry, cells = self.parameters.geometry, self.parameters.elements.shape
        coarsest = annulus(1, geometry.inner, geometry.outer, AROUND, ACROSS, cells)
        return refinements(coarsest, geometry.level)

    def build(self, space: QuadraticSpace) -> QuasiNewtonianFlow:
        """The inner wall turns, the outer does not; nothing slips."""
        geometry, speed = self.parameters.geometry, self.parameters.conditions.speed
        given = self.parameters.material
        law = ModifiedPoliquen(
            given.alpha,
            given.beta,
            given.delta,
            given.grain_diameter,
            1.0,
            given.pressure / given.density,
            eps=given.eps,
        )
        self.exact = couette_profile(law, geometry.inner, geometry.outer, speed)
        conditions: dict[str, Condition] = {
            "inner": Velocity(lambda x: speed / geometry.inner * np.stack([-x[:, 1], x[:, 0]], axis=1)),
            "outer": NoSlip(),
        }
        return QuasiNewtonianFlow(space, law, conditions, density=1.0)

    def scalars(self, state: FluidState) -> dict[str, float]:
        """Distances xi (percent) of speed, shear rate, viscosity along the cut from the exact ones; moments on the cylinder."""
        solution = state.solution
        lines = self.lines(solution)
        distances = {
            f"xi_{name}": float(observables.xi(lines["cut_r"], lines[f"exact_{name}"], lines[f"cut_{name}"]))
            for name in ("speed", "shear_rate", "viscosity")
        }
        part = self.space.mesh.part_nodes("inner")
        forces = self.flow.reaction(solution.velocity, solution.pressure, state.inertia)[part]
        x, y = self.space.mesh.nodes[part].T
        moment = float(np.sum(x * forces[:, 1] - y * forces[:, 0])) / (2.0 * np.pi)
        return {**distances, "torque": moment, "exact_torque": self.exact.torque}

    def lines(self, solution: FlowSolution) -> dict[str, Vector]:
        """Speed, shear rate, viscosity across the gap on y = 0, and the exact ones there."""
        geometry = self.parameters.geometry
        cut = self.cut(solution, (geometry.inner, 0.0), (geometry.outer, 0.0))
        speed, rate, viscosity = self.exact.at(cut.points[:, 0])
        return {
            "cut_r": cut.points[:, 0],
            "cut_speed": cut.speed,
            "cut_shear_rate": cut.shear_rate,
            "cut_viscosity": cut.viscosity,
            "exact_speed": speed,
            "exact_shear_rate": rate,
            "exact_viscosity": viscosity,
        }


def _across(name: str, words: str, unit: str) -> tuple[tuple[str, Curve], ...]:
    """The picture of one field across the gap, evenly and by order of magnitude."""
    drawn = ((f"cut_{name}", words), (f"exact_{name}", f"exact {words}"))
    return tuple(
        (f"{name}{ending}", Curve("cut_r", "r (m)", drawn, f"{words} ({unit})", logarithmic=bool(ending)))
        for ending in ("", "_log")
    )


KIND = fluid_kind(
    "couette",
    CouetteParameters,
    CouetteModel,
    FluidShown(
        figures=(
            ("xi_speed", "speed, distance from the exact one (%)"),
            ("xi_shear_rate", "shear rate, distance from the exact one (%)"),
            ("xi_viscosity", "viscosity, distance from the exact one (%)"),
            ("torque", "moment on the inner cylinder / (2 pi density) (m⁴/s²)"),
            ("exact_torque", "exact moment"),
        ),
        curves=(
            *_across("speed", "speed", "m/s"),
            *_across("shear_rate", "shear rate", "1/s"),
            *_across("viscosity", "viscosity / density", "m²/s"),
        ),
        units=KINEMATIC,
        pressure=False,  # that of the flow, some 1e-5 m²/s² beside the P of the law
    ),
)
