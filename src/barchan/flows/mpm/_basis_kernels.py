"""Kernels of the velocity and stress bases of the material point method: values at particles, sums over them (seed B, 7.3.3).

The basis functions of a cell are numbered locally: 2^d corners for Q1 and P1, 3^d control points for the quadratic splines.
Sums run over the cells in a fixed order, particle by particle: results do not depend on the thread count.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Q1, P1, B2 = 0, 1, 2


@njit(cache=True)
def _axis_spline(
    t: float, first: bool, last: bool, values: NDArray[np.float64], slopes: NDArray[np.float64]
) -> None:
    """The three quadratic splines of a cell along an axis, open knots at the two ends of the box."""
    if first and last:
        values[0], values[1], values[2] = (1.0 - t) ** 2, 2.0 * t * (1.0 - t), t * t
        slopes[0], slopes[1], slopes[2] = -2.0 * (1.0 - t), 2.0 - 4.0 * t, 2.0 * t
        return
    left = 1.0 if first else 0.5
    right = 1.0 if last else 0.5
    values[0], values[2] = left * (1.0 - t) ** 2, right * t * t
    values[1] = 1.0 - values[0] - values[2]
    slopes[0], slopes[2] = -2.0 * left * (1.0 - t), 2.0 * right * t
    slopes[1] = -slopes[0] - slopes[2]


@njit(cache=True)
def _sorted_axes(t: NDArray[np.float64], order: NDArray[np.int64]) -> None:
    """Axes by decreasing local coordinate: the Kuhn simplex of a point."""
    d = t.size
    for k in range(d):
        order[k] = k
    for k in range(1, d):
        axis, place = order[k], k
        while place > 0 and t[order[place - 1]] < t[axis]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = axis


@njit(cache=True)
def _simplex_number(order: NDArray[np.int64]) -> int:
    """Rank of a permutation of 2 or 3 axes, 0 to d! - 1."""
    if order.size == 2:
        return order[0]
    return 2 * order[0] + (1 if order[1] > order[2] else 0)


@njit(cache=True, parallel=True)
def evaluate(
    kind: int,
    positions: NDArray[np.float64],
    origin: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cells: NDArray[np.int64],
    margin: float,
    weights: NDArray[np.float64],
    gradients: NDArray[np.float64],
    cell_ids: NDArray[np.int64],
    simplices: NDArray[np.int64],
) -> None:
    """Values (P, m) and gradients (P, m, d) of the functions of each point's cell, its flat cell and its simplex."""
    count, d = positions.shape
    per_axis = 3 if kind == B2 else 2
    for p in prange(count):
        t, order = np.empty(d), np.empty(d, np.int64)
        values, slopes = np.empty((d, 3)), np.empty((d, 3))
        flat = 0
        for k in range(d):
            scaled = (positions[p, k] - origin[k]) / spacing[k]
            index = min(max(int(np.floor(scaled)), 0), cells[k] - 1)
            flat = flat * cells[k] + index
            t[k] = min(max(scaled - index, margin), 1.0 - margin)
            if kind == B2:
                _axis_spline(t[k], index == 0, index == cells[k] - 1, values[k], slopes[k])
            else:
                values[k, 0], values[k, 1] = 1.0 - t[k], t[k]
                slopes[k, 0], slopes[k, 1] = -1.0, 1.0
        cell_ids[p] = flat
        _sorted_axes(t, order)
        simplices[p] = _simplex_number(order)
        if kind == P1:
            corner = 0
            weights[p, 0] = 1.0 - t[order[0]]
            gradients[p, 0, order[0]] = -1.0 / spacing[order[0]]
            for k in range(d):
                axis = order[k]
                corner += 1 << (d - 1 - axis)
                following = t[order[k + 1]] if k + 1 < d else 0.0
                weights[p, corner] = t[axis] - following
                gradients[p, corner, axis] = 1.0 / spacing[axis]
                if k + 1 < d:
                    gradients[p, corner, order[k + 1]] = -1.0 / spacing[order[k + 1]]
        else:
            for j in range(weights.shape[1]):
                rest, weight = j, 1.0
                for k in range(d - 1, -1, -1):
                    weight *= values[k, rest % per_axis]
                    rest //= per_axis
                weights[p, j] = weight
                for axis in range(d):
                    rest, slope = j, 1.0
                    for k in range(d - 1, -1, -1):
                        digit = rest % per_axis
                        slope *= slopes[k, digit] / spacing[k] if k == axis else values[k, digit]
                        rest //= per_axis
                    gradients[p, j, axis] = slope


@njit(cache=True)
def simplex_corners(d: int) -> NDArray[np.int64]:
    """(d!, d + 1) local corners of the Kuhn simplices, in the order of their barycentric coordinates."""
    count = 2 if d == 2 else 6
    corners = np.zeros((count, d + 1), np.int64)
    order = np.empty(d, np.int64)
    for first in range(d):
        for second in range(d):
            if second == first:
                continue
            order[0], order[1] = first, second
            if d == 3:
                order[2] = 3 - first - second
            number, corner = _simplex_number(order), 0
            for k in range(d):
                corner += 1 << (d - 1 - order[k])
                corners[number, k + 1] = corner
    return corners


@njit(cache=True)
def scatter(
    numbers: NDArray[np.int32],
    weights: NDArray[np.float64],
    values: NDArray[np.float64],
    sums: NDArray[np.float64],
) -> None:
    """sums[numbers[p, j]] += weights[p, j] values[p]: (P, m), (P, m), (P, e) into (n, e)."""
    for p in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            weight = weights[p, j]
            if weight != 0.0:
                row = numbers[p, j]
                for e in range(values.shape[1]):
                    sums[row, e] += weight * values[p, e]


@njit(cache=True, parallel=True)
def gather(
    numbers: NDArray[np.int32],
    weights: NDArray[np.float64],
    values: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """found[p] = sum_j weights[p, j] values[numbers[p, j]]; negative numbers are left out."""
    for p in prange(numbers.shape[0]):
        for e in range(values.shape[1]):
            found[p, e] = 0.0
        for j in range(numbers.shape[1]):
            row = numbers[p, j]
            if row >= 0:
                for e in range(values.shape[1]):
                    found[p, e] += weights[p, j] * values[row, e]


@njit(cache=True)
def scatter_affine(
    numbers: NDArray[np.int32],
    weights: NDArray[np.float64],
    masses: NDArray[np.float64],
    places: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    affine: NDArray[np.float64],
    node_masses: NDArray[np.float64],
    momenta: NDArray[np.float64],
) -> None:
    """Masses (n,) and momenta (n, d) of the nodes, sum_p m_p w_i (v_p + c_p (y_i - x_p)) (seed B, Eq. 7.16-7.18)."""
    d = positions.shape[1]
    for p in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            share = masses[p] * weights[p, j]
            if share == 0.0:
                continue
            i = numbers[p, j]
            node_masses[i] += share
            for e in range(d):
                seen = velocities[p, e]
                for k in range(d):
                    seen += affine[p, e, k] * (places[i, k] - positions[p, k])
                momenta[i, e] += share * seen


@njit(cache=True, parallel=True)
def gradients_at(
    numbers: NDArray[np.int32],
    gradients: NDArray[np.float64],
    values: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """found[p] = sum_j values[numbers[p, j]] (x) grad w_j(x_p): (n, d) into (P, d, d)."""
    d = values.shape[1]
    for p in prange(numbers.shape[0]):
        for e in range(d):
            for k in range(d):
                found[p, e, k] = 0.0
        for j in range(numbers.shape[1]):
            i = numbers[p, j]
            for e in range(d):
                for k in range(d):
                    found[p, e, k] += values[i, e] * gradients[p, j, k]


@njit(cache=True)
def scatter_stresses(
    numbers: NDArray[np.int32],
    gradients: NDArray[np.float64],
    stresses: NDArray[np.float64],
    forces: NDArray[np.float64],
) -> None:
    """forces[i] += stresses[p] grad w_i(x_p): (P, d, d) into (n, d), the adjoint of `gradients_at`."""
    d = forces.shape[1]
    for p in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            i = numbers[p, j]
            for e in range(d):
                for k in range(d):
                    forces[i, e] += stresses[p, e, k] * gradients[p, j, k]


@njit(cache=True, parallel=True)
def cell_table(
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    volumes: NDArray[np.float64],
    stress_weights: NDArray[np.float64],
    first: NDArray[np.int64],
    gradients: NDArray[np.float64],
    table: NDArray[np.float64],
    sums: NDArray[np.float64],
) -> None:
    """sum_p V_p omega_q(x_p) grad w_j(x_p) (C, f, m, d) and sum_p V_p omega_q(x_p) (C, f) of the occupied cells.

    A particle has the stress functions `first[p]` to `first[p] + stress_weights.shape[1] - 1` of its cell.
    """
    d = gradients.shape[2]
    for c in prange(starts.size - 1):
        for q in range(starts[c], starts[c + 1]):
            p = order[q]
            for a in range(stress_weights.shape[1]):
                share = volumes[p] * stress_weights[p, a]
                if share == 0.0:
                    continue
                f = first[p] + a
                sums[c, f] += share
                for j in range(gradients.shape[1]):
                    for k in range(d):
                        table[c, f, j, k] += share * gradients[p, j, k]


@njit(cache=True, parallel=True)
def table_from_moments(
    moments: NDArray[np.float64],
    value: NDArray[np.int64],
    gradient: NDArray[np.int64],
    slopes: NDArray[np.float64],
    table: NDArray[np.float64],
    sums: NDArray[np.float64],
) -> None:
    """What `cell_table` gives for multilinear velocities and stresses, from the moments of the cells (see `_kernels`)."""
    corners, d = slopes.shape
    for c in prange(moments.shape[0]):
        for i in range(corners):
            for m in value[i]:
                sums[c, i] += moments[c, m]
            for j in range(corners):
                for k in range(d):
                    m0, m1 = gradient[i, j, k, 0], gradient[i, j, k, 1]
                    table[c, i, j, k] = slopes[j, k] * (moments[c, m0] + moments[c, m1])


@njit(cache=True, parallel=True)
def gather_table(
    node_cells: NDArray[np.int32],
    slots: NDArray[np.int64],
    table: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> None:
    """Rows (q, slots, d) of continuous stresses: the tables of the cells around each node added up."""
    for a in prange(node_cells.shape[0]):
        for i in range(node_cells.shape[1]):
            c = node_cells[a, i]
            if c >= 0:
                for j in range(table.shape[2]):
                    for k in range(table.shape[3]):
                        rows[a, slots[i, j], k] += table[c, i, j, k]
