"""One interface to the factorisation of a symmetric positive definite M: diagonal, small independent blocks, or sparse.

Pardiso (extra `fast`) serves large sparse matrices where present, else SuperLU. A bordered factor solves the saddle point
[[M, -C^T], [C, 0]] of bilateral constraints (seed B 2.3.1 eliminates them the same way, without forming P^-1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from barchan.errors import InputError
from barchan.linalg._dense_block_kernels import largest_asymmetry
from barchan.linalg.dense_blocks import DenseBlocks
from barchan.linalg.pardiso import Pardiso, available

LARGEST_DENSE_COMPONENT = 64
LARGEST_FULL_COMPONENT = (
    256  # the same where half of the entries of the components are stored, or there are many
)
FEWEST_COMPONENTS = 4  # of the largest size, that count as many
SYMMETRY_TOLERANCE = 1e-8
LARGEST_SUPERLU = 1000  # unknowns of a positive definite matrix beyond which Pardiso is preferred
LARGEST_SERIAL = (
    20_000  # the same for the matrices of pressures, whose many solves SuperLU makes with less overhead
)
Solver: TypeAlias = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Factor:
    """Solves M x = rhs for (m,) or (m, k) right-hand sides.

    `kind` is "diagonal", "blocks" or "sparse"; `diagonal` holds the diagonal of M^-1 when M is diagonal, `blocks` the factors
    of its blocks when these are small, else None.  `root` of a sparse factor gives R z for (m, k) arrays z, with some (m, m) R
    such that R R^T = M^-1, at half the cost of a solve.
    """

    kind: str
    solve: Solver
    diagonal: np.ndarray | None = None
    blocks: DenseBlocks | None = None
    root: Solver | None = None

    @property
    def has_sparse_inverse(self) -> bool:
        """Whether M^-1 is sparse: M diagonal or made of small blocks."""
        return self.kind != "sparse"

    @property
    def inverse(self) -> sp.csr_array | None:
        """M^-1 when that is sparse, else None."""
        if self.blocks is not None:
            return self.blocks.inverse
        return None if self.diagonal is None else sp.csr_array(sp.diags_array(self.diagonal))


def factorise(M: sp.csr_array, name: str = "M") -> Factor:
    """Factorise a symmetric positive definite sparse matrix (m, m).

    Raises
    ------
    InputError : not square, not finite, not symmetric, or not positive definite.
    """
    check_symmetric(M, name)
    diagonal = M.diagonal()
    if (diagonal <= 0.0).any():
        worst = int(np.argmin(diagonal))
        raise InputError(
            name, f"entry ({worst}, {worst}) is {diagonal[worst]:g}", "symmetric positive definite"
        )
    rows = np.repeat(np.arange(M.shape[0]), np.diff(M.indptr)) if M.nnz > M.shape[0] else None
    if rows is None or not M.data[M.indices != rows].any():
        return Factor("diagonal", lambda x: (x.T / diagonal).T, 1.0 / diagonal)
    _, label = connected_components(M, directed=False)
    sizes = np.bincount(label).astype(np.int64)
    pays = 2 * M.nnz >= (sizes**2).sum() or FEWEST_COMPONENTS * sizes.max() <= M.shape[0]
    if sizes.max() <= (LARGEST_FULL_COMPONENT if pays else LARGEST_DENSE_COMPONENT):
        blocks = DenseBlocks.of(M, label, name)
        return Factor("blocks", blocks.solve, blocks=blocks)
    found = positive_solver(M, name)
    return Factor("sparse", found.solve, root=found.root)


def check_symmetric(M: sp.csr_array, name: str, tolerance: float = SYMMETRY_TOLERANCE) -> None:
    """Raise InputError unless the matrix is square, finite and symmetric up to `tolerance` times its largest entry."""
    if M.shape[0] != M.shape[1]:
        raise InputError(name, f"matrix of shape {M.shape}", "square")
    if not np.isfinite(M.data).all():
        raise InputError(name, "matrix with NaN or infinite entries", "finite")
    scale = abs(M.data).max(initial=0.0)
    if not M.has_canonical_format:
        M = M.copy()
        M.sum_duplicates()
    worst = largest_asymmetry(M.indptr, M.indices, M.data)
    if worst > tolerance * scale:
        raise InputError(name, f"matrix with asymmetry {worst / scale:.2g} of its largest entry", "symmetric")


def sparse_solver(M: sp.csr_array, name: str, positive: bool) -> Solver:
    """Direct solver of a sparse matrix, by Pardiso where present, else SuperLU.

    Raises
    ------
    InputError : singular matrix, as far as the factorisation shows it; with `positive`, one that is not positive definite.
    """
    if positive:
        return positive_solver(M, name).solve
    singular = InputError(name, "singular matrix", "invertible")
    M = sp.csr_array(M, dtype=float)
    if not np.diff(M.indptr).all():
        raise singular
    if not available():
        try:
            return spla.splu(sp.csc_array(M)).solve
        except RuntimeError:
            raise singular from None
    if not M.has_canonical_format:
        M = M.copy()
        M.sum_duplicates()
    pardiso = Pardiso(M.indptr, M.indices, M.data, "general")
    if not pardiso.factorise(M.data):
        raise singular
    return pardiso.solve


class PositiveFactor(NamedTuple):
    """`solve` and `root` as in `Factor`; `entries` that a solve reads."""

    solve: Solver
    root: Solver
    entries: int


def positive_solver(M: sp.csr_array, name: str, serial: int = LARGEST_SUPERLU) -> PositiveFactor:
    """Factor of a positive definite matrix, by SuperLU up to `serial` unknowns.

    Raises
    ------
    InputError : singular or indefinite matrix (signs of the pivots).
    """
    indefinite = InputError(name, "matrix with a non-positive pivot", "positive definite")
    if M.shape[0] > serial and available():
        upper = sp.csr_array(sp.triu(M, format="csr"))
        upper.sum_duplicates()
        pardiso = Pardiso(upper.indptr, upper.indices, upper.data, "positive")
        if not pardiso.factorise(upper.data):
            raise indefinite
        entries = 2 * int(pardiso.megabytes * 2**20 / 8)
        return PositiveFactor(pardiso.solve, pardiso.solve_backward, entries)
    try:
        factor = spla.splu(
            sp.csc_array(M),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        raise InputError(name, "singular matrix", "invertible") from None
    # A vanishing pivot makes SuperLU exchange rows, after which the signs mean nothing.
    if (factor.U.diagonal() <= 0.0).any() or not np.array_equal(factor.perm_r, factor.perm_c):
        raise indefinite

    def root(z: np.ndarray) -> np.ndarray:
        # U = diag(U) L^T, since rows and columns are permuted alike, so that U^-1 diag(U)^1/2 is a root of the inverse.
        half = np.sqrt(factor.U.diagonal())
        return np.asarray(
            spla.spsolve_triangular(factor.U.tocsr(), (z.T * half).T, lower=False)[factor.perm_c]
        )

    return PositiveFactor(factor.solve, root, int(factor.nnz))
