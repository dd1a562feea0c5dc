"""The weak strain rate of piecewise constant velocities, with the volume fraction (seed B, Eq. 7.12-7.13).

Derivation. For piecewise constant tau and v, b(tau, v) = int phi tau : D(v) becomes, cell by cell and with the divergence
theorem, b_h(tau, v) = sum_K phi_K tau_K : sum_{F of K} |F| v_F (x) n_K, where v_F is the one velocity of the side F: this is
the discontinuous Green formula (7.12) applied to the tensor phi tau, written with v_F instead of jumps. The formula of the
seed has v_F = (v_K + v_K') / 2, consistent for every continuous v; so is any other mean. We take that of the momentum,

    v_F = (phi_K v_K + phi_K' v_K') / (phi_K + phi_K'),

which is the seed's between cells that are equally full, and v_K (a free surface, without traction) where K' is empty. So
dropping empty cells is the limit of nearly empty ones: the stress of a full cell pushes a neighbour with a force
proportional to the mass there, where the plain mean would give that neighbour an acceleration without bound, and would
leave no stress in full cells under a surface (a neighbour of mass zero bears no force at all).

At the boundary v_F = v_K, and what walls do stands in contacts of their own (`momentum.wall_contacts`): u_n = -v_K . n >= 0
with a normal traction, and Coulomb friction on it, that of the matter itself where it does not slip. With the jump at the wall
inside the strain of the cell, as in (7.13), the wall bears only on packed cells, and a layer one cell thick has no friction:
its stress vanishes, for nothing but the wall holds it. With contacts a resting bed has as many stresses as velocities.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.cones import strain_tensor, tensor_block_size
from barchan.flows.dry._kernels import fill_strain, overlap
from barchan.flows.dry.cells import Cells


def strain_operator(
    cells: Cells,
    fractions: NDArray[np.float64],
    filled: NDArray[np.bool_],
    sticky: NDArray[np.bool_] | None = None,
) -> sp.bsr_array:
    """B (n s, n d) over the n filled cells, blocks (s, d) [m^(d-1)]: (B v)_K = 2 phi_K |K| chi^-1(D_h(v)_K) [m^d/s].

    r . (B v) = b_h(tau, v) with tau_K = chi(r_K).  fractions : (c,).
    sticky : (c, k) boundary sides that have only the normal velocity of their cell: the strain rate that matter at a wall of
        no slip has, with the tangential jump; none when left out.
    """
    if sticky is None:
        sticky = np.zeros(cells.neighbours.shape, dtype=bool)
    active = np.flatnonzero(filled)
    numbers = np.full(cells.count, -1, dtype=np.int64)
    numbers[active] = np.arange(len(active))
    d, s = cells.dimension, tensor_block_size(cells.dimension)
    indptr = np.zeros(len(active) + 1, dtype=np.int32)
    overlap(filled, cells.neighbours, indptr)
    indices = np.empty(indptr[-1], dtype=np.int32)
    data = np.empty((indptr[-1], s, d))
    fill_strain(
        active,
        numbers,
        cells.neighbours,
        cells.faces,
        sticky,
        fractions,
        strain_tensor(d),
        indptr,
        indices,
        data,
    )
    matrix = sp.bsr_array((data, indices, indptr), shape=(len(active) * s, len(active) * d))
    matrix.sort_indices()
    return matrix
