"""What the parameters of every kind of scene share: tables of a TOML file with names, units, ranges and defaults."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from barchan.errors import InputError

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1)]

MOST_FRAMES = 99_999
MOST_STEPS = 1_000_000  # a moving body may have a keyframe for each


class Group(BaseModel):
    """A table of the scene file: frozen, no unknown keys, no NaN or infinity, no silent conversions."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    entries: ClassVar[type[Group] | None] = None
    """Of a table whose keys are names that the user gives: the model of what stands under each."""


class SceneHeader(Group):
    """[scene]: every kind narrows `kind` to its own name."""

    name: str = Field(min_length=1, pattern=r"^[A-Za-z0-9_.-]+$", description="short name, used for folders")
    kind: str = Field(description="what is simulated")
    description: str = Field(default="", description="one line for `barchan scenes`")


class StepTime(Group):
    """[time] of what goes by steps of one length."""

    end: Positive = Field(description="simulated time, s")
    frame_rate: Positive = Field(description="frames stored per second")
    step: Positive = Field(description="time step, s")


class StepSolver(Group):
    """[solver] of what solves a friction problem in each step."""

    method: str = Field(default="auto", min_length=1, description="name of the friction solver")
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-6, description="largest certificate of a step"
    )
    max_sweeps: Count = Field(default=10_000, description="most solver iterations in a step")


class ProblemWriting(Group):
    """What [observe] says of the friction problems of the steps."""

    write_problems_every: Annotated[int, Field(ge=0)] = Field(
        default=0,
        description="steps from one friction problem written to the run folder to the next; 0: never",
    )


class SceneParameters(Group):
    """A complete scene: one attribute per table of the TOML file. Each kind has its own subclass."""

    units: ClassVar[str] = "SI units"
    time_unit: ClassVar[str] = " s"

    scene: SceneHeader

    @property
    def dimension(self) -> int:
        """2 or 3."""
        raise AttributeError("dimension")

    @property
    def size(self) -> str:
        """How fine the discretisation is, in words."""
        raise AttributeError("size")

    @property
    def frame_rate(self) -> float:
        """Frames per unit of time; a steady scene has its solution at time 1."""
        return 1.0

    @property
    def frame_count(self) -> int:
        """Most frames after the initial one."""
        return 1

    @classmethod
    def anchored(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """The tables of a file, which may not be valid, with the paths in them taken from its folder."""
        return tables

    @classmethod
    def completed(cls, tables: dict[str, Any]) -> Mapping[str, Any]:
        """The tables of a file, which may not be valid, with defaults that depend on other keys."""
        return tables

    def check(self) -> None:
        """Raise InputError unless the tables fit together."""


class SteppedParameters(SceneParameters):
    """A complete scene that goes by steps of one length, with frames between them."""

    scene: SceneHeader
    time: StepTime

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return self.time.frame_rate

    @property
    def frame_count(self) -> int:
        """Frames after the initial one."""
        return max(1, round(self.time.end * self.time.frame_rate))

    @classmethod
    def anchored(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Mesh files of bodies are taken from the folder of the scene file."""
        bodies = tables.get("bodies", {})
        for body in bodies.values() if isinstance(bodies, dict) else ():
            anchor_file(body, folder)
        return tables

    def check(self) -> None:
        """Raise InputError for more frames than a run folder holds, or more than MOST_STEPS steps."""
        time = self.time
        if time.end * time.frame_rate > MOST_FRAMES:
            raise InputError("time.frame_rate", time.frame_rate, f"at most {MOST_FRAMES} frames in all")
        if time.end > MOST_STEPS * time.step:
            raise InputError("time.step", time.step, f"at most {MOST_STEPS} steps in all (s)")


def anchor_file(table: Any, folder: Path) -> None:
    """The path under `file` of a table, which may not be valid, taken from `folder`."""
    name = table.get("file") if isinstance(table, dict) else None
    if isinstance(table, dict) and isinstance(name, str) and name:
        table["file"] = str((folder / name).resolve())
