"""Kernels of the material point method: sums over particles and over grid stencils (seed B, 7.3.1 and 7.3.2).

A plane grid is treated as a solid one whose third axis has no extent, so that one compiled kernel serves both dimensions.
Every parallel loop writes one row per iteration and adds in a fixed order: results do not depend on the thread count.

Within a cell every integrand is a product of three shape functions or slopes, so a cell is summed up by its moments
`sum_p V_p b_i(xi) b_j(eta) b_k(zeta)` with b = ((1 - t)^2, t (1 - t), t^2): 1 - t = b0 + b1, t = b1 + b2, 1 = b0 + 2 b1 + b2,
which are sums of positive numbers. The tables that pick moments are built by `stencil.MomentTables`.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

# Local coordinates are kept this far inside their cell, so that no active node has a zero weight: a particle lying exactly
# on a face would otherwise leave the far nodes without mass but not without force (their slopes do not vanish).
SMALLEST_LOCAL_COORDINATE = 1e-9
# Within about this distance (in cells) of a face, particles show less and less of their velocity gradient across the face to
# the grid. A node beyond the face that carries almost no other matter would else be extrapolated from its own velocity of
# the step before and fall freely for ever, above matter at rest, without a weight to make this felt.
AFFINE_MARGIN = 0.01


@njit(cache=True, inline="always")
def _inside_unit(t: float) -> float:
    return min(max(t, SMALLEST_LOCAL_COORDINATE), 1.0 - SMALLEST_LOCAL_COORDINATE)


@njit(cache=True, inline="always")
def _in_half(t: float, half: int) -> bool:
    """A particle in the middle belongs to both halves, so that mirrored matter marks mirrored parts."""
    return t > 0.5 - SMALLEST_LOCAL_COORDINATE if half == 1 else t < 0.5 + SMALLEST_LOCAL_COORDINATE


@njit(cache=True, inline="always")
def _affine_share(t: float) -> float:
    return min(1.0, t * (1.0 - t) / AFFINE_MARGIN)


@njit(cache=True, parallel=True)
def sum_cells(
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    occupied: NDArray[np.int64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    affine: NDArray[np.float64],
    volumes: NDArray[np.float64],
    moments: NDArray[np.float64],
    momenta: NDArray[np.float64],
    halves: NDArray[np.bool_],
) -> None:
    """Moments (C, 3^d) of the particle volumes and, at the corners (C, 2^d, d), sum V_p w_i (v_p + c_p (y_i - x_p)).

    `halves` (C, 2^d) tells which parts of the cell, cut in two along each axis, hold a particle.

    `origin`, `spacing` and `cells` have length 3; in the plane the third entries are 0, 1 and 1.
    """
    d = positions.shape[1]
    corners, thirds = (2, 3) if d == 3 else (1, 1)
    for c in prange(occupied.size):
        cell2 = occupied[c] % cells[2]
        cell1 = (occupied[c] // cells[2]) % cells[1]
        cell0 = occupied[c] // (cells[2] * cells[1])
        for q in range(starts[c], starts[c + 1]):
            p = order[q]
            volume = volumes[p]
            t0 = _inside_unit((positions[p, 0] - origin[0]) / spacing[0] - cell0)
            t1 = _inside_unit((positions[p, 1] - origin[1]) / spacing[1] - cell1)
            t2 = _inside_unit((positions[p, 2] - origin[2]) / spacing[2] - cell2) if d == 3 else 0.0
            b0 = ((1.0 - t0) * (1.0 - t0), t0 * (1.0 - t0), t0 * t0)
            b1 = ((1.0 - t1) * (1.0 - t1), t1 * (1.0 - t1), t1 * t1)
            b2 = ((1.0 - t2) * (1.0 - t2), t2 * (1.0 - t2), t2 * t2)
            for i in range(2):
                for j in range(2):
                    for k in range(corners):
                        if _in_half(t0, i) and _in_half(t1, j) and (d == 2 or _in_half(t2, k)):
                            halves[c, (2 * i + j) * corners + k] = True
            for i in range(3):
                for j in range(3):
                    product = volume * b0[i] * b1[j]
                    for k in range(thirds):
                        moments[c, (3 * i + j) * thirds + k] += product * b2[k]
            seen0, seen1 = spacing[0] * _affine_share(t0), spacing[1] * _affine_share(t1)
            seen2 = spacing[2] * _affine_share(t2)
            for i in range(2):
                w0, y0 = (t0 if i == 1 else 1.0 - t0), (i - t0) * seen0
                for j in range(2):
                    w1, y1 = (t1 if j == 1 else 1.0 - t1), (j - t1) * seen1
                    for k in range(corners):
                        w2, y2 = (t2 if k == 1 else 1.0 - t2), (k - t2) * seen2
                        weight, corner = volume * w0 * w1 * w2, (2 * i + j) * corners + k
                        for e in range(d):
                            seen = velocities[p, e] + affine[p, e, 0] * y0 + affine[p, e, 1] * y1
                            if d == 3:
                                seen += affine[p, e, 2] * y2
                            momenta[c, corner, e] += weight * seen


@njit(cache=True)
def gather_nodes(
    node_cells: NDArray[np.int32],
    corner_moments: NDArray[np.int64],
    moments: NDArray[np.float64],
    momenta: NDArray[np.float64],
    node_volumes: NDArray[np.float64],
    node_momenta: NDArray[np.float64],
) -> None:
    """Add up what the cells around each node hold: volumes (n,) and momenta (n, d), from arrays filled with zeros."""
    for a in range(node_cells.shape[0]):
        for corner in range(node_cells.shape[1]):
            c = node_cells[a, corner]
            if c < 0:
                continue
            for m in corner_moments[corner]:
                node_volumes[a] += moments[c, m]
            for e in range(node_momenta.shape[1]):
                node_momenta[a, e] += momenta[c, corner, e]


@njit(cache=True, parallel=True)
def gather_gradients(
    node_cells: NDArray[np.int32],
    slots: NDArray[np.int64],
    gradient_moments: NDArray[np.int64],
    slopes: NDArray[np.float64],
    moments: NDArray[np.float64],
    gradients: NDArray[np.float64],
) -> None:
    """Stencil g_ij = sum_p V_p w_i(x_p) grad w_j(x_p), (n, 3^d, d), into an array filled with zeros."""
    corners, d = node_cells.shape[1], gradients.shape[2]
    for a in prange(node_cells.shape[0]):
        for i in range(corners):
            c = node_cells[a, i]
            if c < 0:
                continue
            for j in range(corners):
                slot = slots[i, j]
                for k in range(d):
                    m0, m1 = gradient_moments[i, j, k, 0], gradient_moments[i, j, k, 1]
                    gradients[a, slot, k] += slopes[j, k] * (moments[c, m0] + moments[c, m1])


@njit(cache=True, parallel=True)
def gather_viscous_blocks(
    node_cells: NDArray[np.int32],
    slots: NDArray[np.int64],
    product_moments: NDArray[np.int64],
    slopes: NDArray[np.float64],
    moments: NDArray[np.float64],
    blocks: NDArray[np.float64],
) -> None:
    """Stencil (n, 3^d, d, d) of sum_p V_p D(u):D(v) for v = e_k w_i, u = e_l w_j.

    With K_kl = sum_p V_p d_k w_i d_l w_j the block is (delta_kl Tr K + K_lk) / 2.
    """
    corners, d = node_cells.shape[1], blocks.shape[2]
    for a in prange(node_cells.shape[0]):
        for i in range(corners):
            c = node_cells[a, i]
            if c < 0:
                continue
            for j in range(corners):
                slot = slots[i, j]
                for k in range(d):
                    for el in range(d):
                        total = 0.0
                        for t in range(4):
                            total += moments[c, product_moments[i, j, k, el, t]]
                        total *= 0.5 * slopes[i, k] * slopes[j, el]
                        blocks[a, slot, el, k] += total
                        if k == el:
                            for e in range(d):
                                blocks[a, slot, e, e] += total


@njit(cache=True, parallel=True)
def fill_strain_blocks(
    gradients: NDArray[np.float64],
    indices: NDArray[np.int32],
    tensor: NDArray[np.float64],
    free: NDArray[np.bool_],
    data: NDArray[np.float64],
) -> None:
    """Blocks (s, d) of the strain operator: data = sum_k tensor[:, :, k] g_k, columns of constrained components zero."""
    s, d, _ = tensor.shape
    for entry in prange(indices.size):
        b = indices[entry]
        for row in range(s):
            for column in range(d):
                total = 0.0
                if free[b, column]:
                    for k in range(d):
                        total += tensor[row, column, k] * gradients[entry, k]
                data[entry, row, column] = total
