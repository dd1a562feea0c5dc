"""What the parameters of every kind of scene share: tables of a TOML file with names, units, ranges and defaults."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1)]

MOST_FRAMES = 99_999


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
