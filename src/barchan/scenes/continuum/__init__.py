"""What the kinds of scenes on finite elements share: tables of their files, the model that steps them, what is shown."""

from barchan.scenes.continuum.model import ContinuumModel, FlowState
from barchan.scenes.continuum.parameters import (
    Cells,
    ContinuumHeader,
    ContinuumParameters,
    ElementsGroup,
    GranularSolverGroup,
    InertialParameters,
    SolverGroup,
    TimeGroup,
)
from barchan.scenes.continuum.report import Curve, Shown, continuum_kind

__all__ = [
    "Cells",
    "ContinuumHeader",
    "ContinuumModel",
    "ContinuumParameters",
    "InertialParameters",
    "Curve",
    "ElementsGroup",
    "FlowState",
    "GranularSolverGroup",
    "Shown",
    "SolverGroup",
    "TimeGroup",
    "continuum_kind",
]
