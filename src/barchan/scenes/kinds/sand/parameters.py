"""The parameters of a scene of kind "sand": pieces of matter and rigid bodies in a box (seed B 7.3 to 7.5).

SI units; the vertical is the last axis; friction coefficients are physical (ERRATA 1).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.granular.parameters import (
    Box,
    FrictionalWall,
    GranularParameters,
    ParticlesGroup,
    SolverGroup,
    TimeGroup,
    wall_key,
)
from barchan.scenes.kinds.sand.entries import (
    BodiesGroup,
    BodyTable,
    MaterialsGroup,
    MatterGroup,
    PieceOfMatter,
    SandMaterial,
    Share,
    vector_key,
)
from barchan.scenes.parameters import Group, NotNegative, Positive, SceneHeader

SAMPLE_MESH = "sample"


class SandHeader(SceneHeader):
    """[scene]"""

    kind: Literal["sand"] = Field(description="what is simulated: grains and rigid bodies in a box")
    gravity: NotNegative = Field(default=9.81, description="gravity, m/s^2")
    slope_deg: Annotated[float, Field(gt=-90.0, lt=90.0)] = Field(
        default=0.0, description="slope of the floor, falling along x, degrees"
    )


SandWall = Literal["stick", "slip", "open"] | FrictionalWall


def _wall(default: str | None, description: str) -> Any:
    return wall_key(default, description, '"stick", "slip", "open"')


class SandWalls(Group):
    """[walls]"""

    x_min: SandWall = _wall("slip", "wall at x = 0; matter leaves through an open one")
    x_max: SandWall = _wall("slip", "wall opposite")
    y_min: SandWall | None = _wall(None, "side wall (3D only)")
    y_max: SandWall | None = _wall(None, "side wall (3D only)")
    z_min: SandWall = _wall("stick", "floor")
    z_max: SandWall = _wall("slip", "lid")


class SandTime(TimeGroup):
    """[time]"""

    rest_speed: NotNegative = Field(
        default=0.0, description="the run ends at a frame when nothing is faster than this, m/s; 0: never"
    )


class SandSolver(SolverGroup):
    """[solver]"""

    multilevel: bool = Field(
        default=True, description="steps without stresses before them start from those of a coarser grid"
    )
    warm_start: Literal["grid", "particles"] = Field(
        default="grid", description="what keeps the stresses of the last step"
    )


class SandParticles(ParticlesGroup):
    """[particles]"""

    transfer: Literal["apic", "pic", "flip"] = Field(  # type: ignore[assignment]
        default="apic", description="velocity transfer; apic keeps angular momentum"
    )
    flip_share: Share = Field(
        default=0.95, description="share of the change of velocity in flip, the rest pic"
    )
    stress: Literal["Q1", "Q1d", "particles", "P1", "P1d"] = Field(
        default="Q1", description="stress space: on nodes, in cells (d), on particles"
    )
    velocity: Literal["Q1", "P1", "B2"] = Field(
        default="Q1", description="velocity space: multilinear, tetrahedra, quadratic splines"
    )
    volume_correction: Share = Field(default=0.3, description="share of excess volume removed in a step")
    resample: bool = Field(default=False, description="split stretched particles, merge close ones")
    split_ratio: Positive = Field(
        default=2.0, description="longest over shortest axis at which they split, above 1.59"
    )
    grains: Annotated[int, Field(ge=0, le=64)] = Field(
        default=0, description="passive grains drawn for each particle"
    )


class ObserveGroup(Group):
    """[observe]"""

    length: Positive | None = Field(default=None, description="length L0 that run-outs are relative to, m")
    height: Positive | None = Field(default=None, description="height H0 that heights are relative to, m")
    back: float = Field(default=0.0, description="abscissa that the front is measured from, m")
    level: NotNegative | None = Field(
        default=None, description="the volume above this height and its discharge are measured, m"
    )
    until_share: Share = Field(
        default=0.0, description="the run ends at a frame when less of that volume is left than this share"
    )
    outline: Literal["none", "heap", "crater"] = Field(
        default="none", description="whose outline seen from above is measured (3D)"
    )
    outline_height: NotNegative | None = Field(
        default=None,
        description="height of the surface at the outline; left out: an edge of a cell of the floor, m",
    )
    centre: list[float] | None = vector_key("centre (x, y) of the outline; left out: of the box, m")


class SandParameters(GranularParameters):
    """A complete scene of kind "sand"."""

    scene: SandHeader
    box: Box
    material: SandMaterial
    materials: MaterialsGroup = MaterialsGroup()
    matter: MatterGroup
    bodies: BodiesGroup = BodiesGroup()
    walls: SandWalls = SandWalls()
    time: SandTime
    solver: SandSolver = SandSolver()
    particles: SandParticles = SandParticles()
    observe: ObserveGroup = ObserveGroup()

    @property
    def gravity_vector(self) -> list[float]:
        """Gravity (d,) m/s^2 in the axes of the box, whose floor may slope."""
        angle, g = math.radians(self.scene.slope_deg), self.scene.gravity
        across = [0.0] * (self.dimension - 2)
        return [g * math.sin(angle), *across, -g * math.cos(angle)]

    def pieces(self) -> Iterator[tuple[str, PieceOfMatter]]:
        """Names and tables of the pieces of matter."""
        yield from (self.matter.model_extra or {}).items()

    def body_tables(self) -> Iterator[tuple[str, BodyTable]]:
        """Names and tables of the bodies."""
        yield from (self.bodies.model_extra or {}).items()

    def all_materials(self) -> dict[str, SandMaterial]:
        """The material of [material] under the empty name, first, then those of [materials]."""
        return {"": self.material, **(self.materials.model_extra or {})}

    @classmethod
    def anchored(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Mesh files of bodies are taken from the folder of the scene file."""
        bodies = tables.get("bodies", {})
        for body in bodies.values() if isinstance(bodies, dict) else ():
            name = body.get("file") if isinstance(body, dict) else None
            if isinstance(name, str) and name not in ("", SAMPLE_MESH):
                body["file"] = str((folder / name).resolve())
        return tables

    def check(self) -> None:
        """Raise InputError unless the tables fit together; bodies are checked when they are made."""
        self.check_box(self.walls)
        names = self.all_materials()
        if not list(self.pieces()):
            raise InputError("matter", "empty", "a table [matter.NAME] with keys shape, position, ...")
        for name, piece in self.pieces():
            if piece.material not in names:
                known = ", ".join(repr(one) for one in names if one) or "left out: there is no [materials]"
                raise InputError(f"matter.{name}.material", piece.material, known)
            check_vectors(f"matter.{name}", piece, ("position", "size", "velocity", "normal"), self.dimension)
        for name, body in self.body_tables():
            vectors = ("position", "size", "velocity", "force")
            check_vectors(f"bodies.{name}", body, vectors, self.dimension)
        self._check_observed()

    def _check_observed(self) -> None:
        observe = self.observe
        if (observe.length is None) != (observe.height is None):
            missing = "length" if observe.length is None else "height"
            raise InputError(f"observe.{missing}", "missing", "given with the other of length and height, m")
        if observe.outline != "none" and self.dimension == 2:
            raise InputError("observe.outline", observe.outline, "'none' in 2D")
        if observe.centre is not None and len(observe.centre) != self.dimension - 1:
            raise InputError("observe.centre", observe.centre, "two numbers, x and y, in 3D")
        if observe.until_share > 0.0 and observe.level is None:
            raise InputError("observe.level", "missing", "given with observe.until_share, m")


def check_vectors(field: str, table: Group, names: tuple[str, ...], dimension: int) -> None:
    """Raise InputError unless the vectors of a table, where given, have `dimension` components."""
    for name in names:
        value = getattr(table, name)
        if value is not None and len(value) != dimension:
            raise InputError(f"{field}.{name}", value, f"{dimension} numbers, one for each axis")
