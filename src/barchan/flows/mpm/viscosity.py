"""The Newtonian part of a step: velocities before friction acts (seed B, Eq. 7.22)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.mpm import _basis_kernels as kernels
from barchan.flows.mpm.assembly import viscous_stiffness
from barchan.flows.mpm.velocity import VelocityField

Vector = NDArray[np.float64]


def unconstrained_velocities(
    field: VelocityField,
    viscosity: Vector | float,
    volumes: Vector,
    free: NDArray[np.bool_],
    inertia: Vector,
    gravity: Vector,
    dt: float,
    tolerance: float,
) -> Vector:
    """u* (n, d) of (M / dt + A) u* = M u^{p->g} / dt + M g, by conjugate gradients (seed B, Eq. 7.22).

    viscosity : [Pa s], one number or one for each particle, with `volumes` (P,).  inertia : (n,) M / dt.
    Components that are not `free` (n, d) are zero. Without viscosity u* = u^{p->g} + dt g.

    Raises InputError when the iteration does not converge (viscosity or time step out of any proportion).
    """
    velocities = field.velocities + dt * gravity
    velocities[~free] = 0.0
    if not np.any(viscosity):
        return velocities
    product, stiffness_diagonal = _stiffness(field, viscosity, volumes, free)
    diagonal = np.repeat(inertia, field.basis.dimension)
    size = len(diagonal)
    scale = 1.0 / (diagonal + stiffness_diagonal)
    solution, info = spla.cg(
        spla.LinearOperator((size, size), matvec=lambda x: diagonal * x + product(x), dtype=np.float64),
        diagonal * velocities.reshape(-1),
        x0=velocities.reshape(-1),
        rtol=tolerance,
        maxiter=10 * size,
        M=spla.LinearOperator((size, size), matvec=lambda x: scale * x, dtype=np.float64),
    )
    if info != 0:
        raise InputError("material.viscosity", viscosity, "small enough for the viscous step to be solvable")
    return np.asarray(solution).reshape(velocities.shape)


def _stiffness(
    field: VelocityField, viscosity: Vector | float, volumes: Vector, free: NDArray[np.bool_]
) -> tuple[Callable[[Vector], Vector], Vector]:
    """x -> A x and the diagonal of A: assembled for one viscosity and multilinear velocities, else particle by particle."""
    if np.ndim(viscosity) == 0 and field.basis.name == "Q1":
        stiffness = viscous_stiffness(field.matter, float(viscosity), free)
        return stiffness.__matmul__, stiffness.diagonal()
    weights = np.asarray(viscosity * volumes)
    rows, gradients = field.rows, field.shapes.gradients
    d = field.basis.dimension
    slopes = np.empty((len(weights), d, d))

    def product(x: Vector) -> Vector:
        kernels.gradients_at(rows, gradients, np.where(free, x.reshape(free.shape), 0.0), slopes)
        stresses = 0.5 * weights[:, None, None] * (slopes + slopes.transpose(0, 2, 1))
        forces = np.zeros(free.shape)
        kernels.scatter_stresses(rows, gradients, stresses, forces)
        return np.where(free, forces, 0.0).reshape(-1)

    squares = 0.5 * (np.sum(gradients**2, axis=2, keepdims=True) + gradients**2) * weights[:, None, None]
    diagonal = np.stack(
        [np.bincount(rows.reshape(-1), squares[..., k].reshape(-1), minlength=len(free)) for k in range(d)],
        axis=1,
    )
    return product, np.where(free, diagonal, 0.0).reshape(-1)
