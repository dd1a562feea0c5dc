"""Kernels of strain operators stored by gradients: H_ij v = chi^T of v (x) g_ij, one vector g_ij a block (seed B, 7.3.5).

A row first sums the symmetric tensor G = sum_j sym(z_j (x) g_ij) and maps it to u_i once; a change of r_i becomes a symmetric
tensor S once, of which every neighbour sees S g_ij. Blocks of another kind (contacts) are stored as they are, beside them.
In kernels: `form` = (pointers, columns, g, other_pointers, other_columns, other_blocks, inverse_mass), z = M^-1 H^T r.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from numba import njit, prange

from barchan.friction._kernels import FULL_SWEEP_EVERY, answer_block
from barchan.linalg.borrowed import borrowed

Kernel: TypeAlias = Callable[..., None]
_MEAN = 2.0 * math.sqrt(2.0 / 3.0) * 0.5  # sqrt(2/3): the normal coordinate of a tensor in space
_THIRD = 1.0 / math.sqrt(3.0)
# Relative distance from chi of a gradient up to which a block counts as one.
ROUND_OFF = 1e-12


@njit(inline="always")
def _gather(S, D, i, form, z, rhs):
    """rhs (S,) += row i of H times z."""
    pointers, columns, g, others, other_columns, blocks, _ = form
    if D == 3:
        s00 = s11 = s22 = s01 = s02 = s12 = 0.0
        for e in range(pointers[i], pointers[i + 1]):
            base = 3 * columns[e]
            z0, z1, z2 = z[base], z[base + 1], z[base + 2]
            g0, g1, g2 = g[e, 0], g[e, 1], g[e, 2]
            s00 += z0 * g0
            s11 += z1 * g1
            s22 += z2 * g2
            s01 += z0 * g1 + z1 * g0
            s02 += z0 * g2 + z2 * g0
            s12 += z1 * g2 + z2 * g1
        rhs[0] += _MEAN * (s00 + s11 + s22)
        rhs[1] += s00 - s11
        rhs[2] += _THIRD * (2.0 * s22 - s00 - s11)
        rhs[3] += s01
        rhs[4] += s02
        rhs[5] += s12
    else:
        s00 = s11 = s01 = 0.0
        for e in range(pointers[i], pointers[i + 1]):
            base = 2 * columns[e]
            z0, z1 = z[base], z[base + 1]
            g0, g1 = g[e, 0], g[e, 1]
            s00 += z0 * g0
            s11 += z1 * g1
            s01 += z0 * g1 + z1 * g0
        rhs[0] += s00 + s11
        rhs[1] += s00 - s11
        rhs[2] += s01
    for e in range(others[i], others[i + 1]):
        base = D * other_columns[e]
        for c in range(D):
            value = z[base + c]
            for k in range(S):
                rhs[k] += blocks[e, c, k] * value


@njit(inline="always")
def _spread(S, D, i, form, change, z):
    """z += M^-1 times column i of H^T times `change` (S,)."""
    pointers, columns, g, others, other_columns, blocks, inverse_mass = form
    if D == 3:
        mean, skew = _MEAN * change[0], _THIRD * change[2]
        s00, s11, s22 = mean + change[1] - skew, mean - change[1] - skew, mean + 2.0 * skew
        s01, s02, s12 = change[3], change[4], change[5]
        for e in range(pointers[i], pointers[i + 1]):
            base = 3 * columns[e]
            g0, g1, g2 = g[e, 0], g[e, 1], g[e, 2]
            z[base] += inverse_mass[base] * (s00 * g0 + s01 * g1 + s02 * g2)
            z[base + 1] += inverse_mass[base + 1] * (s01 * g0 + s11 * g1 + s12 * g2)
            z[base + 2] += inverse_mass[base + 2] * (s02 * g0 + s12 * g1 + s22 * g2)
    else:
        s00, s11, s01 = change[0] + change[1], change[0] - change[1], change[2]
        for e in range(pointers[i], pointers[i + 1]):
            base = 2 * columns[e]
            g0, g1 = g[e, 0], g[e, 1]
            z[base] += inverse_mass[base] * (s00 * g0 + s01 * g1)
            z[base + 1] += inverse_mass[base + 1] * (s01 * g0 + s11 * g1)
    for e in range(others[i], others[i + 1]):
        base = D * other_columns[e]
        for c in range(D):
            total = 0.0
            for k in range(S):
                total += blocks[e, c, k] * change[k]
            z[base + c] += inverse_mass[base + c] * total


@cache
def gradient_sweeps(S: int, D: int, LOCAL: int, PARALLEL: bool, JACOBI: bool, COUNT: bool) -> Kernel:
    """The sweeps of `block_sweeps` on a strain operator: `system` begins with `form` and is stored in the order of the sweep.

    Only forces, multipliers and sleep have the order of the problem: rows that follow each other in memory are fetched ahead.
    """

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def kernel(sweeps, start, turning, schedule, system, calm, relaxation, state, counts, scratch):
        colour_ptr, group_ptr, order = schedule
        form, diagonal, b, local, laws = system
        matrix = (
            borrowed(form[0]), borrowed(form[1]), borrowed(form[2]), borrowed(form[3]),
            borrowed(form[4]), borrowed(form[5]), borrowed(form[6]),
        )  # fmt: skip
        diagonal, b, local, laws = borrowed(diagonal), borrowed(b), borrowed(local), borrowed(laws)
        r, z, old_r, old_z, multiplier, sleep = state
        r, z, old_r, old_z = borrowed(r), borrowed(z), borrowed(old_r), borrowed(old_z)
        multiplier, sleep, order = borrowed(multiplier), borrowed(sleep), borrowed(order)
        first_scratch, second_scratch = borrowed(scratch[0]), borrowed(scratch[1])
        third_scratch, fourth_scratch = borrowed(scratch[2]), borrowed(scratch[3])
        seen_z = old_z if JACOBI else z
        for sweep in range(start, start + sweeps):
            backward = turning and sweep % 2 == 1
            full = sweep % FULL_SWEEP_EVERY == 0  # see `block_sweeps`
            if JACOBI:
                old_r[:], old_z[:] = r, z
            for turn in range(len(colour_ptr) - 1):
                colour = len(colour_ptr) - 2 - turn if backward else turn
                for group in prange(colour_ptr[colour], colour_ptr[colour + 1]):
                    slot = group - colour_ptr[colour] if PARALLEL else 0
                    rhs, new = first_scratch[slot, :S], second_scratch[slot, :S]
                    rows, matrices = third_scratch[slot], fourth_scratch[slot]
                    length = group_ptr[group + 1] - group_ptr[group]
                    for position in range(length):
                        place = group_ptr[group] + (length - 1 - position if backward else position)
                        i = order[place]
                        if sleep[i] and not full:
                            continue
                        for k in range(S):
                            rhs[k] = b[place, k]
                            for m in range(S):
                                rhs[k] -= diagonal[place, k, m] * r[i, m]
                            new[k] = r[i, k]
                        _gather(S, D, place, matrix, seen_z, rhs)
                        change = answer_block(
                            S, LOCAL, COUNT, i, place, (diagonal, b, local, laws), relaxation, multiplier, r, rhs,
                            new, rows, matrices, counts[slot],
                        )  # fmt: skip
                        if change > 0.0:
                            _spread(S, D, place, matrix, rhs, z)
                        if full:
                            sleep[i] = change <= calm

    return kernel


@cache
def gradient_products(S: int, D: int, PARALLEL: bool) -> tuple[Kernel, Kernel]:
    """Kernels (spread, gather): z (m,) = M^-1 H^T r and u (n, S) = H z.

    spread takes the pointers, rows and gradients of the strain blocks by columns, the lists of `by_columns` of the other
    blocks and scratch (n, 6) for the tensors of r.
    """

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def spread(form, columns, other_columns, r, stress, z):
        blocks, inverse_mass = form[5], form[6]
        pointers, rows, g = columns
        other_pointers, other_entries, other_rows = other_columns
        for i in prange(len(r)):
            if D == 3:
                mean, skew = _MEAN * r[i, 0], _THIRD * r[i, 2]
                stress[i, 0], stress[i, 1] = mean + r[i, 1] - skew, mean - r[i, 1] - skew
                stress[i, 2], stress[i, 3] = mean + 2.0 * skew, r[i, 3]
                stress[i, 4], stress[i, 5] = r[i, 4], r[i, 5]
            else:
                stress[i, 0], stress[i, 1], stress[i, 2] = r[i, 0] + r[i, 1], r[i, 0] - r[i, 1], r[i, 2]
        for j in prange(len(pointers) - 1):
            f0 = f1 = f2 = 0.0
            for e in range(pointers[j], pointers[j + 1]):
                i = rows[e]
                if D == 3:
                    g0, g1, g2 = g[e, 0], g[e, 1], g[e, 2]
                    f0 += stress[i, 0] * g0 + stress[i, 3] * g1 + stress[i, 4] * g2
                    f1 += stress[i, 3] * g0 + stress[i, 1] * g1 + stress[i, 5] * g2
                    f2 += stress[i, 4] * g0 + stress[i, 5] * g1 + stress[i, 2] * g2
                else:
                    f0 += stress[i, 0] * g[e, 0] + stress[i, 2] * g[e, 1]
                    f1 += stress[i, 2] * g[e, 0] + stress[i, 1] * g[e, 1]
            z[D * j], z[D * j + 1] = f0, f1
            if D == 3:
                z[D * j + 2] = f2
            for place in range(other_pointers[j], other_pointers[j + 1]):
                e, i = other_entries[place], other_rows[place]
                for c in range(D):
                    total = 0.0
                    for k in range(S):
                        total += blocks[e, c, k] * r[i, k]
                    z[D * j + c] += total
            for c in range(D):
                z[D * j + c] *= inverse_mass[D * j + c]
        return PARALLEL

    @njit(cache=True, error_model="numpy", parallel=PARALLEL, fastmath={"contract", "reassoc"})
    def gather(form, z, u):
        for i in prange(len(u)):
            rhs = u[i]
            for k in range(S):
                rhs[k] = 0.0
            _gather(S, D, i, form, z, rhs)
        return PARALLEL

    return spread, gather


@cache
def gradient_fit(S: int, D: int, PARALLEL: bool) -> Kernel:
    """Kernel telling which blocks (e, S, D) are strain blocks, T g with the columns of some components zero.

    Writes g (e, D), `fits` (e,) and `zero` (e,), a bit for each zero column. `basis` (S, D, D) is T[:, c, k] = chi's basis:
    with T_c^T T_c = I + e_c e_c^T the least-squares g follows column by column.
    """

    @njit(cache=True, error_model="numpy", parallel=PARALLEL)
    def kernel(pointers, data, basis, g, fits, zero):
        for i in prange(len(pointers) - 1):
            for e in range(pointers[i], pointers[i + 1]):
                bits, filled, scale = 0, 0, 0.0
                for c in range(D):
                    largest = 0.0
                    for s in range(S):
                        largest = max(largest, abs(data[e, s, c]))
                    if largest == 0.0:
                        bits |= 1 << c
                    else:
                        filled += 1
                    scale = max(scale, largest)
                zero[e], fits[e] = bits, True
                for k in range(D):
                    total = 0.0
                    for s in range(S):
                        for c in range(D):
                            total += basis[s, c, k] * data[e, s, c]
                    weight = filled + (0 if bits >> k & 1 else 1)
                    g[e, k] = total / weight if filled else 0.0
                for s in range(S):
                    for c in range(D):
                        value = 0.0
                        for k in range(D):
                            value += basis[s, c, k] * g[e, k]
                        if not bits >> c & 1 and not abs(value - data[e, s, c]) <= ROUND_OFF * scale:
                            fits[e] = False

    return kernel


@njit(cache=True)
def mark_free(columns, zero, free):
    """free (columns, d) |= whether some block has a column there that is not zero."""
    d = free.shape[1]
    for e in range(len(columns)):
        for c in range(d):
            if not zero[e] >> c & 1:
                free[columns[e], c] = True


@njit(cache=True)
def refuse_inconsistent(columns, zero, free, g, fits):
    """A strain block whose column is zero where others move this component is none; returns how many blocks fit."""
    count, d = 0, free.shape[1]
    for e in range(len(columns)):
        if fits[e]:
            moves = False
            for k in range(d):
                moves |= g[e, k] != 0.0
            for c in range(d):
                if moves and zero[e] >> c & 1 and free[columns[e], c]:
                    fits[e] = False
            count += fits[e]
    return count


@njit(cache=True)
def split_rows(pointers, columns, data, all_gradients, fits, form):
    """Sort blocks into those stored by gradients and the others, stored transposed; fills the arrays of `form`."""
    own, own_columns, g, others, other_columns, blocks = form
    a, b = 0, 0
    own[0], others[0] = 0, 0
    for i in range(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            if fits[e]:
                own_columns[a] = columns[e]
                for k in range(g.shape[1]):
                    g[a, k] = all_gradients[e, k]
                a += 1
            else:
                other_columns[b] = columns[e]
                for k in range(blocks.shape[1]):
                    for s in range(blocks.shape[2]):
                        blocks[b, k, s] = data[e, s, k]
                b += 1
        own[i + 1], others[i + 1] = a, b


@njit(cache=True, parallel=True)
def reorder_rows(order, pointers, columns, data, new_pointers, new_columns, new_data):
    """The rows of a form in another order, whose pointers are given: `data` (e, k) by rows."""
    for place in prange(len(order)):
        old, new = pointers[order[place]], new_pointers[place]
        for e in range(new_pointers[place + 1] - new):
            new_columns[new + e] = columns[old + e]
            for k in range(data.shape[1]):
                new_data[new + e, k] = data[old + e, k]


@njit(cache=True, parallel=True)
def take_rows(order, data, out):
    """out (e, k) = data[order]."""
    for e in prange(len(order)):
        for k in range(data.shape[1]):
            out[e, k] = data[order[e], k]
