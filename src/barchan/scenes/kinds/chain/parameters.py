"""The parameters of a scene of kind "chain": segments joined end to end in the plane, fixed obstacles, models of the motion.

SI units; the vertical is z. Lists hold one number for all segments or one for each, from the first end on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import ConfigDict, Field

from barchan.errors import InputError
from barchan.scenes.parameters import (
    Count,
    Group,
    NotNegative,
    Positive,
    SceneHeader,
    SteppedParameters,
    StepSolver,
)


def _numbers(description: str, default: list[float] | None = None, each: str = "finite") -> Any:
    """A key that holds one number, or one for each segment."""
    accepted = f"a list of one number or one for each segment, {each}"
    schema: Any = {"accepted": accepted}
    return Field(default=default or [0.0], description=description, json_schema_extra=schema)


def _point(description: str) -> Any:
    """A key that holds a vector of the plane."""
    return Field(default=[0.0, 0.0], description=description, json_schema_extra={"accepted": "[x, z]"})


class ChainHeader(SceneHeader):
    """[scene]"""

    kind: Literal["chain"] = Field(description="what is simulated: a plane chain of segments")
    gravity: NotNegative = Field(default=9.81, description="gravity, m/s^2")


class ChainGroup(Group):
    """[chain]"""

    segments: Count = Field(default=3, description="number of segments")
    half_lengths: list[float] = _numbers("half of the length of the segments, m", [0.25], "each > 0")
    line_densities: list[float] = _numbers("mass of a length of the segments, kg/m", [1.0], "each > 0")
    angles: list[float] = _numbers("of the segments from the x axis at the start, degrees")
    spins: list[float] = _numbers("their rates at the start, degrees/s")
    bending_stiffness: NotNegative = Field(default=0.0, description="of the spring in each joint, N m")
    air_friction: NotNegative = Field(default=0.0, description="drag of a length over its speed, kg/(m s)")
    inertia: Literal["consistent", "lumped"] = Field(
        default="consistent", description="of slender rods, or half of the mass of a segment at each end"
    )
    held: bool = Field(default=True, description="whether the first end stays at `root`")
    clamp: float | None = Field(
        default=None, description="direction of a clamp at the root, degrees; left out: a free hinge"
    )
    root: list[float] = _point("place of the first end at the start, m")
    velocity: list[float] = _point("of the first end at the start, where it is not held, m/s")
    friction: NotNegative = Field(default=0.5, description="friction coefficient of its joints")


class ObstacleEntry(Group):
    """An obstacle of [obstacles]."""

    shape: Literal["plane", "disc"] = Field(description="shape")
    position: list[float] = Field(
        description="centre; of a plane any point of it, m", json_schema_extra={"accepted": "[x, z]"}
    )
    radius: Positive | None = Field(default=None, description="of a disc, m")
    normal: list[float] = Field(
        default=[0.0, 1.0], description="direction out of a plane", json_schema_extra={"accepted": "[x, z]"}
    )
    friction: NotNegative = Field(default=0.5, description="friction coefficient; of a pair: geometric mean")


class ObstaclesTable(Group):
    """[obstacles]: the name of a fixed obstacle -> what it is."""

    model_config = ConfigDict(extra="allow")
    entries = ObstacleEntry

    __pydantic_extra__: dict[str, ObstacleEntry] = Field(init=False)


class ChainSolver(StepSolver):
    """[solver]"""

    model: Literal["all", "maximal", "lumped", "reduced"] = Field(
        default="all",
        description="coordinates: segments with joints, masses at the joints, angles alone, or all three side by side",
    )
    iterations: Count = Field(
        default=1, description="most linearisations of a step; 1: the linearised implicit step"
    )


class ChainParameters(SteppedParameters):
    """A complete scene of kind "chain"."""

    scene: ChainHeader
    chain: ChainGroup = ChainGroup()
    obstacles: ObstaclesTable = ObstaclesTable()
    solver: ChainSolver = ChainSolver()

    @property
    def dimension(self) -> int:
        """2."""
        return 2

    @property
    def size(self) -> str:
        """How many segments, in words."""
        return f"{self.chain.segments} segments"

    @property
    def model_names(self) -> tuple[str, ...]:
        """The models that run side by side."""
        return ("maximal", "lumped", "reduced") if self.solver.model == "all" else (self.solver.model,)

    def obstacle_tables(self) -> Iterator[tuple[str, ObstacleEntry]]:
        """Names and tables of [obstacles]."""
        yield from (self.obstacles.model_extra or {}).items()

    def check(self) -> None:
        """Raise InputError unless the tables fit together; chain and obstacles are checked when they are made."""
        super().check()
        for name in ("half_lengths", "line_densities", "angles", "spins"):
            given = getattr(self.chain, name)
            if len(given) not in (1, self.chain.segments):
                allowed = f"one number or {self.chain.segments}, one for each segment"
                raise InputError(f"chain.{name}", given, allowed)
        points = [("chain.root", self.chain.root), ("chain.velocity", self.chain.velocity)]
        for name, entry in self.obstacle_tables():
            points += [(f"obstacles.{name}.{key}", getattr(entry, key)) for key in ("position", "normal")]
            if (entry.radius is None) == (entry.shape == "disc"):
                allowed = "given for a disc, and only there"
                raise InputError(
                    f"obstacles.{name}.radius", "missing" if entry.radius is None else entry.radius, allowed
                )
        for key, value in points:
            if len(value) != 2:
                raise InputError(key, value, "two numbers [x, z]")
