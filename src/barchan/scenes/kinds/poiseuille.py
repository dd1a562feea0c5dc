"""Bingham Poiseuille flow in a channel -1 <= y <= 1 driven by gravity along x (seed A 6.1.1-6.1.2, Fig. 3-5); Re = 1.

Without inertia the shear stress is y in absolute value, so matter moves as one where |y| <= Bi, and elsewhere
u'(|y|) = -(|y| - Bi), which gives u = ((1 - Bi)^2 - max(|y| - Bi, 0)^2) / 2.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.flows.dense import Condition, DenseFlow, DenseState, Material, NoSlip, Velocity
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
from barchan.scenes.parameters import Group, NotNegative, Positive
from barchan.spaces.meshes import rectangle
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]


FINE = 4001
AT_REST = 1e-7
"""Speed below which the whole channel counts as a plug."""


class PoiseuilleHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["poiseuille"] = Field(description="what is simulated: plane Bingham Poiseuille flow")


class MaterialGroup(Group):
    """[material]"""

    bingham: NotNegative = Field(
        default=0.5, description="Bi = yield stress / (rho g L), L half of the channel"
    )


class GeometryGroup(Group):
    """[geometry]"""

    length: Positive = Field(default=0.5, description="length of the channel that is simulated")
    cells: Cells = Field(default=32, description="cells across the channel; as wide along it")


class PoiseuilleParameters(ContinuumParameters):
    """A complete scene of kind "poiseuille"."""

    scene: PoiseuilleHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    elements: ElementsGroup = ElementsGroup()
    solver: SolverGroup = SolverGroup()

    @property
    def size(self) -> str:
        """The cells across."""
        return f"{self.geometry.cells} cells across"


class PoiseuilleModel(ContinuumModel):
    """The model of the channel."""

    parameters: PoiseuilleParameters

    def build(self) -> DenseFlow:
        """Walls without slip; on both ends the velocity is along the axis."""
        geometry, elements = self.parameters.geometry, self.parameters.elements
        along = max(2, math.ceil(geometry.length * geometry.cells / 2.0 - 1e-9))
        mesh = rectangle((-geometry.length, -1.0), (0.0, 1.0), (along, geometry.cells))
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        conditions: dict[str, Condition] = {
            "bottom": NoSlip(),
            "top": NoSlip(),
            "left": Velocity((None, 0.0)),
            "right": Velocity((None, 0.0)),
        }
        material = Material.dimensionless(1.0, self.parameters.material.bingham)
        return DenseFlow(space, material, conditions, gravity=(1.0, 0.0))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Errors of the velocity in the maximum and H1 norms, width of the plug, peak velocity and flux."""
        bingham = self.parameters.material.bingham
        exact = exact_velocity(self.space.nodes[:, 1], bingham)
        nodal = state.velocity.reshape(-1, 2)
        difference = np.hypot(nodal[:, 0] - exact, nodal[:, 1])
        return {
            "error_max": float(difference.max()),
            "error_h1": self._h1_error(state, bingham),
            "peak": float(nodal[:, 0].max()),
            "peak_exact": 0.5 * max(1.0 - bingham, 0.0) ** 2,
            "plug_width": self._plug_width(state),
            "plug_width_exact": 2.0 * min(bingham, 1.0),
        }

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """The profile across the middle of the simulated length."""
        middle = -0.5 * self.parameters.geometry.length
        points, velocities, _ = self.line(state, (middle, -1.0), (middle, 1.0))
        y = points[:, 1]
        return {
            "profile_y": y,
            "profile_ux": velocities[:, 0],
            "profile_exact": exact_velocity(y, self.parameters.material.bingham),
        }

    def _plug_width(self, state: DenseState) -> float:
        """Width over which u_x changes by less than 1 % of its steepest change, by differences over fine steps."""
        middle = -0.5 * self.parameters.geometry.length
        points, velocities, _ = self.line(state, (middle, -1.0), (middle, 1.0), FINE)
        steps = np.abs(np.diff(velocities[:, 0]))
        moving = float(np.abs(velocities[:, 0]).max()) > AT_REST
        flat = steps < 0.01 * steps.max() if moving else np.ones(len(steps), dtype=bool)
        return float(np.diff(points[:, 1])[flat].sum())

    def _h1_error(self, state: DenseState, bingham: float) -> float:
        """sqrt(integral of |grad(u - u_exact)|^2), by a quadrature fine enough for the kink at the edge of the plug."""
        space = self.space
        tables = space.tables(*space.element.quadrature(2 * space.element.velocity.degree + 2))
        nodal = state.velocity.reshape(-1, 2)[space.cell_nodes]
        gradients = np.einsum("ekc,eqkd->eqcd", nodal, tables.gradients, optimize=True)
        gradients[..., 0, 1] -= exact_shear_rate(tables.points[..., 1], bingham)
        return float(np.sqrt(np.einsum("eq,eqcd,eqcd->", tables.weights, gradients, gradients)))


def exact_velocity(y: Vector, bingham: float) -> Vector:
    """(n,) u_x of the steady flow at y (n,)."""
    beyond = np.maximum(np.abs(y) - bingham, 0.0)
    return np.asarray(0.5 * np.maximum(max(1.0 - bingham, 0.0) ** 2 - beyond**2, 0.0))


def exact_shear_rate(y: Vector, bingham: float) -> Vector:
    """du_x/dy of the steady flow at y."""
    return np.asarray(-np.sign(y) * np.maximum(np.abs(y) - bingham, 0.0))


KIND = continuum_kind(
    "poiseuille",
    PoiseuilleParameters,
    PoiseuilleModel,
    Shown(
        figures=(
            ("peak", "peak velocity"),
            ("peak_exact", "  exact"),
            ("plug_width", "width of the plug"),
            ("plug_width_exact", "  exact"),
            ("error_max", "error of the velocity, maximum norm"),
            ("error_h1", "error of the velocity, H1 norm"),
        ),
        curves=(
            (
                "profile",
                Curve(
                    "profile_y",
                    "y / L",
                    (("profile_ux", "computed"), ("profile_exact", "exact")),
                    "velocity / U",
                    upright=True,
                ),
            ),
        ),
    ),
)
