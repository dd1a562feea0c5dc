"""Second-order cone programs: rows that must lie in cones, gathered block by block, and their solution by Clarabel.

min x^T P x / 2 + q^T x  with  G_j x + g_j in cone_j. The programs themselves (seed B 2.3.2, Eqs. 2.21 and 2.24, criterion H(0))
are built by `methods.conic_programs` and `existence` from the two block cones below: admissible forces and opening rates.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

ZERO, NONNEGATIVE, SECOND_ORDER = "zero", "nonnegative", "second-order"
FEASIBLE, TIGHTEST = 1e-8, 1e-16


@dataclass(frozen=True, eq=False)
class BlockRows:
    """Rows S x + g in a cone for x (n s,): `select` (rows, n s) sparse, `offset` (rows,), `kind` of cone."""

    kind: str
    select: sp.csr_array
    offset: np.ndarray


@dataclass(frozen=True, eq=False)
class ConicAnswer:
    """What Clarabel returns: x, the multipliers of each group of rows (in their order), iterations, and how it ended."""

    x: np.ndarray
    multipliers: list[np.ndarray]
    iterations: int
    status: str

    @property
    def usable(self) -> bool:
        """Whether x and the multipliers are an answer of some accuracy, and not a proof of infeasibility or garbage."""
        return "Infeasible" not in self.status and all(
            np.isfinite(values).all() for values in (self.x, *self.multipliers)
        )


@dataclass(eq=False)
class ConicProgram:
    """min x^T P x / 2 + q^T x over rows added by `require`.

    P : (N, N) sparse, symmetric positive semi-definite (the upper triangle is read).  q : (N,).
    block_size : s, size of the second-order cones.
    """

    P: Any
    q: np.ndarray
    block_size: int
    _rows: list[tuple[str, sp.csr_array, np.ndarray]] = field(default_factory=list)

    def require(self, kind: str, G: Any, g: np.ndarray) -> None:
        """Add the rows G x + g in the zero, nonnegative or product of second-order cones of `block_size` each."""
        self._rows.append((kind, sp.csr_array(G), np.asarray(g, dtype=float)))

    def solve(self, tolerance: float, max_iterations: int = 200) -> ConicAnswer:
        """Solve to the feasibility and gap `tolerance` (Clarabel ends earlier where it makes no progress)."""
        if max_iterations <= 0:
            empty = [np.zeros(len(g)) for _, _, g in self._rows]
            return ConicAnswer(np.zeros(len(self.q)), empty, 0, "MaxIterations")
        A = sp.csc_matrix(-sp.vstack([G for _, G, _ in self._rows]))
        b = np.concatenate([g for _, _, g in self._rows])
        settings = _settings(tolerance, max_iterations)
        upper = sp.csc_matrix(sp.triu(self.P))
        answer = clarabel.DefaultSolver(upper, self.q, A, b, self._cones(), settings).solve()
        ends = np.cumsum([len(g) for _, _, g in self._rows])[:-1]
        return ConicAnswer(
            np.array(answer.x), np.split(np.array(answer.z), ends), answer.iterations, str(answer.status)
        )

    def _cones(self) -> list[Any]:
        cones: list[Any] = []
        for kind, _, g in self._rows:
            if kind == SECOND_ORDER:
                cones += [clarabel.SecondOrderConeT(self.block_size)] * (len(g) // self.block_size)
            else:
                cones.append((clarabel.ZeroConeT if kind == ZERO else clarabel.NonnegativeConeT)(len(g)))
        return cones


def _settings(tolerance: float, max_iterations: int) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = max_iterations
    settings.direct_solve_method = "faer"
    settings.max_threads = 1  # the same bytes on every machine
    settings.tol_feas = max(tolerance, FEASIBLE)  # it gives up when a residual above this grows again
    settings.tol_gap_abs = settings.tol_gap_rel = max(tolerance, TIGHTEST)
    return settings


def force_cones(parameters: np.ndarray, s: int) -> list[BlockRows]:
    """Admissible forces of n blocks as cone rows on r (n s,).

    |r_T| <= sigma + mu (r_N + tau) and r_N + tau >= 0 (seed B Eq. 1.16, ERRATA 8); without friction and shear yield r_T = 0.
    `parameters` (n, 4): mu, shear yield sigma, tensile yield tau, dilatancy (not used).
    """
    mu, shear, tension = parameters[:, 0], parameters[:, 1], parameters[:, 2]
    round_ = (mu > 0.0) | (shear > 0.0)
    half = (mu == 0.0) | (shear > 0.0)
    weight = np.ones((len(mu), s))
    weight[:, 0] = mu
    offset = np.zeros((len(mu), s))
    offset[:, 0] = shear + mu * tension
    groups = [
        BlockRows(SECOND_ORDER, _blocks(round_, weight), offset[round_].reshape(-1)),
        BlockRows(NONNEGATIVE, _normals(half, s), tension[half]),
    ]
    smooth = _tangents(~round_, s)
    groups.append(BlockRows(ZERO, smooth, np.zeros(smooth.shape[0])))
    return [group for group in groups if group.select.shape[0]]


def opening_cones(slope: np.ndarray, s: int) -> list[BlockRows]:
    """Rates u (n s,) with u_N >= slope |u_T| as cone rows; `slope` (n,) >= 0 (mu: the dual of the friction cone)."""
    round_ = slope > 0.0
    weight = np.ones((len(slope), s))
    weight[:, 1:] = slope[:, None]
    groups = [
        BlockRows(SECOND_ORDER, _blocks(round_, weight), np.zeros(int(round_.sum()) * s)),
        BlockRows(NONNEGATIVE, _normals(~round_, s), np.zeros(int((~round_).sum()))),
    ]
    return [group for group in groups if group.select.shape[0]]


def tangent_cones(chosen: np.ndarray, s: int) -> BlockRows:
    """Second-order rows (0, u_T) of the chosen blocks: bound |u_T| by adding a variable to each first row."""
    weight = np.ones((len(chosen), s))
    weight[:, 0] = 0.0
    return BlockRows(SECOND_ORDER, _blocks(chosen, weight), np.zeros(int(chosen.sum()) * s))


def _blocks(chosen: np.ndarray, weight: np.ndarray) -> sp.csr_array:
    """Rows of the chosen blocks, entry a of block i times weight[i, a]."""
    n, s = weight.shape
    columns = (np.flatnonzero(chosen)[:, None] * s + np.arange(s)).reshape(-1)
    return _picked(columns, weight[chosen].reshape(-1), n * s)


def _normals(chosen: np.ndarray, s: int) -> sp.csr_array:
    """Rows that pick the normal entries of the chosen blocks."""
    columns = np.flatnonzero(chosen) * s
    return _picked(columns, np.ones(len(columns)), len(chosen) * s)


def _tangents(chosen: np.ndarray, s: int) -> sp.csr_array:
    """Rows that pick the tangential entries of the chosen blocks."""
    columns = (np.flatnonzero(chosen)[:, None] * s + np.arange(1, s)).reshape(-1)
    return _picked(columns, np.ones(len(columns)), len(chosen) * s)


def _picked(columns: np.ndarray, values: np.ndarray, width: int) -> sp.csr_array:
    return sp.csr_array((values, (np.arange(len(columns)), columns)), shape=(len(columns), width))
