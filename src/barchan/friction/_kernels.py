"""Gauss-Seidel and Jacobi sweeps over blocks, with W stored or factored as G G^T, G = H M^-1/2 (seed B 3.4.1, Algorithm 4.1).

One factory per block size. Blocks are swept in groups; groups of one colour share no unknown and run in parallel, so
that the result does not depend on the number of threads. Cost of a sweep: linear in the stored entries.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

import numpy as np
from numba import njit, prange

from barchan.cones._kernels import natural_map_residual_squared, project_block
from barchan.friction.local._coulomb import solve_exact
from barchan.friction.local._dispatch import (
    FAILED,
    LOCAL_TOLERANCE,
    SECULAR,
    USED_FAILSAFE,
    local_error,
    solve_certified,
)
from barchan.linalg.borrowed import borrowed

FULL_SWEEP_EVERY = 11
PARALLEL_ROWS = 1500  # block rows from which a product with the operator uses all threads
Kernel: TypeAlias = Callable[..., None]


@njit(cache=True, error_model="numpy")
def gather_stored(S, i, w, r, rhs):
    """rhs += row i of W times r."""
    indptr, indices, data = w
    for entry in range(indptr[i], indptr[i + 1]):
        j = indices[entry]
        for k in range(S):
            total = 0.0
            for m in range(S):
                total += data[entry, k, m] * r[j, m]
            rhs[k] += total


@njit(inline="always")
def _gather_factored(S, Q, i, g, z, rhs):
    """rhs += row i of G times z."""
    indptr, indices, data = g
    for entry in range(indptr[i], indptr[i + 1]):
        base = indices[entry] * Q
        for c in range(Q):
            value = z[base + c]
            for k in range(S):
                rhs[k] += data[entry, c, k] * value


@njit(inline="always")
def _spread_factored(S, Q, i, g, change, z):
    """z += column i of G^T times change."""
    indptr, indices, data = g
    for entry in range(indptr[i], indptr[i + 1]):
        base = indices[entry] * Q
        for c in range(Q):
            total = 0.0
            for k in range(S):
                total += data[entry, c, k] * change[k]
            z[base + c] += total


@njit(cache=True, error_model="numpy")
def _count(S, code, diagonal, rhs, law, new, status, row, counts):
    """Add a block solve to `counts` (solves, failures, fail-safe calls); the secular solver is checked here only."""
    counts[0] += 1
    if code == SECULAR and not local_error(S, diagonal, rhs, law, new, row) <= LOCAL_TOLERANCE:
        status = FAILED
    counts[1] += status & FAILED
    counts[2] += status // USED_FAILSAFE


@njit(inline="always")
def _right_hand_side(S, Q, i, matrix, diagonal, b, r, seen_r, seen_z, rhs, new):
    """rhs = b_i + sum of W_ij r_j over the other blocks; new = r_i."""
    for k in range(S):
        rhs[k] = b[i, k]
        for m in range(S):
            rhs[k] -= diagonal[i, k, m] * r[i, m]
        new[k] = r[i, k]
    if Q == 0:
        gather_stored(S, i, matrix, seen_r, rhs)
    else:
        _gather_factored(S, Q, i, matrix, seen_z, rhs)


@njit(cache=True, error_model="numpy")
def _relax(S, step, old, law, new):
    """new <- projection of old + step (new - old) on the admissible set."""
    for k in range(S):
        new[k] = old[k] + step * (new[k] - old[k])
    project_block(new, law[0], law[1], law[2], new)


@njit(inline="always")
def answer_block(
    S, LOCAL, COUNT, i, place, blocks, relaxation, multiplier, r, rhs, new, rows, matrices, counts
):
    """Solve block i for u = W_ii r_i + rhs from `new`, relax and write r_i; `rhs` becomes its change, whose square returns.

    Its data are at `place` in the arrays `blocks`.
    """
    diagonal, b, local, laws = blocks
    status = 0
    if LOCAL == SECULAR:
        multiplier[i] = solve_exact(S, place, local, rhs, laws, multiplier[i], new, rows[0], rows[1])
    else:
        status = solve_certified(
            S, LOCAL, diagonal[place], local[place], rhs, b[place], laws[place], new, rows, matrices
        )
    if COUNT:
        _count(S, LOCAL, diagonal[place], rhs, laws[place], new, status, rows[1], counts)
    # An answer that fails its check is trusted half (Algorithm 4.1).
    step = 0.5 * relaxation if status & FAILED else relaxation
    if step != 1.0:
        _relax(S, step, r[i], laws[place], new)
    change = 0.0  # squared
    for k in range(S):
        rhs[k] = new[k] - r[i, k]
        change += rhs[k] * rhs[k]
        r[i, k] = new[k]
    return change


@cache
def block_sweeps(S: int, Q: int, LOCAL: int, PARALLEL: bool, JACOBI: bool, COUNT: bool) -> Kernel:
    """Kernel doing `sweeps` splitting sweeps on u = W r + b.

    Q = 0: W is stored as block rows (S x S). Q > 0: W = G G^T with G as block rows (stored Q x S) and z = G^T r kept.
    JACOBI: blocks see the forces before the sweep (seed B 3.4.1). COUNT: local solves and failures are counted.
    """
    fast = {"contract", "reassoc"} if Q else False  # regroups the long sums of the factored form

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath=fast)
    def kernel(sweeps, start, turning, schedule, system, calm, relaxation, state, counts, scratch):
        colour_ptr, group_ptr, order = schedule
        (indptr, indices, data), diagonal, b, local, laws = system
        matrix = (borrowed(indptr), borrowed(indices), borrowed(data))
        diagonal, b, local, laws = borrowed(diagonal), borrowed(b), borrowed(local), borrowed(laws)
        r, z, old_r, old_z, multiplier, sleep = state
        r, z, old_r, old_z = borrowed(r), borrowed(z), borrowed(old_r), borrowed(old_z)
        multiplier, sleep, order = borrowed(multiplier), borrowed(sleep), borrowed(order)
        first_scratch, second_scratch = borrowed(scratch[0]), borrowed(scratch[1])
        third_scratch, fourth_scratch = borrowed(scratch[2]), borrowed(scratch[3])
        seen_r, seen_z = (old_r, old_z) if JACOBI else (r, z)
        for sweep in range(start, start + sweeps):
            backward = turning and sweep % 2 == 1
            # Calm blocks are noted in full sweeps only: next to sleeping neighbours every block looks calm.
            full = sweep % FULL_SWEEP_EVERY == 0
            if JACOBI:
                old_r[:], old_z[:] = r, z
            for place in range(len(colour_ptr) - 1):
                colour = len(colour_ptr) - 2 - place if backward else place
                for group in prange(colour_ptr[colour], colour_ptr[colour + 1]):
                    slot = group - colour_ptr[colour] if PARALLEL else 0
                    rhs, new = first_scratch[slot, :S], second_scratch[slot, :S]
                    rows, matrices = third_scratch[slot], fourth_scratch[slot]
                    length = group_ptr[group + 1] - group_ptr[group]
                    for position in range(length):
                        i = order[group_ptr[group] + (length - 1 - position if backward else position)]
                        if sleep[i] and not full:
                            continue
                        _right_hand_side(S, Q, i, matrix, diagonal, b, r, seen_r, seen_z, rhs, new)
                        change = answer_block(
                            S, LOCAL, COUNT, i, i, (diagonal, b, local, laws), relaxation, multiplier, r, rhs, new,
                            rows, matrices, counts[slot],
                        )  # fmt: skip
                        if Q > 0 and change > 0.0:
                            _spread_factored(S, Q, i, matrix, rhs, z)
                        if full:
                            sleep[i] = change <= calm

    return kernel


@cache
def factored_products(S: int, Q: int, PARALLEL: bool) -> tuple[Kernel, Kernel]:
    """Kernels (spread, gather) of G stored as block rows (blocks Q x S): z = G^T r and u = G z."""

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def spread(columns, r, z):
        indptr, entries, rows, data = columns
        for j in prange(len(indptr) - 1):
            for c in range(Q):
                z[j * Q + c] = 0.0
            for place in range(indptr[j], indptr[j + 1]):
                e, i = entries[place], rows[place]
                for c in range(Q):
                    total = 0.0
                    for k in range(S):
                        total += data[e, c, k] * r[i, k]
                    z[j * Q + c] += total
        return PARALLEL

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def gather(rows, z, u):
        indptr, indices, data = rows
        for i in prange(len(indptr) - 1):
            for k in range(S):
                u[i, k] = 0.0
            for e in range(indptr[i], indptr[i + 1]):
                base = indices[e] * Q
                for c in range(Q):
                    value = z[base + c]
                    for k in range(S):
                        u[i, k] += data[e, c, k] * value
        return PARALLEL

    return spread, gather


@njit(cache=True)
def by_columns(indptr, indices, columns):
    """Pointers per block column, then entry and block row of each of its blocks, in the order of the rows."""
    pointers = np.zeros(columns + 1, np.int32)
    for j in indices:
        pointers[j + 1] += 1
    for j in range(columns):
        pointers[j + 1] += pointers[j]
    place = pointers[:columns].copy()
    entries, rows = np.empty(len(indices), np.int32), np.empty(len(indices), np.int32)
    for i in range(len(indptr) - 1):
        for e in range(indptr[i], indptr[i + 1]):
            at = place[indices[e]]
            entries[at], rows[at] = e, i
            place[indices[e]] = at + 1
    return pointers, entries, rows


@cache
def lumped_diagonal(S: int, Q: int, PARALLEL: bool) -> Kernel:
    """Kernel of the diagonal blocks (n, S, S) of H M^-1 H^T, H in block rows (S x Q) and M^-1 a diagonal (columns, Q)."""

    @njit(cache=True, error_model="numpy", parallel=PARALLEL)
    def kernel(indptr, indices, data, inverse_mass, out):
        for i in prange(len(indptr) - 1):
            for a in range(S):
                for b in range(S):
                    out[i, a, b] = 0.0
            for e in range(indptr[i], indptr[i + 1]):
                for a in range(S):
                    for b in range(a + 1):
                        total = 0.0
                        for c in range(Q):
                            total += data[e, a, c] * inverse_mass[indices[e], c] * data[e, b, c]
                        out[i, a, b] += total
            for a in range(S):
                for b in range(a):
                    out[i, b, a] = out[i, a, b]

    return kernel


@njit(cache=True, error_model="numpy")
def law_residual_squared(r, u, laws, rho):
    """Sum over blocks of the squared natural map, and of |r|^2: the solvers' own estimate of the law residual."""
    residual = 0.0
    size = 0.0
    for i in range(r.shape[0]):
        residual += natural_map_residual_squared(
            r[i], u[i], laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], rho[i]
        )
        for k in range(r.shape[1]):
            size += r[i, k] * r[i, k]
    return residual, size


@njit(cache=True, error_model="numpy")
def block_rows_times(indptr, indices, data, x, out):
    """out = b-rows times x for (nnz, S, S) blocks: out (n, S), x (m, S)."""
    s = x.shape[1]
    for i in range(len(indptr) - 1):
        for k in range(s):
            out[i, k] = 0.0
        for entry in range(indptr[i], indptr[i + 1]):
            j = indices[entry]
            for k in range(s):
                total = 0.0
                for m in range(s):
                    total += data[entry, k, m] * x[j, m]
                out[i, k] += total


def sweep_scratch(slots: int, s: int) -> tuple[np.ndarray, ...]:
    """Scratch arrays of the sweep kernels for `slots` groups in flight (padded against false sharing)."""
    pad = max(s, 8)
    return (
        np.zeros((slots, pad)),
        np.zeros((slots, pad)),
        np.zeros((slots, 11, s)),
        np.zeros((slots, 2 * s + 4, pad)),
    )


@njit(cache=True, error_model="numpy")
def project_blocks(x, laws, out):
    """out_i = projection of x_i on the admissible set of its law, for (n, s) arrays."""
    for i in range(x.shape[0]):
        project_block(x[i], laws[i, 0], laws[i, 1], laws[i, 2], out[i])
