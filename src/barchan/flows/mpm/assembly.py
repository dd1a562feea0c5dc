"""Matrices and vectors of one step from the moments of the particles (seed B, 7.1.4 and 7.3.1).

Strain operator B (form b), compression allowance k, Newtonian stiffness A (form a), all on the velocities of active cells,
with the particles as quadrature points.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import strain_tensor, tensor_block_size
from barchan.flows.mpm._kernels import fill_strain_blocks, gather_viscous_blocks
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.stresses import StressRows
from barchan.flows.mpm.transfer import GridMatter


def strain_operator(
    rows: StressRows, free: NDArray[np.bool_], inverse_metric: NDArray[np.float64] | None = None
) -> sp.bsr_array:
    """B (q s, n d) in blocks (s, d) [m^(d-1)]: (B u)_i = 2 chi^-1(sum_p V_p omega_i(x_p) D(u)(x_p)) [m^d/s].

    Its transpose gives the internal forces: r . (B v) = sum_p V_p tau(x_p):D(v)(x_p) with tau = sum_i omega_i chi(r_i).
    Columns of velocity components that are not `free` (n, d) are zero, which holds these components at zero.
    inverse_metric : (q, s, s) by which each row of blocks is multiplied (anisotropic friction, seed B 7.4.2).
    """
    d = free.shape[1]
    size = tensor_block_size(d)
    data = np.empty((len(rows.indices), size, d))
    fill_strain_blocks(rows.gradients, rows.indices, strain_tensor(d), free, data)
    if inverse_metric is not None:
        row_of = np.repeat(np.arange(len(rows.ids)), np.diff(rows.indptr))
        data = np.ascontiguousarray(inverse_metric[row_of] @ data)
    return sp.bsr_array((data, rows.indices, rows.indptr), shape=(len(rows.ids) * size, len(free) * d))


def compression_allowance(
    rows: StressRows, max_volume_fraction: float, packing_tolerance: float, dt: float
) -> NDArray[np.float64]:
    """k (q, s): e_N sqrt(2/d) max((1 - e) phi_max c_i - sum_p V_p omega_i(x_p), 0) / dt [m^d/s] (seed B, 7.1.4 and 7.3.1).

    From k(tau) = integral of (beta / d) Tr tau and Tr chi(e_N) = sqrt(2 d). The clamp at zero keeps the step dissipative:
    excess volume is not pushed out again. c_i is the room occupied by matter (`StressRows.room`) and e the packing
    tolerance: both make k smaller, never negative, so the argument of seed B 7.1.2 that contacts dissipate holds as
    before. k is continuous in the volumes: support is not lost at a stroke.
    """
    d = rows.places.shape[1]
    packed = (1.0 - packing_tolerance) * max_volume_fraction * rows.room
    allowance = np.zeros((len(packed), tensor_block_size(d)))
    allowance[:, 0] = np.sqrt(2.0 / d) * np.maximum(packed - rows.volumes, 0.0) / dt
    return allowance


def viscous_stiffness(matter: GridMatter, viscosity: float, free: NDArray[np.bool_]) -> sp.bsr_array:
    """A (n d, n d) in blocks (d, d): v.A u = eta sum_p V_p D(u)(x_p):D(v)(x_p) [kg/s].

    Rows and columns of components that are not `free` (n, d) are zero.
    """
    d = matter.grid.dimension
    tables, count = moment_tables(d), len(matter.active.nodes)
    blocks = np.zeros((count, 3**d, d, d))
    gather_viscous_blocks(
        matter.stencil.cells, tables.slots, tables.product, matter.stencil.slopes, matter.moments, blocks
    )
    linked = matter.stencil.linked
    rows, _ = np.nonzero(linked)
    indices = matter.stencil.neighbours[linked]
    indptr = np.append(0, np.cumsum(np.count_nonzero(linked, axis=1))).astype(np.int32)
    data = blocks[linked]
    del blocks  # as large as all else here
    data *= viscosity
    data *= free[rows][:, :, None]
    data *= free[indices][:, None, :]
    return sp.bsr_array((data, indices, indptr), shape=(count * d, count * d))
