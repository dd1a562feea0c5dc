"""The parameters of a collapsing column, as they stand in a TOML file: names, units, allowed ranges and defaults.

Scenes are those of seed B 7.2.3 and 7.5.1 (collapse of a column); friction coefficients are physical (ERRATA
1). SI units; the vertical is the last axis, x runs from the back wall along the flow.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.granular.parameters import (
    Box,
    GranularParameters,
    MaterialGroup,
    ParticlesGroup,
    SolverGroup,
    TimeGroup,
    WallsGroup,
)
from barchan.scenes.parameters import Group, NotNegative, Positive, SceneHeader


class ColumnHeader(SceneHeader):
    """[scene]"""

    kind: Literal["column"] = Field(default="column", description="what is simulated: a collapsing column")
    gravity: Positive = Field(default=9.81, description="gravity, downwards along the last axis, m/s^2")


class Column(Group):
    """[column]"""

    length: Positive = Field(description="length L0 of the column along x, m")
    height: Positive = Field(description="height H0 of the column, m")
    position: NotNegative = Field(default=0.0, description="distance of the column from the back wall, m")


class ColumnParameters(GranularParameters):
    """A complete scene of kind "column"."""

    scene: ColumnHeader
    box: Box
    column: Column
    material: MaterialGroup
    walls: WallsGroup = WallsGroup()
    time: TimeGroup
    solver: SolverGroup = SolverGroup()
    particles: ParticlesGroup = ParticlesGroup()

    def check(self) -> None:
        """Raise InputError unless dimensions agree, the column is inside the box and its walls exist."""
        self.check_box(self.walls)
        box, column = self.box, self.column
        room = box.size[0] - column.position
        if room <= 0.0:
            raise InputError(
                "column.position", column.position, f"less than the box length {box.size[0]:g} m"
            )
        if column.length > room * (1.0 + 1e-12):
            raise InputError(
                "column.length", column.length, f"at most {room:g} m, the room in the box along x"
            )
        if column.height > box.size[-1] * (1.0 + 1e-12):
            raise InputError(
                "column.height", column.height, f"at most {box.size[-1]:g} m, the height of the box"
            )
