"""MKL's Pardiso by its C interface: one analysis, many factorisations of the same pattern, several right-hand sides at once.

pypardiso (extra `fast`) finds the library; its own `solve` compares or hashes the whole matrix at every call and knows only
nonsymmetric matrices, so the routine is called here directly.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numba
import numpy as np

TYPES = {"positive": 2, "indefinite": -2, "structural": 1, "general": 11}
ANALYSE, FACTORISE, SOLVE, SOLVE_BACKWARD, RELEASE = 11, 22, 33, 333, -1
ZERO_PIVOT, NO_MEMORY = -4, -2
INTEGERS = ctypes.POINTER(ctypes.c_int32)


@cache
def available() -> bool:
    """True where Pardiso can be used."""
    if importlib.util.find_spec("pypardiso") is None:
        return False
    try:
        library()
    except (ImportError, OSError, AttributeError):
        return False
    return True


@cache
def library() -> Any:
    """MKL, as pypardiso finds it.

    Numba's threads are started first: MKL then takes the same OpenMP library, hence the same pool of threads. Where it brings
    its own, its threads must not spin after their work (0.2 s by default): they would take the cores of the next kernel.
    """
    numba.get_num_threads()
    os.environ.setdefault("KMP_BLOCKTIME", "0")
    import pypardiso

    mkl = pypardiso.PyPardisoSolver().libmkl
    mkl.pardiso.restype = None
    mkl.MKL_Set_Num_Threads_Local.restype = ctypes.c_int
    return mkl


@contextmanager
def _threads(count: int | None) -> Iterator[None]:
    """`count` threads for MKL, or as many as the house's own kernels have, also where BLAS is held to one (`one_blas_thread`).

    The setting of the calling thread goes before the global one, which threadpoolctl lowers for every BLAS it has met.
    """
    mkl = library()
    before = mkl.MKL_Set_Num_Threads_Local(count or numba.get_num_threads())
    try:
        yield
    finally:
        mkl.MKL_Set_Num_Threads_Local(before)


def _release(handle: np.ndarray, kind: int, m: int, parameters: np.ndarray) -> None:
    none = np.zeros(1)
    empty = np.zeros(1, np.int32)
    _call(handle, kind, RELEASE, m, none, empty, empty, 1, parameters, none, none, 1)


def _call(
    handle: np.ndarray, kind: int, phase: int, m: int, data: np.ndarray, indptr: np.ndarray, indices: np.ndarray,
    right_sides: int, parameters: np.ndarray, b: np.ndarray, x: np.ndarray, threads: int | None,
) -> int:  # fmt: skip
    """Error number of one call."""
    error = ctypes.c_int32(0)

    def integer(value: int) -> Any:
        return ctypes.byref(ctypes.c_int32(value))

    def pointer(array: np.ndarray, of: Any = INTEGERS) -> Any:
        return array.ctypes.data_as(of)

    with _threads(threads):
        library().pardiso(
            pointer(handle, ctypes.POINTER(ctypes.c_int64)), integer(1), integer(1), integer(kind), integer(phase),
            integer(m), pointer(data, ctypes.c_void_p), pointer(indptr), pointer(indices), None,
            integer(right_sides), pointer(parameters), integer(0), pointer(b, ctypes.c_void_p),
            pointer(x, ctypes.c_void_p), ctypes.byref(error),
        )  # fmt: skip
    return error.value


class Pardiso:
    """Factorisations of matrices of one pattern.

    Parameters
    ----------
    indptr, indices : of the pattern (m, m): sorted columns with the whole diagonal; the upper triangle for symmetric kinds.
    data : (nnz,) typical entries, for the ordering where it depends on them (indefinite matrices).
    kind : "positive", "indefinite" (symmetric), "structural" (symmetric pattern, any entries), "general".
    threads : of every call; as many as Numba's kernels may use when None.

    Raises
    ------
    MemoryError : the factors do not fit.
    """

    def __init__(
        self, indptr: np.ndarray, indices: np.ndarray, data: np.ndarray, kind: str, threads: int | None = None
    ) -> None:
        self.m, self.kind, self._threads = len(indptr) - 1, TYPES[kind], threads
        self._handle = np.zeros(64, np.int64)
        self._indptr, self._indices = indptr.astype(np.int32), indices.astype(np.int32)
        self._data = np.ascontiguousarray(data, dtype=float)
        self._parameters = self._choose(kind)
        error = self._phase(ANALYSE)
        self._finalizer = weakref.finalize(
            self, _release, self._handle, self.kind, self.m, self._parameters.copy()
        )
        self._refuse(error, "analysis")

    @staticmethod
    def _choose(kind: str) -> np.ndarray:
        """The array `iparm` of Pardiso's manual (numbers from 1 in the comments)."""
        chosen = np.zeros(64, np.int32)
        chosen[0] = 1  # (1) no defaults
        chosen[1] = 2  # (2) nested dissection by METIS: the same on any number of threads
        chosen[9] = (
            8 if kind == "indefinite" else 13
        )  # (10) pivots below 10^-8, 10^-13 of the norm are perturbed
        # Scaling and matching (11, 13) would tie the analysis to the entries; they change by orders of magnitude.
        chosen[10] = chosen[12] = kind == "general"
        chosen[17] = chosen[18] = 0  # (18, 19) do not count entries and operations
        chosen[20] = 1  # (21) 1 x 1 and 2 x 2 pivots in indefinite matrices
        chosen[23] = kind != "general"  # (24) two-level scheduling
        chosen[34] = 1  # (35) indices from 0
        return chosen

    def _phase(self, phase: int, b: np.ndarray | None = None, x: np.ndarray | None = None) -> int:
        none = np.zeros(1)
        b, x = none if b is None else b, none if x is None else x
        right_sides = b.shape[1] if b.ndim == 2 else 1
        return _call(
            self._handle, self.kind, phase, self.m, self._data, self._indptr, self._indices, right_sides,
            self._parameters, b, x, self._threads,
        )  # fmt: skip

    def _refuse(self, error: int, phase: str) -> None:
        if error == NO_MEMORY:
            raise MemoryError(f"Pardiso: no memory for the {phase} of {self.m} unknowns")
        if error:
            raise RuntimeError(f"Pardiso: error {error} in the {phase}")

    def factorise(self, data: np.ndarray) -> bool:
        """Factorise the matrix of these entries (nnz,); False when it is singular or, if positive is asked, it is not so."""
        self._data = np.ascontiguousarray(data, dtype=float)
        if not np.isfinite(self._data).all():
            return False
        error = self._phase(FACTORISE)
        if error == ZERO_PIVOT:
            return False
        self._refuse(error, "factorisation")
        return True

    def solve(self, rhs: np.ndarray, refinements: int = 0) -> np.ndarray:
        """x of shape (m,) or (m, k), for right-hand sides of that shape, by the last factorisation.

        `refinements` bounds the steps of iterative refinement; with 0 there are two where pivots had to be replaced, else none.
        """
        self._parameters[7] = refinements
        return self._solution(SOLVE, rhs)

    def solve_backward(self, rhs: np.ndarray) -> np.ndarray:
        """P^T L^-T rhs, where the positive definite matrix is P^T L L^T P: half a solve."""
        self._parameters[7] = 0
        return self._solution(SOLVE_BACKWARD, rhs)

    def _solution(self, phase: int, rhs: np.ndarray) -> np.ndarray:
        b = np.asfortranarray(rhs, dtype=float)
        x = np.zeros_like(b)
        if b.size:
            self._refuse(self._phase(phase, b, x), "solution")
        return x

    @property
    def negative(self) -> int:
        """Negative pivots of the last factorisation of an indefinite matrix."""
        return int(self._parameters[22])

    @property
    def perturbed(self) -> int:
        """Pivots that were too small and were replaced in the last factorisation."""
        return int(self._parameters[13])

    @property
    def megabytes(self) -> float:
        """Memory of the factors and of their making, as Pardiso counts it."""
        return float(max(self._parameters[14], self._parameters[15] + self._parameters[16])) / 1024.0
