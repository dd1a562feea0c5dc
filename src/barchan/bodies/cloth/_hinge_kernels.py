"""Bending at the edges between triangles: angles, their gradients and Hessians (Grinspun et al. 2003).

The angle of a hinge (a, b, c, d) changes as its two triangles turn about the edge ab. A triangle (a, b, o) turns at the rate
g . (v_o - (1 - s) v_a - s v_b), g = |e| N / |N|^2, N = e x (o - a), e = b - a, s = (o - a).e / |e|^2 the foot of its height;
that of the first triangle counts negative, that of the second positive, so grad theta = -w g(c) + w' g(d). Derivatives of g
and s in the corners give the Hessian.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from barchan.bodies.cloth._blocks import add_block, cross_into, fill_cross, inner

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


@njit(cache=True)
def _angle(x: Array, hinge: Whole, work: Array) -> float:
    """Angle [rad]; work (5, 3)."""
    e, r, q, first, second = work[0], work[1], work[2], work[3], work[4]
    for i in range(3):
        e[i] = x[hinge[1], i] - x[hinge[0], i]
        r[i] = x[hinge[2], i] - x[hinge[0], i]
        q[i] = x[hinge[3], i] - x[hinge[0], i]
    cross_into(e, r, first)
    cross_into(q, e, second)
    cosine = inner(first, second)
    cross_into(first, second, r)
    return float(np.arctan2(inner(r, e) / np.sqrt(inner(e, e)), cosine))


@njit(cache=True)
def _turning(x: Array, a: int, b: int, o: int, sign: float, g: Array, share: Array, work: Array) -> None:
    """g (3,) times `sign`, and the shares (3,) of a, b, o in the rate at which the triangle turns."""
    e, r, normal = work[0], work[1], work[2]
    for i in range(3):
        e[i] = x[b, i] - x[a, i]
        r[i] = x[o, i] - x[a, i]
    cross_into(e, r, normal)
    squared = inner(e, e)
    factor = sign * np.sqrt(squared) / inner(normal, normal)
    s = inner(r, e) / squared
    share[0], share[1], share[2] = s - 1.0, -s, 1.0
    for i in range(3):
        g[i] = factor * normal[i]


@njit(cache=True)
def angle_gradient(x: Array, hinge: Whole, gradient: Array, work: Array) -> float:
    """Angle [rad] of a hinge and its gradient (4, 3) [1/m]; work (9, 3)."""
    gradient[:] = 0.0
    g, share = work[5], work[6]
    for side in range(2):
        o = 2 + side
        _turning(x, hinge[0], hinge[1], hinge[o], -1.0 if side == 0 else 1.0, g, share, work)
        for i in range(3):
            gradient[0, i] += share[0] * g[i]
            gradient[1, i] += share[1] * g[i]
            gradient[o, i] += share[2] * g[i]
    return _angle(x, hinge, work)


@njit(cache=True)
def _turning_derivatives(e: Array, r: Array, sign: float, dg: Array, ds: Array, work: Array) -> None:
    """dg (3, 3, 3): derivatives of sign g in a, b, o; ds (3, 3): gradients of s in a, b, o. work (9, 3)."""
    normal = work[2]
    cross_into(e, r, normal)
    nn, ee = inner(normal, normal), inner(e, e)
    length = np.sqrt(ee)
    s = inner(r, e) / ee
    over_e, over_r = work[3:6], work[6:9]
    fill_cross(e, over_e)
    fill_cross(r, over_r)
    for i in range(3):
        ds[2, i] = e[i] / ee
        ds[1, i] = (r[i] - 2.0 * s * e[i]) / ee
        ds[0, i] = -ds[1, i] - ds[2, i]
        for j in range(3):
            # along n g changes like the inverse of |N|: (I - 2 n n^T) dN
            from_r, from_e = 0.0, 0.0
            for m in range(3):
                mirror = (1.0 if i == m else 0.0) - 2.0 * normal[i] * normal[m] / nn
                from_r += mirror * over_e[m, j]
                from_e -= mirror * over_r[m, j]
            dg[2, i, j] = sign * length / nn * from_r
            dg[1, i, j] = sign * (length / nn * from_e + normal[i] / nn * e[j] / length)
            dg[0, i, j] = -dg[1, i, j] - dg[2, i, j]


@njit(cache=True)
def _angle_hessian(x: Array, hinge: Whole, hessian: Array, work: Array) -> None:
    """Hessian (4, 4, 3, 3) of the angle."""
    hessian[:] = 0.0
    g, share, e, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    dg, ds = np.empty((3, 3, 3)), np.empty((3, 3))
    place = np.empty(3, dtype=np.int64)
    for side in range(2):
        sign = -1.0 if side == 0 else 1.0
        place[0], place[1], place[2] = 0, 1, 2 + side
        _turning(x, hinge[0], hinge[1], hinge[2 + side], sign, g, share, work)
        for i in range(3):
            e[i] = x[hinge[1], i] - x[hinge[0], i]
            r[i] = x[hinge[2 + side], i] - x[hinge[0], i]
        _turning_derivatives(e, r, sign, dg, ds, work)
        for v in range(3):
            slope = 1.0 if v == 0 else (-1.0 if v == 1 else 0.0)  # of the shares in s
            for w in range(3):
                block = hessian[place[v], place[w]]
                for i in range(3):
                    for j in range(3):
                        block[i, j] += share[v] * dg[w, i, j] + slope * g[i] * ds[w, j]


@njit(cache=True)
def add_bending(x: Array, hinges: Whole, rest: Array, stiffness: Array, gradient: Array) -> float:
    """Energy sum k (theta - rest)^2 / 2 [J]; its gradient is added to `gradient` (n, 3)."""
    slope, work = np.empty((4, 3)), np.empty((9, 3))
    energy = 0.0
    for h in range(hinges.shape[0]):
        bend = angle_gradient(x, hinges[h], slope, work) - rest[h]
        energy += 0.5 * stiffness[h] * bend * bend
        for v in range(4):
            for i in range(3):
                gradient[hinges[h, v], i] += stiffness[h] * bend * slope[v, i]
    return energy


@njit(cache=True)
def add_bending_hessian(
    x: Array, hinges: Whole, rest: Array, stiffness: Array, convex: bool, entries: Whole, data: Array
) -> None:
    """Add the Hessian to blocks: entries (h, 4, 4) in data (nnz, 3, 3); `convex` keeps k grad theta grad theta^T only."""
    slope, work, hessian = np.empty((4, 3)), np.empty((9, 3)), np.empty((4, 4, 3, 3))
    for h in range(hinges.shape[0]):
        bend = angle_gradient(x, hinges[h], slope, work) - rest[h]
        for v in range(4):
            for w in range(4):
                add_block(data, entries[h, v, w], stiffness[h], slope[v], slope[w])
        if convex:
            continue
        _angle_hessian(x, hinges[h], hessian, work)
        for v in range(4):
            for w in range(4):
                entry = entries[h, v, w]
                for i in range(3):
                    for j in range(3):
                        data[entry, i, j] += stiffness[h] * bend * hessian[v, w, i, j]


@njit(cache=True)
def _stiffness_gradient(p: Array, hinge: Whole, rigidity: float, out: Array) -> float:
    """k = D |e|^2 / (A1 + A2) of a rest hinge and its gradient (4, 3)."""
    e, r, normal, way = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    areas = 0.0
    out[:] = 0.0
    for i in range(3):
        e[i] = p[hinge[1], i] - p[hinge[0], i]
    for side in range(2):
        o = 2 + side
        for i in range(3):
            r[i] = p[hinge[o], i] - p[hinge[0], i]
        cross_into(e, r, normal)
        size = np.sqrt(inner(normal, normal))
        areas += 0.5 * size
        for i in range(3):
            normal[i] *= 0.5 / size
        cross_into(normal, e, way)  # dA/do
        for i in range(3):
            out[o, i] += way[i]
            out[0, i] -= way[i]
        cross_into(r, normal, way)  # dA/db
        for i in range(3):
            out[1, i] += way[i]
            out[0, i] -= way[i]
    squared = inner(e, e)
    for v in range(4):
        for i in range(3):
            out[v, i] *= -rigidity * squared / areas**2
    for i in range(3):
        out[1, i] += 2.0 * rigidity * e[i] / areas
        out[0, i] -= 2.0 * rigidity * e[i] / areas
    return rigidity * squared / areas


@njit(cache=True)
def add_bending_mixed(
    x: Array, p: Array, hinges: Whole, rigidity: float, entries: Whole, data: Array
) -> None:
    """Add d(dE/dx)/dp to blocks: grad theta ((theta - rest) dk/dp - k d(rest)/dp)^T, p (n, 3) the rest positions."""
    slope, rest_slope, change = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    work = np.empty((9, 3))
    for h in range(hinges.shape[0]):
        bend = angle_gradient(x, hinges[h], slope, work) - angle_gradient(p, hinges[h], rest_slope, work)
        stiffness = _stiffness_gradient(p, hinges[h], rigidity, change)
        for v in range(4):
            for i in range(3):
                change[v, i] = bend * change[v, i] - stiffness * rest_slope[v, i]
        for v in range(4):
            for w in range(4):
                add_block(data, entries[h, v, w], 1.0, slope[v], change[w])
