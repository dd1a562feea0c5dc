"""Discharge of a plane silo (seed A 6.2, Fig. 8), creeping or inertial; lengths are in units of L, the outlet being D/L.

Half of the silo is simulated: x = 0 is its axis, y = 0 its bottom, gravity points down. `discharge` is that of the
whole silo, 2 times the flux through the half outlet, in units of sqrt(g L^3).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.errors import InputError
from barchan.flows.dense import (
    Condition,
    DenseFlow,
    DenseState,
    FreeSlip,
    FrictionalWall,
    Material,
    MuI,
    NoSlip,
    Symmetry,
    observables,
)
from barchan.scenes.continuum import (
    ContinuumHeader,
    ContinuumModel,
    Curve,
    ElementsGroup,
    GranularSolverGroup,
    InertialParameters,
    Shown,
    TimeGroup,
    continuum_kind,
)
from barchan.scenes.parameters import Count, Group, NotNegative, Positive
from barchan.spaces.meshes import silo
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]


class SiloHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["silo"] = Field(description="what is simulated: the discharge of a silo")


class MaterialGroup(Group):
    """[material]"""

    mu: NotNegative = Field(
        default=0.5, description="friction coefficient at rest (sine of the friction angle)"
    )
    reynolds: Positive = Field(default=1.0, description="Re = rho sqrt(g L) L / viscosity")
    bingham: NotNegative = Field(default=0.0, description="Bi = yield stress without pressure / (rho g L)")
    dilatancy: NotNegative = Field(default=0.0, description="expansion per shear, at most mu")
    mu_increment: NotNegative = Field(
        default=0.0, description="growth of the friction coefficient in rapid flow, mu(I)"
    )
    inertial_reference: Positive = Field(
        default=0.4, description="inertial number d du/dy / sqrt(p / rho) at which half of that is reached"
    )
    grain_diameter: NotNegative = Field(
        default=1.0 / 11.2, description="grain diameter of mu(I), in units of L"
    )


class GeometryGroup(Group):
    """[geometry]"""

    outlet: Positive = Field(default=1.0, description="aperture of the whole silo")
    width: Positive = Field(default=8.0, description="width of the whole silo")
    height: Positive = Field(default=8.0, description="height of the filling, kept up")
    below: NotNegative = Field(default=0.0, description="length of a stress-free jet below the outlet")
    wall: Literal["no_slip", "free_slip"] | NotNegative = Field(
        default="no_slip",
        description="side wall and bottom",
        json_schema_extra={"accepted": '"no_slip", "free_slip" or a friction coefficient >= 0'},
    )
    vertices: Count = Field(default=670, description="vertices of the mesh of the half silo, nearly")
    grading: bool = Field(default=True, description="cells smaller near the edge of the outlet")


class FlowGroup(Group):
    """[flow]"""

    regime: Literal["creeping", "inertial"] = Field(
        default="creeping", description="steady without inertia, or in time from rest"
    )


class SiloParameters(InertialParameters):
    """A complete scene of kind "silo"."""

    scene: SiloHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    flow: FlowGroup = FlowGroup()
    elements: ElementsGroup = ElementsGroup()
    time: TimeGroup = TimeGroup()
    solver: GranularSolverGroup = GranularSolverGroup()

    @property
    def size(self) -> str:
        """The vertices asked for."""
        return f"{self.geometry.vertices} vertices"

    def check(self) -> None:
        """Raise InputError unless the outlet fits and the friction coefficients agree."""
        super().check()
        geometry = self.geometry
        if geometry.outlet >= geometry.width:
            raise InputError("geometry.outlet", geometry.outlet, f"less than the width {geometry.width:g}")


class SiloModel(ContinuumModel):
    """The model of a silo."""

    parameters: SiloParameters

    def __init__(self, parameters: SiloParameters) -> None:
        super().__init__(parameters, parameters.time if parameters.inertial else None)

    def build(self) -> DenseFlow:
        """Half of the silo with a symmetric axis; top, outlet and jet are free."""
        geometry, elements = self.parameters.geometry, self.parameters.elements
        mesh = silo(
            geometry.outlet,
            geometry.width,
            geometry.height,
            geometry.vertices,
            below=geometry.below,
            grading=geometry.grading,
        )
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        conditions: dict[str, Condition] = {"axis": Symmetry()}
        for part in ("wall", "bottom"):
            conditions[part] = wall_condition(geometry.wall)
        return DenseFlow(space, self._material(), conditions, gravity=(0.0, -1.0))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Discharge of the whole silo, its outflow velocity and the pressure that the bottom bears on the average."""
        geometry = self.parameters.geometry
        discharge = 2.0 * observables.discharge(self.flow, state, "outlet")
        pressures = observables.pressures(self.flow, state)
        weights, points = self.space.weights, self.space.points
        low = points[:, 1] < 0.05 * geometry.height
        return {
            "discharge": discharge,
            "outlet_velocity": discharge / geometry.outlet,
            "bottom_pressure": float(np.average(pressures[low], weights=weights[low])),
            "max_pressure": float(pressures.max()),
        }

    def watched(self, state: DenseState) -> float:
        """The discharge."""
        return self.scalars(state)["discharge"]

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """Sections S1 (axis), S2 (x = outlet), both vertical, and H1 (y = outlet, horizontal): velocities and pressures.

        Seed A takes the sections of Fig. 10 from a paper that does not come with it, and draws no positions.
        """
        geometry = self.parameters.geometry
        aside = min(geometry.outlet, 0.5 * geometry.width)
        up = min(geometry.outlet, geometry.height)
        sections = {
            "s1": ((0.0, 0.0), (0.0, geometry.height), 1, "y"),
            "s2": ((aside, 0.0), (aside, geometry.height), 1, "y"),
            "h1": ((0.0, up), (0.5 * geometry.width, up), 0, "x"),
            "outlet": ((0.0, 0.0), (0.5 * geometry.outlet, 0.0), 0, "x"),
        }
        found = {}
        for name, (start, end, axis, letter) in sections.items():
            points, velocities, pressures = self.line(state, start, end)
            found[f"{name}_{letter}"] = points[:, axis]
            found[f"{name}_ux"], found[f"{name}_uy"] = velocities.T
            found[f"{name}_pressure"] = pressures
        return found

    def _material(self) -> Material:
        given = self.parameters.material
        mu: float | MuI = given.mu
        if given.mu_increment > 0.0:
            # MuI measures shear by |D_T| = (du/dy)/2 in simple shear, the scene by du/dy as publications do.
            mu = MuI(
                given.mu, given.mu + given.mu_increment, given.inertial_reference, 2.0 * given.grain_diameter
            )
        return Material.dimensionless(given.reynolds, given.bingham, mu=mu, dilatancy=given.dilatancy)


def wall_condition(choice: str | float) -> Condition:
    """The condition of a solid wall: "no_slip", "free_slip" or a friction coefficient."""
    if isinstance(choice, str):
        return NoSlip() if choice == "no_slip" else FreeSlip()
    return FrictionalWall(choice)


KIND = continuum_kind(
    "silo",
    SiloParameters,
    SiloModel,
    Shown(
        figures=(
            ("discharge", "discharge Q / sqrt(g L^3)"),
            ("max_pressure", "greatest pressure / (rho g L)"),
        ),
        curves=(
            (
                "vertical",
                Curve(
                    "s1_y",
                    "y / L",
                    (("s1_uy", "section S1, on the axis"), ("s2_uy", "section S2, one outlet aside")),
                    "vertical velocity / sqrt(g L)",
                    upright=True,
                ),
            ),
            (
                "horizontal",
                Curve(
                    "h1_x",
                    "x / L",
                    (("h1_uy", "vertical, section H1"), ("h1_ux", "horizontal, section H1")),
                    "velocity / sqrt(g L)",
                ),
            ),
        ),
        mirror=True,
    ),
)
