"""Springs along the edges of a cloth in place of a membrane (Van Gelder 1998): k = E h (A1 + A2) / L^2."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.cloth._blocks import add_block, add_isotropic, cross_into, inner

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def _direction(x: Array, a: int, b: int, unit: Array) -> float:
    """Length of ab; unit (3,) points from a to b."""
    for i in range(3):
        unit[i] = x[b, i] - x[a, i]
    length = np.sqrt(inner(unit, unit))
    for i in range(3):
        unit[i] /= length
    return float(length)


@njit(cache=True)
def add_springs(x: Array, edges: Whole, rest: Array, stiffness: Array, gradient: Array) -> float:
    """Energy sum k (l - L)^2 / 2 [J]; its gradient is added to `gradient` (n, 3)."""
    unit = np.empty(3)
    energy = 0.0
    for s in range(edges.shape[0]):
        stretch = _direction(x, edges[s, 0], edges[s, 1], unit) - rest[s]
        energy += 0.5 * stiffness[s] * stretch * stretch
        for i in range(3):
            gradient[edges[s, 0], i] -= stiffness[s] * stretch * unit[i]
            gradient[edges[s, 1], i] += stiffness[s] * stretch * unit[i]
    return energy


@njit(cache=True)
def add_spring_hessian(
    x: Array, edges: Whole, rest: Array, stiffness: Array, convex: bool, entries: Whole, data: Array
) -> None:
    """Add the Hessian to blocks: entries (e, 4, 4), of whose rows and columns the first two are the ends of the edge.

    `convex` leaves out the compressive force.
    """
    unit = np.empty(3)
    for s in range(edges.shape[0]):
        across = 1.0 - rest[s] / _direction(x, edges[s, 0], edges[s, 1], unit)
        if convex:
            across = max(across, 0.0)
        for v in range(2):
            for w in range(2):
                sign = stiffness[s] if v == w else -stiffness[s]
                add_isotropic(data, entries[s, v, w], sign * across)
                add_block(data, entries[s, v, w], sign * (1.0 - across), unit, unit)


@njit(cache=True)
def add_spring_mixed(
    x: Array, p: Array, stencils: Whole, modulus: float, entries: Whole, data: Array
) -> None:
    """Add d(dE/dx)/dp to blocks, p (n, 3) the rest positions; stencils (e, 4) end with -1 beside a boundary."""
    unit, rest_unit, r, normal, way = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    change = np.empty((4, 3))
    for s in range(stencils.shape[0]):
        a, b = stencils[s, 0], stencils[s, 1]
        length, rest = _direction(x, a, b, unit), _direction(p, a, b, rest_unit)
        change[:] = 0.0
        areas = 0.0
        for o in range(2, 4):
            if stencils[s, o] < 0:
                continue
            for i in range(3):
                r[i] = p[stencils[s, o], i] - p[a, i]
            cross_into(rest_unit, r, normal)
            height = np.sqrt(inner(normal, normal))
            areas += 0.5 * rest * height
            for i in range(3):
                normal[i] *= 0.5 / height
            cross_into(normal, rest_unit, way)  # dA/do over the length
            for i in range(3):
                change[o, i] += rest * way[i]
                change[0, i] -= rest * way[i]
            cross_into(r, normal, way)  # dA/db
            for i in range(3):
                change[1, i] += way[i]
                change[0, i] -= way[i]
        stretch = length - rest
        # d/dp of k (l - L) with k = modulus areas / L^2
        lengths = -modulus * areas / rest**2 * (2.0 * stretch / rest + 1.0)
        for i in range(3):
            for v in range(4):
                change[v, i] *= modulus * stretch / rest**2
            change[0, i] -= lengths * rest_unit[i]
            change[1, i] += lengths * rest_unit[i]
        for v in range(2):
            for w in range(4):
                if stencils[s, w] >= 0:
                    add_block(data, entries[s, v, w], -1.0 if v == 0 else 1.0, unit, change[w])
