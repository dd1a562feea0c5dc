"""Grids and runs of the material point method, shared by its tests."""

from __future__ import annotations

import numpy as np

from barchan.flows.mpm import State, Stepper, StepRecord
from barchan.spaces import RegularGrid

DT = 1 / 240


def grid_of(cells: tuple[int, ...], edge: float = 0.05) -> RegularGrid:
    return RegularGrid(np.zeros(len(cells)), np.full(len(cells), edge), np.array(cells))


def run(stepper: Stepper, state: State, steps: int, dt: float = DT) -> tuple[State, list[StepRecord]]:
    records = []
    for _ in range(steps):
        state, record = stepper.advance(state, dt)
        records.append(record)
    return state, records
