"""The Delassus operator of a diagonal M with bilateral constraints.

W = H P H^T with P = M^-1 - M^-1 C^T S^-1 C M^-1 and S = C M^-1 C^T (seed B 8.3.3: the pressures of an immersed continuum). The
operator without constraints does its part; what they take away again follows from one solve with S, factorised once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from barchan.friction.gradient_form import GradientDelassus
from barchan.friction.lumped import LumpedDelassus
from barchan.friction.problem import Problem


@dataclass(frozen=True, eq=False)
class ConstrainedDelassus:
    """W = H P H^T from the operator `free` of H M^-1 H^T, whose z (m,) is M^-1 H^T r, or M^-1/2 H^T r for blocks as they are.

    read (c, m) : C for that z, in the components that H moves.  push (m, c) : what multipliers add to it there.
    multipliers : g -> l of S l = g (`barchan.linalg.Saddle.schur`).  reaction_work : of a reaction, in sweeps.
    b : (n, s), of velocities that meet the constraints.
    """

    free: LumpedDelassus | GradientDelassus
    read: sp.csr_array
    push: sp.csr_array
    multipliers: Callable[[np.ndarray], np.ndarray]
    reaction_work: float
    b: np.ndarray

    @cached_property
    def diagonal_blocks(self) -> np.ndarray:
        """(n, s, s), of H M^-1 H^T: what a sweep between two solves with S sees."""
        return self.free.diagonal_blocks

    def reaction(self, z: np.ndarray) -> np.ndarray:
        """(m,) what the constraints add to z (m,) of forces alone: -M^-1 C^T S^-1 C z in the components that H moves."""
        return np.asarray(self.push @ self.multipliers(-(self.read @ z)))

    def spread(self, r: np.ndarray) -> np.ndarray:
        """z = P H^T r (m,) from r (n, s), in the components that H moves."""
        z = self.free.spread(r)
        return z + self.reaction(z)

    def gather(self, z: np.ndarray) -> np.ndarray:
        """H z (n, s) from z (m,)."""
        return self.free.gather(z)

    def apply(self, r: np.ndarray) -> np.ndarray:
        """W r, cost of a product with H, H^T, C and C^T and a solve with S."""
        return self.gather(self.spread(np.ascontiguousarray(r)))


def constrained(
    free: LumpedDelassus | GradientDelassus, problem: Problem, b: np.ndarray
) -> ConstrainedDelassus:
    """The operator of a problem with a diagonal M around `free`, the one without its constraints; `b` (n, s)."""
    inverse_mass, saddle = problem.factor.diagonal, problem.saddle
    assert problem.C is not None and inverse_mass is not None and saddle.schur is not None
    if isinstance(free, GradientDelassus):
        moved = free.form[6] != 0.0
        read, push = moved.astype(float), np.where(moved, inverse_mass, 0.0)
    else:
        moved = np.repeat(np.bincount(free.g.indices, minlength=free.g.columns) > 0, free.g.data.shape[1])
        read = push = np.where(moved, np.sqrt(inverse_mass), 0.0)
    before, after = (
        sp.csr_array(problem.C @ sp.diags_array(read)),
        sp.csr_array((problem.C @ sp.diags_array(push)).T),
    )
    for matrix in (before, after):
        matrix.eliminate_zeros()
    # A sweep takes about a nanosecond for each number of H, as products and triangular solves do for theirs.
    work = (before.nnz + after.nnz + saddle.entries) / max(problem.h_rows.data.size, 1)
    return ConstrainedDelassus(free, before, after, saddle.schur, work, b)
