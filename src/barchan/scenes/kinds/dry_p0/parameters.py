"""The parameters of dry grains in a box on a mesh, as they stand in a TOML file (seed B, 7.2.3).

Any consistent units; the presets take a length of the scene, gravity and the density of the packed matter as units. x runs to
the right from the left wall, the vertical is the last axis, z = 0 the floor. Friction coefficients are physical (ERRATA 1).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.friction import methods
from barchan.scenes.parameters import (
    MOST_FRAMES,
    Count,
    Group,
    NotNegative,
    Positive,
    SceneHeader,
    SceneParameters,
)

SIDES = {"x_min": "left", "x_max": "right", "z_min": "bottom", "z_max": "top"}
"""Keys of [walls] -> names of the parts of the mesh."""


class DryHeader(SceneHeader):
    """[scene]"""

    kind: Literal["dry_p0"] = Field(
        description="what is simulated: dry grains on a mesh, constant in each cell"
    )
    gravity: Positive = Field(default=1.0, description="gravity, downwards")


class MeshGroup(Group):
    """[mesh]"""

    size: list[Positive] = Field(min_length=2, max_length=2, description="length and height of the box")
    cells: list[Count] = Field(min_length=2, max_length=2, description="quadrilaterals along each axis")
    shape: Literal["quadrilateral", "triangle"] = Field(
        default="quadrilateral", description="shape of the cells; triangles are halves of quadrilaterals"
    )


class FillGroup(Group):
    """[fill]: the matter at the start, a packed rectangle on the floor."""

    length: Positive = Field(description="its length L0")
    height: Positive = Field(description="its height H0")
    position: NotNegative = Field(default=0.0, description="its distance from the left wall")


class OutletGroup(Group):
    """[outlet]: an opening of the floor."""

    width: NotNegative = Field(default=0.0, description="its width; 0: none")
    position: NotNegative = Field(default=0.0, description="its distance from the left wall")


class DryMaterialGroup(Group):
    """[material]"""

    density: Positive = Field(
        default=1.0, description="mass per volume of matter; bulk density with max_volume_fraction = 1"
    )
    friction: NotNegative = Field(description="friction coefficient at rest (sine of the friction angle)")
    friction_increment: NotNegative = Field(
        default=0.0, description="growth of friction in rapid flow, mu(I)"
    )
    inertial_reference: Positive = Field(
        default=0.4, description="inertial number I0 at which half of that is reached"
    )
    grain_diameter: NotNegative = Field(default=0.0, description="grain diameter of mu(I)")
    viscosity: NotNegative = Field(default=0.0, description="additional Newtonian viscosity")
    max_volume_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0, description="volume fraction of packed matter; below 1 the density is that of the grains"
    )


class DryFrictionalWall(Group):
    """Coulomb friction between matter and wall."""

    friction: NotNegative


DryWall = Literal["no_slip", "slip", "free"] | DryFrictionalWall


def _wall(default: str, description: str) -> Any:
    """A key of [walls]."""
    allowed = '"no_slip", "slip", "free" or {friction = F} with F a finite number >= 0'
    return Field(default=default, description=description, json_schema_extra={"accepted": allowed})


class DryWallsGroup(Group):
    """[walls]"""

    x_min: DryWall = _wall("slip", "left side")
    x_max: DryWall = _wall("slip", "right side")
    z_min: DryWall = _wall("no_slip", "floor, beside the outlet")
    z_max: DryWall = _wall("free", "lid")


class DryTimeGroup(Group):
    """[time]"""

    end: Positive = Field(description="simulated time")
    frame_rate: Positive = Field(description="frames stored per unit of time")
    step: Positive = Field(description="longest time step")
    cfl: Positive = Field(default=0.5, description="cells that the fastest matter may cross in a step")
    least_volume: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="end when no more than this share of the matter is left inside"
    )


class DrySolverGroup(Group):
    """[solver]"""

    method: str = Field(default="auto", min_length=1, description="name of the friction solver")
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-4, description="largest certificate of a step"
    )
    max_sweeps: Count = Field(default=40_000, description="most solver iterations in a step")
    min_sweeps: Annotated[int, Field(ge=0)] = Field(
        default=5, description="fewest solver iterations in a step"
    )
    inertia: Literal["explicit", "conservative"] = Field(
        default="explicit",
        description="how velocities are carried: explicit upwind, or implicit like the matter",
    )


class DryParameters(SceneParameters):
    """A complete scene of kind "dry_p0"."""

    units: ClassVar[str] = "consistent units"
    time_unit: ClassVar[str] = ""

    scene: DryHeader
    mesh: MeshGroup
    fill: FillGroup
    outlet: OutletGroup = OutletGroup()
    material: DryMaterialGroup
    walls: DryWallsGroup = DryWallsGroup()
    time: DryTimeGroup
    solver: DrySolverGroup = DrySolverGroup()

    @property
    def dimension(self) -> int:
        """Scenes of this kind are plane."""
        return 2

    @property
    def size(self) -> str:
        """The cells of the mesh."""
        halves = " x 2" if self.mesh.shape == "triangle" else ""
        return " x ".join(str(count) for count in self.mesh.cells) + halves + " cells"

    @property
    def spacing(self) -> tuple[float, float]:
        """Edges of a quadrilateral."""
        (length, height), (along, up) = self.mesh.size, self.mesh.cells
        return length / along, height / up

    @property
    def frame_rate(self) -> float:
        """Frames per unit of time."""
        return self.time.frame_rate

    @property
    def frame_count(self) -> int:
        """Most frames after the initial one."""
        return max(1, math.ceil(self.time.end * self.time.frame_rate * (1.0 - 1e-12)))

    def check(self) -> None:
        """Raise InputError unless matter and outlet fit into the box, the outlet has a cell and the solver exists."""
        length, height = self.mesh.size
        room = length - self.fill.position
        if room <= 0.0:
            raise InputError(
                "fill.position", self.fill.position, f"less than the length {length:g} of the box"
            )
        if self.fill.length > room * (1.0 + 1e-12):
            raise InputError("fill.length", self.fill.length, f"at most {room:g}, the room in the box")
        if self.fill.height > height * (1.0 + 1e-12):
            raise InputError("fill.height", self.fill.height, f"at most the height {height:g} of the box")
        outlet, cell = self.outlet, self.spacing[0]
        if outlet.width > 0.0:
            if outlet.width < cell * (1.0 - 1e-9):
                raise InputError(
                    "outlet.width", outlet.width, f"at least one cell of the mesh wide ({cell:g})"
                )
            if outlet.position + outlet.width > length * (1.0 + 1e-12):
                raise InputError(
                    "outlet.width", outlet.width, f"such that it ends within the box ({length:g})"
                )
        if self.solver.method not in methods():
            raise InputError("solver.method", self.solver.method, "one of " + ", ".join(methods()))
        if self.frame_count > MOST_FRAMES:
            raise InputError(
                "time.frame_rate",
                self.time.frame_rate,
                f"such that there are fewer than {MOST_FRAMES + 1} frames",
            )
