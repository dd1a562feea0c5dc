"""Numerical choices of the two-phase time step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from barchan.errors import InputError
from barchan.flows.mpm import Options as GrainOptions
from barchan.flows.suspension.fluid_grid import PRESSURES

MODELS = ("two_phase", "darcy")
SOLUTIONS = ("two_step", "coupled")
LONGEST = 40_000
"""Sweeps at most by default: where drag ties grains to the fluid, contacts take longer than in dry matter."""


@dataclass(frozen=True)
class Options:
    """How a step is made.

    grains : stress space, transfers, tolerance and method of the granular part (`barchan.flows.mpm.Options`); multilinear
        velocities only.
    model : "two_phase", or "darcy", which neglects the inertia of the fluctuation (seed B, Eq. 8.21).
    solution : "two_step", a Stokes-like problem and then a frictional one with lumped inertia (seed B, Eq. 8.27), or "coupled",
        both at once, for small problems.
    pressure : "layers" or "coarse", stable and exactly incompressible, or "penalised", multilinear on the grid of the
        velocities with div u_v = -penalty p (`fluid_grid`).
    penalty : [1/(Pa s)] of penalised pressures, None otherwise; `fluid_grid.penalty_for` proposes one.
    stokes_tolerance : relative residual of the first step.

    Raises InputError for a value out of range.
    """

    grains: GrainOptions = field(default_factory=lambda: GrainOptions(max_sweeps=LONGEST))
    model: Literal["two_phase", "darcy"] = "two_phase"
    solution: Literal["two_step", "coupled"] = "two_step"
    pressure: Literal["layers", "coarse", "penalised"] = "layers"
    penalty: float | None = None
    stokes_tolerance: float = 1e-7

    def __post_init__(self) -> None:
        for name, known in (("model", MODELS), ("solution", SOLUTIONS), ("pressure", PRESSURES)):
            if getattr(self, name) not in known:
                raise InputError(f"options.{name}", getattr(self, name), "one of " + ", ".join(known))
        tolerance = self.stokes_tolerance
        if not isinstance(tolerance, (int, float)) or not math.isfinite(tolerance) or tolerance <= 0.0:
            raise InputError("options.stokes_tolerance", tolerance, "a finite number > 0")
        if self.grains.velocity != "Q1":
            raise InputError("options.grains.velocity", self.grains.velocity, "Q1 inside a fluid")
