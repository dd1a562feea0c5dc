"""The space of the grains (seed C, 3.2.1): open or periodic, sheared with Lees-Edwards images, its top a piston."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from barchan.bodies.rigid import inputs
from barchan.errors import InputError


@dataclass(frozen=True)
class Piston:
    """Keeps the stress along the last axis at `pressure` by moving the top of a periodic cell.

    M dv/dt = sigma - pressure - M v / damping, where sigma is the mean compressive stress of the grains.

    pressure : > 0 [Pa], in the plane [N/m]. mass : M > 0 per area [kg/m^2], in the plane [kg/m]. damping : time > 0 [s].
    """

    pressure: float
    mass: float
    damping: float

    def __post_init__(self) -> None:
        for name in ("pressure", "mass", "damping"):
            inputs.positive(f"cell.piston.{name}", getattr(self, name))


@dataclass(frozen=True, init=False)
class Cell:
    """A periodic cell with a corner at the origin.

    lengths : (d,) [m]; along axes that are not periodic they mean nothing.
    periodic : (d,) which axes are (default: all).
    shear_rate : du_0/dx_last [1/s] of Lees-Edwards images: those above move along axis 0 by shear_rate times the height.
    piston : what moves the top, or None.
    """

    lengths: tuple[float, ...]
    periodic: tuple[bool, ...]
    shear_rate: float
    piston: Piston | None

    def __init__(
        self,
        lengths: ArrayLike,
        periodic: Sequence[bool] | None = None,
        shear_rate: float = 0.0,
        piston: Piston | None = None,
    ) -> None:
        sizes = inputs.vector("cell.lengths", lengths, (2, 3))
        if np.any(sizes <= 0.0):
            raise InputError("cell.lengths", sizes.tolist(), "positive")
        axes = (True,) * len(sizes) if periodic is None else tuple(bool(p) for p in periodic)
        if len(axes) != len(sizes):
            raise InputError("cell.periodic", axes, f"{len(sizes)} truth values")
        if not np.isfinite(shear_rate):
            raise InputError("cell.shear_rate", shear_rate, "a finite number")
        if shear_rate != 0.0 and not (axes[0] and axes[-1]):
            raise InputError("cell.shear_rate", shear_rate, "0 unless the first and last axis are periodic")
        if piston is not None and not all(axes):
            raise InputError("cell.piston", piston, "None unless all axes are periodic")
        object.__setattr__(self, "lengths", tuple(float(v) for v in sizes))
        object.__setattr__(self, "periodic", axes)
        object.__setattr__(self, "shear_rate", float(shear_rate))
        object.__setattr__(self, "piston", piston)

    @property
    def dimension(self) -> int:
        """Space dimension d."""
        return len(self.lengths)


@dataclass(frozen=True)
class CellState:
    """height [m] of the cell, its rate [m/s], offset [m] of the images above along axis 0, stress [Pa] the piston feels."""

    height: float
    height_rate: float = 0.0
    offset: float = 0.0
    stress: float = 0.0


def cell_rows(cell: Cell | None, state: CellState, dimension: int) -> NDArray[np.float64]:
    """(3, 6) : edges and velocities of the far sides, as the kernels read them; zero rows where nothing is periodic."""
    rows = np.zeros((3, 6))
    if cell is None:
        return rows
    for axis in range(dimension):
        if cell.periodic[axis]:
            rows[axis, axis] = cell.lengths[axis]
    last = dimension - 1
    if cell.periodic[last]:
        rows[last, last] = state.height
        rows[last, 0] += state.offset
        rows[last, 3 + last] = state.height_rate
        rows[last, 3] += cell.shear_rate * state.height
    return rows


def drive_of(cell: Cell | None, state: CellState, dimension: int) -> NDArray[np.float64]:
    """(7,) : what `advance_cell` reads."""
    drive = np.zeros(7)
    drive[0] = dimension - 1
    if cell is not None:
        drive[1] = cell.shear_rate
        if cell.piston is not None:
            drive[2:6] = cell.piston.pressure, cell.piston.mass, cell.piston.damping, 1.0
            drive[6] = state.stress
    return drive


def wrap(x: NDArray[np.float64], v: NDArray[np.float64], rows: NDArray[np.float64]) -> None:
    """Bring grains (n, 3) that left the cell back into it, with the velocities of their new images; all in place.

    The cell is the slanted box of the edges in `rows` (3, 6); first the images above are brought as near as they can be.
    """
    last = 1 if rows[2, 2] == 0.0 else 2
    if rows[0, 0] > 0.0:
        rows[last, 0] -= rows[0, 0] * np.round(rows[last, 0] / rows[0, 0])
    for axis in (2, 1, 0):
        length = rows[axis, axis]
        if length == 0.0:
            continue
        place = x[:, axis].copy()
        if axis == 0 and rows[last, last] > 0.0:
            place -= rows[last, 0] / rows[last, last] * x[:, last]
        times = np.floor(place / length)[:, None]
        moved = times[:, 0] != 0.0
        if np.any(moved):
            x[moved] -= times[moved] * rows[axis, :3]
            v[moved] -= times[moved] * rows[axis, 3:]
