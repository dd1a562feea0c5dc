"""Multigrid cycles (V, W, F) with Vanka smoothing on given levels, alone or inside flexible GMRES (seed C 4.3).

Matrices whose pressures are known up to a constant are solved with a given mean: every level knows the weights of its mean, and
the coarsest system is bordered by them, so that cycles converge to the solution of mean zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from barchan.errors import InputError
from barchan.linalg.factor import Solver
from barchan.linalg.fgmres import KrylovResult, Map, flexible_gmres
from barchan.linalg.vanka import VankaSmoother

CYCLES = ("V", "W", "F")


@dataclass(frozen=True)
class CycleOptions:
    """What a cycle does.

    shape : "V", "W" or "F".   pre, post : smoothing sweeps on the finest level before and after the coarse correction.
    growth : factor of the number of sweeps from a level to the next coarser one.
    damping : of the patch corrections; full ones diverge on some of the unsymmetric matrices far from a solution.
    """

    shape: str = "F"
    pre: int = 8
    post: int = 8
    growth: float = 1.0
    damping: float = 0.8

    def __post_init__(self) -> None:
        if self.shape not in CYCLES:
            raise InputError("shape", self.shape, f"one of {', '.join(CYCLES)}")
        if min(self.pre, self.post) < 0 or self.pre + self.post < 1:
            raise InputError("pre, post", (self.pre, self.post), "at least one sweep in all")
        if not 0.0 < self.damping <= 2.0 or self.growth < 1.0:
            raise InputError(
                "damping, growth", (self.damping, self.growth), "damping in (0, 2], growth at least 1"
            )


@dataclass(frozen=True)
class Border:
    """How a constant pressure is fixed on a level: `weights` (size,) of the mean, `constant` (size,) with mean one."""

    weights: np.ndarray
    constant: np.ndarray


@dataclass(frozen=True)
class Level:
    """One grid: its smoother, the prolongation (size, coarser size) into it, its border; the coarsest has no prolongation."""

    smoother: VankaSmoother
    prolongation: sp.csr_array | None = None
    border: Border | None = None


class Multigrid:
    """Cycles over levels from coarse to fine.

    `levels[0]` is solved directly. `update` must follow every change of the coarsest matrix; the caller updates smoothers.

    Attributes
    ----------
    options : of the cycles; may be replaced between solves.

    Raises
    ------
    InputError : no level, or prolongations that do not fit.
    """

    def __init__(self, levels: list[Level], options: CycleOptions | None = None) -> None:
        if not levels:
            raise InputError("levels", levels, "at least one")
        for coarse, fine in pairwise(levels):
            shape = None if fine.prolongation is None else fine.prolongation.shape
            if shape != (fine.smoother.size, coarse.smoother.size):
                raise InputError(
                    "prolongation", shape, f"of shape {fine.smoother.size, coarse.smoother.size}"
                )
        self.options = options or CycleOptions()
        self._orders = [level.smoother.order for level in levels]
        self._levels = [_reordered(level, self._orders[max(k - 1, 0)]) for k, level in enumerate(levels)]
        self._restrictions = [
            None if level.prolongation is None else sp.csr_array(level.prolongation.T)
            for level in self._levels
        ]
        self._coarse: Solver | None = None

    def update(self, coarse: sp.csr_array) -> None:
        """Factorise the coarsest matrix (size, size), in the numbering of the caller.

        Raises InputError when it is singular.
        """
        level, order = self._levels[0], self._orders[0]
        border, matrix = level.border, sp.csr_array(coarse[order][:, order])
        matrix.sort_indices()
        if border is None:
            self._coarse = _direct(matrix)
            return
        scale, largest = float(np.abs(matrix.diagonal()).max()), float(np.abs(border.weights).max())
        column, row = scale * border.constant[:, None], scale / largest * border.weights[None]
        bordered = sp.block_array([[matrix, sp.csr_array(column)], [sp.csr_array(row), None]], format="csr")
        solve = _direct(bordered)
        self._coarse = lambda b: solve(np.append(b[:-1], scale * b[-1] / largest))[:-1]

    def cycle(self, b: np.ndarray) -> np.ndarray:
        """One cycle for the right-hand side b (size,) from a start of zero."""
        smoother = self._levels[-1].smoother
        # Residuals are scaled to size one for the sake of single precision.
        scale = float(np.abs(b).max(initial=0.0))
        if scale == 0.0:
            return np.zeros(len(b))
        order = self._orders[-1]
        x, right = np.zeros(len(b), smoother.dtype), (b[order] / scale).astype(smoother.dtype)
        self._descend(len(self._levels) - 1, x, right, 0.0, self.options.shape)
        x = scale * x.astype(float)
        border = self._levels[-1].border
        if border is not None:
            x -= (border.weights @ x) * border.constant
        y = np.empty(len(b))
        y[order] = x
        return y

    def _descend(self, k: int, x: np.ndarray, b: np.ndarray, mean: float, shape: str) -> None:
        """Improve x on level k for the right-hand side b and the weighted mean `mean`, in place."""
        smoother = self._levels[k].smoother
        if k == 0:
            self._solve_coarsest(x, b, mean)
            return
        factor = self.options.growth ** (len(self._levels) - 1 - k)
        damping = self.options.damping
        smoother.sweep_ordered(x, b, round(self.options.pre * factor), damping=damping)
        visits = 1 if shape == "V" or k == 1 else 2
        for visit in range(visits):
            self._correct(k, x, b, mean, "V" if shape == "F" and visit else shape)
        smoother.sweep_ordered(x, b, round(self.options.post * factor), backward=True, damping=damping)

    def _correct(self, k: int, x: np.ndarray, b: np.ndarray, mean: float, shape: str) -> None:
        """Correct x on level k from the next coarser level."""
        level, restriction = self._levels[k], self._restrictions[k]
        assert level.prolongation is not None and restriction is not None
        rest = restriction @ level.smoother.residual_ordered(x, b)
        missing = 0.0 if level.border is None else mean - float(level.border.weights @ x)
        e = np.zeros_like(rest)
        self._descend(k - 1, e, rest, missing, shape)
        x += level.prolongation @ e

    def _solve_coarsest(self, x: np.ndarray, b: np.ndarray, mean: float) -> None:
        assert self._coarse is not None, "update first"
        border = self._levels[0].border
        r = self._levels[0].smoother.residual_ordered(x, b).astype(float)
        if border is None:
            x += self._coarse(r)
        else:
            x += self._coarse(np.append(r, mean - float(border.weights @ x)))

    def solve(
        self,
        b: np.ndarray,
        gain: float = 0.1,
        max_cycles: int = 20,
        krylov: bool = True,
        weights: np.ndarray | None = None,
        apply: Map | None = None,
    ) -> KrylovResult:
        """Solve A x = b (size,) until the residual has fallen by the factor `gain`; `iterations` are cycles.

        krylov : inside flexible GMRES, else cycles alone (stationary).   weights : of the rows in the residual's norm.
        apply : x -> A x in double precision, where the smoother works in single.
        """
        apply = apply or self._apply
        if krylov:
            return flexible_gmres(apply, self.cycle, b, gain, max_cycles, weights)
        weigh = 1.0 if weights is None else weights
        x, r, cycles = np.zeros(len(b)), b, 0
        start = norm = float(np.linalg.norm(weigh * b))
        while cycles < max_cycles and norm > gain * start:
            x += self.cycle(r)
            r, cycles = b - apply(x), cycles + 1
            norm = float(np.linalg.norm(weigh * r))
        return KrylovResult(x, cycles, norm / start if start else 0.0)

    def _apply(self, x: np.ndarray) -> np.ndarray:
        smoother, order = self._levels[-1].smoother, self._orders[-1]
        zero, y = np.zeros(len(x), smoother.dtype), np.empty(len(x))
        y[order] = -smoother.residual_ordered(x[order].astype(smoother.dtype), zero)
        return y


def _direct(matrix: sp.csr_array) -> Solver:
    """SuperLU, whose pivoting copes with the zero blocks of saddle points; the coarsest grids are small.

    Raises InputError for a singular matrix.
    """
    try:
        return spla.splu(sp.csc_array(matrix)).solve
    except RuntimeError:
        raise InputError(
            "coarse matrix", "singular", "invertible: conditions that determine the flow"
        ) from None


def _reordered(level: Level, coarser: np.ndarray) -> Level:
    """The level with its prolongation and border in the order of the smoothers and the precision of its own."""
    order, matrix, border = level.smoother.order, level.prolongation, level.border
    if matrix is not None:
        matrix = sp.csr_array(matrix[order][:, coarser]).astype(level.smoother.dtype)
        matrix.sort_indices()
    if border is not None:
        border = Border(border.weights[order], border.constant[order])
    return Level(level.smoother, matrix, border)
