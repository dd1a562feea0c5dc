"""What stands in a scene of kind "cloth": the piece of cloth, its material, where it is pinned, the bodies that it touches.

Positions are those of centres, sizes full lengths (m); a rotation is a rotation vector in degrees (its direction the axis).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from barchan.scenes.kinds.sand.entries import rows_key, vector_key
from barchan.scenes.parameters import Group, NotNegative, Positive


def three(description: str, default: list[float]) -> Any:
    """A key that holds three numbers."""
    return Field(default=default, description=description, json_schema_extra={"accepted": "three numbers"})


class ClothGroup(Group):
    """[cloth]: its rest shape, and where it starts."""

    shape: Literal["rectangle", "disc", "skirt", "mesh"] = Field(
        description="a rectangle or disc in a plane, a skirt about a vertical axis, or the surface in a file"
    )
    size: list[Positive] | None = Field(
        default=None,
        description="of a rectangle, along x and y, m",
        json_schema_extra={"accepted": "two numbers"},
    )
    radius: Positive | None = Field(default=None, description="of a disc, m")
    waist_radius: Positive | None = Field(default=None, description="of a skirt, at its waist, m")
    hem_radius: Positive | None = Field(default=None, description="of a skirt, at its hem, m")
    length: Positive | None = Field(
        default=None, description="of a skirt, from waist to hem along the cloth, m"
    )
    file: str = Field(default="", description="file of a surface of triangles, relative to the scene file")
    scale: Positive = Field(default=1.0, description="factor on the lengths in the file")
    spacing: Positive = Field(default=0.04, description="length of the edges of the mesh, m")
    pattern: Literal["equilateral", "squares", "crossed", "unstructured"] = Field(
        default="equilateral", description="of the triangles of a rectangle"
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=0, description="of unstructured meshes, discs and jitter"
    )
    position: list[float] = three(
        "of the middle of a rectangle, disc or waist at the start, m", [0.0, 0.0, 0.0]
    )
    rotation: list[float] = three("rotation vector at the start, degrees", [0.0, 0.0, 0.0])
    widened: Positive = Field(
        default=1.0, description="lengths along x and y at the start over those at rest, before the rotation"
    )
    jitter: NotNegative = Field(
        default=0.0,
        description="random displacements of vertices at the start (`seed`), in spacings: no shape is perfect",
    )
    velocity: list[float] = three("at the start, m/s", [0.0, 0.0, 0.0])


class ClothMaterialGroup(Group):
    """[material]"""

    young_modulus: Positive = Field(default=1e5, description="of stretching, Pa")
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5)] = Field(default=0.3, description="of stretching")
    thickness: Positive = Field(default=1e-3, description="of the cloth: also how near two layers come, m")
    area_density: Positive = Field(default=0.2, description="mass over area, kg/m^2")
    membrane: Literal["stvk", "springs"] = Field(
        default="stvk", description="stretching: Saint Venant-Kirchhoff triangles, or springs along the edges"
    )
    bending_stiffness: NotNegative | None = Field(
        default=None, description="flexural rigidity, N m; left out: that of a solid sheet of this thickness"
    )
    mass_damping: NotNegative = Field(default=0.0, description="of Rayleigh's damping, times the mass, 1/s")
    stiffness_damping: NotNegative = Field(default=0.0, description="likewise, times the stiffness, s")
    friction: NotNegative = Field(default=0.5, description="friction coefficient of the cloth")


class PinsGroup(Group):
    """[pins]: vertices that are held."""

    where: Literal["nowhere", "corners", "side", "rim", "waist", "points"] = Field(
        default="nowhere",
        description="corners or the side of least x of a rectangle, the whole boundary, the waist of a skirt, given points",
    )
    points: list[list[float]] | None = rows_key(
        "the nearest vertices at the start are pinned, m", "rows of three numbers"
    )
    body: str = Field(
        default="",
        description="body that carries them; empty: they stay",
        json_schema_extra={"accepted": "a name"},
    )


class ClothBodyEntry(Group):
    """A body of [bodies]."""

    shape: Literal["sphere", "box", "capsule", "hull", "revolved", "plane", "mesh"] = Field(
        description="shape"
    )
    radius: Positive | None = Field(default=None, description="radius of a sphere or capsule, m")
    length: Positive | None = Field(
        default=None, description="of a capsule, between the centres of its ends, along its last axis, m"
    )
    size: list[Positive] | None = vector_key("full lengths of a box, m")
    points: list[list[float]] | None = rows_key(
        "corners of a convex hull; of a revolved body those of its outline (r, z) in turn, m",
        "rows of numbers",
    )
    normal: list[float] | None = vector_key("direction out of a plane; left out: upwards")
    file: str = Field(default="", description="file of a closed mesh, relative to the scene file")
    scale: Positive = Field(default=1.0, description="factor on the lengths of the mesh")
    position: list[float] = three("position at the start; of a plane any point of it, m", [0.0, 0.0, 0.0])
    rotation: list[float] | None = vector_key("rotation vector at the start, degrees")
    friction: NotNegative = Field(default=0.5, description="friction coefficient of its surface")
    motion: Literal["fixed", "moving"] = Field(default="fixed", description="whether it moves")
    velocity: list[float] = three("of a moving body once it is up to speed, m/s", [0.0, 0.0, 0.0])
    spin: list[float] = three("likewise its angular velocity, rad/s", [0.0, 0.0, 0.0])
    amplitude: list[float] = three("of its way to and fro, added to that, m", [0.0, 0.0, 0.0])
    swing: list[float] = three("of its turning to and fro: rotation vector, degrees", [0.0, 0.0, 0.0])
    frequency: Positive = Field(default=1.0, description="of both, Hz")
    start: NotNegative = Field(default=0.0, description="when it starts to move, s")
    stop: Positive | None = Field(default=None, description="when it slows down, s; left out: never")
    ramp: NotNegative = Field(default=0.0, description="time that speeding up and slowing down take, s")


class ClothBodiesTable(Group):
    """[bodies]: the name of a body -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = ClothBodyEntry

    __pydantic_extra__: dict[str, ClothBodyEntry] = Field(init=False)
