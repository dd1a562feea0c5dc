"""Random matter in small boxes, shared by the tests of the material point method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from barchan.flows.mpm import State
from barchan.spaces import RegularGrid


def grid_of(dimension: int) -> RegularGrid:
    if dimension == 2:
        return RegularGrid([0.1, -0.2], [0.3, 0.25], [6, 5])
    return RegularGrid([0.0, 0.5, -1.0], [0.2, 0.1, 0.4], [4, 3, 4])


def scattered(dimension: int, count: int = 120, seed: int = 0) -> tuple[RegularGrid, State]:
    """Particles scattered over the lower corner of the box, with random velocities, gradients and volumes."""
    grid, rng = grid_of(dimension), np.random.default_rng(seed)
    # Away from the cells' faces by more than the margin in which APIC hides velocity gradients.
    local = rng.integers(0, grid.cells - 1, size=(count, dimension)) + rng.uniform(
        0.02, 0.98, size=(count, dimension)
    )
    arrays = State.at_start(
        grid.origin + local * grid.spacing,
        rng.uniform(0.5, 1.5, count) * grid.cell_volume / 8,
        rng.normal(size=(count, dimension)),
    ).arrays()
    return grid, State.from_arrays(arrays | {"affine": rng.normal(size=(count, dimension, dimension))})


@pytest.fixture
def random_state() -> Callable[..., tuple[RegularGrid, State]]:
    """`random_state(dimension, count, seed)` -> (grid, state) of scattered particles."""
    return scattered
