"""Tables shared by the scene files of quasi-Newtonian flows on curved cells (seed C chapters 4-6)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.scenes.parameters import MOST_FRAMES, Count, Group, NotNegative, Positive, SceneParameters

Level = Annotated[int, Field(ge=1, le=8)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]


class FluidElementsGroup(Group):
    """[elements]: second-order velocities, linear pressures."""

    shape: Literal["quadrilateral", "triangle"] = Field(
        default="quadrilateral", description="shape of the cells"
    )
    pressures: Literal["auto", "P1d", "P1d_mapped", "P1"] = Field(
        default="auto",
        description="pressures; d: discontinuous, in physical or mapped coordinates (triangles are then split at their "
        "centres); auto: P1d, on triangles P1",
    )

    @property
    def chosen(self) -> str:
        """Pressures of the space."""
        if self.pressures != "auto":
            return self.pressures
        return "P1d" if self.shape == "quadrilateral" else "P1"

    @property
    def split(self) -> bool:
        """Whether triangles are cut in three at their centres, without which discontinuous pressures are unstable there."""
        return self.shape == "triangle" and self.chosen == "P1d"

    @property
    def pieces(self) -> int:
        """Cells to each quadrilateral."""
        return 1 if self.shape == "quadrilateral" else 6 if self.split else 2


class FluidSolverGroup(Group):
    """[solver]"""

    method: Literal["stress-velocity", "newton", "adaptive-newton", "damped-newton", "fixed-point"] = Field(
        default="stress-velocity", description="nonlinear solver"
    )
    strategy: Literal["f1", "f2", "f3", "phase1", "phase2", "phase2-slow", "phase3"] = Field(
        default="f1", description="how adaptive-newton changes its weight"
    )
    delta0: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.2, description="first weight of the Newton part of adaptive-newton"
    )
    halvings: Annotated[int, Field(ge=0, le=20)] | None = Field(
        default=None,
        description="how often a step is halved while the residual grows; by default 6 for damped-newton, "
        "3 for adaptive-newton, else 0",
    )
    start: Literal["auto", "nested", "rest"] = Field(
        default="auto",
        description="of the steady flow: that on the next coarser mesh, and so on, or rest; auto: nested on quadrilaterals",
    )
    tolerance: Share = Field(default=1e-8, description="residual of a solution over that of the flow at rest")
    max_iterations: Count = Field(default=200, description="most nonlinear iterations of a solution or step")
    linear_solver: Literal["auto", "direct", "multigrid"] = Field(
        default="auto",
        description="solver of linear systems; auto: multigrid for many unknowns on quadrilaterals",
    )
    gain: Share = Field(default=0.25, description="factor by which multigrid lowers the residual of a system")
    max_cycles: Count = Field(default=10, description="most multigrid cycles for a system")
    smoothing: Count = Field(
        default=8, description="smoothing steps of multigrid before and after each correction"
    )


class GranularFluidSolverGroup(FluidSolverGroup):
    """[solver] of granular matter, for which seed C chose another strategy (8.1)."""

    strategy: Literal["f1", "f2", "f3", "phase1", "phase2", "phase2-slow", "phase3"] = Field(
        default="f3", description="how adaptive-newton changes its weight"
    )
    delta0: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.5, description="first weight of the Newton part of adaptive-newton"
    )


class FluidTimeGroup(Group):
    """[time]: of a flow that is stepped in time from rest; without an end the steady flow is solved at once."""

    end: NotNegative = Field(default=0.0, description="end, in units of time; 0: the steady flow")
    step: Positive = Field(default=0.05, description="time step")
    frame_rate: Positive = Field(default=10.0, description="frames stored per unit of time")
    scheme: Literal["backward-euler", "bdf2"] = Field(
        default="backward-euler", description="implicit time scheme"
    )


class FluidParameters(SceneParameters):
    """A scene of a quasi-Newtonian flow; subclasses add the tables of their kind."""

    if TYPE_CHECKING:  # each kind declares these, so that they stand at the end of its files
        elements: FluidElementsGroup
        time: FluidTimeGroup
        solver: FluidSolverGroup

    @property
    def dimension(self) -> int:
        """The flows of seed C are plane."""
        return 2

    @property
    def steady(self) -> bool:
        """Whether the steady flow is solved at once."""
        return self.time.end == 0.0

    @property
    def nested(self) -> bool:
        """Whether the steady flow starts from that on the next coarser mesh."""
        start = self.solver.start
        return start == "nested" or (start == "auto" and self.elements.shape == "quadrilateral")

    @property
    def frame_rate(self) -> float:
        """Frames per unit of time."""
        return 1.0 if self.steady else self.time.frame_rate

    @property
    def frame_count(self) -> int:
        """Frames after the initial one."""
        if self.steady:
            return 1
        count = max(1, math.ceil(self.time.end * self.time.frame_rate * (1.0 - 1e-12)))
        if count > MOST_FRAMES:
            raise InputError(
                "time.frame_rate", self.time.frame_rate, f"such that there are at most {MOST_FRAMES} frames"
            )
        return count

    def check(self) -> None:
        """Raise InputError for pressures or a linear solver that the cells do not have."""
        elements = self.elements
        if self.solver.linear_solver == "multigrid" and elements.shape == "triangle":
            raise InputError(
                "elements.shape", elements.shape, "'quadrilateral' for the linear solver 'multigrid'"
            )
        if self.solver.start == "nested" and elements.shape == "triangle":
            raise InputError("elements.shape", elements.shape, "'quadrilateral' for the start 'nested'")
        wrong = {"quadrilateral": "P1", "triangle": "P1d_mapped"}[elements.shape]
        if elements.pressures == wrong:
            others = {"quadrilateral": "P1d or P1d_mapped", "triangle": "P1 or P1d"}[elements.shape]
            raise InputError("elements.pressures", wrong, f"{others} on a {elements.shape}")
