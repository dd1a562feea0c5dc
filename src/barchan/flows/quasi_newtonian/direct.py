"""Sparse direct solution of the linear systems of Newton's method, enclosed flows included.

An enclosed flow leaves the pressure open up to a constant: one incompressibility equation follows from the others and gives way
to the value of one pressure unknown; a second right-hand side then moves that value until the mean pressure is the wanted one,
which is not a mere shift where the viscosity depends on the pressure (seed C 8.2.1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.linalg.cell_pattern import CellPattern
from barchan.linalg.pardiso import Pardiso, available

REFINEMENTS = 2
LARGEST_RESIDUAL = 1e-6
"""Relative residual of a solve above which Pardiso analyses the matrix afresh: its entries have left those of the first one."""


class DirectSolver:
    """Newton systems of a flow by Pardiso where present, else SuperLU.

    cycles : of the last solve, always 0 (what an iterative solver would report).
    """

    def __init__(self, flow: QuasiNewtonianFlow) -> None:
        self._flow, space = flow, flow.space
        self._pattern = CellPattern(space.cell_unknowns, space.size)
        self._fixed = flow.constraints.fixed.copy()
        self._pinned = 2 * space.N if flow.enclosed else -1
        self._factor: Pardiso | None = None
        self._lu: Any = None
        self.cycles = 0

    def update(self, elements: np.ndarray) -> None:
        """Factorise the matrix of element matrices (C, n, n), which are rotated in place.

        Raises InputError for a singular matrix.
        """
        space = self._flow.space
        self._flow.constraints.rotate_elements(space, elements)
        data = self._pattern.assemble(elements, self._fixed)
        self._matrix = self._pattern.matrix(data)
        if self._pinned >= 0:
            start, end = self._pattern.indptr[self._pinned : self._pinned + 2]
            data[start:end] = self._pattern.indices[start:end] == self._pinned
        self._factorise(fresh=self._factor is None)

    def _factorise(self, fresh: bool) -> None:
        self._lu = None
        if not available():
            self._fall_back()
            return
        matrix = self._matrix
        if fresh or self._factor is None:
            self._factor = Pardiso(matrix.indptr, matrix.indices, matrix.data, "general")
        if not self._factor.factorise(matrix.data):
            raise _singular()

    def _fall_back(self) -> None:
        """Factorise by SuperLU, which exchanges rows where Pardiso only replaces small pivots."""
        try:
            self._lu = spla.splu(sp.csc_array(self._matrix))
        except RuntimeError:
            raise _singular() from None

    def solve(self, rhs: np.ndarray, mean: float = 0.0) -> np.ndarray:
        """(size,) increment for a right-hand side with zeros at fixed unknowns.

        mean : change of the mean pressure that the increment brings, for enclosed flows.
        """
        if self._pinned < 0:
            return self._apply(rhs)
        space = self._flow.space
        sides = np.zeros((space.size, 2))
        sides[:, 0] = rhs
        sides[self._pinned] = 0.0, 1.0
        both = self._apply(sides)
        means = space.pressure_weights @ both[2 * space.N :] / space.area
        return both[:, 0] + (mean - means[0]) / means[1] * both[:, 1]

    def _apply(self, rhs: np.ndarray) -> np.ndarray:
        if self._factor is not None and self._lu is None:
            x = self._factor.solve(rhs, REFINEMENTS)
            if self._misses(x, rhs):
                self._factorise(fresh=True)
                x = self._factor.solve(rhs, REFINEMENTS)
                if self._misses(x, rhs):
                    self._fall_back()
        return x if self._lu is None else np.asarray(self._lu.solve(rhs))

    def _misses(self, x: np.ndarray, rhs: np.ndarray) -> bool:
        """Whether the residual of a solve is too large."""
        return bool(np.linalg.norm(self._matrix @ x - rhs) > LARGEST_RESIDUAL * np.linalg.norm(rhs))


def _singular() -> InputError:
    return InputError(
        "conditions",
        "a singular system",
        "conditions on the boundary that determine the flow, with a viscosity that vanishes nowhere (eps > 0)",
    )
