"""Tables shared by the scene files of dense flows on finite elements (seeds A and B chapter 6)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from barchan.errors import InputError
from barchan.friction import methods
from barchan.scenes.parameters import MOST_FRAMES, Group, Positive, SceneHeader, SceneParameters

Cells = Annotated[int, Field(ge=2, le=4096)]


class ContinuumHeader(SceneHeader):
    """[scene]"""

    dimensionless: Literal[True] = Field(default=True, description="lengths, speeds, stresses have no units")


class ElementsGroup(Group):
    """[elements]"""

    velocity: Literal["P1", "P2", "P3", "P4"] = Field(default="P2", description="velocities")
    stress: Literal["P0", "P1", "P1d", "P2d"] = Field(
        default="P1d", description="stresses; d: discontinuous between cells"
    )
    imposed: Literal["auto", "factored", "projected"] = Field(
        default="auto", description="how strain rates reach the points of the stress"
    )


class SolverGroup(Group):
    """[solver]"""

    method: str = Field(default="auto", min_length=1, description="name of the friction solver")
    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-6, description="largest certificate of a solution or step"
    )


class GranularSolverGroup(SolverGroup):
    """[solver] of flows whose friction makes certificates dear."""

    tolerance: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=1e-4, description="largest certificate of a solution or step"
    )


class TimeGroup(Group):
    """[time]: of a flow with inertia; a creeping one is steady."""

    end: Positive = Field(default=20.0, description="latest end, in units of sqrt(L/g)")
    frame_rate: Positive = Field(default=2.0, description="frames stored per unit of time")
    step: Positive = Field(default=0.1, description="time step until the flow is steady")
    final_step: Positive = Field(
        default=0.025, description="time step with which it then goes on until it is steady again"
    )
    steady_tolerance: Positive = Field(
        default=2e-3, description="relative change between the halves of the window that counts as steady"
    )
    steady_window: Positive = Field(default=2.0, description="time over which the change is measured")


class ContinuumParameters(SceneParameters):
    """A scene on finite elements; subclasses add the tables of their kind."""

    units: ClassVar[str] = "dimensionless"
    time_unit: ClassVar[str] = ""

    scene: ContinuumHeader
    if TYPE_CHECKING:  # each kind declares these, so that they stand at the end of its files
        elements: ElementsGroup
        solver: SolverGroup

    @property
    def dimension(self) -> int:
        """The scenes of seed A are plane."""
        return 2

    def check(self) -> None:
        """Raise InputError for a solver that does not exist."""
        if self.solver.method not in methods():
            raise InputError("solver.method", self.solver.method, "one of " + ", ".join(methods()))


def last_frame(time: TimeGroup) -> int:
    """Number of the first frame at or after the end. Raises InputError when there are too many."""
    count = max(1, math.ceil(time.end * time.frame_rate * (1.0 - 1e-12)))
    if count > MOST_FRAMES:
        raise InputError(
            "time.frame_rate", time.frame_rate, f"such that there are fewer than {MOST_FRAMES + 1} frames"
        )
    return count


class InertialParameters(ContinuumParameters):
    """A granular scene with a regime, creeping or inertial, and a material with friction and dilatancy."""

    if TYPE_CHECKING:
        flow: Any
        material: Any
        time: TimeGroup

    @property
    def inertial(self) -> bool:
        """Whether the scene is stepped in time."""
        return bool(self.flow.regime == "inertial")

    @property
    def frame_rate(self) -> float:
        """Frames per unit of time."""
        return self.time.frame_rate if self.inertial else 1.0

    @property
    def frame_count(self) -> int:
        """Most frames after the initial one."""
        return last_frame(self.time) if self.inertial else 1

    def check(self) -> None:
        """Raise InputError as every continuum scene, and for more dilatancy than friction."""
        super().check()
        if self.material.dilatancy > self.material.mu:
            raise InputError(
                "material.dilatancy", self.material.dilatancy, f"at most mu = {self.material.mu:g}"
            )
