"""Iterative solver for M + H^T D H in three dimensions, where the factors of the whole matrix no longer fit.

Two-level overlapping Schwarz: parts of the domain with the unknowns next to them are factorised exactly, so that contrasts of D
inside a part cost nothing, and the coarse space of `barchan.linalg.coarse` links them (combined as "A-DEF2" of Tang, Nabben,
Vuik and Erlangga 2009). Conjugate gradients for positive definite matrices, else GMRES.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias

import numba
import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg.coarse import HarmonicCoarseSpace, part_solver
from barchan.linalg.pattern_solver import PatternSolver

PART = 9_000
RESTART = 100
DIRECT_MEGABYTES = (
    8000.0  # of factors, up to which the direct solver is also the faster one (docs/solvers.md)
)
Map: TypeAlias = Callable[[np.ndarray], np.ndarray]


class KrylovSolver:
    """Solves with matrices that share a pattern, with the interface of `PatternSolver`.

    Parameters
    ----------
    pattern : (m, m) csr with sorted columns and the whole diagonal; whole, or the upper triangle when "positive".
    symmetric : "positive" (symmetric positive definite) or "structural" (symmetric pattern only, positive real part).
    points, components : (m, d) place and (m,) component of every velocity unknown.
    tolerance : of a solve, residual relative to the right-hand side.   max_iterations : of one right-hand side.
    part : unknowns of a part, before overlap.   overlap : layers of unknowns added to each part.

    Attributes
    ----------
    iterations : of each right-hand side of the last solve.   residuals : (k,) relative residuals reached.

    Raises
    ------
    InputError : unknown kind, arrays that do not fit the pattern.
    """

    def __init__(
        self,
        pattern: Any,
        symmetric: str,
        points: np.ndarray,
        components: np.ndarray,
        tolerance: float = 1e-8,
        max_iterations: int = 1000,
        part: int = PART,
        overlap: int = 2,
    ) -> None:
        if symmetric not in ("positive", "structural"):
            raise InputError("symmetric", symmetric, "positive or structural")
        if not 0.0 < tolerance < 1.0:
            raise InputError("tolerance", tolerance, "between 0 and 1")
        pattern = sp.csr_array(pattern)
        self.m, self.nnz, self.kind = pattern.shape[0], pattern.nnz, symmetric
        for name, array in (("points", points), ("components", components)):
            if len(array) != self.m:
                raise InputError(name, f"{len(array)} entries", f"one for each of the {self.m} unknowns")
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self.iterations: list[int] = []
        self.residuals = np.zeros(0)
        self._number = _numbered(pattern, symmetric == "positive")
        cores = _bisected(points, part)
        self._parts = [_extended(core, self._number, overlap) for core in cores]
        prepared = self._of_each_part(lambda i: part_solver(self._number, self._parts[i], symmetric))
        self._places, self._solvers = [place for place, _ in prepared], [solver for _, solver in prepared]
        owner = np.empty(self.m, np.int64)
        for i, core in enumerate(cores):
            owner[core] = i
        # The coarse space reads entries of the whole matrix, numbered anew.
        again = sp.csr_array(
            (np.arange(1.0, self._number.nnz + 1.0), self._number.indices, self._number.indptr),
            shape=pattern.shape,
        )
        self._coarse = HarmonicCoarseSpace(again, owner, points, components, symmetric, self._of_each_part)

    def _of_each_part(self, work: Callable[[int], Any]) -> list[Any]:
        """Results of `work` on every part; parts on different threads, each with one of MKL: sums do not vary."""
        with ThreadPoolExecutor(numba.get_num_threads()) as pool:
            return list(pool.map(work, range(len(self._parts))))

    def factorise(self, data: np.ndarray) -> bool:
        """Factorise parts and coarse matrix of the entries `data` (nnz,); False when one is singular or indefinite."""
        if data.shape != (self.nnz,):
            raise InputError(
                "data", f"array of shape {data.shape}", f"of shape {(self.nnz,)}, as the pattern"
            )
        if not np.isfinite(data).all():
            return False
        whole = data[self._number.data.astype(np.int64) - 1]
        self._K = sp.csr_array((whole, self._number.indices, self._number.indptr), shape=(self.m, self.m))
        if not all(self._of_each_part(lambda i: self._solvers[i].factorise(data[self._places[i]]))):
            return False
        return self._coarse.factorise(self._K)

    @property
    def megabytes(self) -> float | None:
        """Memory of the factors and of the coarse functions; None where it is not known."""
        of_parts = [solver.megabytes for solver in self._solvers]
        of_coarse = self._coarse.megabytes
        if of_coarse is None or None in of_parts:
            return None
        return sum(filter(None, of_parts)) + of_coarse

    def precondition(self, r: np.ndarray) -> np.ndarray:
        """Approximate solution (m,) of K x = r: the parts on what the coarse space leaves, made orthogonal to it."""
        coarse = self._coarse.solve(r)
        rest = r - self._K @ coarse
        found = self._of_each_part(lambda i: self._solvers[i].solve(rest[self._parts[i]], 0))
        local = np.zeros(self.m)
        for members, x in zip(self._parts, found, strict=True):
            local[members] += x
        return coarse + local - self._coarse.solve(self._K @ local)

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """x of the shape of `rhs`, (m,) or (m, k), by the last matrix factorised; `residuals` tells what was reached."""
        columns = np.asarray(rhs, dtype=float).reshape(self.m, -1)
        method = conjugate_gradients if self.kind == "positive" else gmres
        found = [
            method(lambda v: self._K @ v, b, self.precondition, self.tolerance, self.max_iterations)
            for b in columns.T
        ]
        self.iterations = [iterations for _, iterations in found]
        x = np.stack([x for x, _ in found], axis=1)
        size = np.linalg.norm(columns, axis=0)
        self.residuals = np.linalg.norm(columns - self._K @ x, axis=0) / np.where(size > 0.0, size, 1.0)
        return x.reshape(np.shape(rhs))


def solver_for(
    pattern: Any,
    symmetric: str,
    points: np.ndarray,
    components: np.ndarray,
    memory: float = DIRECT_MEGABYTES,
    tolerance: float = 1e-8,
) -> PatternSolver | KrylovSolver:
    """The direct solver if its factors will fit into `memory` (MB), as its analysis tells beforehand; else the iterative one.

    Arguments as for `KrylovSolver`. Without Pardiso nothing is known beforehand and the direct solver is taken.
    """
    try:
        direct = PatternSolver(pattern, symmetric)
    except MemoryError:
        return KrylovSolver(pattern, symmetric, points, components, tolerance)
    if direct.megabytes is None or direct.megabytes <= memory:
        return direct
    del direct
    return KrylovSolver(pattern, symmetric, points, components, tolerance)


def _numbered(pattern: sp.csr_array, symmetric: bool) -> sp.csr_array:
    """The whole pattern; entries say, counted from 1, where among the data given an entry lies."""
    number = sp.csr_array(
        (np.arange(1.0, pattern.nnz + 1.0), pattern.indices, pattern.indptr), shape=pattern.shape
    )
    if symmetric and sp.tril(pattern, -1).nnz == 0:
        number = sp.csr_array(number + sp.triu(number, 1).T)
    number.sort_indices()
    return number


def _bisected(points: np.ndarray, largest: int) -> list[np.ndarray]:
    """Parts of about `largest` unknowns by halving along the longest side; unknowns at one point stay together."""
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    most = max(1, largest * len(places) // len(points))
    waiting, part_of, count = [np.arange(len(places))], np.empty(len(places), np.int64), 0
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            part_of[part] = count
            count += 1
            continue
        axis = int(np.argmax(np.ptp(places[part], axis=0)))
        order = part[np.argsort(places[part, axis], kind="stable")]
        waiting += [order[: len(part) // 2], order[len(part) // 2 :]]
    owner = part_of[place_of.reshape(-1)]
    return [np.flatnonzero(owner == i) for i in range(count)]


def _extended(core: np.ndarray, links: sp.csr_array, layers: int) -> np.ndarray:
    """The unknowns of `core` and those at most `layers` links away."""
    for _ in range(layers):
        core = np.unique(np.concatenate([core, links[core].indices]))
    return core


def conjugate_gradients(
    apply: Map, b: np.ndarray, precondition: Map, tolerance: float, max_iterations: int
) -> tuple[np.ndarray, int]:
    """(x, iterations) of the preconditioned method, to a residual relative to b."""
    x, r = np.zeros_like(b), b.copy()
    limit = tolerance * float(np.linalg.norm(b))
    p, product = np.zeros_like(b), np.inf
    for iteration in range(max_iterations):
        if np.linalg.norm(r) <= limit:
            # The residual carried along drifts from the true one; where they differ the method starts again from there.
            r, product = b - apply(x), np.inf
            if np.linalg.norm(r) <= limit:
                return x, iteration
        z = precondition(r)
        before, product = product, float(r @ z)
        p = z + product / before * p
        q = apply(p)
        step = product / float(p @ q)
        x += step * p
        r -= step * q
    return x, max_iterations


def gmres(
    apply: Map,
    b: np.ndarray,
    precondition: Map,
    tolerance: float,
    max_iterations: int,
    restart: int = RESTART,
) -> tuple[np.ndarray, int]:
    """(x, iterations) of restarted GMRES, flexible and from the right: the residual is that of the system itself."""
    x, done = np.zeros_like(b), 0
    limit = tolerance * float(np.linalg.norm(b))
    while True:
        r = b - apply(x)
        if np.linalg.norm(r) <= limit or done >= max_iterations:
            return x, done
        steps = min(restart, max_iterations - done)
        correction, used = _arnoldi(apply, precondition, r, limit, steps)
        x += correction
        done += used


def _arnoldi(
    apply: Map, precondition: Map, r: np.ndarray, limit: float, steps: int
) -> tuple[np.ndarray, int]:
    """Correction of least residual over at most `steps` directions, and how many were used."""
    size = float(np.linalg.norm(r))
    basis, moved = np.empty((steps + 1, len(r))), np.empty((steps, len(r)))
    h = np.zeros((steps + 1, steps))
    basis[0] = r / size
    for j in range(steps):
        moved[j] = precondition(basis[j])
        w = apply(moved[j])
        for _ in range(2):  # twice is enough to make it orthogonal
            part = basis[: j + 1] @ w
            h[: j + 1, j] += part
            w = w - part @ basis[: j + 1]
        h[j + 1, j] = np.linalg.norm(w)
        target = np.zeros(j + 2)
        target[0] = size
        y, *_ = np.linalg.lstsq(h[: j + 2, : j + 1], target, rcond=None)
        left = np.linalg.norm(target - h[: j + 2, : j + 1] @ y)
        if left <= limit or h[j + 1, j] == 0.0:
            break
        basis[j + 1] = w / h[j + 1, j]
    return y @ moved[: j + 1], j + 1
