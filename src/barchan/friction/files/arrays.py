"""The neutral form of a problem file: a frozen bundle of matrices and vectors, and what makes it sound.

Signs and names are those of DESIGN (M v = f + H^T r + C^T l, C v = k, u = H v + w; reduced u = W r + b),
whatever the file used (seed B, 2.2-2.3; mixed problems are its Eq. 2.18).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError

Vector: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SolutionArrays:
    """A solution or a first guess as a file stores it, in the signs of `ProblemArrays`.

    Attributes
    ----------
    r : (n s,) contact forces, impulses or stresses.
    u : (n s,) relative velocities or strain rates.
    v : (m,) generalised velocities; None in files of reduced problems.
    l : (c,) multipliers of the bilateral rows (also those of a mixed problem); None without them.
    """

    r: Vector
    u: Vector
    v: Vector | None = None
    l: Vector | None = None


@dataclass(frozen=True, eq=False)
class ProblemArrays:
    """A discrete Coulomb friction problem as arrays: n blocks of size s, m velocities, c bilateral rows.

    Either W and b (reduced) or M, f, H and w (full) are given, never both; C and k only beside M; B, P and c only
    beside W, where they make the problem mixed: bilateral multipliers l not eliminated. Matrices
    are `scipy.sparse.csr_array` in canonical form (sorted, no duplicates, no stored zeros), vectors flat
    float64.

    Attributes
    ----------
    dimension : 2 or 3, as written in the file.
    block_size : s; rows of a block are ordered (N; T...).
    mu : (n,) friction coefficients.
    W, b : (n s, n s) and (n s,), u = W r + b.
    B, P, c : (n s, c), (c, c) and (c,) of a mixed problem, u = W r + B l + b and P l + B^T r + c = 0; else None.
    M, f, H, w : (m, m), (m,), (n s, m), (n s,), M v = f + H^T r + C^T l and u = H v + w.
    C, k : (c, m) and (c,), C v = k; None without bilateral rows.
    solution, guesses : what the file stored beside the problem, not checked against it.
    title, description, math_info : free text of FCLIB files.
    dilatancy : (n,) zeta of s(u) = (mu - zeta) |u_T| e_N; None stands for 0, which is Coulomb's law.
    """

    dimension: int
    block_size: int
    mu: Vector
    W: sp.csr_array | None = None
    b: Vector | None = None
    B: sp.csr_array | None = None
    P: sp.csr_array | None = None
    c: Vector | None = None
    M: sp.csr_array | None = None
    f: Vector | None = None
    H: sp.csr_array | None = None
    w: Vector | None = None
    C: sp.csr_array | None = None
    k: Vector | None = None
    solution: SolutionArrays | None = None
    guesses: tuple[SolutionArrays, ...] = ()
    title: str = ""
    description: str = ""
    math_info: str = ""
    dilatancy: Vector | None = None

    @property
    def reduced(self) -> bool:
        """Whether the problem is given by W and b."""
        return self.W is not None

    @property
    def count(self) -> int:
        """Number of blocks n."""
        return len(self.mu)


def canonical(matrix: sp.sparray | sp.spmatrix | NDArray[np.float64]) -> sp.csr_array:
    """`matrix` as float64 CSR with sorted columns, duplicates added up and stored zeros dropped."""
    result = sp.csr_array(matrix, dtype=np.float64)
    if result is matrix:
        result = result.copy()
    result.sum_duplicates()
    result.eliminate_zeros()
    result.sort_indices()
    return result


def require_sound(arrays: ProblemArrays, source: str) -> None:
    """Check that sizes agree, numbers are finite and coefficients make sense.

    Raises
    ------
    InputError : its field is `source` (the file) followed by the name of the array at fault.
    """
    if arrays.dimension not in (2, 3):
        raise InputError(f"{source}: dimension", arrays.dimension, "2 or 3")
    if arrays.block_size < 2:
        raise InputError(f"{source}: block size", arrays.block_size, "2 or more")
    if arrays.reduced == (arrays.M is not None):
        raise InputError(f"{source}: matrices", "W and M" if arrays.reduced else "neither W nor M", "W or M")
    size = arrays.count * arrays.block_size
    _require_vector(source, "mu", arrays.mu, arrays.count)
    _require_range(source, "mu", arrays.mu, arrays.mu >= 0.0, ">= 0")
    if arrays.reduced:
        _require_matrix(source, "W", arrays.W, (size, size))
        _require_vector(source, "b", arrays.b, size)
        _require_mixed(arrays, source, size)
    else:
        _require_full(arrays, source, size)
    if arrays.dilatancy is not None:
        _require_vector(source, "dilatancy", arrays.dilatancy, arrays.count)
        inside = (arrays.dilatancy >= 0.0) & (arrays.dilatancy <= arrays.mu)
        _require_range(source, "dilatancy", arrays.dilatancy, inside, "between 0 and mu")
    states = (arrays.solution, *arrays.guesses)
    for name, state in zip(
        ("solution", *(f"guess {g + 1}" for g in range(len(arrays.guesses)))), states, strict=True
    ):
        if state is not None:
            _require_state(arrays, f"{source}: {name}", state, size)


def _require_mixed(arrays: ProblemArrays, source: str, size: int) -> None:
    given = [part is not None for part in (arrays.B, arrays.P, arrays.c)]
    if arrays.c is None or not all(given):
        if any(given):
            raise InputError(f"{source}: bilateral rows", "some of B, P and c", "all of B, P and c")
        return
    _require_vector(source, "c", arrays.c, len(arrays.c))
    _require_matrix(source, "B", arrays.B, (size, len(arrays.c)))
    _require_matrix(source, "P", arrays.P, (len(arrays.c), len(arrays.c)))


def _require_full(arrays: ProblemArrays, source: str, size: int) -> None:
    velocities = 0 if arrays.M is None else arrays.M.shape[0]
    _require_matrix(source, "M", arrays.M, (velocities, velocities))
    _require_vector(source, "f", arrays.f, velocities)
    _require_matrix(source, "H", arrays.H, (size, velocities))
    _require_vector(source, "w", arrays.w, size)
    if (arrays.C is None) != (arrays.k is None):
        raise InputError(f"{source}: bilateral rows", "C or k alone", "C and k together")
    if arrays.C is not None:
        _require_matrix(source, "C", arrays.C, (arrays.C.shape[0], velocities))
        _require_vector(source, "k", arrays.k, arrays.C.shape[0])


def _require_state(arrays: ProblemArrays, source: str, state: SolutionArrays, size: int) -> None:
    _require_vector(source, "r", state.r, size)
    _require_vector(source, "u", state.u, size)
    if state.v is not None:
        _require_vector(source, "v", state.v, 0 if arrays.M is None else arrays.M.shape[0])
    if state.l is not None:
        rows = arrays.k if arrays.c is None else arrays.c
        _require_vector(source, "l", state.l, 0 if rows is None else len(rows))


def _require_matrix(source: str, name: str, matrix: sp.csr_array | None, shape: tuple[int, int]) -> None:
    if matrix is None:
        raise InputError(f"{source}: {name}", "missing", "given")
    if matrix.shape != shape:
        raise InputError(f"{source}: shape of {name}", matrix.shape, f"{shape}")
    bad = np.flatnonzero(~np.isfinite(matrix.data))
    if len(bad):
        raise InputError(f"{source}: {name}", f"{matrix.data[bad[0]]}", "finite numbers")


def _require_vector(source: str, name: str, vector: Vector | None, length: int) -> None:
    if vector is None:
        raise InputError(f"{source}: {name}", "missing", "given")
    if vector.shape != (length,):
        raise InputError(f"{source}: shape of {name}", vector.shape, f"({length},)")
    _require_range(source, name, vector, np.isfinite(vector), "finite")


def _require_range(source: str, name: str, vector: Vector, good: NDArray[np.bool_], allowed: str) -> None:
    bad = np.flatnonzero(~good)
    if len(bad):
        raise InputError(f"{source}: {name}[{bad[0]}]", f"{vector[bad[0]]}", allowed)
