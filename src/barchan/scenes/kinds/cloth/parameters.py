"""The parameters of a scene of kind "cloth": a sheet in contact with itself and with bodies that move as given.

SI units; the vertical is the last axis; friction coefficients are physical.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.kinds.cloth.entries import (
    ClothBodiesTable,
    ClothBodyEntry,
    ClothGroup,
    ClothMaterialGroup,
    PinsGroup,
)
from barchan.scenes.kinds.cloth.inverse import InverseGroup
from barchan.scenes.kinds.sand.entries import Share
from barchan.scenes.kinds.sand.parameters import check_vectors
from barchan.scenes.parameters import (
    Count,
    Group,
    NotNegative,
    ProblemWriting,
    SceneHeader,
    SteppedParameters,
    StepSolver,
    anchor_file,
)

_NEEDED = {
    "rectangle": ("size",), "disc": ("radius",), "skirt": ("waist_radius", "hem_radius", "length"), "mesh": (),
}  # fmt: skip


class ClothHeader(SceneHeader):
    """[scene]"""

    kind: Literal["cloth"] = Field(description="what is simulated: a cloth in frictional contact")
    gravity: NotNegative = Field(default=9.81, description="gravity, m/s^2")
    slope_deg: Annotated[float, Field(gt=-90.0, lt=90.0)] = Field(
        default=0.0, description="gravity is turned so that horizontal ground falls along x, degrees"
    )


class ClothContact(Group):
    """[contact]"""

    self_contact: bool = Field(default=False, description="whether the cloth touches itself")
    mixing: Literal["geometric", "mean", "min", "max"] = Field(
        default="geometric", description="friction of cloth and body from the coefficients of both"
    )
    recovery: Share = Field(default=0.5, description="share of an overlap pushed out in a step")
    margin: NotNegative = Field(
        default=0.0, description="gap up to which contacts are looked for beyond what a step needs, m"
    )
    allowed_overlap: NotNegative = Field(
        default=0.01, description="of cloth and bodies at the start, in thicknesses of the cloth"
    )


class ClothSolver(StepSolver):
    """[solver]"""

    method: str = Field(
        default="auto", min_length=1, description="friction solver; auto: nodal where it applies"
    )
    max_sweeps: Count = Field(default=20_000, description="most solver iterations in a step")
    iterations: Count = Field(default=1, description="linearisations of the elastic forces in a step")


class ClothObserve(ProblemWriting):
    """[observe]"""

    colour: Literal["speed", "height"] = Field(default="speed", description="of the cloth in pictures")


class ClothParameters(SteppedParameters):
    """A complete scene of kind "cloth"."""

    scene: ClothHeader
    cloth: ClothGroup
    material: ClothMaterialGroup = ClothMaterialGroup()
    pins: PinsGroup = PinsGroup()
    bodies: ClothBodiesTable = ClothBodiesTable()
    contact: ClothContact = ClothContact()
    inverse: InverseGroup = InverseGroup()
    solver: ClothSolver = ClothSolver()
    observe: ClothObserve = ClothObserve()

    @property
    def dimension(self) -> int:
        """3."""
        return 3

    @property
    def size(self) -> str:
        """How fine the cloth is, in words."""
        cloth = self.cloth
        if cloth.shape == "mesh":
            return f"the mesh {Path(cloth.file).name}"
        area = {
            "rectangle": math.prod(cloth.size or []), "disc": math.pi * (cloth.radius or 0.0) ** 2,
            "skirt": math.pi * ((cloth.waist_radius or 0.0) + (cloth.hem_radius or 0.0)) * (cloth.length or 0.0),
        }[cloth.shape]  # fmt: skip
        return f"about {area / (math.sqrt(0.75) * cloth.spacing**2):.0f} vertices"

    @property
    def gravity_vector(self) -> list[float]:
        """Gravity (3,) m/s^2, turned by the slope."""
        angle, g = math.radians(self.scene.slope_deg), self.scene.gravity
        return [g * math.sin(angle), 0.0, -g * math.cos(angle)]

    def obstacles(self) -> Iterator[tuple[str, ClothBodyEntry]]:
        """Names and tables of [bodies]."""
        yield from (self.bodies.model_extra or {}).items()

    @classmethod
    def anchored(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Mesh files are taken from the folder of the scene file."""
        anchor_file(tables.get("cloth"), folder)
        return super().anchored(tables, folder)

    def check(self) -> None:
        """Raise InputError unless the tables fit together; meshes and bodies are checked when they are made."""
        super().check()
        cloth, pins = self.cloth, self.pins
        check_vectors("cloth", cloth, ("position", "rotation", "velocity"), 3)
        for name, body in self.obstacles():
            vectors = ("position", "size", "normal", "rotation", "velocity", "spin", "amplitude", "swing")
            check_vectors(f"bodies.{name}", body, vectors, 3)
        for key in _NEEDED[cloth.shape]:
            if getattr(cloth, key) is None:
                raise InputError(f"cloth.{key}", "missing", f"given for a {cloth.shape}, m")
        if cloth.size is not None and len(cloth.size) != 2:
            raise InputError("cloth.size", cloth.size, "two numbers, m")
        if cloth.shape == "mesh" and not cloth.file:
            raise InputError("cloth.file", cloth.file, "a mesh file")
        only = {"corners": "rectangle", "side": "rectangle", "waist": "skirt"}.get(pins.where, cloth.shape)
        if only != cloth.shape:
            raise InputError("pins.where", pins.where, f"another place: only a {only} has it")
        if (pins.where == "points") != (pins.points is not None):
            raise InputError("pins.points", pins.points, "given where, and only where, pins.where = 'points'")
        if pins.body and pins.body not in dict(self.obstacles()):
            raise InputError("pins.body", pins.body, "the name of a body")
