"""What changes from step to step in a model of Super-Helices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from barchan.bodies.fibres.model import Vector


@dataclass(frozen=True, eq=False)
class HelixShape:
    """Super-Helices at a time.

    curvatures : (p, 3) twist and two curvatures of each piece [1/m].  velocities : (3 p,) their rates [1/(m s)].
    point_velocities : (k, 3) of the points of quadrature [m/s].  root_velocities, root_spins : (f, 3) [m/s], [rad/s].
    """

    time: float
    curvatures: Vector
    velocities: Vector
    point_velocities: Vector
    root_velocities: Vector
    root_spins: Vector

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every field as an array."""
        return {
            "time": np.array(self.time), "curvatures": self.curvatures, "velocities": self.velocities,
            "point_velocities": self.point_velocities, "root_velocities": self.root_velocities, "root_spins": self.root_spins,
        }  # fmt: skip
