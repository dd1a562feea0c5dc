"""Velocities that arrive along characteristics, u o X with X(x) = x - dt u(x) (seed A, 5.2; seed B, 6.5.3)."""

from __future__ import annotations

import numpy as np

from barchan.spaces.characteristics import feet
from barchan.spaces.mixed import MixedSpace


class Carrier:
    """Carries velocities of one space to its velocity quadrature points."""

    def __init__(self, space: MixedSpace) -> None:
        self.space = space
        self.cells = space.velocity_cells

    def arriving(self, v: np.ndarray, dt: float) -> np.ndarray:
        """(n, d) velocities u(x - dt u(x)) at `space.velocity_points`; paths stop at the boundary."""
        space = self.space
        return np.asarray(feet(space, space.locator, v, dt, space.velocity_points, self.cells))
