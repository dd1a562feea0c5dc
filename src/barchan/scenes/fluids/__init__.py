"""What the kinds of scenes of quasi-Newtonian flows share: tables of their files, the model that solves them, what is shown."""

from barchan.scenes.fluids.model import FluidModel, FluidRecord, FluidState, max_speed
from barchan.scenes.fluids.parameters import (
    FluidElementsGroup,
    FluidParameters,
    FluidSolverGroup,
    FluidTimeGroup,
    GranularFluidSolverGroup,
    Level,
)
from barchan.scenes.fluids.report import FluidShown, fluid_kind

__all__ = [
    "FluidElementsGroup",
    "FluidModel",
    "FluidParameters",
    "FluidRecord",
    "FluidShown",
    "FluidSolverGroup",
    "FluidState",
    "FluidTimeGroup",
    "GranularFluidSolverGroup",
    "Level",
    "fluid_kind",
    "max_speed",
]
