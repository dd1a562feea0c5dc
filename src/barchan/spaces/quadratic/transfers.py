"""Prolongation from a quadrilateral mesh to its regular refinement, for Q2/P1 (seed C 4.2; grids of its multigrid).

A fine velocity is the coarse one at the reference place of the fine node, a fine pressure the coarse linear function on the
child. On curved cells the spaces are nested in reference coordinates only, as usual with isoparametric refinement.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.spaces.quadratic.mesh import QUADRILATERAL_OFFSETS
from barchan.spaces.quadratic.space import QuadraticSpace

_CHILDREN = 4


def check_refinement(coarse: QuadraticSpace, fine: QuadraticSpace) -> None:
    """Raise InputError unless `fine` is a space of the same kind on the refined quadrilaterals of `coarse`."""
    if not (coarse.mesh.quadrilateral and fine.mesh.quadrilateral):
        raise InputError("spaces", "triangles", "spaces on quadrilaterals")
    if coarse.pressure_name != fine.pressure_name:
        raise InputError("spaces", f"{coarse.pressure_name} and {fine.pressure_name}", "of one pressure")
    if fine.cells != _CHILDREN * coarse.cells or not np.array_equal(
        fine.cell_nodes[0::4, 0], coarse.cell_nodes[:, 0]
    ):
        raise InputError(
            "spaces", f"{coarse.cells} and {fine.cells} cells", "a mesh and its `refined()`, coarse to fine"
        )


def velocity_transfer(space: QuadraticSpace) -> np.ndarray:
    """(4, 9, 9) shapes of the parent [j, fine node, coarse node] at the nodes of its child j."""
    reference = np.asarray(space.mesh.shapes.element.doflocs, dtype=float)
    places = 0.5 * (reference[None] + QUADRILATERAL_OFFSETS[:, None])
    tables = space.mesh.shapes.values(places.reshape(-1, 2).T).T.reshape(4, 9, 9)
    tables[np.abs(tables) < 1e-14] = 0.0
    return np.ascontiguousarray(tables)


def pressure_transfer(coarse: QuadraticSpace, fine: QuadraticSpace) -> np.ndarray:
    """(C_fine, 3, 3) coefficients on a child [cell, fine, coarse] of the linear functions of its parent."""
    transfer = np.zeros((fine.cells, 3, 3))
    transfer[:, 0, 0] = 1.0
    if coarse.pressure_name == "P1d_mapped":
        transfer[:, 1, 1] = transfer[:, 2, 2] = 0.5
        transfer[:, 0, 1:] = np.tile(QUADRILATERAL_OFFSETS - 0.5, (coarse.cells, 1))
        return transfer
    parents, children = np.repeat(coarse.pressure_frames, 4, axis=0), fine.pressure_frames
    transfer[:, 0, 1:] = (children[:, :2] - parents[:, :2]) / parents[:, 2:]
    transfer[:, 1, 1] = transfer[:, 2, 2] = children[:, 2] / parents[:, 2]
    return transfer


def velocity_prolongation(coarse: QuadraticSpace, fine: QuadraticSpace) -> sp.csr_array:
    """(N_fine, N_coarse) of one component; each fine node is taken from one of the parents that share it."""
    owner = np.empty(fine.N, np.int64)
    flat = fine.cell_nodes.ravel()
    owner[flat[::-1]] = np.arange(len(flat))[::-1]  # the first cell with that node
    cells, places = owner // 9, owner % 9
    values = velocity_transfer(coarse)[cells % 4, places]
    columns = coarse.cell_nodes[cells // 4]
    kept = values != 0.0
    pointers = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    matrix = sp.csr_array((values[kept], columns[kept], pointers), shape=(fine.N, coarse.N))
    matrix.sort_indices()
    return matrix


def prolongation(coarse: QuadraticSpace, fine: QuadraticSpace) -> sp.csr_array:
    """(fine.size, coarse.size) prolongation of velocities and pressures.

    Raises InputError unless `fine` lives on the refined mesh of `coarse`, both of quadrilaterals, with one kind of pressure.
    """
    check_refinement(coarse, fine)
    velocity = sp.kron(velocity_prolongation(coarse, fine), sp.eye_array(2), format="csr")
    blocks = pressure_transfer(coarse, fine)
    parent = coarse.cell_pressures[np.repeat(np.arange(coarse.cells), 4)]
    columns = np.broadcast_to(parent[:, None, :], blocks.shape)
    pointers = np.arange(0, blocks.size + 1, 3)
    pressure = sp.csr_array((blocks.ravel(), columns.ravel(), pointers), shape=(fine.P, coarse.P))
    pressure.eliminate_zeros()
    matrix = sp.csr_array(sp.block_array([[velocity, None], [None, pressure]], format="csr"))
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
    return matrix


def point_transfer(space: QuadraticSpace) -> np.ndarray:
    """(4, Q, Q) weights [j, point of child j, point of the parent] that carry values at quadrature points to the children.

    Linear in each direction between the Gauss points of the parent, constant beyond them: bounds of the values are kept.
    """
    X = space.reference_points
    lines = np.unique(np.round(X[0], 12))
    order = [[int(np.argmin(np.abs(lines - x))) for x in row] for row in X]
    hats = np.eye(len(lines))
    transfer = np.empty((4, X.shape[1], X.shape[1]))
    for j, offset in enumerate(QUADRILATERAL_OFFSETS):
        along = [np.stack([np.interp(0.5 * (X[a] + offset[a]), lines, hat) for hat in hats]) for a in (0, 1)]
        transfer[j] = (along[0][order[0]] * along[1][order[1]]).T
    return transfer
