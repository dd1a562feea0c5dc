"""What stands under the names a person gives in a scene of kind "bodies": single bodies, makers of many, joints.

Positions are those of centres, sizes full lengths (m); a rotation is a rotation vector in degrees (its direction the axis),
in 2D one angle. Bodies are those of `barchan.bodies.rigid`, joints those of `barchan.bodies.moreau`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from barchan.scenes.kinds.sand.entries import Share, rotation_key, rows_key, turning_key, vector_key
from barchan.scenes.parameters import Count, Group, NotNegative, Positive


class BodyEntry(Group):
    """A body of [bodies]."""

    shape: Literal["sphere", "box", "capsule", "polygon", "hull", "plane", "mesh"] = Field(
        description="shape; 2D: disk, rectangle; polygon in 2D, hull and mesh in 3D"
    )
    radius: Positive | None = Field(default=None, description="radius of a sphere or capsule, m")
    length: Positive | None = Field(
        default=None, description="of a capsule, between the centres of its ends, along its last axis, m"
    )
    size: list[Positive] | None = vector_key("full lengths of a box, m")
    points: list[list[float]] | None = rows_key(
        "corners of a polygon in turn, or of a convex hull in any order, m",
        "a row of numbers for each corner",
    )
    normal: list[float] | None = vector_key("direction out of a plane; left out: upwards")
    file: str = Field(default="", description="file of a closed mesh, relative to the scene file")
    scale: Positive = Field(default=1.0, description="factor on the lengths of the mesh")
    position: list[float] | None = vector_key("position at the start; of a plane any point of it, m")
    rotation: list[float] | None = rotation_key("rotation vector at the start, degrees")
    velocity: list[float] | None = vector_key("velocity at the start; of a driven body: while it moves, m/s")
    spin: list[float] | None = turning_key("angular velocity, likewise, rad/s")
    friction: NotNegative = Field(default=0.5, description="friction coefficient of its surface")
    density: Positive | None = Field(default=None, description="density of a free body, kg/m^d")
    mass: Positive | None = Field(default=None, description="mass of a free body instead, kg")
    motion: Literal["free", "fixed", "driven", "scripted"] = Field(
        default="free", description="how it moves: by forces, not at all, at a velocity, by a script"
    )
    force: list[float] | None = vector_key("constant force on a free body, N")
    torque: list[float] | None = turning_key("constant torque on a free body, N m")
    held: list[Literal["x", "y", "z", "spin", "spin_x", "spin_y", "spin_z"]] | None = Field(
        default=None,
        description="velocities of a free body kept at zero",
        json_schema_extra={"accepted": "a list of 'x', 'y', 'z', 'spin' (2D), 'spin_x', 'spin_y', 'spin_z'"},
    )
    start: NotNegative = Field(default=0.0, description="a driven body moves from here on, s")
    stop: Positive | None = Field(default=None, description="a driven body stops, s; left out: never")
    times: list[float] | None = rows_key("times of a script, s", "increasing numbers")
    positions: list[list[float]] | None = rows_key(
        "positions at these times, m", "a row of numbers for each time"
    )
    rotations: list[list[float]] | None = rows_key(
        "rotation vectors at these times, degrees", "a row of numbers for each time"
    )


class BodiesTable(Group):
    """[bodies]: the name of a body -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = BodyEntry

    __pydantic_extra__: dict[str, BodyEntry] = Field(init=False)


class GeneratorEntry(Group):
    """Bodies that a rule makes; they are called NAME_0, NAME_1, ..."""

    kind: Literal["grains", "floor_of_grains", "stack", "card_house", "container", "drum", "hopper"] = Field(
        description="loose grains in a box, glued grains, boxes, cards, plane walls, a turning drum, plates of a silo"
    )
    count: Count = Field(default=1, description="number of grains or boxes")
    shape: Literal["sphere", "box", "capsule"] = Field(
        default="sphere", description="of grains; boxes and capsules fit into a sphere of `radius`"
    )
    radius: Positive | None = Field(
        default=None, description="mean radius of grains; inner radius of a drum, m"
    )
    spread: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="radii of grains are even between 1 - spread and 1 + spread of the mean"
    )
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="of sizes, places and turns")
    jitter: Share = Field(
        default=1.0, description="how far grains lie off their lattice, of what there is room for"
    )
    lower: list[float] | None = vector_key("lower corner of the box of grains, a container or a hopper, m")
    upper: list[float] | None = vector_key("upper corner, m")
    position: list[float] | None = vector_key(
        "centre of a drum; middle of the foot of a stack or card house, m"
    )
    velocity: list[float] | None = vector_key("velocity of grains at the start, m/s")
    size: list[Positive] | None = vector_key(
        "full lengths of a box of a stack; length and thickness of a card (3D: and depth), m"
    )
    storeys: Count = Field(default=2, description="of a card house")
    lean_deg: Annotated[float, Field(gt=0.0, lt=45.0)] = Field(
        default=15.0, description="of the cards of a card house from the vertical, degrees"
    )
    sides: Annotated[int, Field(ge=3)] = Field(default=24, description="of the polygon that is a drum")
    thickness: Positive | None = Field(default=None, description="of the wall of a drum or hopper, m")
    depth: Positive | None = Field(default=None, description="of a drum along its axis y (3D), m")
    turn_rate: float = Field(
        default=0.0, description="of a drum, counter-clockwise as seen with x to the right, rad/s"
    )
    outlet: Positive | None = Field(default=None, description="width of the outlet of a hopper, m")
    level: float = Field(default=0.0, description="height of the outlet, m")
    slope_deg: Annotated[float, Field(ge=0.0, lt=85.0)] = Field(
        default=0.0, description="of the plates of a hopper, 0: a flat bottom, degrees"
    )
    lid: bool = Field(default=False, description="whether a container is closed at the top")
    density: Positive = Field(default=2500.0, description="of the bodies, kg/m^d")
    friction: NotNegative = Field(default=0.5, description="friction coefficient of their surfaces")


class GeneratorsTable(Group):
    """[generators]: the name of a rule -> what it makes."""

    model_config = ConfigDict(extra="allow")
    entries = GeneratorEntry

    __pydantic_extra__: dict[str, GeneratorEntry] = Field(init=False)


class JointEntry(Group):
    """A joint of [joints]."""

    kind: Literal["ball", "hinge", "fixed", "distance", "slider"] = Field(
        description="what the bodies may still do; a pin of the plane is a ball joint"
    )
    first: str = Field(min_length=1, description="name of a body", json_schema_extra={"accepted": "a name"})
    second: str = Field(
        min_length=1, description="name of the other", json_schema_extra={"accepted": "a name"}
    )
    anchor: list[float] = Field(
        description="where it holds at the start, m", json_schema_extra={"accepted": "a number for each axis"}
    )
    second_anchor: list[float] | None = vector_key("of a distance joint: on the second body, m")
    axis: list[float] | None = vector_key("of a hinge or slider")


class JointsTable(Group):
    """[joints]: the name of a joint -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = JointEntry

    __pydantic_extra__: dict[str, JointEntry] = Field(init=False)
