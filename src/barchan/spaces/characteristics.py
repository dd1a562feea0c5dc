"""First-order characteristics: the velocity found at the feet X(x) = x - dt u(x) of the paths (seed A, 5.2).

(u . grad) u + du/dt is replaced by (u_new - u o X) / dt, which leaves the equations of a step symmetric.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.errors import InputError
from barchan.spaces.location import Locator, evaluate


class VelocitySpace(Protocol):
    """What is asked of a space: the scikit-fem basis of its velocities."""

    @property
    def basis(self) -> Any:
        """Basis of an `ElementVector` on the mesh of the locator."""


def feet(
    space: VelocitySpace,
    locator: Locator,
    v: ArrayLike,
    dt: float,
    points: ArrayLike,
    cells: ArrayLike,
) -> NDArray[np.float64]:
    """Velocities (n, d) of u o X at points (n, d): where the matter that is there now was a time `dt` ago.

    Parameters
    ----------
    space : holds `basis`, of the velocity.
    locator : of the same mesh.
    v : (size,) coefficients of the velocity u.
    dt : time step, at least 0.
    points : (n, d), for instance the quadrature points.
    cells : (n,) cell of each point, negative where it is not known.

    A path that leaves the domain stops at the boundary. Raises InputError for a negative `dt` or values that are not finite.
    """
    if not (np.isfinite(dt) and dt >= 0.0):
        raise InputError("dt", dt, "a time of at least 0")
    places = np.ascontiguousarray(points, dtype=np.float64)
    homes = np.ascontiguousarray(cells, dtype=np.int64)
    if np.any(homes < 0):
        homes = locator.find(places, homes)[0]
    here = evaluate(space.basis, v, homes, locator.reference(places, homes))
    if not np.all(np.isfinite(here)):
        raise InputError("v", "velocities that are not finite", "finite")
    reached, reference, _ = locator.follow(places, places - dt * here, homes)
    return evaluate(space.basis, v, reached, reference)
