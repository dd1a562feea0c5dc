"""The Couette device of seed C (chapter 6), which several benchmarks solve: 16 2^(l-1) by 2 2^(l-1) cells on level l."""

from __future__ import annotations

import numpy as np

import _table  # noqa: F401  (finds barchan when it is not installed)
from barchan.flows.quasi_newtonian import ModifiedPoliquen, NoSlip, QuasiNewtonianFlow, Velocity
from barchan.spaces.meshes import annulus
from barchan.spaces.quadratic import QuadraticSpace, refinements

INNER, OUTER, SPEED = 0.019, 0.024, 0.019886667


def turning(x: np.ndarray) -> np.ndarray:
    """Rigid rotation with the speed of the inner wall."""
    return SPEED / INNER * np.stack([-x[:, 1], x[:, 0]], axis=1)


def hierarchy(level: int) -> list[QuadraticSpace]:
    """Spaces of the levels 1 to `level`."""
    return [QuadraticSpace(mesh) for mesh in refinements(annulus(1, INNER, OUTER), level)]


def device(space: QuadraticSpace, eps: float) -> QuasiNewtonianFlow:
    """The flow of the granular fluid, stresses over density."""
    model = ModifiedPoliquen(0.15, 0.27, 0.06, 0.001, 1.0, 1487.0 / 1500.0, eps=eps)
    return QuasiNewtonianFlow(space, model, {"inner": Velocity(turning), "outer": NoSlip()})
