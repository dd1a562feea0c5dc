"""Matrices and vectors of one step from the moments of the particles (seed B, 7.1.4 and 7.3.1).

Strain operator B (form b), compression allowance k, Newtonian stiffness A (form a), all on the stencil of active nodes,
with multilinear velocities and stresses at the same nodes and the particles as quadrature points.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import chi_inverse, tensor_block_size
from barchan.flows.mpm._kernels import fill_strain_blocks, gather_viscous_blocks
from barchan.flows.mpm.material import Material
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.transfer import GridMatter
from barchan.flows.mpm.walls import WallContacts


@lru_cache(maxsize=2)
def _strain_tensor(dimension: int) -> NDArray[np.float64]:
    """(s, d, d): T with T[:, c, k] g_k = 2 chi^-1(sym(e_c (x) g)); the 2 makes up for <s, t> = s:t/2."""
    unit = np.eye(dimension)
    outer = np.einsum("ca,kb->ckab", unit, unit)
    symmetric = 0.5 * (outer + np.swapaxes(outer, -1, -2))
    return np.ascontiguousarray(np.moveaxis(2.0 * chi_inverse(symmetric), -1, 0))


def strain_operator(matter: GridMatter, free: NDArray[np.bool_]) -> sp.bsr_array:
    """B (n s, n d) in blocks (s, d) [m^(d-1)]: (B u)_i = 2 chi^-1(sum_p V_p w_i(x_p) D(u)(x_p)) [m^d/s].

    Its transpose gives the internal forces: r . (B v) = sum_p V_p tau(x_p):D(v)(x_p) with tau = sum_i w_i chi(r_i).
    Columns of velocity components that are not `free` (n, d) are zero, which holds these components at zero.
    """
    linked = matter.stencil.linked
    count, d = free.shape
    size = tensor_block_size(d)
    indptr = np.zeros(count + 1, dtype=np.int32)
    np.cumsum(np.count_nonzero(linked, axis=1), out=indptr[1:])
    indices = np.empty(indptr[-1], dtype=np.int32)
    data = np.empty((indptr[-1], size, d))
    fill_strain_blocks(
        matter.gradients, linked, matter.stencil.neighbours, _strain_tensor(d), free, indptr, indices, data
    )
    return sp.bsr_array((data, indices, indptr), shape=(count * size, count * d))


def with_wall_rows(strain: sp.bsr_array, contacts: WallContacts, free: NDArray[np.bool_]) -> sp.bsr_array:
    """Append one block (s, d) per frictional contact below the strain operator: rows a_i (n; t_1; ..), then zeros.

    The relative velocity is scaled by the contact area a_i, so that the block of r is a traction in Pa. The contact is
    exact Coulomb friction with a unilateral normal velocity, not the tensor form of seed B's appendix C.2; the s - d
    rows left over are zero and their stresses stay at zero.
    """
    if len(contacts.numbers) == 0:
        return strain
    size, d = strain.blocksize
    blocks = np.zeros((len(contacts.numbers), size, d))
    blocks[:, :d, :] = contacts.areas[:, None, None] * contacts.frames * free[contacts.numbers][:, None, :]
    indptr = np.concatenate([strain.indptr, strain.indptr[-1] + 1 + np.arange(len(blocks), dtype=np.int32)])
    indices = np.concatenate([strain.indices, contacts.numbers.astype(np.int32)])
    data = np.concatenate([strain.data, blocks])
    return sp.bsr_array(
        (data, indices, indptr.astype(np.int32)), shape=((len(indptr) - 1) * size, strain.shape[1])
    )


def compression_allowance(matter: GridMatter, material: Material, dt: float) -> NDArray[np.float64]:
    """k (n, s): e_N sqrt(2/d) max((1 - e) phi_max c_i - sum_p V_p w_i(x_p), 0) / dt [m^d/s] (seed B, 7.1.4 and 7.3.1).

    From k(tau) = integral of (beta / d) Tr tau and Tr chi(e_N) = sqrt(2 d). The clamp at zero keeps the step dissipative:
    excess volume is not pushed out again. c_i is the room occupied by matter (`GridMatter.occupied_capacities`) and e is
    `material.packing_tolerance`: both make k smaller, never negative, so the argument of seed B 7.1.2 that contacts
    dissipate holds as before. k is continuous in the volumes: support is not lost at a stroke.
    """
    d = matter.grid.dimension
    packed = (1.0 - material.packing_tolerance) * material.max_volume_fraction * matter.occupied_capacities
    allowance = np.zeros((len(packed), tensor_block_size(d)))
    allowance[:, 0] = np.sqrt(2.0 / d) * np.maximum(packed - matter.volumes, 0.0) / dt
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
    data = viscosity * blocks[linked] * free[rows][:, :, None] * free[indices][:, None, :]
    return sp.bsr_array((data, indices, indptr), shape=(count * d, count * d))
