"""The discrete Coulomb friction problem (DCFP): data, validation and the quantities every solver and the certificate need.

M v = f + H^T r + C^T l, C v = k, u = H v + w, (u_i, r_i) in law_i (seed B Eq. 2.17); reduced form u = W r + b (Eq. 2.19).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from copy import copy
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from barchan.cones import Law
from barchan.errors import InputError
from barchan.friction._kernels import PARALLEL_ROWS, lumped_diagonal
from barchan.linalg import (
    BlockRows,
    Factor,
    Saddle,
    block_rows,
    delassus_diagonal,
    delassus_trace,
    diagonal_blocks_of_square,
    factorise,
    saddle_solver,
)
from barchan.linalg.dense_blocks import WhitenedRows
from barchan.linalg.factor import check_symmetric

DELASSUS_ASYMMETRY = 1e-2
EXACT_ENTRIES = 20_000_000  # of H M^-1, beyond which `rho` is an estimate where M has a dense inverse
Matrix: TypeAlias = np.ndarray | sp.sparray | sp.spmatrix


def _numbers(name: str, value: Any) -> np.ndarray:
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            raise InputError(name, "array of complex numbers", "real")
        return np.asarray(array, dtype=float)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(name, value, "an array of numbers") from error


def _vector(name: str, value: Any, length: int | None = None) -> np.ndarray:
    array = np.ascontiguousarray(_numbers(name, value))
    if array.ndim != 1:
        raise InputError(name, f"array of shape {array.shape}", "a one-dimensional array")
    if length is not None and len(array) != length:
        raise InputError(name, f"array of length {len(array)}", f"of length {length}")
    if not np.isfinite(array).all():
        raise InputError(name, "array with NaN or infinite entries", "finite")
    return array


def _matrix(name: str, value: Any) -> sp.sparray:
    if not sp.issparse(value):
        value = np.atleast_2d(_numbers(name, value))
        if value.ndim != 2:
            raise InputError(name, f"array of shape {value.shape}", "a matrix")
    elif value.dtype.kind not in "biuf":
        raise InputError(name, f"sparse matrix of {value.dtype}", "real numbers")
    in_blocks = sp.issparse(value) and value.format == "bsr"
    matrix = sp.bsr_array(value, dtype=float) if in_blocks else sp.csr_array(value, dtype=float)
    if not np.isfinite(matrix.data).all():
        raise InputError(name, "matrix with NaN or infinite entries", "finite")
    return matrix


def _check_minors(W: sp.coo_array) -> None:
    """Refuse a W with a 2 x 2 principal minor that is negative beyond round-off: what is cheap to see of indefiniteness."""
    diagonal = W.diagonal()
    bound = np.sqrt(diagonal[W.coords[0]] * diagonal[W.coords[1]])
    excess = np.abs(W.data) - bound
    if (excess > DELASSUS_ASYMMETRY * np.abs(W.data).max(initial=0.0)).any():
        raise InputError("W", "matrix with a negative eigenvalue", "positive semi-definite")


@dataclass(frozen=True, eq=False)
class Problem:
    """A frictional problem in full form (M, f, H, w and optionally C, k) or reduced form (see `Problem.reduced`).

    Parameters
    ----------
    M : (m, m) symmetric positive definite matrix.  f : (m,).  H : (n s, m).  w : (n s,).
    law : one law for all blocks, with scalar parameters or one entry per block.
    C, k : (c, m) and (c,) bilateral constraints C v = k, optional; rows may repeat each other.
    W, b : (n s, n s) symmetric positive semi-definite Delassus operator and (n s,); used instead of M, f, H, w.
        Stored problems carry round-off of the code that made them: up to DELASSUS_ASYMMETRY is accepted, W kept as given.
    block_size : s; needed only when neither the law's arrays nor the blocks of a BSR matrix tell it.
    reference_force : r_ref of the certificate; the law residual is relative to max(|r|, r_ref).
    places : (m, d) point and (m,) component of every velocity, optional; iterative solvers of large 3D systems ask for it.

    Raises
    ------
    InputError : names the array and what is wrong with it (shape, NaN, symmetry, definiteness, C v = k without solution).
    """

    M: Any = None
    f: Any = None
    H: Any = None
    w: Any = None
    law: Any = None
    C: Any = None
    k: Any = None
    W: Any = None
    b: Any = None
    block_size: int | None = None
    reference_force: float = 0.0
    places: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def reduced(
        cls, W: Matrix, b: Any, law: Law, block_size: int | None = None, reference_force: float = 0.0
    ) -> Problem:
        """Problem u = W r + b (seed B Eq. 2.19)."""
        return cls(W=W, b=b, law=law, block_size=block_size, reference_force=reference_force)

    def variant(self, law: Law, drift: np.ndarray | None = None) -> Problem:
        """The same operator under another law, with `drift` (n s,) added to w or b; what is factorised stays so.

        Fixed points solve a sequence of such problems (seed B 2.3.2). `law` must fit the n blocks.
        """
        assert self.rho is not None  # made once, here, and shared by every variant
        other = copy(self)
        for name in ("parameters", "_prepared"):
            other.__dict__.pop(name, None)
        store = object.__setattr__
        store(other, "law", law)
        law.parameters(self.n)
        added = np.zeros(self.n * self.s) if drift is None else np.asarray(drift, dtype=float).reshape(-1)
        name = "b" if self.is_reduced else "w"
        store(other, name, getattr(self, name) + added)
        store(other, "origin", self.origin)
        store(other, "drift", self.drift + added)
        return other

    def part(self, blocks: np.ndarray, W: sp.csr_array, b: np.ndarray) -> Problem:
        """The reduced problem of some of the blocks, with their W and b (n', s); nothing is checked again."""
        other = object.__new__(Problem)
        given: dict[str, Any] = dict.fromkeys(field.name for field in fields(self))
        given |= {"W": W, "b": b.reshape(-1), "law": self.law.take(blocks), "block_size": self.s}
        given["reference_force"] = self.reference_force
        # The metric of the whole: with bilateral constraints it does not follow from the part's W.
        other.__dict__.update(given, rho=self.rho[blocks])
        return other

    @cached_property
    def origin(self) -> Problem:
        """The problem that this one is a variant of; itself when it is none."""
        return self

    @cached_property
    def drift(self) -> np.ndarray:
        """(n s,) what a variant adds to w or b of its origin."""
        return np.zeros(self.n * self.s)

    def __post_init__(self) -> None:
        store = object.__setattr__
        if not isinstance(self.law, Law):
            raise InputError("law", self.law, "a law of barchan.cones, such as Coulomb(mu)")
        if not (np.isfinite(self.reference_force) and self.reference_force >= 0.0):
            raise InputError("reference_force", self.reference_force, "finite and >= 0")
        if self.is_reduced:
            store(self, "W", _matrix("W", self.W))
            rows = self.W.shape[0]
            store(self, "b", _vector("b", self.b, rows))
            check_symmetric(sp.csr_array(self.W), "W", DELASSUS_ASYMMETRY)
            if (self.W.diagonal() < 0.0).any():
                raise InputError("W", "matrix with a negative diagonal entry", "positive semi-definite")
            _check_minors(sp.coo_array(self.W))
        else:
            rows = self._store_full()
        store(self, "block_size", self._find_block_size(rows))
        self.law.parameters(self.n)

    def _store_full(self) -> int:
        store = object.__setattr__
        for name in ("M", "f", "H", "w"):
            if getattr(self, name) is None:
                raise InputError(name, None, "given (or use Problem.reduced(W=, b=, law=))")
        store(self, "M", sp.csr_array(_matrix("M", self.M)))
        store(self, "H", _matrix("H", self.H))
        store(self, "_factor", factorise(self.M))
        store(self, "f", _vector("f", self.f, self.M.shape[0]))
        if self.H.shape[1] != self.M.shape[1]:
            raise InputError("H", f"matrix of shape {self.H.shape}", f"with {self.M.shape[1]} columns, as M")
        store(self, "w", _vector("w", self.w, self.H.shape[0]))
        if (self.C is None) != (self.k is None):
            raise InputError("C, k", "one without the other", "given together")
        if self.C is not None:
            store(self, "C", sp.csr_array(_matrix("C", self.C)))
            if self.C.shape[1] != self.M.shape[1]:
                raise InputError(
                    "C", f"matrix of shape {self.C.shape}", f"with {self.M.shape[1]} columns, as M"
                )
            store(self, "k", _vector("k", self.k, self.C.shape[0]))
            store(self, "_saddle", saddle_solver(self.M, self.C, self.k, self.factor.diagonal))
        return int(self.H.shape[0])

    def _find_block_size(self, rows: int) -> int:
        matrix = self.W if self.is_reduced else self.H
        size = self.block_size
        if size is None and self.law.count:
            size = rows // self.law.count if rows % self.law.count == 0 else None
            if size is None:
                raise InputError("law", f"{self.law.count} blocks", f"a divisor of the {rows} rows")
        if size is None and matrix.format == "bsr":
            size = matrix.blocksize[0]
        if size is None:
            raise InputError("block_size", None, "given, since neither the law nor a BSR matrix tells it")
        if size < 2 or rows % size:
            raise InputError("block_size", size, f"at least 2 and a divisor of the {rows} rows")
        if self.law.count not in (None, rows // size):
            raise InputError("law", f"{self.law.count} blocks", f"{rows // size} blocks of size {size}")
        return int(size)

    @property
    def is_reduced(self) -> bool:
        """True for u = W r + b."""
        return self.W is not None

    @property
    def s(self) -> int:
        """Block size."""
        return self.block_size  # type: ignore[return-value]

    @property
    def n(self) -> int:
        """Number of blocks."""
        return (self.W if self.is_reduced else self.H).shape[0] // self.s

    @property
    def size(self) -> int:
        """Number of velocity unknowns m (0 in reduced form)."""
        return 0 if self.is_reduced else self.M.shape[0]

    @property
    def factor(self) -> Factor:
        """Factorisation of M, made once."""
        return self._factor  # type: ignore[attr-defined]

    @property
    def saddle(self) -> Saddle:
        """Factorisation of M and C together, made once; for problems with bilateral constraints."""
        return self._saddle  # type: ignore[attr-defined]

    @cached_property
    def _prepared(self) -> dict[Hashable, Any]:
        return {}

    def prepared(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What a solver sets up once for this problem, made when first asked for.

        What does not depend on law, w and b (decompositions, orders, factors) is better kept by `problem.origin`.
        """
        if key not in self._prepared:
            self._prepared[key] = make()
        return self._prepared[key]

    def release(self) -> None:
        """Drop what solvers have set up, which refers to the problem and would stay in memory until garbage is collected."""
        self._prepared.clear()
        self.__dict__.pop("origin", None)

    @cached_property
    def parameters(self) -> np.ndarray:
        """(n, 4) law parameters (mu, shear yield, tensile yield, dilatancy)."""
        return self.law.parameters(self.n)

    @cached_property
    def velocity_block(self) -> int:
        """Columns per block of H: those of a BSR matrix, else 1."""
        return int(self.H.blocksize[1]) if self.H.format == "bsr" and self.H.blocksize[0] == self.s else 1

    @cached_property
    def h_rows(self) -> BlockRows:
        """H as block rows (s x velocity_block)."""
        return block_rows(self.H, self.s, self.velocity_block)

    @cached_property
    def w_rows(self) -> BlockRows:
        """W of a reduced problem as block rows (s x s)."""
        return block_rows(self.W, self.s, self.s)

    @cached_property
    def diagonal_blocks(self) -> np.ndarray:
        """(n, s, s) diagonal blocks of W. Cost O(entries), more when M is not made of small blocks (`delassus_diagonal`)."""
        if self.is_reduced:
            return diagonal_blocks_of_square(self.w_rows)
        if self.factor.diagonal is not None:
            return self._diagonal_blocks_of_lumped()
        if self.factor.blocks is None:
            return delassus_diagonal(self.factor, self.M, self.H, self.s)
        return self.whitened.diagonal()

    @cached_property
    def whitened(self) -> WhitenedRows:
        """G with G G^T = W for an M of small blocks."""
        assert self.factor.blocks is not None
        return self.factor.blocks.whitened(self.H, self.s)

    def _diagonal_blocks_of_lumped(self) -> np.ndarray:
        rows = self.h_rows
        inverse_mass = np.asarray(self.factor.diagonal).reshape(-1, self.velocity_block)
        blocks = np.empty((self.n, self.s, self.s))
        kernel = lumped_diagonal(self.s, self.velocity_block, self.n >= PARALLEL_ROWS)
        kernel(rows.indptr, rows.indices, rows.data, inverse_mass, blocks)
        return blocks

    @cached_property
    def rho(self) -> np.ndarray:
        """(n,) force per velocity rho_i = s / Tr(W_ii) of the certificate (blocks with W_ii = 0 take the median).

        With a sparse M whose inverse is dense and more than EXACT_ENTRIES numbers in H M^-1, Tr(W_ii) is estimated from PROBES
        random vectors that are always the same (`barchan.linalg.delassus_trace`): a relative standard deviation of
        sqrt(2 / (PROBES s)) = 10 % where W_ii is a multiple of the identity (s = 3), 18 % at worst. Without C, as W_ii itself.
        """
        entries = self.n * self.s * self.size
        if self.is_reduced or self.factor.kind != "sparse" or entries <= EXACT_ENTRIES:
            trace = np.einsum("iaa->i", self.diagonal_blocks)
        else:
            trace = delassus_trace(self.factor, self.H, self.s)
        if len(trace) and trace.min() > 0.0:
            return np.asarray(self.s / trace)
        positive = trace > 0.0
        fallback = self.s / np.median(trace[positive]) if positive.any() else 1.0
        return np.where(positive, self.s / np.where(positive, trace, 1.0), fallback)
