"""Block Vanka smoother: Gauss-Seidel over cells, the velocities and pressures of a cell corrected together (seed C 4.3).

Patch matrices are cut out of the assembled matrix and inverted once per matrix. Cells are swept in blocks of consecutive
numbers (squares of cells, after regular refinement), coloured so that blocks that run at once do not interact: the same bytes
on any number of threads.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg._vanka_kernels import (
    LANES,
    invert_patches,
    permute_columns,
    permute_data,
    residual,
    residual_in_order,
    sweep_by_colour,
    sweep_in_order,
    twin_rows,
    visiting_order,
)
from barchan.linalg.colouring import Schedule, coloured_schedule

BLOCK = 64
LARGEST_SERIAL = 2048  # patches up to which starting threads costs more than it brings
LARGEST_SERIAL_ROWS = 20_000  # of a product
PRECISIONS = {"single": np.float32, "double": np.float64}


class VankaSmoother:
    """Multiplicative sweeps of patch corrections on matrices of one pattern.

    Parameters
    ----------
    indptr, indices : (size + 1,), (nnz,) of the pattern in compressed rows.
    patches : (C, n) unknowns of every patch.   positions : (C, n, n) place of every patch entry in the matrix data.
    precision : "double" or "single", of the sweeps; inverses are always formed in double precision.
    block : consecutive patches that are swept one after the other by one thread.

    Attributes
    ----------
    size : unknowns.   dtype : of the sweeps.   order : (size,) unknowns in the order in which sweeps first visit them.

    Raises
    ------
    InputError : arrays whose shapes do not belong together, unknown precision.
    """

    def __init__(
        self,
        indptr: np.ndarray,
        indices: np.ndarray,
        patches: np.ndarray,
        positions: np.ndarray,
        precision: str = "double",
        block: int = BLOCK,
    ) -> None:
        if precision not in PRECISIONS:
            raise InputError("precision", precision, f"one of {', '.join(PRECISIONS)}")
        if patches.ndim != 2 or positions.shape != (*patches.shape, patches.shape[1]):
            raise InputError("positions", f"array of shape {positions.shape}", "(C, n, n) for (C, n) patches")
        self.size, self.dtype = len(indptr) - 1, np.dtype(PRECISIONS[precision])
        patches = np.ascontiguousarray(patches, np.int32)
        self._pointers, self._positions = np.asarray(indptr, np.int32), positions
        # Rows in the order of their first visit: a block of patches then reads memory nearly in sequence.
        self.order = visiting_order(patches, self.size)
        place = np.empty(self.size, np.int32)
        place[self.order] = np.arange(self.size, dtype=np.int32)
        lengths = np.diff(self._pointers)[self.order]
        self._indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
        self._indices = np.empty(len(indices), np.int32)
        permute_columns(
            self._pointers, np.asarray(indices, np.int32), self.order, place, self._indptr, self._indices
        )
        self._patches = np.ascontiguousarray(place[patches])
        self._twins = twin_rows(self._indptr, self._indices)
        count, n = patches.shape
        padded = -(-n // LANES) * LANES
        self._inverses = np.zeros((count, n, padded), self.dtype)
        self._data = np.zeros(len(indices), self.dtype)
        self._block = block
        self._schedule = self._colours() if count > LARGEST_SERIAL else None
        if self._schedule is not None:
            self._scratch = np.zeros((self._schedule.widest, 2 * padded), self.dtype)[:, :padded]

    def _colours(self) -> Schedule:
        """Blocks of patches, coloured: two conflict when one writes what the other reads or writes."""
        count, n = self._patches.shape
        blocks = -(-count // self._block)
        owner = np.repeat(np.arange(count) // self._block, n)
        ones = np.ones(count * n, np.int32)
        reach = sp.csr_array((ones, (owner, self._patches.ravel())), shape=(blocks, self.size))
        pattern = sp.csr_array(
            (np.ones(len(self._indices), np.int32), self._indices, self._indptr), shape=(self.size, self.size)
        )
        read = sp.csr_array(reach @ pattern) + reach
        conflict = sp.csr_array(read @ reach.T)
        return coloured_schedule(sp.csr_array(conflict + conflict.T), 1, shared_columns=False)

    def update(self, data: np.ndarray) -> None:
        """Take the matrix of entries `data` (nnz,), in the pattern given, and invert its patches."""
        if data.shape != self._data.shape:
            raise InputError("data", f"array of shape {data.shape}", f"of shape {self._data.shape}")
        invert_patches(data, self._positions, self._inverses)
        permute_data(self._pointers, data, self.order, self._indptr, self._data)

    def sweep(
        self, x: np.ndarray, b: np.ndarray, sweeps: int = 1, backward: bool = False, damping: float = 1.0
    ) -> None:
        """Improve x (size,) for the right-hand side b (size,) in place."""
        y = x[self.order].astype(self.dtype)
        self.sweep_ordered(y, b[self.order].astype(self.dtype), sweeps, backward, damping)
        x[self.order] = y

    def sweep_ordered(
        self, x: np.ndarray, b: np.ndarray, sweeps: int = 1, backward: bool = False, damping: float = 1.0
    ) -> None:
        """`sweep` on vectors numbered as `order` says (x[order] of the caller's x), in the precision of the smoother."""
        arrays = (self._indptr, self._indices, self._data, self._twins, self._patches, self._inverses, x, b)
        options = (sweeps, backward, self.dtype.type(damping))
        if self._schedule is None:
            sweep_in_order(*arrays, *options)
            return
        schedule = self._schedule
        sweep_by_colour(*arrays, *options, schedule.colour_ptr, schedule.order, self._block, self._scratch)

    def residual_ordered(self, x: np.ndarray, b: np.ndarray) -> np.ndarray:
        """b - A x (size,) of vectors numbered as `order` says, in the precision of the smoother."""
        out = np.empty_like(b)
        product = residual_in_order if self._schedule is None else residual
        product(self._indptr, self._indices, self._data, x, b, out)
        return out


def multiply(indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A x (size,) on all threads, A in compressed rows."""
    out = np.empty(len(indptr) - 1)
    product = residual if len(out) > LARGEST_SERIAL_ROWS else residual_in_order
    product(indptr, indices, data, x, np.zeros(len(out)), out)
    return np.negative(out, out=out)
