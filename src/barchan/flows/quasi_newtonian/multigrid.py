"""Geometric multigrid for the Newton matrices of Q2/P1 flows: [[A, B~], [B^T, 0]] on refined quadrilaterals (seed C 4.3).

Coarse matrices are Galerkin products formed cell by cell from the element matrices of the finest level, so that the tangent of
the viscosity, known at its quadrature points only, needs no definition elsewhere; block Vanka smoothing, Krylov acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.flows.quasi_newtonian._galerkin_kernels import coarse_elements, rotate_elements, row_weights
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.linalg.cell_pattern import CellPattern
from barchan.linalg.fgmres import KrylovResult
from barchan.linalg.multigrid import Border, CycleOptions, Level, Multigrid
from barchan.linalg.vanka import VankaSmoother, multiply
from barchan.spaces.quadratic.space import QuadraticSpace
from barchan.spaces.quadratic.transfers import (
    check_refinement,
    pressure_transfer,
    prolongation,
    velocity_transfer,
)


@dataclass(frozen=True)
class LevelConstraints:
    """What is prescribed on a level.

    fixed : (size,) true for unknowns (in rotated components) whose increment is zero.
    rotation : (size, size) orthogonal T with Cartesian x = T x_rotated, 2 x 2 blocks at nodes; None where nothing is rotated.
    mean_free : whether pressures are known up to a constant; the solution then has mean zero.
    """

    fixed: np.ndarray
    rotation: sp.csr_array | None = None
    mean_free: bool = False

    def frames(self, nodes: int) -> np.ndarray:
        """(N, 2, 2) blocks of the rotation at the nodes."""
        frames = np.tile(np.eye(2), (nodes, 1, 1))
        if self.rotation is not None:
            T = sp.csr_array(self.rotation)
            main = T.diagonal()[: 2 * nodes]
            frames[:, 0, 0], frames[:, 1, 1] = main[0::2], main[1::2]
            frames[:, 0, 1] = T.diagonal(k=1)[: 2 * nodes - 1 : 2]
            frames[:, 1, 0] = T.diagonal(k=-1)[: 2 * nodes - 1 : 2]
        return frames

    def projections(self, nodes: int) -> np.ndarray:
        """(N, 2, 2) projections of Cartesian velocities on what is not fixed at the nodes."""
        frames, free = self.frames(nodes), ~self.fixed[: 2 * nodes].reshape(-1, 2)
        return np.einsum("nac,nc,nbc->nab", frames, free.astype(float), frames)


class GeometricMultigrid:
    """Solver of A x = b on the finest of nested Q2/P1 spaces.

    Parameters
    ----------
    spaces : coarse to fine, each on the refined mesh of the one before.
    constraints : of each level, in the same order; the matrices are T^T A T with unit rows and columns for fixed unknowns.
    options : of the cycles.   precision : "single" or "double", of the cycles; residuals and Krylov vectors are double.
    pattern : of the finest level, where it is known already.

    Attributes
    ----------
    pattern : CellPattern of the finest level.   data : (nnz,) entries of its constrained matrix, after `update`.

    Raises
    ------
    InputError : spaces that are not nested or not on quadrilaterals, constraints that do not fit.
    """

    def __init__(
        self,
        spaces: Sequence[QuadraticSpace],
        constraints: Sequence[LevelConstraints],
        options: CycleOptions | None = None,
        precision: str = "double",
        pattern: CellPattern | None = None,
    ) -> None:
        if not spaces or len(spaces) != len(constraints):
            raise InputError(
                "constraints", f"{len(constraints)} levels", f"{len(spaces)}, one for each space"
            )
        for space, constraint in zip(spaces, constraints, strict=True):
            if constraint.fixed.shape != (space.size,):
                raise InputError("fixed", f"array of shape {constraint.fixed.shape}", f"({space.size},)")
        pairs = list(pairwise(spaces))
        for coarse, fine in pairs:
            check_refinement(coarse, fine)
        self._spaces, self._constraints = list(spaces), list(constraints)
        self._frames = [c.frames(s.N) for s, c in zip(spaces, constraints, strict=True)]
        self._projections = [c.projections(s.N) for s, c in zip(spaces, constraints, strict=True)]
        self._tables = [velocity_transfer(coarse) for coarse, _ in pairs]
        self._pressures = [pressure_transfer(coarse, fine) for coarse, fine in pairs]
        self._patterns = [CellPattern(space.cell_unknowns, space.size) for space in spaces[:-1]]
        self._patterns.append(pattern or CellPattern(spaces[-1].cell_unknowns, spaces[-1].size))
        self.pattern = self._patterns[-1]
        levels = []
        for k, (space, found) in enumerate(zip(spaces, self._patterns, strict=True)):
            smoother = VankaSmoother(
                found.indptr, found.indices, space.cell_unknowns, found.positions, precision
            )
            border = _border(space) if constraints[k].mean_free else None
            levels.append(Level(smoother, self._prolongation(k) if k else None, border))
        self._levels = levels
        self._multigrid = Multigrid(levels, options)
        self.data = np.zeros(len(self.pattern.indices))
        self._weights = np.ones(spaces[-1].size)
        self._shift = _border(spaces[-1]).constant if constraints[-1].mean_free else None

    @property
    def smoother(self) -> VankaSmoother:
        """That of the finest level."""
        return self._levels[-1].smoother

    @property
    def options(self) -> CycleOptions:
        """What a cycle does; may be replaced between solves."""
        return self._multigrid.options

    @options.setter
    def options(self, options: CycleOptions) -> None:
        self._multigrid.options = options

    def _prolongation(self, k: int) -> sp.csr_array:
        """Prolongation into level k between constrained, rotated unknowns."""
        matrix = prolongation(self._spaces[k - 1], self._spaces[k])
        coarse, fine = self._constraints[k - 1], self._constraints[k]
        if coarse.rotation is not None:
            matrix = sp.csr_array(matrix @ coarse.rotation)
        if fine.rotation is not None:
            matrix = sp.csr_array(fine.rotation.T @ matrix)
        kept_rows, kept_columns = (~fine.fixed).astype(float), (~coarse.fixed).astype(float)
        matrix = sp.csr_array(sp.diags_array(kept_rows) @ matrix @ sp.diags_array(kept_columns))
        matrix.eliminate_zeros()
        matrix.indices, matrix.indptr = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
        return matrix

    def update(self, elements: np.ndarray) -> None:
        """Take the Newton matrix with these element matrices (C, n, n) on the finest level, Cartesian and unconstrained.

        `elements` is overwritten. Raises InputError when the coarsest matrix is singular.
        """
        cells, n = self._spaces[-1].cell_unknowns.shape
        if elements.shape != (cells, n, n):
            raise InputError("elements", f"array of shape {elements.shape}", f"({cells}, {n}, {n})")
        for k in range(len(self._levels) - 1, -1, -1):
            coarser = None
            if k:
                # Fixed components are taken out first: the product is then P^T A P with the constrained prolongation P.
                rotate_elements(elements, self._spaces[k].cell_nodes, self._projections[k])
                coarser = np.empty((self._spaces[k - 1].cells, n, n))
                coarse_elements(elements, self._tables[k - 1], self._pressures[k - 1], coarser)
            if self._constraints[k].rotation is not None:
                rotate_elements(elements, self._spaces[k].cell_nodes, self._frames[k])
            data = self._patterns[k].assemble(elements, self._constraints[k].fixed)
            self._levels[k].smoother.update(data)
            if k == len(self._levels) - 1:
                self.data = data
            if k == 0:
                self._multigrid.update(self._patterns[0].matrix(data))
            else:
                assert coarser is not None
                elements = coarser
        velocities = 2 * self._spaces[-1].N
        row_weights(self.pattern.indptr, self.pattern.indices, self.data, velocities, self._weights)

    def solve(
        self,
        rhs: np.ndarray,
        gain: float = 0.25,
        max_cycles: int = 10,
        krylov: bool = True,
        weighted: bool = True,
        mean: float = 0.0,
    ) -> KrylovResult:
        """(x, cycles, relative residual) for a right-hand side (size,) in rotated components, zero at fixed unknowns.

        krylov : cycles inside flexible GMRES, else alone.   mean : pressure of the solution where it is free up to a constant.
        weighted : residuals in units of sqrt(energy), rows divided by the roots of their diagonals, else in the plain norm.
        """

        def apply(x: np.ndarray) -> np.ndarray:
            return multiply(self.pattern.indptr, self.pattern.indices, self.data, x)

        weights = self._weights if weighted else None
        if self._shift is None or mean == 0.0:
            return self._multigrid.solve(rhs, gain, max_cycles, krylov, weights, apply)
        shift = mean * self._shift
        found = self._multigrid.solve(rhs - apply(shift), gain, max_cycles, krylov, weights, apply)
        return KrylovResult(found.x + shift, found.iterations, found.residual)


class MultigridSolver:
    """The linear solver of a nonlinear iteration: a few multigrid cycles for every system.

    Parameters
    ----------
    flow : on the last of the spaces.   spaces : coarse to fine, each on the refined mesh of the one before.
    gain : factor by which a solve reduces the residual.   max_cycles : of a solve.
    options, precision : of the cycles, see `GeometricMultigrid`.

    Attributes
    ----------
    cycles : of the last solve.

    Raises
    ------
    InputError : spaces that are not nested or not on quadrilaterals, or do not end with that of the flow.
    """

    def __init__(
        self,
        flow: QuasiNewtonianFlow,
        spaces: Sequence[QuadraticSpace],
        gain: float = 0.25,
        max_cycles: int = 10,
        options: CycleOptions | None = None,
        precision: str = "single",
    ) -> None:
        if not spaces or spaces[-1] is not flow.space:
            raise InputError(
                "spaces", f"{len(spaces)} spaces", "coarse to fine, the last one that of the flow"
            )
        if not (0.0 < gain < 1.0 and max_cycles >= 1):
            raise InputError(
                "gain, max_cycles", (gain, max_cycles), "a gain between 0 and 1, at least one cycle"
            )
        constraints = []
        for space in spaces:
            found = flow.constraints if space is flow.space else flow.on(space)
            constraints.append(LevelConstraints(found.fixed, found.rotation, flow.enclosed))
        self.grids = GeometricMultigrid(spaces, constraints, options, precision)
        self.gain, self.max_cycles, self.cycles = gain, max_cycles, 0

    def update(self, elements: np.ndarray) -> None:
        """Take the element matrices (C, n, n) of the next system; they may be overwritten."""
        self.grids.update(elements)

    def solve(self, rhs: np.ndarray, mean: float = 0.0) -> np.ndarray:
        """The increment (size,) for a right-hand side, changing the mean pressure of an enclosed flow by `mean`."""
        found = self.grids.solve(rhs, self.gain, self.max_cycles, mean=mean)
        self.cycles = found.iterations
        return found.x


def _border(space: QuadraticSpace) -> Border:
    """Mean and constant of the pressures of a space."""
    constant, weights = np.zeros(space.size), np.zeros(space.size)
    constant[2 * space.N :] = space.unit_pressure
    weights[2 * space.N :] = space.pressure_weights / space.area
    return Border(weights, constant)
