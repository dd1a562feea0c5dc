"""Numerical options of the mesh-based two-phase model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from barchan.errors import InputError
from barchan.flows.dry.options import Options as DryOptions

MODELS = ("two_phase", "darcy")


@dataclass(frozen=True)
class Options(DryOptions):
    """How a step is solved: the options of the dry model, and

    inertia : of the grains; the default "conservative" lets no step of transport add kinetic energy (`transport`). The fluid's
        is always carried so.
    model : "two_phase", or "darcy", which neglects the inertia of the fluctuation (seed B, Eq. 8.21).

    Raises InputError for a value out of range.
    """

    inertia: Literal["explicit", "conservative"] = "conservative"
    model: Literal["two_phase", "darcy"] = "two_phase"

    @property
    def darcy(self) -> bool:
        """Whether the Darcy-like model is solved."""
        return self.model == "darcy"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.model not in MODELS:
            raise InputError("options.model", self.model, "one of " + ", ".join(MODELS))
