"""The Stokes-like first step: (M_v + K) u = M_v u^ + C^T p, C u = k (seed B, 8.3.3), in the volume average alone.

Conjugate gradients projected on {C v = 0} (Gould, Hribar and Nocedal 2001): the preconditioner is the saddle matrix of the
diagonal of M_v + K, through its Schur complement, factorised once a step. Every iterate keeps C u = k to round-off; without
viscosity the first one is the solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.flows.suspension.p0.pressure import Pressures
from barchan.flows.suspension.p0.viscosity import Viscosity
from barchan.linalg.factor import Solver

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VolumeStep:
    """velocities : (c, d) of the volume average.  pressures : (p,) [Pa].  iterations : of conjugate gradients."""

    velocities: Vector
    pressures: Vector
    iterations: int


def volume_step(
    pressures: Pressures, viscosity: Viscosity, inertia: Vector, predicted: Vector, coefficients: Vector, tolerance: float
) -> VolumeStep:  # fmt: skip
    """The volume average at the end of the step, before contacts.

    inertia : (c, d) M_v [kg/s].  predicted : (c, d) u^ [m/s].  coefficients : (c,) viscosities [Pa s].
    Raises InputError when conjugate gradients do not reach the relative `tolerance`.
    """
    C, transposed = pressures.divergence, pressures.transposed
    weights = viscosity.weights(coefficients)
    viscous = bool(np.any(coefficients > 0.0))
    mass = inertia.reshape(-1)
    diagonal = mass + viscosity.diagonal(weights) if viscous else mass
    schur = pressures.schur(1.0 / diagonal)

    def multiplied(v: Vector) -> Vector:
        return mass * v + viscosity.forces(weights, v, with_walls=False) if viscous else mass * v

    def projected(residual: Vector) -> tuple[Vector, Vector]:
        """(g, y) with C g = 0 and g = D^-1 (residual - C^T y); twice, since round-off of y would enter C u."""
        y = schur(C @ (residual / diagonal))
        rest = residual - transposed @ y
        more = schur(C @ (rest / diagonal))
        return (rest - transposed @ more) / diagonal, y + more

    load = mass * predicted.reshape(-1)
    if viscous:
        load = load - viscosity.forces(weights, np.zeros(len(load)), with_walls=True)
    u = onto_constraints(pressures, schur, diagonal, predicted.reshape(-1))
    residual = multiplied(u) - load
    gradient, multiplier = projected(residual)
    direction = -gradient
    product = float(residual @ gradient)
    enough = tolerance**2 * max(float(u @ (diagonal * u)), float(load @ (load / diagonal)))
    iterations = 0
    while viscous and product > enough:
        if iterations > 10 * len(u):
            raise InputError("mixture.fluid_viscosity", "not solvable", "small enough for the viscous step")
        pushed = multiplied(direction)
        length = product / float(direction @ pushed)
        u = u + length * direction
        residual = residual - transposed @ multiplier + length * pushed
        gradient, multiplier = projected(residual)
        before, product = product, float(residual @ gradient)
        direction = -gradient + (product / before) * direction
        iterations += 1
    u = onto_constraints(pressures, schur, diagonal, u)
    found = projected(multiplied(u) - load)[1]
    return VolumeStep(u.reshape(predicted.shape), found, iterations)


def onto_constraints(pressures: Pressures, schur: Solver, diagonal: Vector, u: Vector) -> Vector:
    """The velocities (c d,) nearest to u in the metric of `diagonal` with C u = k."""
    missing = pressures.sources - pressures.divergence @ u
    return np.asarray(u + (pressures.transposed @ schur(missing)) / diagonal)
