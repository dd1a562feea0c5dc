"""Interior-point blocks that keep pressure and friction apart: r_N u_N = tau, and (mu r_N + sigma, r_T) o (t, u_T) = tau e.

Coulomb's law is two complementarities: 0 <= r_N + tau_t, u_N - zeta t >= 0, and friction on the disc of radius mu r_N whose
multiplier t >= |u_T| is the slip (seed B 1.3, the disjunctive law 4; equivalent to De Saxce's cone at tau = 0). On this central
path u_N depends on r_N alone and everything is smooth, which De Saxce's shift |u_T| is not. Newton's matrix of the pair is
K = -du/dr; a fictitious dilatancy zeta' in K (the last argument of `stiffness`) makes it as symmetric as one likes.

State of n blocks of size s: x (n, s) forces, y (n, s) = (t, u_T) and w (n,) = u_N - zeta t, all equilibrated; laws (n, 4).
`chunks`: the parts that the blocks are cut into, one a thread. Scaling: (w', eta, lam) of Nesterov and Todd for the pair (z, y)
with z = (mu (x_N + tau_t) + sigma, x_T).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from barchan.friction._barrier import _scale, cone_det, longest_step

MU, SIGMA, TENSILE, ZETA = 0, 1, 2, 3


@njit(cache=True, error_model="numpy")
def _cone_force(law, x, z):
    """z of one block; False where the law has no friction at all."""
    z[0] = law[MU] * (x[0] + law[TENSILE]) + law[SIGMA]
    for k in range(1, len(x)):
        z[k] = x[k]
    return law[MU] > 0.0 or law[SIGMA] > 0.0


@njit(cache=True, error_model="numpy", parallel=True)
def scale_blocks(chunks, laws, state, scaling):
    """Nesterov-Todd scaling of every block into `scaling`; returns the gap, summed over blocks: z . y + (x_N + tau_t) w."""
    x, y, w = state
    point, eta, lam = scaling
    n, s = x.shape
    gaps = np.zeros(chunks)
    for chunk in prange(chunks):
        z = np.empty(s)
        gap = 0.0
        for i in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            gap += (x[i, 0] + laws[i, TENSILE]) * w[i]
            if not _cone_force(laws[i], x[i], z):
                eta[i] = 0.0
                continue
            root_z, root_y = math.sqrt(cone_det(z)), math.sqrt(cone_det(y[i]))
            dot = 0.0
            for k in range(s):
                dot += z[k] * y[i, k]
            gap += dot
            gamma = math.sqrt(0.5 * (1.0 + dot / (root_z * root_y)))
            square = 1.0
            for k in range(1, s):
                point[i, k] = (z[k] / root_z - y[i, k] / root_y) / (2.0 * gamma)
                square += point[i, k] * point[i, k]
            point[i, 0] = math.sqrt(square)
            eta[i] = math.sqrt(root_z / root_y)
            _scale(point[i], eta[i], y[i], False, lam[i])
        gaps[chunk] = gap
    return gaps.sum()


@njit(cache=True, error_model="numpy", parallel=True)
def stiffness(laws, state, scaling, dilatancy, compliance, out):
    """D = (K + compliance)^-1 (n, s, s) into `out`, with K of the dilatancies (n,) given instead of the law's.

    K_TT = (2 w_T w_T^T + I) / eta^2 and the Schur complement of K_NN are inverted in closed form, without cancellation, so
    that D is positive definite to the last digit where K is symmetric.
    """
    x, _, w = state
    point, eta, _ = scaling
    n, s = x.shape
    for i in prange(n):
        schur = w[i] / (x[i, 0] + laws[i, TENSILE]) + compliance
        if eta[i] == 0.0:
            out[i] = 0.0
            out[i, 0, 0] = 1.0 / schur
            continue
        soft = 1.0 / (eta[i] * eta[i])
        square = 0.0
        for k in range(1, s):
            square += point[i, k] * point[i, k]
        across = 1.0 / (soft + compliance)
        along = 1.0 / (soft * (1.0 + 2.0 * square) + compliance)
        # Of w_T w_T^T in K_TT^-1, which is `across` on the complement of w_T, and of w_T in q = -K_TT^-1 Theta_T0.
        outer = -2.0 * soft * across * along
        q = 2.0 * point[i, 0] * soft * along
        mu, zeta = laws[i, MU], dilatancy[i]
        schur += zeta * mu * soft / (2.0 * point[i, 0] * point[i, 0] - 1.0)
        out[i, 0, 0] = 1.0 / schur
        for a in range(1, s):
            out[i, 0, a] = zeta * q * point[i, a] / schur
            out[i, a, 0] = mu * q * point[i, a] / schur
            for b in range(1, s):
                out[i, a, b] = (outer + zeta * mu * q * q / schur) * point[i, a] * point[i, b]
            out[i, a, a] += across


@njit(cache=True, error_model="numpy", parallel=True)
def misfit(laws, state, rates, out):
    """out (n, s) = rates - (w + zeta t, u_T): how far the block's own rates are from those of the velocities."""
    _, y, w = state
    n, s = out.shape
    for i in prange(n):
        out[i, 0] = rates[i, 0] - w[i]
        if laws[i, MU] > 0.0 or laws[i, SIGMA] > 0.0:
            out[i, 0] -= laws[i, ZETA] * y[i, 0]
            for k in range(1, s):
                out[i, k] = rates[i, k] - y[i, k]
        else:
            for k in range(1, s):
                out[i, k] = 0.0


@njit(cache=True, error_model="numpy")
def _divide(lam, rhs, out):
    """out with lam o out = rhs in the Jordan algebra."""
    dot = 0.0
    for k in range(1, len(lam)):
        dot += lam[k] * rhs[k]
    det = cone_det(lam)
    out[0] = (lam[0] * rhs[0] - dot) / det
    for k in range(1, len(lam)):
        out[k] = (dot / lam[0] - rhs[0]) / det * lam[k] + rhs[k] / lam[0]


@njit(cache=True, error_model="numpy")
def _multiply(a, b, out):
    """out = a o b."""
    out[0] = a[0] * b[0]
    for k in range(1, len(a)):
        out[0] += a[k] * b[k]
        out[k] = a[0] * b[k] + b[0] * a[k]


@njit(cache=True, error_model="numpy")
def _pull_inside(v, low, high, out):
    """out = (v brought to eigenvalues in [low, high]) - v, no eigenvalue lowered by more than `high`."""
    slip = 0.0
    for k in range(1, len(v)):
        slip += v[k] * v[k]
    slip = math.sqrt(slip)
    first, second = v[0] - slip, v[0] + slip
    first = max(min(max(first, low), high) - first, -high)
    second = max(min(max(second, low), high) - second, -high)
    out[0] = 0.5 * (first + second)
    for k in range(1, len(v)):
        out[k] = 0.5 * (second - first) * (v[k] / slip if slip > 0.0 else 0.0)


@njit(cache=True, error_model="numpy", parallel=True)
def target(chunks, laws, state, scaling, center, weights, moved, step, target, right):
    """Right sides of the linearised complementarities, into target = (c (n, s), e (n,)).

    dy = c - Theta dz, dw = e - w / l dl aim at gap `center` weights_i. `moved` = (dz, dy, dl, dw) is a direction already found:
    with step = 0 its second-order terms are removed (Mehrotra); with step > 0 `target` holds that direction's right sides, and
    what a trial step of that length would leave far from the centre is pulled back (Gondzio), added to `right` (n, s), (n,).
    """
    x, _, w = state
    point, eta, lam = scaling
    dz, dy, dl, dw = moved
    c, e = target
    cone_right, line_right = right
    n, s = x.shape
    for chunk in prange(chunks):
        a, b, v, rhs = np.empty(s), np.empty(s), np.empty(s), np.empty(s)
        for i in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            goal = center * weights[i]
            line = x[i, 0] + laws[i, TENSILE]
            if step == 0.0:
                line_right[i] = goal - line * w[i] - dl[i] * dw[i]
            else:
                product = (line + step * dl[i]) * (w[i] + step * dw[i])
                line_right[i] += max(min(max(product, 0.1 * goal), 10.0 * goal) - product, -10.0 * goal)
            e[i] = line_right[i] / line
            if eta[i] == 0.0:
                for k in range(s):
                    c[i, k] = 0.0
                continue
            _scale(point[i], eta[i], dz[i], True, a)
            _scale(point[i], eta[i], dy[i], False, b)
            if step == 0.0:
                _multiply(a, b, rhs)
                _multiply(lam[i], lam[i], v)
                for k in range(s):
                    cone_right[i, k] = -v[k] - rhs[k]
                cone_right[i, 0] += goal
            else:
                for k in range(s):
                    a[k] = lam[i, k] + step * a[k]
                    b[k] = lam[i, k] + step * b[k]
                _multiply(a, b, v)
                _pull_inside(v, 0.1 * goal, 10.0 * goal, rhs)
                for k in range(s):
                    cone_right[i, k] += rhs[k]
            _divide(lam[i], cone_right[i], v)
            _scale(point[i], eta[i], v, True, c[i])


@njit(cache=True, error_model="numpy", parallel=True)
def expand(chunks, laws, state, scaling, target, dx, moved):
    """The direction (dz, dy, dl, dw) that belongs to the forces' direction dx; returns the longest feasible step."""
    x, y, w = state
    point, eta, _ = scaling
    c, e = target
    dz, dy, dl, dw = moved
    n, s = x.shape
    longest = np.full(chunks, np.inf)
    for chunk in prange(chunks):
        z, a = np.empty(s), np.empty(s)
        step = np.inf
        for i in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            line = x[i, 0] + laws[i, TENSILE]
            dl[i] = dx[i, 0]
            dw[i] = e[i] - w[i] / line * dx[i, 0]
            if dl[i] < 0.0:
                step = min(step, -line / dl[i])
            if dw[i] < 0.0:
                step = min(step, -w[i] / dw[i])
            if eta[i] == 0.0:
                continue
            dz[i, 0] = laws[i, MU] * dx[i, 0]
            for k in range(1, s):
                dz[i, k] = dx[i, k]
            _scale(point[i], eta[i], dz[i], True, z)
            _scale(point[i], eta[i], z, True, a)
            for k in range(s):
                dy[i, k] = c[i, k] - a[k]
            _cone_force(laws[i], x[i], z)
            step = min(step, longest_step(z, dz[i]), longest_step(y[i], dy[i]))
        longest[chunk] = step
    return longest.min()


@njit(cache=True, error_model="numpy", parallel=True)
def gap_after(laws, state, moved, step):
    """The gap after a step along `moved`."""
    x, y, w = state
    dz, dy, dl, dw = moved
    n, s = x.shape
    gap = 0.0
    for i in prange(n):
        part = (x[i, 0] + laws[i, TENSILE] + step * dl[i]) * (w[i] + step * dw[i])
        if laws[i, MU] > 0.0 or laws[i, SIGMA] > 0.0:
            z = laws[i, MU] * (x[i, 0] + laws[i, TENSILE]) + laws[i, SIGMA]
            part += (z + step * dz[i, 0]) * (y[i, 0] + step * dy[i, 0])
            for k in range(1, s):
                part += (x[i, k] + step * dz[i, k]) * (y[i, k] + step * dy[i, k])
        gap += part
    return gap
