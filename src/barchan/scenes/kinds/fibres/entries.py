"""What stands in a scene of kind "fibres": the fibres, how their roots move, the bodies that they touch.

Positions are those of centres, sizes full lengths (m); a rotation is a rotation vector in degrees (its direction the axis).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from barchan.scenes.kinds.sand.entries import rows_key, vector_key
from barchan.scenes.parameters import Count, Group, NotNegative, Positive


def three(description: str, default: list[float]) -> Any:
    """A key that holds three numbers."""
    return Field(default=default, description=description, json_schema_extra={"accepted": "three numbers"})


class FibresGroup(Group):
    """[fibres]"""

    model: Literal["rods", "helices"] = Field(description="Discrete Elastic Rods or Super-Helices")
    arrangement: Literal["single", "wisp", "ponytail"] = Field(
        description="one fibre; a wisp, side by side from a round patch; a bundle that spreads like a brush"
    )
    count: Count = Field(default=1, description="number of fibres of a wisp or ponytail")
    segments: Annotated[int, Field(ge=2)] = Field(
        description="of a fibre: edges of a rod, pieces of a super-helix"
    )
    nodes_per_piece: Count = Field(default=3, description="segments of contact on a piece of a super-helix")
    length: Positive = Field(description="of a fibre, m")
    length_spread: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="lengths are even between 1 - this and 1 + this times the mean"
    )
    radius: Positive = Field(description="of a fibre, m")
    density: Positive = Field(default=1300.0, description="of its matter, kg/m^3")
    young: Positive = Field(default=4e9, description="Young's modulus, Pa")
    poisson: Annotated[float, Field(gt=-1.0, le=0.5)] = Field(default=0.4, description="Poisson's ratio")
    damping: NotNegative = Field(default=0.0, description="internal: viscosity over stiffness, s")
    air: NotNegative = Field(default=0.0, description="drag of a length of fibre over its speed, kg/(m s)")
    position: list[float] = three("middle of the roots, m", [0.0, 0.0, 0.0])
    direction: list[float] = three("of the fibres at their roots", [0.0, 0.0, -1.0])
    spacing: Annotated[float, Field(gt=2.0)] = Field(
        default=3.0, description="of the roots, which stand on a lattice of triangles, in radii"
    )
    jitter: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, description="how far roots stand off the lattice, of what there is room for"
    )
    splay_deg: Annotated[float, Field(ge=0.0, lt=80.0)] = Field(
        default=0.0, description="angle of the outermost fibres of a ponytail with its middle, degrees"
    )
    curl: float = Field(default=0.0, description="natural curvature, 1/m")
    curl_twist: float = Field(default=0.0, description="natural twist, 1/m")
    variation: NotNegative = Field(
        default=0.0, description="standard deviation of natural curvatures from segment to segment, 1/m"
    )
    start: Literal["straight", "natural"] = Field(default="straight", description="shape at the start")
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="of lengths, places and curvatures")


class RootsGroup(Group):
    """[roots]: how what holds the roots moves, from `start` on."""

    motion: Literal["still", "oscillation", "rotation", "head_turn"] = Field(
        default="still",
        description="not at all, to and fro, round and round, or one turn that starts and ends softly",
    )
    amplitude: list[float] = three("of an oscillation, m", [0.0, 0.0, 0.0])
    frequency: Positive = Field(default=1.0, description="of an oscillation, Hz")
    turn_rate: float = Field(default=0.0, description="of a rotation, rad/s")
    angle_deg: float = Field(default=0.0, description="of a head turn, degrees")
    duration: Positive = Field(default=0.5, description="of a head turn, s")
    axis: list[float] = three("of rotations and turns", [0.0, 0.0, 1.0])
    pivot: list[float] = three("a point of that axis, m", [0.0, 0.0, 0.0])
    start: NotNegative = Field(default=0.0, description="when it starts, s")
    stop: Positive | None = Field(
        default=None, description="when an oscillation or rotation stops, s; left out: never"
    )


class InverseGroup(Group):
    """[inverse]: a groom, which is where the fibres come to rest before the run, and the natural shapes that keep it."""

    target: Literal["off", "unaware", "input", "end", "straight"] = Field(
        default="off",
        description="no groom; its shape as natural shape, which sags; or the natural shapes that hold it, nearest to its own "
        "curvatures, to those of the ends of fibres, or to straight",
    )
    metric: Literal["energy", "curvature"] = Field(
        default="energy", description="distance of natural shapes: elastic energy, or curvatures"
    )
    regularisation: NotNegative = Field(
        default=1e-3, description="of contact forces, against the mean of the diagonal of the operator"
    )
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-8, description="certificate of the forces that hold the groom"
    )
    settle: Positive = Field(default=2.0, description="time to come to rest, s")


class ObstacleEntry(Group):
    """A body of [bodies]."""

    shape: Literal["sphere", "box", "capsule", "hull", "plane", "mesh"] = Field(description="shape")
    radius: Positive | None = Field(default=None, description="radius of a sphere or capsule, m")
    length: Positive | None = Field(
        default=None, description="of a capsule, between the centres of its ends, along its last axis, m"
    )
    size: list[Positive] | None = vector_key("full lengths of a box, m")
    points: list[list[float]] | None = rows_key("corners of a convex hull, m", "rows of three numbers")
    normal: list[float] | None = vector_key("direction out of a plane; left out: upwards")
    file: str = Field(default="", description="file of a closed mesh, relative to the scene file")
    scale: Positive = Field(default=1.0, description="factor on the lengths of the mesh")
    position: list[float] = three("position at the start; of a plane any point of it, m", [0.0, 0.0, 0.0])
    rotation: list[float] | None = vector_key("rotation vector at the start, degrees")
    friction: NotNegative = Field(default=0.5, description="friction coefficient with fibres")
    motion: Literal["fixed", "driven", "oscillating", "with_roots"] = Field(
        default="fixed", description="not at all, at a velocity and spin, to and fro, or as the roots do"
    )
    velocity: list[float] | None = vector_key("of a driven body, m/s")
    spin: list[float] | None = vector_key("angular velocity of a driven body, rad/s")
    amplitude: list[float] | None = vector_key("of the way of an oscillating body, m")
    swing: list[float] | None = vector_key("of its turning: rotation vector, degrees")
    frequency: Positive = Field(default=1.0, description="of an oscillating body, Hz")
    start: NotNegative = Field(default=0.0, description="when it starts to move, s")


class ObstaclesTable(Group):
    """[bodies]: the name of a body -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = ObstacleEntry

    __pydantic_extra__: dict[str, ObstacleEntry] = Field(init=False)
