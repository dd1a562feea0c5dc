"""Diagonal blocks of W = H M^-1 H^T for a sparse M with a dense inverse: exactly, or their traces by random vectors.

Exactly: only entries of M^-1 at pairs of unknowns that one block touches are needed. In an order of small bandwidth M is block
tridiagonal, and the blocks of its inverse on the same three diagonals follow from a recursion (Takahashi, Fagan and Chin 1973).

With R R^T = M^-1 the trace of W_ii is the sum of squares of the rows of G_i = H_i R. For z of independent signs +-1 the mean
of |G_i z|^2 is that trace and its variance is at most 2 |W_ii|_F^2 (Hutchinson 1989; Avron and Toledo 2011), whatever the
condition of M: after k vectors the relative standard deviation is at most sqrt(2 / k) |W_ii|_F / Tr(W_ii), that is
sqrt(2 / (k s)) for W_ii proportional to the identity and sqrt(2 / k) for one of rank one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from barchan.linalg.blocks import block_rows
from barchan.linalg.factor import Factor

PROBES = 64
SEED = 20_190_927
MEGABYTES = 400  # of blocks of the inverse, or of right-hand sides and solutions at a time
AT_ONCE = 2_000_000


def delassus_diagonal(factor: Factor, M: Any, H: Any, s: int) -> np.ndarray:
    """(n, s, s) diagonal blocks of H M^-1 H^T for M (m, m) and H (n s, m).

    Cost about 10 m w^2 for a bandwidth w; where that takes more than MEGABYTES, one solve per row, many at a time.
    """
    M, H = sp.csr_array(M), sp.csr_array(H)
    touched = sp.csr_array((np.ones(H.nnz), H.indices, H.indptr[::s]), shape=(H.shape[0] // s, H.shape[1]))
    links = touched.T @ touched + sp.csr_array((np.ones(M.nnz), M.indices, M.indptr), shape=M.shape)
    links = sp.csr_array(links)
    order = reverse_cuthill_mckee(links, symmetric_mode=True)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    rows = np.repeat(np.arange(links.shape[0]), np.diff(links.indptr))
    width = max(1, int(np.abs(rank[rows] - rank[links.indices]).max(initial=0)))
    if 32 * M.shape[0] * width > MEGABYTES * 2**20:
        return _by_solves(factor, H, s)
    return _from_inverse(_inverse_near_diagonal(M[order][:, order], width), rank, H, s)


def _inverse_near_diagonal(M: sp.csr_array, w: int) -> np.ndarray:
    """(c, w, 2 w): for each of c = ceil(m / w) rows of w x w blocks of M^-1 the blocks left of and on the diagonal.

    M (m, m) has bandwidth at most w. With M_k,k+1 = E_k and the pivots D_k = M_kk - E_k-1^T D_k-1^-1 E_k-1:
    Z_k+1,k = -Z_k+1,k+1 G_k^T and Z_kk = D_k^-1 - G_k Z_k+1,k, where G_k = D_k^-1 E_k.
    """
    m = M.shape[0]
    count = -(-m // w)
    # Unknowns of no effect fill the last block.
    M = sp.csr_array(sp.block_diag([M, sp.eye_array(count * w - m)], format="csr"))
    cut = [slice(k * w, (k + 1) * w) for k in range(count)]
    pivot_inverse, moved = np.empty((count, w, w)), np.empty((count, w, w))
    identity = np.eye(w)
    carried = np.zeros((w, w))
    for k in range(count):
        factor = sl.cho_factor(M[cut[k], cut[k]].toarray() - carried, lower=True, check_finite=False)
        pivot_inverse[k] = sl.cho_solve(factor, identity, check_finite=False)
        if k + 1 < count:
            right = M[cut[k], cut[k + 1]].toarray()
            moved[k] = sl.cho_solve(factor, right, check_finite=False)
            carried = right.T @ moved[k]
    inverse = np.zeros((count, w, 2 * w))
    inverse[-1, :, w:] = pivot_inverse[-1]
    for k in range(count - 2, -1, -1):
        below = -inverse[k + 1, :, w:] @ moved[k].T
        inverse[k + 1, :, :w] = below
        inverse[k, :, w:] = pivot_inverse[k] - moved[k] @ below
    return inverse


def _from_inverse(inverse: np.ndarray, rank: np.ndarray, H: sp.csr_array, s: int) -> np.ndarray:
    """Diagonal blocks (n, s, s) from the entries of M^-1 near its diagonal; `rank` (m,) places of the unknowns there."""
    rows, w = block_rows(H, s, 1), inverse.shape[1]
    blocks = np.zeros((rows.n, s, s))
    widths = np.diff(rows.indptr)
    for k in np.unique(widths[widths > 0]):
        alike = np.flatnonzero(widths == k)
        for part in np.array_split(alike, -(-len(alike) * int(k) ** 2 // AT_ONCE)):
            entries = rows.indptr[part][:, None] + np.arange(k)
            place = rank[rows.indices[entries]]
            lower = np.maximum(place[:, :, None], place[:, None, :])
            other = np.minimum(place[:, :, None], place[:, None, :])
            near = inverse[lower // w, lower % w, other - (lower // w - 1) * w]
            values = rows.data[entries, :, 0]
            blocks[part] = np.einsum("nka,nkl,nlb->nab", values, near, values, optimize=True)
    return 0.5 * (blocks + blocks.transpose(0, 2, 1))


def _by_solves(factor: Factor, H: sp.csr_array, s: int) -> np.ndarray:
    n = H.shape[0] // s
    blocks = np.zeros((n, s, s))
    chunk = max(1, _right_sides(H.shape[1]) // s)
    for first in range(0, n, chunk):
        rows = H[first * s : min(first + chunk, n) * s]
        solved = np.asarray(factor.solve(rows.T.toarray(order="F"))).reshape(H.shape[1], -1, s)
        row = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr))
        products = rows.data[:, None] * solved[rows.indices, row // s]
        part = np.zeros((rows.shape[0], s))
        np.add.at(part, row, products)
        blocks[first : first + chunk] = part.reshape(-1, s, s)
    return 0.5 * (blocks + blocks.transpose(0, 2, 1))


def delassus_trace(factor: Factor, H: Any, s: int, probes: int = PROBES) -> np.ndarray:
    """(n,) estimates of the traces of the diagonal blocks of H M^-1 H^T for H (n s, m); zero where H_i is zero.

    The same numbers at every call. Cost: `probes` backward substitutions and products with H.
    """
    assert factor.root is not None
    H = sp.csr_array(H)
    random = np.random.default_rng(SEED)
    total = np.zeros(H.shape[0] // s)
    chunk = min(_right_sides(H.shape[1] + H.shape[0] // 2), 16)
    for first in range(0, probes, chunk):
        signs = random.choice([-1.0, 1.0], (min(chunk, probes - first), H.shape[1])).T
        velocities = (H @ factor.root(signs)).reshape(len(total), s, -1)
        total += np.einsum("iaq,iaq->i", velocities, velocities)
    return total / probes


def _right_sides(m: int) -> int:
    """How many right-hand sides of length m, with their solutions, fit into MEGABYTES."""
    return max(1, MEGABYTES * 2**20 // (2 * 8 * max(m, 1)))
