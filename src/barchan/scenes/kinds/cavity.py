"""Incompressible Bingham fluid in a unit square whose lid moves along x with unit speed; no gravity, no inertia.

Lengths are in units of the side L, speeds of that of the lid V, stresses of eta V / L: bingham = tau0 L / (eta V). The
box is closed, so div u >= 0 everywhere means div u = 0. The lid's corners belong to the side walls, which do not slip.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from barchan.flows.dense import Condition, DenseFlow, DenseState, Material, NoSlip, Velocity, observables
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
from barchan.spaces.extrema import greatest
from barchan.spaces.meshes import rectangle
from barchan.spaces.mixed import MixedSpace

Vector = NDArray[np.float64]


class CavityHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["cavity"] = Field(description="what is simulated: a lid-driven cavity")


class MaterialGroup(Group):
    """[material]"""

    bingham: NotNegative = Field(
        default=2.0, description="Bi = tau0 L / (eta V), L the side, V speed of the lid"
    )


class GeometryGroup(Group):
    """[geometry]"""

    cells: Cells = Field(default=32, description="cells along each side")
    grading: Annotated[float, Field(gt=0.0)] = Field(
        default=2.0, description="width of the cells in the middle over that at the sides"
    )


class CavityElementsGroup(ElementsGroup):
    """[elements]: a continuous stress, as in the stable pair of Taylor and Hood."""

    stress: Literal["P0", "P1", "P1d", "P2d"] = Field(
        default="P1", description="stresses; d: discontinuous between cells"
    )


class CavityParameters(ContinuumParameters):
    """A complete scene of kind "cavity"."""

    scene: CavityHeader
    material: MaterialGroup = MaterialGroup()
    geometry: GeometryGroup = GeometryGroup()
    elements: CavityElementsGroup = CavityElementsGroup()
    solver: SolverGroup = SolverGroup()

    @property
    def size(self) -> str:
        """The cells of the square."""
        return f"{self.geometry.cells} x {self.geometry.cells} cells"


class CavityModel(ContinuumModel):
    """The model of the cavity."""

    parameters: CavityParameters

    def build(self) -> DenseFlow:
        """A closed box with a moving lid."""
        geometry, elements = self.parameters.geometry, self.parameters.elements
        mesh = rectangle((0.0, 0.0), (1.0, 1.0), (geometry.cells,) * 2, grading=geometry.grading)
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        conditions: dict[str, Condition] = {
            "top": Velocity((1.0, 0.0)),
            "left": NoSlip(),
            "right": NoSlip(),
            "bottom": NoSlip(),
        }
        material = Material(bingham=self.parameters.material.bingham)
        return DenseFlow(space, material, conditions, gravity=(0.0, 0.0))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Centre and strength of the vortex, area that does not yield, slowest u_x on x = 1/2 and its height."""
        centre, strength = self._vortex(state)
        rigid = observables.rigid(self.flow, state)
        y, ux = self._centreline(state)
        low = int(np.argmin(ux))
        return {
            "vortex_x": centre[0],
            "vortex_y": centre[1],
            "vortex_strength": strength,
            "plug_area": float(self.space.weights[rigid].sum()),
            "centreline_min": float(ux[low]),
            "centreline_min_y": float(y[low]),
        }

    def lines(self, state: DenseState) -> dict[str, Vector]:
        """u_x along x = 1/2 and u_y along y = 1/2."""
        y, ux = self._centreline(state)
        points, velocities, _ = self.line(state, (0.0, 0.5), (1.0, 0.5))
        return {
            "centreline_y": y,
            "centreline_ux": ux,
            "centreline_x": points[:, 0],
            "centreline_uy": velocities[:, 1],
        }

    def _centreline(self, state: DenseState) -> tuple[Vector, Vector]:
        points, velocities, _ = self.line(state, (0.5, 0.0), (0.5, 1.0))
        return points[:, 1], velocities[:, 0]

    def _vortex(self, state: DenseState) -> tuple[tuple[float, float], float]:
        """Place and value of the largest |psi|, psi = 0 on the walls, by a parabola through the vertices around it."""
        vertices = self.space.mesh.p.T
        psi = observables.stream_function(self.flow, state)
        psi = psi - psi[int(np.argmin(vertices.sum(axis=1)))]
        return greatest(vertices, psi)


CENTRELINE = (
    "centreline",
    Curve("centreline_y", "y / L", (("centreline_ux", "u_x on x = L/2"),), "velocity / V", upright=True),
)
"""The picture of the velocity on the middle line of a cavity."""

KIND = continuum_kind(
    "cavity",
    CavityParameters,
    CavityModel,
    Shown(
        figures=(
            ("vortex_x", "vortex centre x"),
            ("vortex_y", "vortex centre y"),
            ("centreline_min", "slowest u_x on x = 1/2"),
            ("plug_area", "area that does not yield"),
        ),
        curves=(CENTRELINE,),
    ),
)
