"""Tables that every scene of the material point method has: box, material, walls, time, solver, particles.

Friction coefficients are physical (ERRATA 1). SI units; the vertical is the last axis.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.parameters import MOST_FRAMES, Count, Group, NotNegative, Positive, SceneParameters

FACES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")


class Box(Group):
    """[box]"""

    size: list[Positive] = Field(
        min_length=2, max_length=3, description="length (depth) height of the box, m"
    )
    cells: list[Count] = Field(min_length=2, max_length=3, description="number of grid cells along each axis")


class MaterialGroup(Group):
    """[material]"""

    density: Positive = Field(description="bulk density of the packed material, kg/m^3")
    friction: NotNegative = Field(
        description="friction coefficient at rest mu_s (2D: sine of the friction angle)"
    )
    friction_increment: NotNegative = Field(
        default=0.0, description="mu_D - mu_s: more friction in rapid flow"
    )
    inertial_reference: Positive = Field(
        default=0.4, description="inertial number I0 at which half of that is reached"
    )
    grain_diameter: NotNegative = Field(default=0.0, description="grain diameter, m")
    viscosity: NotNegative = Field(default=0.0, description="additional Newtonian viscosity, Pa s")
    max_volume_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0, description="volume fraction of the packed material (1: volumes are bulk volumes)"
    )
    packing_tolerance: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.02, description="matter within this share of it counts as packed and bears load"
    )
    static_excess: NotNegative = Field(
        default=0.0, description="relative excess of friction where loaded matter hardly shears"
    )
    static_shear_rate: NotNegative = Field(default=0.0, description="shear rate below which it acts, 1/s")


class FrictionalWall(Group):
    """Coulomb friction between material and wall."""

    friction: NotNegative


WallChoice = Literal["stick", "slip"] | FrictionalWall


def wall_key(default: str | None, description: str, words: str = '"stick", "slip"') -> Any:
    """A key of [walls] that takes some words, or a friction coefficient."""
    allowed = f"{words} or {{friction = F}} with F a finite number >= 0"
    return Field(default=default, description=description, json_schema_extra={"accepted": allowed})


class WallsGroup(Group):
    """[walls]"""

    x_min: WallChoice = wall_key("slip", "back wall")
    x_max: WallChoice = wall_key("slip", "front wall")
    y_min: WallChoice | None = wall_key(None, "side wall (3D only)")
    y_max: WallChoice | None = wall_key(None, "side wall (3D only)")
    z_min: WallChoice = wall_key("stick", "floor")
    z_max: WallChoice = wall_key("slip", "lid")


class TimeGroup(Group):
    """[time]"""

    end: Positive = Field(description="simulated time, s")
    frame_rate: Positive = Field(description="frames stored per second")
    step: Positive = Field(description="longest time step, s")
    adaptive: bool = Field(
        True, description="shorten steps so that no particle crosses more than `cfl` cells in one"
    )
    cfl: Positive = Field(default=1.0, description="cells the fastest particle may cross in an adaptive step")


class SolverGroup(Group):
    """[solver]"""

    method: str = Field(default="auto", min_length=1, description="name of the friction solver")
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-4, description="largest certificate of a step"
    )
    max_sweeps: Count = Field(default=10_000, description="most solver iterations in a step")
    min_sweeps: Annotated[int, Field(ge=0)] = Field(
        default=5, description="fewest solver iterations in a step"
    )


class ParticlesGroup(Group):
    """[particles]"""

    per_cell: Annotated[int, Field(ge=1, le=16)] = Field(
        default=3, description="particles along each axis of a cell"
    )
    transfer: Literal["apic", "pic"] = Field(
        default="apic", description="velocity transfer; apic keeps angular momentum"
    )
    move_cfl: Positive = Field(default=0.5, description="cells a particle may cross in a substep of its move")


class GranularParameters(SceneParameters):
    """What complete scenes of the material point method share: a box with a grid, walls, time."""

    if TYPE_CHECKING:  # each kind declares its tables in its own order, which is that of its files
        box: Box
        time: TimeGroup

    @property
    def dimension(self) -> int:
        """2 or 3, the length of `box.size`."""
        return len(self.box.size)

    @property
    def size(self) -> str:
        """The cells of the grid."""
        return " x ".join(str(count) for count in self.box.cells) + " cells"

    @property
    def spacing(self) -> list[float]:
        """Edges of a grid cell (m)."""
        return [size / cells for size, cells in zip(self.box.size, self.box.cells, strict=True)]

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return self.time.frame_rate

    @property
    def frame_count(self) -> int:
        """Frames after the initial one: the run ends with the first frame at or after `time.end`."""
        return max(1, math.ceil(self.time.end * self.time.frame_rate * (1.0 - 1e-12)))

    @classmethod
    def completed(cls, tables: dict[str, Any]) -> dict[str, Any]:
        """In 3D, side walls that are not given slip."""
        size = tables.get("box", {}).get("size")
        if isinstance(size, list) and len(size) == 3:
            tables["walls"] = {"y_min": "slip", "y_max": "slip", **tables.get("walls", {})}
        return tables

    def check_box(self, walls: Group, table: str = "walls") -> None:
        """Raise InputError unless size and cells agree, the walls of [table] exist and the frames can be numbered."""
        box = self.box
        if len(box.cells) != len(box.size):
            raise InputError("box.cells", box.cells, f"{len(box.size)} numbers, as many as box.size has")
        for face in ("y_min", "y_max"):
            wall = getattr(walls, face)
            if self.dimension == 2 and wall is not None:
                raise InputError(f"{table}.{face}", _wall_text(wall), "left out in 2D (x and z only)")
        if self.frame_count > MOST_FRAMES:
            raise InputError(
                "time.frame_rate",
                self.time.frame_rate,
                f"such that there are fewer than {MOST_FRAMES + 1} frames",
            )


def _wall_text(wall: str | Group) -> str:
    if isinstance(wall, str):
        return wall
    given = wall.model_dump(exclude_none=True)
    return "{" + ", ".join(f"{key} = {value}" for key, value in given.items()) + "}"
