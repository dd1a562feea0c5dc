"""What stands under the names a person gives in a scene of kind "sand": pieces of matter, materials, rigid bodies.

Positions are those of centres, sizes full lengths (m); a rotation is a rotation vector in degrees (its direction the axis),
in 2D one angle. Bodies are those of `barchan.bodies.rigid` (seed B 7.4.1).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from barchan.scenes.granular.parameters import MaterialGroup
from barchan.scenes.parameters import Group, NotNegative, Positive

Share = Annotated[float, Field(ge=0.0, le=1.0)]


def vector_key(description: str) -> Any:
    """A key that holds a vector, or none."""
    accepted = "a number for each axis"
    return Field(default=None, description=description, json_schema_extra={"accepted": accepted})


def rotation_key(description: str) -> Any:
    """A key that holds a rotation, or none."""
    accepted = "[angle] in 2D, three numbers in 3D"
    return Field(default=None, description=description, json_schema_extra={"accepted": accepted})


def turning_key(description: str) -> Any:
    """A key that holds an angular velocity or a torque, or none."""
    accepted = "[number] in 2D, three numbers in 3D"
    return Field(default=None, description=description, json_schema_extra={"accepted": accepted})


def rows_key(description: str, accepted: str) -> Any:
    """A key that holds rows of numbers, or none."""
    return Field(default=None, description=description, json_schema_extra={"accepted": accepted})


class SandMaterial(MaterialGroup):
    """[material]: all that the flow knows of a material."""

    cohesion: NotNegative = Field(default=0.0, description="cohesion at the start: tension sustained, Pa")
    cohesion_decay: NotNegative = Field(default=0.0, description="rate xi of dc/dt = -xi |D(u)| c")
    shear_yield: NotNegative = Field(default=0.0, description="lasting yield stress without pressure, Pa")
    tensile_yield: NotNegative = Field(default=0.0, description="lasting tension sustained, Pa")
    dilatancy: NotNegative = Field(default=0.0, description="expansion per shear, at most the friction")
    anisotropy: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="weight alpha of the grains' orientations in friction"
    )
    elongation: Share = Field(
        default=0.9,
        description="shape of the grains, l = (L/W - 1)/(L/W + 1): how fast they turn into the flow",
    )
    faceted: bool = Field(
        default=False,
        description="largest component instead of the norm in the yield criterion: for comparison",
    )


class MaterialsGroup(Group):
    """[materials]: the name of a further material -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = SandMaterial

    __pydantic_extra__: dict[str, SandMaterial] = Field(init=False)


class Piece(Group):
    """Where a piece of matter is at the start, and how it moves there."""

    shape: Literal["box", "sphere", "cylinder", "cone"] = Field(
        default="box", description="shape; 2D: rectangle, disk, triangle"
    )
    position: list[float] = Field(
        description="centre; of a cone that of its base, m",
        json_schema_extra={"accepted": "a number for each axis"},
    )
    size: list[Positive] | None = vector_key("full lengths of a box, m")
    radius: Positive | None = Field(default=None, description="radius, m")
    height: Positive | None = Field(default=None, description="height of a cylinder or cone, m")
    rotation: list[float] | None = rotation_key("rotation vector of the shape, degrees")
    velocity: list[float] | None = vector_key("initial velocity, m/s")


class PieceOfMatter(Piece):
    """A piece of [matter]."""

    material: str = Field(default="", description="name in [materials]; empty: that of [material]")
    orientation: Literal["random", "aligned"] = Field(
        default="random", description="of anisotropic grains at the start"
    )
    normal: list[float] | None = vector_key("the normal of aligned grains; left out: the vertical")


class MatterGroup(Group):
    """[matter]: the name of a piece of matter -> where it is at the start."""

    model_config = ConfigDict(extra="allow")
    entries = PieceOfMatter

    __pydantic_extra__: dict[str, PieceOfMatter] = Field(init=False)


class BodyTable(Group):
    """A rigid body of [bodies]."""

    shape: Literal[
        "sphere",
        "box",
        "cylinder",
        "torus",
        "wheel",
        "plate_with_hole",
        "hourglass",
        "bucket",
        "polygon",
        "mesh",
    ] = Field(description="shape; 2D: disk, rectangle")
    radius: Positive | None = Field(default=None, description="radius; of a torus that of its centre line, m")
    minor_radius: Positive | None = Field(default=None, description="radius of the tube of a torus, m")
    height: Positive | None = Field(
        default=None, description="length of a cylinder or wheel along its axis, m"
    )
    axis: Literal["x", "y", "z"] = Field(default="z", description="axis of a cylinder, torus or wheel")
    size: list[Positive] | None = vector_key("full lengths of a box, plate, hourglass or bucket, m")
    hole: Positive | None = Field(
        default=None, description="diameter of the hole of a plate, width of the neck of an hourglass, m"
    )
    thickness: Positive | None = Field(
        default=None, description="of the walls of a bucket; height of the neck of an hourglass, m"
    )
    treads: Annotated[int, Field(ge=0)] = Field(default=0, description="number of treads of a wheel")
    tread_height: Positive | None = Field(default=None, description="height of the treads of a wheel, m")
    points: list[list[float]] | None = rows_key(
        "corners of a polygon in turn, m", "a row [x, z] for each corner"
    )
    file: str = Field(
        default="",
        description="mesh file, relative to the scene file; 'sample': a shape that comes with barchan",
    )
    scale: Positive = Field(
        default=1.0, description="factor on the lengths of the mesh; length of the sample, m"
    )
    position: list[float] | None = vector_key(
        "position of the body's origin at the start; of a pen where its text begins, m"
    )
    rotation: list[float] | None = rotation_key("rotation vector at the start, degrees")
    velocity: list[float] | None = vector_key("velocity at the start; of a driven body: while it moves, m/s")
    spin: list[float] | None = turning_key("angular velocity, likewise, rad/s")
    friction: NotNegative = Field(default=0.5, description="friction coefficient between body and matter")
    density: Positive | None = Field(default=None, description="density of a free body, kg/m^3")
    mass: Positive | None = Field(default=None, description="mass of a free body instead, kg")
    motion: Literal["free", "fixed", "driven", "scripted", "writing"] = Field(
        default="fixed",
        description="how it moves: by its forces, not at all, at a velocity, by a script, as a pen",
    )
    force: list[float] | None = vector_key("constant force on a free body, N")
    torque: list[float] | None = turning_key("constant torque on a free body, N m")
    torque_frame: Literal["world", "body"] = Field(default="world", description="axes of the torque")
    held: list[Literal["x", "y", "z", "spin_x", "spin_y", "spin_z"]] | None = Field(
        default=None,
        description="velocities of a free body kept at zero",
        json_schema_extra={"accepted": "a list of 'x', 'y', 'z', 'spin_x', 'spin_y', 'spin_z'"},
    )
    start: NotNegative = Field(default=0.0, description="a driven body moves, a pen writes from here on, s")
    stop: Positive | None = Field(default=None, description="a driven body stops, s; left out: never")
    times: list[float] | None = rows_key("times of a script, s", "increasing numbers")
    positions: list[list[float]] | None = rows_key(
        "positions at these times, m", "a row of numbers for each time"
    )
    rotations: list[list[float]] | None = rows_key(
        "rotation vectors at these times, degrees", "a row of numbers for each time"
    )
    text: str = Field(default="", description="what a pen writes: letters A-Z, digits, blanks")
    letter_height: Positive | None = Field(default=None, description="height of its letters along y, m")
    speed: Positive | None = Field(default=None, description="speed of a pen, m/s")
    lift: Positive | None = Field(default=None, description="how far a pen is lifted between strokes, m")


class BodiesGroup(Group):
    """[bodies]: the name of a body -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = BodyTable

    __pydantic_extra__: dict[str, BodyTable] = Field(init=False)
