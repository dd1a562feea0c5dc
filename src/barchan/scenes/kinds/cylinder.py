"""Flow driven by gravity past a cylinder in a channel (seed A 6.3, Fig. 14-16), without inertia; units of the width L.

x points along gravity and the flow, the cylinder is centred at the origin. Half of the channel is simulated, y >= 0;
drag, area and flux are those of the whole. A pressure on the downstream end sets the speed: the lower, the faster.
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
    Material,
    NoSlip,
    Pressure,
    Symmetry,
    observables,
)
from barchan.scenes.continuum import (
    ContinuumHeader,
    ContinuumModel,
    ContinuumParameters,
    Curve,
    ElementsGroup,
    GranularSolverGroup,
    Shown,
    continuum_kind,
)
from barchan.scenes.parameters import Count, Group, NotNegative, Positive
from barchan.spaces.meshes import channel_with_cylinder
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]

VANISHING = 1e-3
"""Pressure / (rho g L) below which matter counts as come apart: far below any other, far above the solver's tolerance."""

UNSHEARED = 1e-3
"""Shear rate, in units of the greatest speed / diameter, below which matter ahead of the cylinder counts as rigid."""


class CylinderHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["cylinder"] = Field(description="what is simulated: the flow past a cylinder")


class MaterialGroup(Group):
    """[material]"""

    mu: NotNegative = Field(default=0.5, description="friction coefficient")
    reynolds: Positive = Field(default=100.0, description="Re = rho sqrt(g L) L / viscosity")
    bingham: NotNegative = Field(default=0.0, description="Bi = yield stress without pressure / (rho g L)")


class GeometryGroup(Group):
    """[geometry]"""

    diameter: Positive = Field(default=0.25, description="diameter of the cylinder")
    width: Positive = Field(default=1.0, description="width of the channel")
    before: Positive = Field(default=1.5, description="length of the channel upstream of the centre")
    after: Positive = Field(default=1.5, description="length of the channel downstream of the centre")
    vertices: Count = Field(default=700, description="vertices of the mesh of half of the channel, nearly")


class ConditionsGroup(Group):
    """[conditions]"""

    sides: Literal["no_slip", "free_slip"] = Field(default="no_slip", description="sides of the channel")
    external_pressure: NotNegative = Field(
        default=0.8, description="pressure on the downstream end / (rho g L)"
    )


class CylinderParameters(ContinuumParameters):
    """A complete scene of kind "cylinder"."""

    scene: CylinderHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    conditions: ConditionsGroup = ConditionsGroup()
    elements: ElementsGroup = ElementsGroup()
    solver: GranularSolverGroup = GranularSolverGroup()

    @property
    def size(self) -> str:
        """The vertices asked for."""
        return f"{self.geometry.vertices} vertices"

    def check(self) -> None:
        """Raise InputError unless the cylinder fits into the channel."""
        super().check()
        geometry = self.geometry
        if geometry.diameter > 0.9 * geometry.width:
            raise InputError(
                "geometry.diameter", geometry.diameter, f"at most 0.9 of the width {geometry.width:g}"
            )
        for name in ("before", "after"):
            if getattr(geometry, name) <= geometry.diameter:
                raise InputError(
                    f"geometry.{name}", getattr(geometry, name), f"above the diameter {geometry.diameter:g}"
                )


class CylinderModel(ContinuumModel):
    """The model of the channel."""

    parameters: CylinderParameters

    def build(self) -> DenseFlow:
        """No slip on the cylinder, a free upstream end, a pressure on the downstream one."""
        geometry, elements = self.parameters.geometry, self.parameters.elements
        mesh = channel_with_cylinder(
            geometry.diameter, geometry.width, geometry.before, geometry.after, geometry.vertices, half=True
        )
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        given = self.parameters.conditions
        conditions: dict[str, Condition] = {
            "axis": Symmetry(),
            "sides": NoSlip() if given.sides == "no_slip" else FreeSlip(),
            "cylinder": NoSlip(),
            "outflow": Pressure(given.external_pressure),
        }
        material = self.parameters.material
        matter = Material.dimensionless(material.reynolds, material.bingham, mu=material.mu)
        return DenseFlow(space, matter, conditions, gravity=(1.0, 0.0))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Mean upstream velocity U, drag F and its parts, Fr = U / sqrt(D/L), C_D = 2 F / (U^2 D/L), wake, rigid area ahead.

        C_D is infinite when nothing flows. In the wake the pressure vanishes; rigid is what is not sheared.
        """
        geometry = self.parameters.geometry
        ratio = geometry.diameter / geometry.width
        speed = -2.0 * observables.discharge(self.flow, state, "inflow") / geometry.width
        drag = 2.0 * float(observables.drag(self.flow, state, "cylinder")[0])
        contact, viscous = observables.drag_parts(self.flow, state, "cylinder")
        dynamic = 0.5 * speed**2 * ratio
        wake, ahead = self._zones()
        pressures, weights = observables.pressures(self.flow, state), self.space.weights
        rates = observables.shear_rates(self.flow, state)
        rigid = ahead & (rates < UNSHEARED * self.max_speed(state) / geometry.diameter)
        return {
            "mean_velocity": speed,
            "drag": drag,
            "drag_contact": 2.0 * float(contact[0]),
            "drag_viscous": 2.0 * float(viscous[0]),
            "froude": speed / np.sqrt(ratio),
            "drag_coefficient": drag / dynamic if dynamic > 0.0 else np.inf,
            "wake_pressure": float(np.average(pressures[wake], weights=weights[wake])),
            "wake_length": self._wake_length(pressures),
            "front_pressure": float(np.average(pressures[ahead], weights=weights[ahead])),
            "max_pressure": float(pressures.max()),
            "rigid_area_ahead": 2.0 * float(weights[rigid].sum()),
        }

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """The axis ahead of the cylinder and behind it: velocity and pressure."""
        geometry = self.parameters.geometry
        edge = 0.5 * geometry.diameter
        found: dict[str, Vector] = {}
        for name, start, end in (("ahead", -geometry.before, -edge), ("behind", edge, geometry.after)):
            points, velocities, pressures = self.line(state, (start, 0.0), (end, 0.0))
            found |= {
                f"{name}_x": points[:, 0],
                f"{name}_ux": velocities[:, 0],
                f"{name}_pressure": pressures,
            }
        return found

    def _zones(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Points behind the cylinder, within a quarter of a diameter of its rear and of the axis; points ahead of it.

        Matter closes the wake again further behind, the sooner the slower it flows.
        """
        diameter = self.parameters.geometry.diameter
        x, y = self.space.points.T
        wake = (y < 0.25 * diameter) & (x > 0.0) & (x < 0.75 * diameter)
        ahead = (y < 0.5 * diameter) & (x < 0.0) & (x > -1.5 * diameter)
        return wake, ahead

    def _wake_length(self, pressures: Vector) -> float:
        """Length of the axis behind the cylinder without pressure; all of it if the pressure never rises."""
        geometry, (x, y) = self.parameters.geometry, self.space.points.T
        rear = 0.5 * geometry.diameter
        near = (y < 0.1 * geometry.diameter) & (x > rear) & (pressures > VANISHING)
        return float(x[near].min(initial=geometry.after)) - rear


KIND = continuum_kind(
    "cylinder",
    CylinderParameters,
    CylinderModel,
    Shown(
        figures=(
            ("mean_velocity", "mean upstream velocity"),
            ("drag", "drag / (rho g L^2)"),
            ("drag_contact", "of it by the contact stress"),
            ("drag_coefficient", "drag coefficient"),
            ("froude", "Froude number"),
            ("wake_pressure", "pressure behind the cylinder / (rho g L)"),
            ("wake_length", "length without pressure behind the cylinder / L"),
            ("rigid_area_ahead", "rigid area ahead of the cylinder / L^2"),
        ),
        curves=(
            (
                "ahead",
                Curve("ahead_x", "x / L", (("ahead_pressure", "pressure ahead"),), "pressure / (rho g L)"),
            ),
            (
                "behind",
                Curve("behind_x", "x / L", (("behind_ux", "velocity behind"),), "velocity / sqrt(g L)"),
            ),
        ),
        mirror=True,
    ),
)
