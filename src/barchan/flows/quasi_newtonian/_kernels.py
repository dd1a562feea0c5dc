"""Element matrices and vectors of the generalised Navier-Stokes equations (seed C 4.1.6-4.1.8), compiled.

Tensors at points are (xx, yy, xy). Cost: points times (shapes squared) for a matrix, points times shapes for a vector.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

CHUNK = 64
"""Cells to a parallel task: the same whatever the number of threads."""


@njit(cache=True, parallel=True, error_model="numpy")
def sample(cell_nodes, values, gradients, nodal, velocity, slopes):
    """Fields at the points: velocity (C, Q, 2) and slopes (C, Q, 4) = (u_x,x, u_x,y, u_y,x, u_y,y) of nodal (N, 2)."""
    cells, k = cell_nodes.shape
    points = values.shape[0]
    for c in prange(cells):
        for q in range(points):
            u = v = a = b = d = e = 0.0
            for i in range(k):
                node = cell_nodes[c, i]
                x, y = nodal[node, 0], nodal[node, 1]
                u += values[q, i] * x
                v += values[q, i] * y
                dx, dy = gradients[c, q, i, 0], gradients[c, q, i, 1]
                a += dx * x
                b += dy * x
                d += dx * y
                e += dy * y
            velocity[c, q, 0], velocity[c, q, 1] = u, v
            slopes[c, q, 0], slopes[c, q, 1], slopes[c, q, 2], slopes[c, q, 3] = a, b, d, e


@njit(cache=True, parallel=True, error_model="numpy")
def momentum_vectors(values, gradients, weights, pressure_values, stress, pressure, force, divergence, out):
    """Element vectors (C, 2k + m): stress : D(v) - p div v + force . v, and -q div u.

    stress (C, Q, 3), pressure, divergence (C, Q), force (C, Q, 2): inertia less body force.
    """
    cells, points, k, _ = gradients.shape
    m = pressure_values.shape[2]
    for c in prange(cells):
        for j in range(2 * k + m):
            out[c, j] = 0.0
        for q in range(points):
            w = weights[c, q]
            p = pressure[c, q]
            xx, yy, xy = w * (stress[c, q, 0] - p), w * (stress[c, q, 1] - p), w * stress[c, q, 2]
            fx, fy = w * force[c, q, 0], w * force[c, q, 1]
            for i in range(k):
                dx, dy, f = gradients[c, q, i, 0], gradients[c, q, i, 1], values[q, i]
                out[c, 2 * i] += xx * dx + xy * dy + fx * f
                out[c, 2 * i + 1] += xy * dx + yy * dy + fy * f
            for j in range(m):
                out[c, 2 * k + j] -= w * divergence[c, q] * pressure_values[c, q, j]


@njit(cache=True, parallel=True, error_model="numpy")
def element_matrices(
    values, gradients, weights, pressure_values, viscosity, first, second, by_pressure, velocity, slopes,
    density, convection, carried_by, reaction, out,
):  # fmt: skip
    """Jacobians (C, 2k + m, 2k + m) of `momentum_vectors`.

    2 viscosity D(du) : D(v) + (first : D(v)) (second : D(du)) + (by_pressure : D(v)) dp
    + density (carried_by (u . grad) du + convection (du . grad) u + reaction du) . v - dp div v;   - q div du.

    viscosity (C, Q); first, second, by_pressure (C, Q, 3); velocity (C, Q, 2); slopes (C, Q, 4); the rest numbers.
    """
    cells, points, k, _ = gradients.shape
    m = pressure_values.shape[2]
    n = 2 * k + m
    for chunk in prange((cells + CHUNK - 1) // CHUNK):
        left, right = np.empty(2 * k), np.empty(2 * k)
        for c in range(chunk * CHUNK, min(cells, (chunk + 1) * CHUNK)):
            for i in range(n):
                for j in range(n):
                    out[c, i, j] = 0.0
            for q in range(points):
                w = weights[c, q]
                eta = w * viscosity[c, q]
                rho = w * density
                ux, uy = velocity[c, q, 0], velocity[c, q, 1]
                for i in range(k):
                    dx, dy = gradients[c, q, i, 0], gradients[c, q, i, 1]
                    left[2 * i] = first[c, q, 0] * dx + first[c, q, 2] * dy
                    left[2 * i + 1] = first[c, q, 1] * dy + first[c, q, 2] * dx
                    right[2 * i] = second[c, q, 0] * dx + second[c, q, 2] * dy
                    right[2 * i + 1] = second[c, q, 1] * dy + second[c, q, 2] * dx
                ca = rho * (convection * slopes[c, q, 0] + reaction)
                cb, cd = rho * convection * slopes[c, q, 1], rho * convection * slopes[c, q, 2]
                ce = rho * (convection * slopes[c, q, 3] + reaction)
                for i in range(k):
                    dx, dy, f = gradients[c, q, i, 0], gradients[c, q, i, 1], values[q, i]
                    lx, ly = w * left[2 * i], w * left[2 * i + 1]
                    px = w * (by_pressure[c, q, 0] * dx + by_pressure[c, q, 2] * dy - dx)
                    py = w * (by_pressure[c, q, 1] * dy + by_pressure[c, q, 2] * dx - dy)
                    for j in range(k):
                        ex, ey, g = gradients[c, q, j, 0], gradients[c, q, j, 1], values[q, j]
                        carried = rho * carried_by * f * (ux * ex + uy * ey)
                        plain = f * g
                        xx, yy = eta * dx * ex, eta * dy * ey
                        out[c, 2 * i, 2 * j] += 2.0 * xx + yy + carried + ca * plain + lx * right[2 * j]
                        out[c, 2 * i, 2 * j + 1] += eta * dy * ex + cb * plain + lx * right[2 * j + 1]
                        out[c, 2 * i + 1, 2 * j] += eta * dx * ey + cd * plain + ly * right[2 * j]
                        out[c, 2 * i + 1, 2 * j + 1] += (
                            2.0 * yy + xx + carried + ce * plain + ly * right[2 * j + 1]
                        )
                    for j in range(m):
                        psi = pressure_values[c, q, j]
                        out[c, 2 * i, 2 * k + j] += psi * px
                        out[c, 2 * i + 1, 2 * k + j] += psi * py
                        out[c, 2 * k + j, 2 * i] -= w * psi * dx
                        out[c, 2 * k + j, 2 * i + 1] -= w * psi * dy
