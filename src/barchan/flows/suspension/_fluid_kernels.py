"""Kernels of the fluid on the grid: the viscous stiffness and the transport along characteristics (seed B, 8.3).

A plane grid is a solid one whose third axis has one node and no cell. Every parallel loop writes one row per iteration and adds
in a fixed order: results do not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray


@njit(cache=True, parallel=True)
def assemble_stiffness(
    nodes: NDArray[np.int64],
    viscosity: NDArray[np.float64],
    element: NDArray[np.float64],
    indptr: NDArray[np.int32],
    blocks: NDArray[np.float64],
) -> None:
    """Blocks (nnz, d, d) of sum_c eta_c K_c, K_c = `element` (2^d, 2^d, d, d), in the rows of `indptr`.

    nodes (3,) along each axis, 1 for the third one of the plane; viscosity (cells,).
    """
    d = element.shape[2]
    third = 2 if nodes[2] > 1 else 1
    cells1, cells2 = nodes[1] - 1, max(nodes[2] - 1, 1)
    for i in prange(nodes[0] * nodes[1] * nodes[2]):
        i2 = i % nodes[2]
        i1 = (i // nodes[2]) % nodes[1]
        i0 = i // (nodes[2] * nodes[1])
        blocks[indptr[i] : indptr[i + 1]] = 0.0
        # Neighbours are numbered like their nodes, without those outside of the box.
        low0, low1, low2 = max(i0 - 1, 0), max(i1 - 1, 0), max(i2 - 1, 0)
        wide1 = min(i1 + 1, nodes[1] - 1) - low1 + 1
        wide2 = min(i2 + 1, nodes[2] - 1) - low2 + 1
        for a0 in range(2):
            for a1 in range(2):
                for a2 in range(third):
                    c0, c1, c2 = i0 - a0, i1 - a1, i2 - a2
                    if c0 < 0 or c1 < 0 or c2 < 0:
                        continue
                    if c0 >= nodes[0] - 1 or c1 >= nodes[1] - 1 or c2 >= cells2:
                        continue
                    eta = viscosity[(c0 * cells1 + c1) * cells2 + c2]
                    a = (a0 * 2 + a1) * third + a2
                    for b0 in range(2):
                        for b1 in range(2):
                            for b2 in range(third):
                                b = (b0 * 2 + b1) * third + b2
                                place = ((c0 + b0 - low0) * wide1 + c1 + b1 - low1) * wide2 + c2 + b2 - low2
                                for k in range(d):
                                    for l in range(d):
                                        blocks[indptr[i] + place, k, l] += eta * element[a, b, k, l]


@njit(cache=True, inline="always")
def _stencil(t: float, nodes: int) -> tuple[int, int, int, float, float, float, float]:
    """(cell, first node, number of nodes, their 4 weights) of the cubic of Lagrange at `t` spacings from the first node.

    Four nodes around the cell, moved inwards next to a wall; all of them where there are fewer than four.
    """
    cell = min(max(int(np.floor(t)), 0), max(nodes - 2, 0))
    if nodes >= 4:
        first = min(max(cell - 1, 0), nodes - 4)
        s = t - first
        return (
            cell,
            first,
            4,
            -(s - 1.0) * (s - 2.0) * (s - 3.0) / 6.0,
            s * (s - 2.0) * (s - 3.0) / 2.0,
            -s * (s - 1.0) * (s - 3.0) / 2.0,
            s * (s - 1.0) * (s - 2.0) / 6.0,
        )
    if nodes == 3:
        return cell, 0, 3, (t - 1.0) * (t - 2.0) / 2.0, -t * (t - 2.0), t * (t - 1.0) / 2.0, 0.0
    if nodes == 2:
        return cell, 0, 2, 1.0 - t, t, 0.0, 0.0
    return 0, 0, 1, 1.0, 0.0, 0.0, 0.0


@njit(cache=True)
def _interpolated(
    field: NDArray[np.float64],
    column: int,
    nodes: NDArray[np.int64],
    t: tuple[float, float, float],
    limited: bool,
) -> float:
    """Value of a column of `field` (n, k) at place t (in spacings); if `limited`, within the values at the cell's corners."""
    cell0, first0, count0, p0, p1, p2, p3 = _stencil(t[0], nodes[0])
    cell1, first1, count1, q0, q1, q2, q3 = _stencil(t[1], nodes[1])
    cell2, first2, count2, r0, r1, r2, r3 = _stencil(t[2], nodes[2])
    along0, along1, along2 = (p0, p1, p2, p3), (q0, q1, q2, q3), (r0, r1, r2, r3)
    total = 0.0
    for i in range(count0):
        for j in range(count1):
            row = ((first0 + i) * nodes[1] + first1 + j) * nodes[2] + first2
            line = 0.0
            for k in range(count2):
                line += along2[k] * field[row + k, column]
            total += along0[i] * along1[j] * line
    if not limited:
        return total
    low, high = np.inf, -np.inf
    for i in range(2):
        for j in range(2):
            for k in range(2 if nodes[2] > 1 else 1):
                corner = field[((cell0 + i) * nodes[1] + cell1 + j) * nodes[2] + cell2 + k, column]
                low, high = min(low, corner), max(high, corner)
    return min(max(total, low), high)


@njit(cache=True, inline="always")
def _within(t: float, nodes: int) -> float:
    return min(max(t, 0.0), float(nodes - 1))


@njit(cache=True, inline="always")
def _upstream(
    field: NDArray[np.float64],
    nodes: NDArray[np.int64],
    at: tuple[float, float, float],
    start: tuple[float, float, float],
    steps: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Place reached from `start` against the velocity found `at` another place; steps (3,) are dt / spacing."""
    u0 = _interpolated(field, 0, nodes, at, False)
    u1 = _interpolated(field, 1, nodes, at, False)
    u2 = _interpolated(field, 2, nodes, at, False) if field.shape[1] == 3 else 0.0
    return (
        _within(start[0] - steps[0] * u0, nodes[0]),
        _within(start[1] - steps[1] * u1, nodes[1]),
        _within(start[2] - steps[2] * u2, nodes[2]),
    )


@njit(cache=True, parallel=True)
def advect(
    nodes: NDArray[np.int64],
    velocities: NDArray[np.float64],
    steps: NDArray[np.float64],
    substeps: int,
    carried: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """out (n, k): `carried` (n, k) at the feet of the paths that end at nodes, by substeps of `steps` (3,) = dt / spacing."""
    whole = (steps[0], steps[1], steps[2])
    half = (0.5 * steps[0], 0.5 * steps[1], 0.5 * steps[2])
    for i in prange(len(carried)):
        place = (
            float(i // (nodes[2] * nodes[1])),
            float((i // nodes[2]) % nodes[1]),
            float(i % nodes[2]),
        )
        for _ in range(substeps):
            middle = _upstream(velocities, nodes, place, place, half)
            place = _upstream(velocities, nodes, middle, place, whole)
        for column in range(carried.shape[1]):
            out[i, column] = _interpolated(carried, column, nodes, place, True)
