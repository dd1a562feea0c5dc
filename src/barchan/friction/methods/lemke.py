"""The faceted friction problem as a linear complementarity problem, solved by Lemke's pivots (seed B 3.1.1; Klarbring 1987).

In 2D the two edges are the cone and the answer is exact; in 3D a pyramid inscribed in it stands for the cone, and the
residual recorded is that of the round cone: it tells what the facets cost. Dense, for small problems.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction._lemke import SOLVED, require_lcp_size, solve_lcp
from barchan.friction.operators import Delassus, StoredDelassus, build_operator
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder


def lemke(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    sides: int = 4,
) -> None:
    """Record `r0` (n, s), then the solution of the faceted problem; iterations are pivots.

    Parameters
    ----------
    sides : of the pyramid, even and at least 4, in 3D. One of its edges points against the unconstrained tangential
        velocity (seed B 3.1.1), so that a contact sliding that way is exact.

    The matrix is copositive for every law of the house, also when W is singular, and positive semi-definite for the
    associated one, where a ray instead of an answer means that there is no solution. For Coulomb's law it is not
    copositive-plus; a ray then means that forces r of the pyramid with W r = 0 and b . r < 0 exist (never so when w = 0),
    which leaves open whether there is a solution. All this but for round-off, and for a W that is indeed semi-definite.

    Raises
    ------
    InputError : blocks of more than 3 rows, wrong options, more rows of the LCP than dense pivoting is for.
    """
    if problem.s > 3:
        allowed = f"a method for blocks of size {problem.s} (a pyramid is for blocks of size 2 or 3)"
        raise InputError("method", "lemke", allowed)
    if sides < 4 or sides % 2:
        raise InputError("sides", sides, "even and at least 4")
    require_lcp_size(problem.n * ((2 if problem.s == 2 else sides) + 2))
    delassus = build_operator(problem, "explicit")
    if recorder.record(0, _residual(problem, delassus, r0), r0):
        return
    pyramid = faceted(problem, delassus, edges(-delassus.b[:, 1:], sides))
    result = solve_lcp(pyramid.M, pyramid.q, max_iterations)
    if result.status == SOLVED:
        r = pyramid.forces(result.z)
        recorder.record(result.pivots, _residual(problem, delassus, r), r)


def _residual(problem: Problem, delassus: Delassus, r: np.ndarray) -> float:
    return law_residual(problem, r, delassus.apply(r) + delassus.b)[0]


def edges(pull: np.ndarray, sides: int) -> np.ndarray:
    """Unit vectors (n, q, s - 1) to the edges of the cone's section, the first along `pull` (n, s - 1) where it is not 0.

    q is 2 for s = 2, else `sides`.
    """
    if pull.shape[1] == 1:
        return np.tile(np.array([[1.0], [-1.0]]), (len(pull), 1, 1))
    angle = np.arctan2(pull[:, 1], pull[:, 0])[:, None] + 2.0 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=2)


class Faceted(NamedTuple):
    """An LCP (M, q) in z = (x, beta, lambda), and how its solution becomes forces.

    With r_N = x - tensile yield and r_T = sum_j beta_j d_j, in units that make the diagonal blocks of W and q about 1:
    0 <= u_N - zeta lambda _|_ x >= 0,  0 <= d_j . u_T + lambda _|_ beta_j >= 0,
    0 <= shear yield + mu x - sum_j beta_j _|_ lambda >= 0, where lambda is the sliding speed.
    """

    M: np.ndarray
    q: np.ndarray
    spread: sp.csr_array
    offset: np.ndarray

    def forces(self, z: np.ndarray) -> np.ndarray:
        """r (n, s) of a solution z."""
        r = self.offset.copy()
        r += (self.spread @ z[: self.spread.shape[1]]).reshape(r.shape)
        return r


def faceted(problem: Problem, delassus: Delassus, d: np.ndarray) -> Faceted:
    """The LCP of the pyramids with edges `d` (n, q, s - 1), for any law of `barchan.cones`.

    z . M z = r . W r + (mu - zeta) sum x lambda >= 0 for z >= 0: M is copositive, positive semi-definite when zeta = mu.
    Source: seed B 3.1.1, inscribed (p = 1); the dilatancy by De Saxce's shift, which a pyramid has too (seed B 1.3).
    """
    n, q, _ = d.shape
    mu, shear, tension, zeta = problem.parameters.T
    root = np.sqrt(problem.rho)
    spread = _spread(d, root)
    offset = np.zeros((n, problem.s))
    offset[:, 0] = -tension
    W = _dense(delassus)
    free = W @ offset.ravel() + delassus.b.ravel()
    blocks, sides = np.arange(n), n + np.arange(n * q).reshape(n, q)
    speed = n + n * q + blocks
    M = np.zeros((n * (q + 2), n * (q + 2)))
    M[: n + n * q, : n + n * q] = spread.T @ (spread.T @ W.T).T
    M[blocks, speed] = -zeta
    M[sides, speed[:, None]] = 1.0
    M[speed, blocks] = mu
    M[speed[:, None], sides] = -1.0
    return Faceted(M, np.concatenate([spread.T @ free, shear / root]), spread, offset)


def _spread(d: np.ndarray, root: np.ndarray) -> sp.csr_array:
    """(n s, n + n q) matrix that gives r + tensile yield e_N from (x, beta), both in units of `root` (n,)."""
    n, q, tangents = d.shape
    s = tangents + 1
    first = s * np.arange(n)
    rows = np.concatenate(
        [first, (first[:, None, None] + 1 + np.arange(tangents) + np.zeros_like(d, int)).ravel()]
    )
    columns = np.concatenate([np.arange(n), np.repeat(n + np.arange(n * q), tangents)])
    values = np.concatenate([root, (root[:, None, None] * d).ravel()])
    return sp.csr_array((values, (rows, columns)), shape=(n * s, n + n * q))


def _dense(delassus: Delassus) -> np.ndarray:
    assert isinstance(delassus, StoredDelassus)
    return delassus.rows.matrix().toarray()
