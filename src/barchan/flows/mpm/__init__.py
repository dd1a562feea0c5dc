"""Material point method for dry granular flow, in 2D and 3D (seed B, 7.1 and 7.3).

Particles carry the matter, a regular grid solves each step's frictional problem; rigid bodies move in it and with it.

    state = fill_box(grid, lower, upper, 3, material)
    stepper = Stepper(grid, material, Walls.cuve(grid.dimension))
    state, record = stepper.advance(state, dt)
"""

from __future__ import annotations

from barchan.flows.mpm.initial import fill_box, fill_shape, joined
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.options import Options
from barchan.flows.mpm.resampling import Resampling
from barchan.flows.mpm.state import State, StepRecord
from barchan.flows.mpm.stepper import Stepper
from barchan.flows.mpm.walls import Wall, Walls

__all__ = [
    "Material", "Options", "Resampling", "State", "StepRecord", "Stepper", "Wall", "Walls", "fill_box", "fill_shape", "joined",
]  # fmt: skip
