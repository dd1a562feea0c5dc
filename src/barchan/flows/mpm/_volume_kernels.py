"""Kernels of the correction of excess volume: a Poisson problem with inequalities on the grid stencil (see `volume`).

Arrays (n, 3^d) hold one value for each neighbour of a node, whose number is -1 where there is none. Every parallel loop writes
one row per iteration: results do not depend on the thread count.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray


@njit(cache=True, parallel=True)
def gather_poisson(
    node_cells: NDArray[np.int32],
    slots: NDArray[np.int64],
    product_moments: NDArray[np.int64],
    slopes: NDArray[np.float64],
    moments: NDArray[np.float64],
    stiffness: NDArray[np.float64],
) -> None:
    """K_ij = sum_p V_p grad w_i . grad w_j, (n, 3^d), into an array filled with zeros."""
    corners, d = node_cells.shape[1], slopes.shape[1]
    for a in prange(node_cells.shape[0]):
        for i in range(corners):
            c = node_cells[a, i]
            if c < 0:
                continue
            for j in range(corners):
                total = 0.0
                for k in range(d):
                    part = 0.0
                    for t in range(4):
                        part += moments[c, product_moments[i, j, k, k, t]]
                    total += slopes[i, k] * slopes[j, k] * part
                stiffness[a, slots[i, j]] += total


@njit(cache=True, parallel=True)
def volume_changes(
    gradients: NDArray[np.float64], neighbours: NDArray[np.int32], moves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Changes (n,) of the nodes' volumes sum_p V_p w_i when the nodes move by `moves` (n, d): sum_j g_ji . move_j.

    gradients : (n, 3^d, d) of `GridMatter`, g_ij = sum_p V_p w_i grad w_j; the node opposite j in the stencil of j is i.
    """
    count, width = neighbours.shape
    found = np.empty(count)
    for a in prange(count):
        total = 0.0
        for slot in range(width):
            b = neighbours[a, slot]
            if b >= 0:
                for k in range(moves.shape[1]):
                    total += gradients[b, width - 1 - slot, k] * moves[b, k]
        found[a] = total
    return found


@njit(cache=True, parallel=True)
def mean_slopes(
    gradients: NDArray[np.float64], neighbours: NDArray[np.int32], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """sum_p V_p w_i(x_p) grad v(x_p) (n, d) of the field with nodal `values` (n,)."""
    count, width = neighbours.shape
    d = gradients.shape[2]
    found = np.zeros((count, d))
    for a in prange(count):
        for slot in range(width):
            b = neighbours[a, slot]
            if b >= 0:
                for k in range(d):
                    found[a, k] += gradients[a, slot, k] * values[b]
    return found


@njit(cache=True)
def least_potential(
    stiffness: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    target: NDArray[np.float64],
    iterations: int,
) -> NDArray[np.float64]:
    """lambda (n,) >= 0 of least energy lambda.K lambda / 2 with K lambda >= target: accelerated projected gradient.

    A fixed number of iterations from zero, invariant under relabelling of nodes: mirror-symmetric matter is shifted
    symmetrically even where the iterations are far from converged. Steps are scaled by the diagonal of K and by the largest row
    sum of what is then left, which bounds its eigenvalues.
    """
    count, width = neighbours.shape
    middle = width // 2
    largest = 0.0
    for a in range(count):
        row = 0.0
        for slot in range(width):
            row += abs(stiffness[a, slot])
        largest = max(largest, row / stiffness[a, middle])
    rates = np.empty(count)
    for a in range(count):
        rates[a] = 1.0 / (largest * stiffness[a, middle])
    found, ahead, before = np.zeros(count), np.zeros(count), np.zeros(count)
    inertia = 1.0
    for _ in range(iterations):
        _step(stiffness, neighbours, target, rates, ahead, found)
        following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * inertia * inertia))
        share = (inertia - 1.0) / following
        for a in range(count):
            ahead[a] = found[a] + share * (found[a] - before[a])
            before[a] = found[a]
        inertia = following
    return found


@njit(cache=True, parallel=True)
def _step(
    stiffness: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    target: NDArray[np.float64],
    rates: NDArray[np.float64],
    ahead: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """One projected gradient step from `ahead` (n,) into `found` (n,)."""
    for a in prange(neighbours.shape[0]):
        residual = target[a]
        for slot in range(neighbours.shape[1]):
            b = neighbours[a, slot]
            if b >= 0:
                residual -= stiffness[a, slot] * ahead[b]
        found[a] = max(ahead[a] + rates[a] * residual, 0.0)
