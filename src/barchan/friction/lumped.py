"""The Delassus operator of a diagonal M, with the blocks of H as they are: W = G G^T, G = H M^-1/2 (seed B 3.4.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from barchan.friction._kernels import PARALLEL_ROWS, by_columns, factored_products
from barchan.linalg import BlockRows


@dataclass(frozen=True, eq=False)
class LumpedDelassus:
    """W = G G^T with G = H M^-1/2 and M diagonal; blocks of G are stored transposed (q, s) for the sweep kernels."""

    g: BlockRows
    b: np.ndarray
    diagonal_blocks: np.ndarray

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """G by columns: pointers per velocity block, then entry and block row of each of its blocks."""
        return (*by_columns(self.g.indptr, self.g.indices, self.g.columns), self.g.data)

    @cached_property
    def _products(self) -> tuple[Callable[..., None], Callable[..., None]]:
        _, q, s = self.g.data.shape
        return factored_products(s, q, self.g.n >= PARALLEL_ROWS)

    def spread(self, r: np.ndarray) -> np.ndarray:
        """z = G^T r (m,) from r (n, s)."""
        z = np.empty(self.g.columns * self.g.data.shape[1])
        self._products[0](self._columns, r, z)
        return z

    def gather(self, z: np.ndarray) -> np.ndarray:
        """G z (n, s) from z (m,)."""
        u = np.empty(self.b.shape)
        self._products[1]((self.g.indptr, self.g.indices, self.g.data), z, u)
        return u

    def apply(self, r: np.ndarray) -> np.ndarray:
        """W r, cost O(entries of H)."""
        return self.gather(self.spread(r))
