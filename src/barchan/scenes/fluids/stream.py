"""The stream function of a plane incompressible flow on curved cells, and the vortex where it is greatest.

u = (d psi / dy, -d psi / dx): of second order like the velocity, closest to it in the mean, zero on the boundary.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from barchan.spaces.quadratic import QuadraticSpace

Vector = NDArray[np.float64]

NEAR = 9
"""Nodes through which the parabola around the vortex goes."""


def stream_function(space: QuadraticSpace, velocity: Vector) -> Vector:
    """(N,) values at the nodes, of velocities (N, 2) that do not cross the boundary."""
    nodes, gradients = space.cell_nodes, space.gradients
    weighted = gradients * space.weights[..., None, None]
    local = np.einsum("cqka,cqla->ckl", weighted, gradients, optimize=True)
    u = np.einsum("qk,cka->cqa", space.values, velocity[nodes])
    right = np.einsum("cqka,cqa->ck", weighted, np.stack([-u[..., 1], u[..., 0]], axis=2), optimize=True)
    k = nodes.shape[1]
    rows, columns = np.repeat(nodes, k, axis=1).ravel(), np.tile(nodes, (1, k)).ravel()
    matrix = sp.csr_array((local.ravel(), (rows, columns)), shape=(space.N, space.N))
    sides = np.bincount(nodes.ravel(), right.ravel(), minlength=space.N)
    inside = np.ones(space.N, dtype=bool)
    for part in space.mesh.boundaries:
        inside[space.mesh.part_nodes(part)] = False
    free = np.flatnonzero(inside)
    psi = np.zeros(space.N)
    psi[free] = spsolve(sp.csc_array(matrix[free][:, free]), sides[free])
    return psi


def vortex(space: QuadraticSpace, velocity: Vector) -> tuple[tuple[float, float], float]:
    """Place and value of the largest |psi|, by a parabola through the nodes around it."""
    psi, places = stream_function(space, velocity), space.mesh.nodes
    best = int(np.argmax(np.abs(psi)))
    near = np.argsort(np.sum((places - places[best]) ** 2, axis=1))[:NEAR]
    x, y = (places[near] - places[best]).T
    columns = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    c = np.linalg.lstsq(columns, psi[near], rcond=None)[0]
    curvature = np.array([[2.0 * c[3], c[4]], [c[4], 2.0 * c[5]]])
    shift = np.zeros(2)
    if abs(np.linalg.det(curvature)) > 1e-12 * max(abs(psi[best]), 1e-300):
        shift = np.linalg.solve(curvature, -c[1:3])
    if np.linalg.norm(shift) > float(np.sqrt(x * x + y * y).max()):  # a flat top: the parabola says nothing
        shift = np.zeros(2)
    place = places[best] + shift
    value = c[0] + c[1:3] @ shift + 0.5 * shift @ curvature @ shift
    return (float(place[0]), float(place[1])), float(value)
