"""Step two: the volume fraction by implicit upwind transport, and velocities carried along (seed B, Eq. 7.14 and 7.2.2).

The matrix A = |K| + dt (upwind fluxes) is an M-matrix whose columns sum up to |K|, plus what leaves the domain. Hence
 - phi^(k+1) >= 0, in floating point too: elimination without exchange of rows adds and multiplies like signs only;
 - the mass is kept to round-off;
 - phi^(k+1) <= phi_max wherever 1 + dt div u >= phi^k / phi_max, which the momentum step demands (`momentum`) for the same
   side velocities: where the maximum x is reached, x (|K| + dt out) <= |K| phi^k + dt in x, so x (1 + dt div u) <= phi^k.
The momentum step holds up to the tolerance of its solver; the little that this lets through (and an overfull start) is moved
to the nearest cells with room, so that 0 <= phi <= phi_max always and no matter is lost.

Velocities. The form t_h of the seed, whose printed sign we settle, is (w . grad) u = sum_F (w . n)^- (u' - u) |F| / |K| on a
cell. Taken so, dust of no weight that falls on a heap brings its full velocity into the heap: energy grows without bound
(measured, docs/dry_p0.md). "explicit" weighs the sum by what flows: dt phi' (w . n)^- |F| over the matter of the cell at the
end, with phi^(k+1) of the neighbour, the same fluxes by which the volume fraction moves; between equal fractions this is the
form of the seed, and the total momentum is kept exactly as long as no cell is emptied by more than it held. "conservative"
carries phi u with the matrix A, exact at any step and more diffusive. Both give means of velocities, so none grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from barchan.flows.dry._kernels import advect, fill_upwind, scratch, side_fluxes, spread_excess
from barchan.flows.dry.cells import Cells
from barchan.flows.dry.options import Options

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moved:
    """What transport gives.

    fractions : (c,).  carried : (c, d) velocities.  gone, excess : volumes that left the domain and were moved as excess [m^d].
    crossing : (c, k) volume of matter that left each cell through each side, before any excess was moved [m^d].
    """

    fractions: Vector
    carried: Vector
    gone: float
    excess: float
    crossing: Vector


def transport(
    cells: Cells, codes: NDArray[np.int64], fractions: Vector, velocities: Vector, dt: float, largest: float,
    options: Options,
) -> Moved:  # fmt: skip
    """Fractions (c,), at most `largest`, and carried velocities (c, d) after a step of `dt` seconds with `velocities`."""
    fluxes = np.empty(cells.neighbours.shape)
    side_fluxes(fractions, options.empty, velocities, cells.neighbours, cells.faces, codes, fluxes)
    matter = cells.volumes * fractions
    contents = matter[:, None]
    if options.inertia == "conservative":
        contents = np.concatenate([contents, contents * velocities], axis=1)
    found = implicit_upwind(cells, fluxes, dt, contents)
    moved = np.ascontiguousarray(found[:, 0])
    leaving = dt * np.sum(np.where(cells.neighbours < 0, fluxes, 0.0), axis=1)
    if options.inertia == "conservative":
        some = np.broadcast_to(found[:, :1] > options.empty, velocities.shape)
        carried = np.divide(found[:, 1:], found[:, :1], out=np.zeros_like(velocities), where=some)
    else:
        carried = np.empty_like(velocities)
        advect(cells.volumes * moved, moved, cells.neighbours, fluxes, dt, velocities, carried)
    amounts, excess = within_capacity(cells, moved, largest)
    # A side's flux is exactly opposite seen from the other cell, so what leaves one enters the other to the bit.
    entering = np.where(cells.neighbours >= 0, np.minimum(fluxes, 0.0) * moved[cells.neighbours], 0.0)
    crossing = dt * (np.maximum(fluxes, 0.0) * moved[:, None] + entering)
    return Moved(amounts, carried, float(np.sum(leaving * moved)), excess, crossing)


def implicit_upwind(cells: Cells, fluxes: Vector, dt: float, contents: Vector) -> Vector:
    """A^-1 of the contents (c, m), each a volume of something in the cells, per volume (c, m).

    Only cells with a flux are unknowns. A is eliminated along the diagonal: the signs of its entries then prove that what
    is nowhere negative stays so.
    """
    count, k = fluxes.shape
    indices, data = np.empty((count, k + 1), dtype=np.int64), np.empty((count, k + 1))
    fill_upwind(cells.volumes, cells.neighbours, fluxes, dt, indices, data)
    changing = np.flatnonzero(np.any(fluxes != 0.0, axis=1))
    solution = contents / cells.volumes[:, None]
    if len(changing) == 0:
        return solution
    number = np.zeros(count, dtype=np.int32)
    number[changing] = np.arange(len(changing))
    values, rows = data[changing], indices[changing]
    values[:, :k][fluxes[changing] <= 0.0] = 0.0
    rows = np.where(values != 0.0, rows, changing[:, None])
    matrix = sp.csc_array(
        (values.ravel(), number[rows].ravel(), np.arange(0, values.size + 1, k + 1, dtype=np.int32)),
        shape=(len(changing),) * 2,
    )
    matrix.sum_duplicates()
    factors = spla.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    solution[changing] = factors.solve(contents[changing])
    return solution


def within_capacity(cells: Cells, fractions: Vector, largest: float) -> tuple[Vector, float]:
    """Fractions (c,) with what exceeds `largest` moved to the nearest room, and the volume of matter moved [m^d]."""
    over = fractions > largest
    if not np.any(over):
        return fractions, 0.0
    excess = float(np.sum((fractions[over] - largest) * cells.volumes[over]))
    capacities = largest * cells.volumes
    amounts = fractions * cells.volumes
    queue, seen = scratch(cells.count)
    homeless = spread_excess(amounts, capacities, cells.neighbours, queue, seen)
    found = np.minimum(amounts / cells.volumes, largest)
    if homeless > 0.0:  # the whole domain is full: nothing but an even share is left
        found = found + homeless / np.sum(cells.volumes)
    return found, excess
