"""Gauss-Seidel sweeps over blocks, with W stored or factored as G G^T, G = H M^-1/2 (seed B Algorithm 4.1).

One factory per block size. Blocks are swept in groups; groups of one colour share no unknown and run in parallel, so
that the result does not depend on the number of threads. Cost of a sweep: linear in the stored entries.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit, prange

from barchan.cones._kernels import natural_map_residual_squared, project_block
from barchan.friction.local._dispatch import solve_with_newton
from barchan.friction.local._secular import solve_secular

FULL_SWEEP_EVERY = 11


@cache
def explicit_sweeps(S: int, LOCAL: int, PARALLEL: bool) -> Callable[..., None]:
    """Kernel doing `sweeps` Gauss-Seidel sweeps on u = W r + b with W as block rows (S x S blocks)."""

    @njit(cache=True, error_model="numpy", parallel=PARALLEL)
    def kernel(sweeps, start, schedule, w, diagonal, b, local, laws, calm, relaxation, state, scratch):
        colour_ptr, group_ptr, order = schedule
        indptr, indices, data = w
        r, multiplier, sleep = state
        colours = len(colour_ptr) - 1
        for sweep in range(start, start + sweeps):
            backward = sweep % 2 == 1
            # Calm blocks are noted in full sweeps only: next to sleeping neighbours every block looks calm.
            full = sweep % FULL_SWEEP_EVERY == 0
            for colour_index in range(colours):
                colour = colours - 1 - colour_index if backward else colour_index
                first = colour_ptr[colour]
                for group in prange(first, colour_ptr[colour + 1]):
                    slot = group - first if PARALLEL else 0
                    rhs, new = scratch[0][slot, :S], scratch[1][slot, :S]
                    rows, matrices = scratch[2][slot], scratch[3][slot]
                    length = group_ptr[group + 1] - group_ptr[group]
                    for position in range(length):
                        place = length - 1 - position if backward else position
                        i = order[group_ptr[group] + place]
                        if sleep[i] and not full:
                            continue
                        for k in range(S):
                            rhs[k] = b[i, k]
                        for entry in range(indptr[i], indptr[i + 1]):
                            j = indices[entry]
                            for k in range(S):
                                total = 0.0
                                for m in range(S):
                                    total += data[entry, k, m] * r[j, m]
                                rhs[k] += total
                        for k in range(S):
                            for m in range(S):
                                rhs[k] -= diagonal[i, k, m] * r[i, m]
                            new[k] = r[i, k]
                        if LOCAL == 0:
                            multiplier[i] = solve_secular(
                                S, local[i], rhs, laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], multiplier[i],
                                new, rows[0], rows[1],
                            )  # fmt: skip
                        elif not solve_with_newton(S, LOCAL, diagonal[i], rhs, laws[i], new, rows, matrices):
                            for k in range(S):
                                new[k] = 0.5 * (new[k] + r[i, k])
                        if relaxation != 1.0:
                            for k in range(S):
                                new[k] = r[i, k] + relaxation * (new[k] - r[i, k])
                            project_block(new, laws[i, 0], laws[i, 1], laws[i, 2], new)
                        change = 0.0
                        for k in range(S):
                            change += (new[k] - r[i, k]) ** 2
                            r[i, k] = new[k]
                        if full:
                            sleep[i] = change <= calm

    return kernel


@cache
def matrix_free_sweeps(S: int, Q: int, LOCAL: int, PARALLEL: bool) -> Callable[..., None]:
    """Kernel doing `sweeps` Gauss-Seidel sweeps on u = G z + b, z = G^T r, with G as block rows (blocks stored Q x S)."""

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def kernel(sweeps, start, schedule, g, diagonal, b, local, laws, calm, relaxation, state, z, scratch):
        colour_ptr, group_ptr, order = schedule
        indptr, indices, data = g
        r, multiplier, sleep = state
        colours = len(colour_ptr) - 1
        for sweep in range(start, start + sweeps):
            backward = sweep % 2 == 1
            # Calm blocks are noted in full sweeps only: next to sleeping neighbours every block looks calm.
            full = sweep % FULL_SWEEP_EVERY == 0
            for colour_index in range(colours):
                colour = colours - 1 - colour_index if backward else colour_index
                first = colour_ptr[colour]
                for group in prange(first, colour_ptr[colour + 1]):
                    slot = group - first if PARALLEL else 0
                    rhs, new = scratch[0][slot, :S], scratch[1][slot, :S]
                    rows, matrices = scratch[2][slot], scratch[3][slot]
                    length = group_ptr[group + 1] - group_ptr[group]
                    for position in range(length):
                        place = length - 1 - position if backward else position
                        i = order[group_ptr[group] + place]
                        if sleep[i] and not full:
                            continue
                        for k in range(S):
                            rhs[k] = b[i, k]
                            new[k] = r[i, k]
                        for k in range(S):
                            for m in range(S):
                                rhs[k] -= diagonal[i, k, m] * r[i, m]
                        for entry in range(indptr[i], indptr[i + 1]):
                            base = indices[entry] * Q
                            for c in range(Q):
                                value = z[base + c]
                                for k in range(S):
                                    rhs[k] += data[entry, c, k] * value
                        if LOCAL == 0:
                            multiplier[i] = solve_secular(
                                S, local[i], rhs, laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], multiplier[i],
                                new, rows[0], rows[1],
                            )  # fmt: skip
                        elif not solve_with_newton(S, LOCAL, diagonal[i], rhs, laws[i], new, rows, matrices):
                            for k in range(S):
                                new[k] = 0.5 * (new[k] + r[i, k])
                        if relaxation != 1.0:
                            for k in range(S):
                                new[k] = r[i, k] + relaxation * (new[k] - r[i, k])
                            project_block(new, laws[i, 0], laws[i, 1], laws[i, 2], new)
                        change = 0.0
                        for k in range(S):
                            rhs[k] = new[k] - r[i, k]
                            change += rhs[k] * rhs[k]
                            r[i, k] = new[k]
                        if change > 0.0:
                            for entry in range(indptr[i], indptr[i + 1]):
                                base = indices[entry] * Q
                                for c in range(Q):
                                    total = 0.0
                                    for k in range(S):
                                        total += data[entry, c, k] * rhs[k]
                                    z[base + c] += total
                        if full:
                            sleep[i] = change <= calm

    return kernel


@cache
def factored_products(S: int, Q: int, PARALLEL: bool) -> tuple[Callable[..., None], Callable[..., None]]:
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
