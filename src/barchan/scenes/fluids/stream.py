"""The stream function of a plane incompressible flow on curved cells, and the vortex where it is greatest.

u = (d psi / dy, -d psi / dx): of second order like the velocity, closest to it in the mean, zero on the boundary.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from barchan.spaces.extrema import greatest
from barchan.spaces.quadratic import QuadraticSpace

Vector = NDArray[np.float64]


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
    return greatest(space.mesh.nodes, stream_function(space, velocity))
