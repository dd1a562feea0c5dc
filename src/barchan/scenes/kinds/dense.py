"""A dense flow on any mesh file, with a condition on each named part of its boundary (seeds A and B chapter 6).

The mesh is read from `[mesh] file`, relative to the scene file; scene.toml keeps its full path. Parts without a
condition are free of stress.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

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
    Pressure,
    Stress,
    Symmetry,
    Velocity,
    observables,
)
from barchan.scenes.continuum import (
    ContinuumHeader,
    ContinuumModel,
    GranularSolverGroup,
    InertialParameters,
    Shown,
    TimeGroup,
    continuum_kind,
)
from barchan.scenes.parameters import Group, NotNegative, Positive
from barchan.spaces.meshes import read_mesh
from barchan.spaces.mixed import MixedSpace

_KEYS = {  # type of a condition -> the key that it needs, and those it may have
    "no_slip": (None, ()),
    "free_slip": (None, ()),
    "symmetry": (None, ()),
    "velocity": ("value", ()),
    "pressure": ("pressure", ()),
    "stress": ("stress", ()),
    "friction": ("friction", ("value",)),
}


class DenseHeader(ContinuumHeader):
    """[scene]"""

    kind: Literal["dense"] = Field(description="what is simulated: a dense flow on a mesh from a file")
    dimensionless: bool = Field(  # type: ignore[assignment]
        default=False, description="lengths, speeds, stresses have no units; otherwise SI"
    )


class MeshGroup(Group):
    """[mesh]"""

    file: str = Field(
        min_length=1, description="mesh file of any format of meshio, relative to the scene file"
    )


class BoundaryGroup(Group):
    """A condition of [boundaries]."""

    type: Literal["no_slip", "free_slip", "symmetry", "velocity", "pressure", "stress", "friction"] = Field(
        description="what holds there"
    )
    value: list[float | Literal["free"]] | None = Field(
        default=None,
        description="velocity, or that of a frictional wall",
        json_schema_extra={"accepted": 'a number, or "free" of a velocity, for each axis'},
    )
    pressure: float | None = Field(default=None, description="external pressure")
    stress: list[list[float]] | None = Field(
        default=None,
        description="external stress, tension positive",
        json_schema_extra={"accepted": "a row of numbers for each axis"},
    )
    friction: NotNegative | None = Field(default=None, description="friction coefficient of a wall")


class BoundariesGroup(Group):
    """[boundaries]: the name of a part of the boundary -> its condition."""

    model_config = ConfigDict(extra="allow")
    entries = BoundaryGroup

    __pydantic_extra__: dict[str, BoundaryGroup] = Field(init=False)


class MaterialGroup(Group):
    """[material]"""

    viscosity: NotNegative = Field(default=1.0, description="viscosity, Pa s; or 1/Re")
    mu: NotNegative = Field(default=0.0, description="friction coefficient at rest")
    bingham: NotNegative = Field(default=0.0, description="yield stress without pressure, Pa; or Bi")
    tensile_yield: NotNegative = Field(default=0.0, description="cohesion: tension sustained, Pa")
    dilatancy: NotNegative = Field(default=0.0, description="expansion per shear, at most mu")
    density: Positive = Field(default=1.0, description="density, kg/m^3")
    mu_increment: NotNegative = Field(
        default=0.0, description="growth of the friction coefficient in rapid flow, mu(I)"
    )
    inertial_reference: Positive = Field(
        default=0.4, description="inertial number d du/dy / sqrt(p / rho) at which half of that is reached"
    )
    grain_diameter: NotNegative = Field(default=0.0, description="grain diameter of mu(I), m")


class FlowGroup(Group):
    """[flow]"""

    regime: Literal["creeping", "inertial"] = Field(
        default="creeping", description="steady without inertia, or in time from rest"
    )
    gravity: list[float] | None = Field(
        default=None,
        description="acceleration, m/s^2; left out: 9.81 down the last axis, 1 when dimensionless",
        json_schema_extra={"accepted": "a number for each axis"},
    )


class DenseElementsGroup(Group):
    """[elements]"""

    velocity: Literal["P1", "P2", "P3", "P4", "Q1", "Q2"] = Field(
        default="P2", description="velocities: P on triangles and tetrahedra, Q on quadrilaterals"
    )
    stress: Literal["P0", "P1", "P1d", "P2d"] = Field(
        default="P1d", description="stresses; d: discontinuous between cells"
    )
    imposed: Literal["auto", "factored", "projected"] = Field(
        default="auto", description="how strain rates reach the points of the stress"
    )


class DenseParameters(InertialParameters):
    """A complete scene of kind "dense"."""

    scene: DenseHeader
    mesh: MeshGroup
    boundaries: BoundariesGroup = BoundariesGroup()
    material: MaterialGroup = MaterialGroup()
    flow: FlowGroup = FlowGroup()
    elements: DenseElementsGroup = DenseElementsGroup()  # type: ignore[assignment]
    time: TimeGroup = TimeGroup()
    solver: GranularSolverGroup = GranularSolverGroup()

    @property
    def size(self) -> str:
        """The file."""
        return self.mesh.file

    @property
    def conditions(self) -> dict[str, BoundaryGroup]:
        """Name of a part -> its condition."""
        return self.boundaries.__pydantic_extra__ or {}

    @classmethod
    def anchored(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """The file of the mesh with its full path."""
        mesh = tables.get("mesh")
        if isinstance(mesh, dict) and isinstance(mesh.get("file"), str) and mesh["file"]:
            tables["mesh"] = {**mesh, "file": str((folder / mesh["file"]).resolve())}
        return tables

    def check(self) -> None:
        """Raise InputError unless the keys of every condition fit its type and the mesh file is there."""
        super().check()
        for name, condition in self.conditions.items():
            needed, allowed = _KEYS[condition.type]
            for key in ("value", "pressure", "stress", "friction"):
                given = getattr(condition, key)
                if key == needed and given is None:
                    raise InputError(
                        f"boundaries.{name}.{key}", "missing", f'given, with type = "{condition.type}"'
                    )
                if given is not None and key != needed and key not in allowed:
                    raise InputError(
                        f"boundaries.{name}.{key}", given, f'left out, with type = "{condition.type}"'
                    )
            if condition.type == "friction" and condition.value and "free" in condition.value:
                raise InputError(
                    f"boundaries.{name}.value", condition.value, "the velocity of the wall, all numbers"
                )
        if not Path(self.mesh.file).is_file():
            raise InputError("mesh.file", self.mesh.file, "a file that exists")


class DenseModel(ContinuumModel):
    """The model of a flow on a mesh from a file."""

    parameters: DenseParameters

    def __init__(self, parameters: DenseParameters) -> None:
        super().__init__(parameters, parameters.time if parameters.inertial else None)

    def build(self) -> DenseFlow:
        """The flow. Raises InputError for a mesh or a condition that it rejects."""
        elements, given = self.parameters.elements, self.parameters.conditions
        mesh = read_mesh(self.parameters.mesh.file)
        for name in given:
            if name not in mesh.boundaries:
                parts = ", ".join(mesh.boundaries)
                raise InputError(
                    f"boundaries.{name}", "unknown", f"a part of the boundary of the mesh: {parts}"
                )
        d = mesh.p.shape[0]
        for name, entry in given.items():
            if entry.value is not None and len(entry.value) != d:
                raise InputError(f"boundaries.{name}.value", entry.value, f"{d} entries")
            if entry.stress is not None and (
                len(entry.stress) != d or {len(row) for row in entry.stress} != {d}
            ):
                raise InputError(f"boundaries.{name}.stress", entry.stress, f"{d} rows of {d} numbers")
        space = MixedSpace(mesh, elements.velocity, elements.stress, elements.imposed)
        conditions = {name: condition_of(entry) for name, entry in given.items()}
        return DenseFlow(space, self._material(), conditions, self._gravity(space.dimension))

    def scalars(self, state: DenseState) -> dict[str, float]:
        """Outflow through every part of the boundary, force on every solid one, greatest pressure."""
        found = {"max_pressure": float(observables.pressures(self.flow, state).max())}
        for name in self.space.mesh.boundaries:
            found[f"outflow_{name}"] = observables.discharge(self.flow, state, name)
            condition = self.parameters.conditions.get(name)
            if condition is not None and condition.type in ("no_slip", "friction"):
                force = observables.drag(self.flow, state, name)
                found |= {f"force_{axis}_{name}": float(f) for axis, f in zip("xyz", force, strict=False)}
        return found

    def _gravity(self, dimension: int) -> list[float]:
        given = self.parameters.flow.gravity
        if given is None:
            strength = 1.0 if self.parameters.scene.dimensionless else 9.81
            return [*[0.0] * (dimension - 1), -strength]
        if len(given) != dimension:
            raise InputError("flow.gravity", given, f"{dimension} numbers")
        return given

    def _material(self) -> Material:
        given = self.parameters.material
        mu: float | MuI = given.mu
        if given.mu_increment > 0.0:
            mu = MuI(
                given.mu, given.mu + given.mu_increment, given.inertial_reference, 2.0 * given.grain_diameter
            )
        return Material(
            mu, given.bingham, given.tensile_yield, given.dilatancy, given.viscosity, density=given.density
        )


def condition_of(entry: BoundaryGroup) -> Condition:
    """The condition that a table of [boundaries] describes."""
    if entry.type == "velocity":
        return Velocity([None if item == "free" else float(item) for item in entry.value or ()])
    if entry.type == "pressure":
        return Pressure(entry.pressure or 0.0)
    if entry.type == "stress":
        return Stress(np.array(entry.stress, dtype=float))
    if entry.type == "friction":
        return FrictionalWall(entry.friction or 0.0, entry.value)
    plain: dict[str, Condition] = {"no_slip": NoSlip(), "free_slip": FreeSlip(), "symmetry": Symmetry()}
    return plain[entry.type]


KIND = continuum_kind(
    "dense", DenseParameters, DenseModel, Shown(figures=(("max_pressure", "greatest pressure"),))
)
