"""The Delassus operator of a continuum in gradient form: a sixth of the memory and half the arithmetic of blocks.

The strain operator of a material point step has blocks H_ij v = chi*(v (x) g_ij) (seed B, 7.3.1 and 7.3.5), with chi* the
adjoint of chi and one vector g_ij for the s d numbers of the block. Walls and bodies add rows of another kind, kept as blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from barchan.cones import chi
from barchan.friction._gradient_kernels import (
    gradient_fit,
    gradient_products,
    mark_free,
    refuse_inconsistent,
    reorder_rows,
    split_rows,
    take_rows,
)
from barchan.friction._kernels import PARALLEL_ROWS, by_columns
from barchan.linalg import BlockRows

# Share of the blocks that must be strain blocks for the form to pay.
SMALLEST_SHARE = 0.5
_DIMENSIONS = {(3, 2): 2, (6, 3): 3}
Columns: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class GradientDelassus:
    """W = H M^-1 H^T with M diagonal and most blocks of H (s, d) those of a strain: (3, 2) or (6, 3).

    form : pointers (n + 1,), columns (e,) and gradients (e, d) of the strain blocks; pointers (n + 1,), columns (o,) and
        transposed blocks (o, d, s) of the others; inverse masses (m,), zero for components that H does not move.
    b : (n, s).  diagonal_blocks : (n, s, s).
    """

    form: tuple[np.ndarray, ...]
    b: np.ndarray
    diagonal_blocks: np.ndarray

    @property
    def strain_blocks(self) -> int:
        """Number of blocks stored by their gradient."""
        return len(self.form[1])

    @property
    def other_blocks(self) -> int:
        """Number of blocks stored as they are."""
        return len(self.form[4])

    @property
    def columns(self) -> int:
        """Block columns of H."""
        return len(self.form[6]) // self.form[2].shape[1]

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Pointers (n + 1,) and columns of all blocks of H, row by row."""
        pointers, columns, _, others, other_columns = self.form[:5]
        if not self.other_blocks:
            return pointers, columns
        together = pointers + others
        merged = np.empty(together[-1], np.int32)
        n = len(pointers) - 1
        for first, chosen in ((pointers, columns), (others, other_columns)):
            row = np.repeat(np.arange(n), np.diff(first))
            shift = together[:-1] - first[:-1] + (0 if first is pointers else np.diff(pointers))
            merged[np.arange(len(chosen)) + shift[row]] = chosen
        return together, merged

    def in_order(self, order: np.ndarray) -> tuple[np.ndarray, ...]:
        """`form` with the rows in the order of a sweep; itself where they are."""
        if np.array_equal(order, np.arange(len(order))):
            return self.form
        new: list[np.ndarray] = []
        for pointers, columns, data in (self.form[:3], self.form[3:6]):
            flat = data.reshape(len(columns), -1) if len(columns) else np.empty((0, 1))
            part = np.zeros_like(pointers), np.empty_like(columns), np.empty_like(flat)
            np.cumsum(np.diff(pointers)[order], out=part[0][1:])
            reorder_rows(order, pointers, columns, flat, *part)
            new += [part[0], part[1], part[2].reshape(data.shape)]
        return (*new, self.form[6])

    @cached_property
    def _by_columns(self) -> tuple[Columns, Columns]:
        """Strain blocks by columns, with their gradients in that order; where to find the other blocks."""
        pointers, columns, g, others, other_columns = self.form[:5]
        firsts, entries, rows = by_columns(pointers, columns, self.columns)
        ordered = np.empty_like(g)
        take_rows(entries, g, ordered)
        return (firsts, rows, ordered), by_columns(others, other_columns, self.columns)

    @cached_property
    def _scratch(self) -> np.ndarray:
        return np.empty((len(self.b), 6))

    @cached_property
    def _products(self) -> tuple[Callable[..., None], Callable[..., None]]:
        return gradient_products(self.b.shape[1], self.form[2].shape[1], len(self.b) >= PARALLEL_ROWS)

    def spread(self, r: np.ndarray) -> np.ndarray:
        """z = M^-1 H^T r (m,) from r (n, s): the velocities that forces add."""
        z = np.empty(len(self.form[6]))
        self._products[0](self.form, *self._by_columns, r, self._scratch, z)
        return z

    def gather(self, z: np.ndarray) -> np.ndarray:
        """H z (n, s) from z (m,)."""
        u = np.empty(self.b.shape)
        self._products[1](self.form, z, u)
        return u

    def apply(self, r: np.ndarray) -> np.ndarray:
        """W r, cost O(blocks of H)."""
        return self.gather(self.spread(np.ascontiguousarray(r)))


def gradient_form(
    rows: BlockRows, inverse_mass: np.ndarray, b: np.ndarray, diagonal_blocks: Callable[[], np.ndarray]
) -> GradientDelassus | None:
    """The operator of H given by block `rows` (n, s, d) and the diagonal of M^-1 (m,), or None where it does not pay.

    Strain blocks are recognised one by one, to round-off; components of constrained velocities may be zero in them, as long
    as no block moves the component. Cost: one pass over H.
    """
    n, (count, s, q) = rows.n, rows.data.shape
    if (s, q) not in _DIMENSIONS or count == 0:
        return None
    g, zero = np.empty((count, q)), np.empty(count, np.uint8)
    fits, free = np.empty(count, np.bool_), np.zeros((rows.columns, q), np.bool_)
    fit: Any = gradient_fit(s, q, n >= PARALLEL_ROWS)
    fit(rows.indptr, rows.data, chi(np.eye(s)), g, fits, zero)
    mark_free(rows.indices, zero, free)
    fitting = refuse_inconsistent(rows.indices, zero, free, g, fits)
    if fitting < SMALLEST_SHARE * count:
        return None
    if fitting == count:
        empty = np.zeros(n + 1, np.int32), np.zeros(0, np.int32), np.zeros((0, q, s))
        form = (rows.indptr, rows.indices, g, *empty)
    else:
        own = np.empty(n + 1, np.int32), np.empty(fitting, np.int32), np.empty((fitting, q))
        rest = count - fitting
        others = np.empty(n + 1, np.int32), np.empty(rest, np.int32), np.empty((rest, q, s))
        form = (*own, *others)
        split_rows(rows.indptr, rows.indices, rows.data, g, fits, form)
    moving = np.where(free.reshape(-1), inverse_mass, 0.0)
    return GradientDelassus((*form, moving), np.ascontiguousarray(b), diagonal_blocks())
