"""Avalanche on an infinite inclined plane (seed A 6.1.3, Fig. 6-7): a patch [0, 1]^2 of a layer of height 1 on a rough base.

Where the layer shears, eta u' = (1 - y) (sin a - mu cos a). With the viscosity eta = |D(u)| = u'/2 that is Bagnold's
profile u' = sqrt(2 (sin a - mu cos a)) (1 - y)^(1/2) (ERRATA 2), with eta = 1 a parabola. Below the angle of friction
nothing moves. The ends bear the exact stress: pressure (1 - y) cos a, shear stress (1 - y) sin a.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.flows.dense import Condition, DenseFlow, DenseState, Material, NoSlip, RateViscosity, Stress
from barchan.scenes.continuum import (
    Cells,
    ContinuumHeader,
    ContinuumModel,
    ContinuumParameters,
    Curve,
    ElementsGroup,
    Shown,
    SolverGroup,
    continuum_kind,
)
from barchan.scenes.parameters import Group, NotNegative
from barchan.spaces.meshes import tensor_rectangle
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]

SMALLEST_VISCOSITY = 1e-3
"""Bagnold's viscosity vanishes at the surface; this share of that at the base keeps the problem definite."""


class BagnoldHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["bagnold"] = Field(description="what is simulated: a layer on an inclined plane")


class MaterialGroup(Group):
    """[material]"""

    mu: NotNegative = Field(default=0.5, description="friction coefficient")
    viscosity: Literal["rate", "constant"] = Field(
        default="rate", description="eta = |D(u)|, which gives Bagnold's profile, or eta = 1"
    )


class GeometryGroup(Group):
    """[geometry]"""

    angle: Annotated[float, Field(ge=0.0, lt=1.5)] | None = Field(
        default=None, description="inclination in radians; left out: atan(1.1 mu)"
    )
    cells: Cells = Field(default=32, description="cells across the layer, thinner towards its surface")


class BagnoldParameters(ContinuumParameters):
    """A complete scene of kind "bagnold"."""

    scene: BagnoldHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    elements: ElementsGroup = ElementsGroup()
    solver: SolverGroup = SolverGroup()

    @property
    def size(self) -> str:
        """The cells across."""
        return f"{self.geometry.cells} cells across"

    @property
    def angle(self) -> float:
        """Inclination (rad)."""
        return math.atan(1.1 * self.material.mu) if self.geometry.angle is None else self.geometry.angle

    @property
    def drive(self) -> float:
        """sin a - mu cos a, 0 below the angle of friction."""
        return max(math.sin(self.angle) - self.material.mu * math.cos(self.angle), 0.0)


class BagnoldModel(ContinuumModel):
    """The model of the layer; x along the slope, y across."""

    parameters: BagnoldParameters

    def build(self) -> DenseFlow:
        """No slip at the base, free surface, exact stress on the ends."""
        parameters = self.parameters
        elements, angle = parameters.elements, parameters.angle
        # The shear rate is like the root of the depth: cells whose depths are like cubes represent it up to the surface.
        heights = 1.0 - np.linspace(1.0, 0.0, parameters.geometry.cells + 1) ** 3
        along = np.linspace(0.0, 1.0, max(4, parameters.geometry.cells // 4) + 1)
        mesh = tensor_rectangle(along, heights)
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        ends = Stress(lambda x: exact_stress(x, angle))
        conditions: dict[str, Condition] = {"bottom": NoSlip(), "left": ends, "right": ends}
        material = Material(mu=parameters.material.mu, viscosity=self._viscosity())
        return DenseFlow(space, material, conditions, gravity=(math.sin(angle), -math.cos(angle)))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Velocity of the surface, and largest errors of velocity and shear rate along the profile."""
        lines = self.lines(state)
        scale = max(float(np.abs(lines["profile_exact"]).max()), 1e-300)
        steepest = max(float(np.abs(lines["profile_shear_rate_exact"]).max()), 1e-300)
        velocity = np.abs(lines["profile_ux"] - lines["profile_exact"]).max()
        rate = np.abs(lines["profile_shear_rate"] - lines["profile_shear_rate_exact"]).max()
        moving = self.parameters.drive > 0.0
        return {
            "surface_velocity": float(lines["profile_ux"][-1]),
            "surface_velocity_exact": float(lines["profile_exact"][-1]),
            "velocity_error": float(velocity / scale) if moving else float(velocity),
            "shear_rate_error": float(rate / steepest) if moving else float(rate),
        }

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """Profiles of u_x and du_x/dy across the middle of the patch, with the exact ones."""
        cells = self.parameters.geometry.cells
        points, velocities, _ = self.line(state, (0.5, 0.0), (0.5, 1.0), 4 * cells + 1)
        y, ux = points[:, 1], velocities[:, 0]
        rate = self._shear_rates(state, y)
        exact, exact_rate = self.exact(y)
        return {
            "profile_y": y,
            "profile_ux": ux,
            "profile_exact": exact,
            "profile_shear_rate": rate,
            "profile_shear_rate_exact": exact_rate,
        }

    def exact(self, y: Vector) -> tuple[Vector, Vector]:
        """u_x and du_x/dy of the steady layer at y (n,)."""
        drive, depth = self.parameters.drive, 1.0 - y
        if self.parameters.material.viscosity == "constant":
            return drive * (1.0 - depth**2) / 2.0, drive * depth
        steepest = math.sqrt(2.0 * drive)
        return steepest * (1.0 - depth**1.5) * 2.0 / 3.0, steepest * np.sqrt(depth)

    def _viscosity(self) -> Any:
        if self.parameters.material.viscosity == "constant" or self.parameters.drive == 0.0:
            return 1.0  # where nothing moves |D| = 0 is no viscosity, and any other shows the same rest
        base = 0.5 * math.sqrt(2.0 * self.parameters.drive)  # |D| at the base
        return RateViscosity(lambda rate: rate, smallest=SMALLEST_VISCOSITY * base, reference_rate=0.5 * base)

    def _shear_rates(self, state: DenseState, y: Vector) -> Vector:
        """du_x/dy at x = 1/2, y (n,): differences over a small share of the depth, one-sided at the ends."""
        step = 0.01 * np.maximum(1.0 - y, 1.0 / self.parameters.geometry.cells**3)
        low, high = np.maximum(y - step, 0.0), np.minimum(y + step, 1.0)
        columns = [np.column_stack([np.full_like(y, 0.5), place]) for place in (low, high)]
        below, above = (self.space.at(state.velocity, column)[:, 0] for column in columns)
        return np.asarray((above - below) / (high - low))


def exact_stress(x: Vector, angle: float) -> Vector:
    """(n, 2, 2) total stress (tension positive) of the steady layer at points (n, 2)."""
    depth = 1.0 - x[:, 1]
    stress = np.empty((len(x), 2, 2))
    stress[:, 0, 0] = stress[:, 1, 1] = -depth * math.cos(angle)
    stress[:, 0, 1] = stress[:, 1, 0] = depth * math.sin(angle)
    return stress


KIND = continuum_kind(
    "bagnold",
    BagnoldParameters,
    BagnoldModel,
    Shown(
        figures=(
            ("surface_velocity", "velocity of the surface"),
            ("surface_velocity_exact", "  exact"),
            ("velocity_error", "largest error of the velocity, of its peak"),
            ("shear_rate_error", "largest error of the shear rate, of its peak"),
        ),
        curves=(
            (
                "profile",
                Curve(
                    "profile_y",
                    "y / H",
                    (("profile_ux", "computed"), ("profile_exact", "exact")),
                    "velocity / sqrt(g H)",
                    upright=True,
                ),
            ),
            (
                "shear_rate",
                Curve(
                    "profile_y",
                    "y / H",
                    (("profile_shear_rate", "computed"), ("profile_shear_rate_exact", "exact")),
                    "shear rate sqrt(H / g)",
                    upright=True,
                ),
            ),
        ),
    ),
)
