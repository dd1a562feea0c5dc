"""Kernels of the nodal algorithm in space (seed B 4.3.1): sweeps over vertices, and corrections on the face they found.

A matrix is (indptr, indices, data, middle): rows of 3 x 3 blocks sorted by column, `middle` the place of each diagonal block.
y (m, 3) velocities in the frames of the nodes, r and w (n, 3) of the contacts, `contact` (m,) the contact of a node or -1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from barchan.friction.local._coulomb import solve_exact
from barchan.friction.local._secular import solve_secular

INVERSION, CONVEX = 0, 1
LEAST_APERTURE = (
    1e-3  # friction below which the inverse block, a cone of aperture 1 / mu, is left for the block itself
)
HELD = 1e-10


@njit(cache=True, error_model="numpy")
def turn_blocks(indptr, indices, data, turned, frames):
    """data_ij <- F_i data_ij F_j^T in place, F the frames (m, 3, 3) of the nodes with `turned` (m,), else I."""
    product = np.empty((3, 3))
    for i in range(len(indptr) - 1):
        for e in range(indptr[i], indptr[i + 1]):
            block, j = data[e], indices[e]
            if turned[i]:
                for a in range(3):
                    for b in range(3):
                        product[a, b] = 0.0
                        for c in range(3):
                            product[a, b] += frames[i, a, c] * block[c, b]
                block[:] = product
            if turned[j]:
                for a in range(3):
                    for b in range(3):
                        product[a, b] = 0.0
                        for c in range(3):
                            product[a, b] += block[a, c] * frames[j, b, c]
                block[:] = product


@njit(inline="always")
def _row(begin, end, indices, data, y):
    """Sum of data_e y_j over the entries of one row, as three numbers: arrays would cost twice the time."""
    g0, g1, g2 = 0.0, 0.0, 0.0
    for e in range(begin, end):
        j = indices[e]
        y0, y1, y2 = y[j, 0], y[j, 1], y[j, 2]
        g0 += data[e, 0, 0] * y0 + data[e, 0, 1] * y1 + data[e, 0, 2] * y2
        g1 += data[e, 1, 0] * y0 + data[e, 1, 1] * y1 + data[e, 1, 2] * y2
        g2 += data[e, 2, 0] * y0 + data[e, 2, 1] * y1 + data[e, 2, 2] * y2
    return g0, g1, g2


@njit(cache=True, error_model="numpy")
def _answer_inverse(block, rows, k, mu, w, g, y, r, multiplier, rhs, c, t):
    """Convex contact k from r = A (y + w) + (g - A w): y + w in the cone of aperture 1 / mu, r in its dual, orthogonal."""
    for a in range(3):
        rhs[a] = g[a] - block[a, 0] * w[k, 0] - block[a, 1] * w[k, 1] - block[a, 2] * w[k, 2]
    multiplier[k] = solve_secular(3, rows[k], rhs, 1.0 / mu, 0.0, 0.0, 1.0 / mu, multiplier[k], y, c, t)
    for a in range(3):
        y[a] -= w[k, a]
    for a in range(3):
        r[k, a] = g[a] + block[a, 0] * y[0] + block[a, 1] * y[1] + block[a, 2] * y[2]


@njit(cache=True, error_model="numpy")
def _answer(inverse, rows, k, laws, w, g, y, r, multiplier, rhs, c, t):
    """Contact k from u = D r + (w - D g), D = A^-1, by the solver of one contact; y = u - w."""
    for a in range(3):
        rhs[a] = w[k, a] - inverse[a, 0] * g[0] - inverse[a, 1] * g[1] - inverse[a, 2] * g[2]
    force = r[k]
    multiplier[k] = solve_exact(3, k, rows, rhs, laws, multiplier[k], force, c, t)
    for a in range(3):
        y[a] = rhs[a] - w[k, a]
        for b in range(3):
            y[a] += inverse[a, b] * force[b]


@njit(cache=True, error_model="numpy")
def sweeps(count, VARIANT, matrix, blocks, contact, local, laws, w, f, y, r, multiplier):
    """`count` Gauss-Seidel sweeps over the nodes, there and back in turn; y, r and `multiplier` (n,) in place.

    blocks : diagonal blocks (m, 3, 3) and their inverses.  local : decompositions of inverses and of blocks at contacts.
    VARIANT : INVERSION solves each contact under its law; CONVEX solves r = A u + c with the convex law of `laws`, zeta = mu.
    """
    indptr, indices, data, middle = matrix
    diagonal, inverses = blocks
    of_inverses, of_blocks = local
    g, rhs, c, t = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    n = len(contact)
    for sweep in range(count):
        for place in range(n):
            i = n - 1 - place if sweep % 2 else place
            a0, a1, a2 = _row(indptr[i], middle[i], indices, data, y)
            b0, b1, b2 = _row(middle[i] + 1, indptr[i + 1], indices, data, y)
            g[0], g[1], g[2] = a0 + b0 - f[i, 0], a1 + b1 - f[i, 1], a2 + b2 - f[i, 2]
            k, inverse, velocity = contact[i], inverses[i], y[i]
            if k < 0:
                for a in range(3):
                    velocity[a] = -(inverse[a, 0] * g[0] + inverse[a, 1] * g[1] + inverse[a, 2] * g[2])
            elif (
                VARIANT == CONVEX and laws[k, 0] > LEAST_APERTURE and laws[k, 1] == 0.0 and laws[k, 2] == 0.0
            ):
                _answer_inverse(
                    diagonal[i], of_blocks, k, laws[k, 0], w, g, velocity, r, multiplier, rhs, c, t
                )
            else:
                _answer(inverse, of_inverses, k, laws, w, g, velocity, r, multiplier, rhs, c, t)


@njit(cache=True, error_model="numpy")
def imbalance(matrix, contact, f, y, r, out):
    """out = A y - f - r (m, 3), r at the contacts; returns |out|^2."""
    indptr, indices, data, _ = matrix
    total = 0.0
    for i in range(len(contact)):
        g0, g1, g2 = _row(indptr[i], indptr[i + 1], indices, data, y)
        out[i, 0], out[i, 1], out[i, 2] = g0 - f[i, 0], g1 - f[i, 1], g2 - f[i, 2]
        if contact[i] >= 0:
            for a in range(3):
                out[i, a] -= r[contact[i], a]
        total += out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2
    return total


@njit(cache=True, error_model="numpy")
def _invert(a, q):
    """Inverse of the leading (q, q) of a positive definite matrix, in place (Gauss-Jordan)."""
    for k in range(q):
        pivot = a[k, k]
        a[k, k] = 1.0
        for j in range(q):
            a[k, j] /= pivot
        for i in range(q):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(q):
                    a[i, j] -= factor * a[k, j]


@njit(cache=True, error_model="numpy")
def _face(block, law, u, r, basis):
    """Directions (columns of `basis`) in which a contact may move without changing its regime; adds curvature to its block.

    Held fast: none. Sliding: the tangential ones, with the normal slaved by the dilatancy, and across the slip the stiffness
    |r_T| / |u_T| of a threshold that stays where it is. Open: all. Returns how many there are.
    """
    slip, drag, trace = (
        math.hypot(u[1], u[2]),
        math.hypot(r[1], r[2]),
        block[0, 0] + block[1, 1] + block[2, 2],
    )
    closed = r[0] + law[2] > 0.0
    held = law[1] + law[0] * (r[0] + law[2]) > 0.0 and slip * trace <= HELD * max(drag, abs(r[0]))
    basis[:] = 0.0
    if not held and drag > 0.0 and slip > 0.0:
        e1, e2, stiffness = u[1] / slip, u[2] / slip, drag / slip
        block[1, 1] += stiffness * e2 * e2
        block[2, 2] += stiffness * e1 * e1
        block[1, 2] -= stiffness * e1 * e2
        block[2, 1] -= stiffness * e1 * e2
        if closed:
            basis[0, 0], basis[0, 1] = law[3] * e1, law[3] * e2
    q = 0
    if not held:
        basis[1, 0], basis[2, 1] = 1.0, 1.0
        q = 2
    if not closed:
        basis[0, q] = 1.0
        q += 1
    return q


@njit(cache=True, error_model="numpy")
def faces(contact, blocks, laws, w, y, r, stiff, flexible):
    """Blocks B (m, 3, 3) with the curvature of contacts into `stiff`; C (C^T B C)^-1 C^T into `flexible`, C by `_face`."""
    diagonal, inverses = blocks
    u, basis, small, half = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(contact)):
        stiff[i], flexible[i] = diagonal[i], inverses[i]
        k = contact[i]
        if k < 0:
            continue
        for a in range(3):
            u[a] = y[i, a] + w[k, a]
        q = _face(stiff[i], laws[k], u, r[k], basis)
        for a in range(3):
            for b in range(q):
                half[a, b] = 0.0
                for c in range(3):
                    half[a, b] += stiff[i, a, c] * basis[c, b]
        for a in range(q):
            for b in range(q):
                small[a, b] = 0.0
                for c in range(3):
                    small[a, b] += basis[c, a] * half[c, b]
        _invert(small, q)
        for a in range(3):
            for b in range(3):
                flexible[i, a, b] = 0.0
                for c in range(q):
                    for d in range(q):
                        flexible[i, a, b] += basis[a, c] * small[c, d] * basis[b, d]


@njit(inline="always")
def _times(block, x0, x1, x2):
    return (
        block[0, 0] * x0 + block[0, 1] * x1 + block[0, 2] * x2,
        block[1, 0] * x0 + block[1, 1] * x1 + block[1, 2] * x2,
        block[2, 0] * x0 + block[2, 1] * x1 + block[2, 2] * x2,
    )


@njit(cache=True, error_model="numpy")
def _backward(indptr, indices, data, middle, flexible, p, t):
    """t = (B + U)^-1 p on the face."""
    n = len(t)
    for place in range(n):
        i = n - 1 - place
        g0, g1, g2 = _row(middle[i] + 1, indptr[i + 1], indices, data, t)
        t[i, 0], t[i, 1], t[i, 2] = _times(flexible[i], p[i, 0] - g0, p[i, 1] - g1, p[i, 2] - g2)


@njit(cache=True, error_model="numpy")
def _forward(indptr, indices, data, middle, stiff, flexible, p, t, q):
    """q = (B + L)^-1 (p - B t) on the face; returns p . (t + q), the curvature along t (Eisenstat 1981)."""
    total = 0.0
    for i in range(len(t)):
        g0, g1, g2 = _row(indptr[i], middle[i], indices, data, q)
        b0, b1, b2 = _times(stiff[i], t[i, 0], t[i, 1], t[i, 2])
        q0, q1, q2 = _times(flexible[i], p[i, 0] - b0 - g0, p[i, 1] - b1 - g1, p[i, 2] - b2 - g2)
        q[i, 0], q[i, 1], q[i, 2] = q0, q1, q2
        total += p[i, 0] * (t[i, 0] + q0) + p[i, 1] * (t[i, 1] + q1) + p[i, 2] * (t[i, 2] + q2)
    return total


@njit(cache=True, error_model="numpy")
def _advance(step, stiff, t, q, x, residual):
    """x += step t, residual -= step (t + q); returns the square of the residual in the metric of the blocks."""
    total = 0.0
    for i in range(len(x)):
        for a in range(3):
            x[i, a] += step * t[i, a]
            residual[i, a] -= step * (t[i, a] + q[i, a])
        e0, e1, e2 = residual[i, 0], residual[i, 1], residual[i, 2]
        b0, b1, b2 = _times(stiff[i], e0, e1, e2)
        total += e0 * b0 + e1 * b1 + e2 * b2
    return total


@njit(cache=True, error_model="numpy")
def _conjugate(ratio, stiff, residual, p):
    """p <- B residual + ratio p."""
    for i in range(len(p)):
        b0, b1, b2 = _times(stiff[i], residual[i, 0], residual[i, 1], residual[i, 2])
        p[i, 0], p[i, 1], p[i, 2] = b0 + ratio * p[i, 0], b1 + ratio * p[i, 1], b2 + ratio * p[i, 2]


@njit(cache=True, error_model="numpy")
def solve_on_face(matrix, stiff, flexible, load, x, scratch, limit, reduction):
    """Conjugate gradients for A x = -load on the face, preconditioned by symmetric Gauss-Seidel sweeps; how many steps.

    Eisenstat's form (1981): a step passes once over the matrix, half backward and half forward. Stops when the residual in
    the preconditioner's norm is `reduction` of the first. `load` (m, 3) is used up; x (m, 3); scratch (3, m, 3).
    """
    indptr, indices, data, middle = matrix
    p, q, t = scratch[0], scratch[1], scratch[2]
    x[:], p[:], t[:] = 0.0, 0.0, 0.0
    for i in range(len(x)):
        for a in range(3):
            p[i, a] = -load[i, a]
    _forward(indptr, indices, data, middle, stiff, flexible, p, t, load)
    square = _advance(0.0, stiff, t, t, x, load)
    _conjugate(0.0, stiff, load, p)
    goal, made = reduction * reduction * square, 0
    while made < limit and square > goal:
        _backward(indptr, indices, data, middle, flexible, p, t)
        curvature = _forward(indptr, indices, data, middle, stiff, flexible, p, t, q)
        if not curvature > 0.0:
            break
        following = _advance(square / curvature, stiff, t, q, x, load)
        _conjugate(following / square, stiff, load, p)
        square = following
        made += 1
    return made


@njit(cache=True, error_model="numpy")
def move(contact, laws, w, x, y):
    """y += x (m, 3); a slip that would turn round stops, and openings below what the law allows are closed."""
    for i in range(len(contact)):
        k = contact[i]
        if k >= 0:
            s1, s2 = y[i, 1] + w[k, 1], y[i, 2] + w[k, 2]
            if s1 * (s1 + x[i, 1]) + s2 * (s2 + x[i, 2]) < 0.0:
                x[i, 1], x[i, 2] = -s1, -s2
        for a in range(3):
            y[i, a] += x[i, a]
        if k >= 0:
            slip = math.hypot(y[i, 1] + w[k, 1], y[i, 2] + w[k, 2])
            y[i, 0] = max(y[i, 0], laws[k, 3] * slip - w[k, 0])
