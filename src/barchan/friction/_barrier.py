"""Second-order cones and half-lines inside an interior-point method: Nesterov-Todd scaling, directions, step lengths.

A block with force r is held in z = (mu (r_N + tau) + sigma, r_T) / kappa in K_1 and, where the cone is truncated, also in
l = r_N + tau >= 0. Their multipliers y in K_1 and m >= 0 make u + s(u) = G^T (y, m) (seed B 3.2; NT scaling of symmetric
cones). Symbols: w the scaling point (determinant 1), eta its length, Theta = W^-2 so that y = Theta z at the scaling.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Columns of the shape table of a block: cone present, line present, mu / kappa, 1 / kappa, mu - zeta.
CONE, LINE, NORMAL, TANGENT, EXCESS = 0, 1, 2, 3, 4


def shape_table(laws: np.ndarray) -> np.ndarray:
    """(n, 5) table of `laws` (n, 4): which constraints hold a block, and how its force enters them."""
    mu, sigma, _, zeta = laws.T
    cone = (mu > 0.0) | (sigma > 0.0)
    kappa = np.where(cone, mu + sigma, 1.0)
    line = (sigma > 0.0) | ~cone
    return np.stack([cone, line, mu / kappa, 1.0 / kappa, mu - zeta], axis=1).astype(float)


@njit(cache=True, error_model="numpy")
def cone_det(x):
    """x_N^2 - |x_T|^2, by the product of its eigenvalues."""
    t = 0.0
    for k in range(1, len(x)):
        t += x[k] * x[k]
    t = math.sqrt(t)
    return (x[0] - t) * (x[0] + t)


@njit(cache=True, error_model="numpy")
def longest_step(x, d):
    """Largest a with x + a d in K_1, for x inside."""
    aa, ab, bb = cone_det(d), x[0] * d[0], cone_det(x)
    for k in range(1, len(x)):
        ab -= x[k] * d[k]
    step = math.inf
    if d[0] < 0.0:
        step = -x[0] / d[0]
    # ab^2 - aa bb, by Lagrange's identity: zero, not the root of rounding, where d is parallel to x.
    disc = 0.0
    for k in range(1, len(x)):
        disc += (x[0] * d[k] - d[0] * x[k]) ** 2
        for m in range(1, k):
            disc -= (x[m] * d[k] - d[m] * x[k]) ** 2
    if disc >= 0.0:
        q = -(ab + math.copysign(math.sqrt(disc), ab))
        if aa != 0.0 and q / aa > 0.0:
            step = min(step, q / aa)
        if q != 0.0 and bb / q > 0.0:
            step = min(step, bb / q)
    return step


@njit(cache=True, error_model="numpy")
def _scale(w, eta, x, inverse, out):
    """out = W x or W^-1 x for the scaling (w, eta) of one cone."""
    sign = -1.0 if inverse else 1.0
    dot = 0.0
    for k in range(1, len(x)):
        dot += sign * w[k] * x[k]
    factor = x[0] + dot / (1.0 + w[0])
    length = 1.0 / eta if inverse else eta
    out[0] = length * (w[0] * x[0] + dot)
    for k in range(1, len(x)):
        out[k] = length * (x[k] + sign * factor * w[k])


@njit(cache=True, error_model="numpy")
def scale_blocks(shape, state, scaling, theta, slope):
    """Scaling of the iterate, Theta (n, s, s) in force space and slope N (n, s, s) of the non-associated term.

    state = (z, y, l, m); scaling = (w (n, s), eta (n,), lam (n, s)) is written.
    Returns the complementarity gap z.y + l m summed over blocks.
    """
    z, y, line, m = state
    w, eta, lam = scaling
    n, s = z.shape
    gap = 0.0
    for i in range(n):
        theta[i] = 0.0
        slope[i] = 0.0
        for k in range(s):
            slope[i, k, k] = 1.0
        if shape[i, CONE] > 0.0:
            root_z, root_y = math.sqrt(cone_det(z[i])), math.sqrt(cone_det(y[i]))
            dot = 0.0
            for k in range(s):
                dot += z[i, k] * y[i, k]
            gap += dot
            gamma = math.sqrt(0.5 * (1.0 + dot / (root_z * root_y)))
            for k in range(s):
                sign = 1.0 if k == 0 else -1.0
                w[i, k] = (z[i, k] / root_z + sign * y[i, k] / root_y) / (2.0 * gamma)
            # Determinant 1 to the last digit: W and W^-1 would part otherwise.
            slip = 1.0
            for k in range(1, s):
                slip += w[i, k] * w[i, k]
            w[i, 0] = math.sqrt(slip)
            eta[i] = math.sqrt(root_z / root_y)
            _scale(w[i], eta[i], y[i], False, lam[i])
            slip = 0.0
            for k in range(1, s):
                slip += y[i, k] * y[i, k]
            slip = math.sqrt(slip)
            for a in range(s):
                ga = shape[i, NORMAL] if a == 0 else shape[i, TANGENT]
                wa = w[i, 0] if a == 0 else -w[i, a]
                for b in range(s):
                    gb = shape[i, NORMAL] if b == 0 else shape[i, TANGENT]
                    wb = w[i, 0] if b == 0 else -w[i, b]
                    j = 0.0
                    if a == b:
                        j = 1.0 if a == 0 else -1.0
                    theta[i, a, b] = ga * gb * (2.0 * wa * wb - j) / (eta[i] * eta[i])
                if a > 0 and slip > 0.0:
                    slope[i, 0, a] = -shape[i, EXCESS] * y[i, a] / slip
        if shape[i, LINE] > 0.0:
            gap += line[i] * m[i]
            theta[i, 0, 0] += m[i] / line[i]
    return gap


@njit(cache=True, error_model="numpy")
def stationarity(shape, y, m, rates, out):
    """out = u - (G^T (y, m) - (mu - zeta) |y_T'| e_N) for rates u (n, s), y_T' = y_T / kappa the slip it stands for."""
    n, s = rates.shape
    for i in range(n):
        out[i, 0] = rates[i, 0]
        slip = 0.0
        if shape[i, CONE] > 0.0:
            out[i, 0] -= shape[i, NORMAL] * y[i, 0]
            for k in range(1, s):
                value = shape[i, TANGENT] * y[i, k]
                slip += value * value
                out[i, k] = rates[i, k] - value
            out[i, 0] += shape[i, EXCESS] * math.sqrt(slip)
        else:
            for k in range(1, s):
                out[i, k] = 0.0
        if shape[i, LINE] > 0.0:
            out[i, 0] -= m[i]


@njit(cache=True, error_model="numpy")
def complementarity_target(shape, scaling, pair, center, corrected, target):
    """The right side d of W dy + W^-1 dz = d: lam \\ (center e - lam o lam - (W^-1 dz) o (W dy)), in scaled variables.

    pair = (dz, dy, dl, dm) is the predictor used when `corrected`; state is implied by the scaling. target = (d, d_line).
    """
    w, eta, lam = scaling
    dz, dy, dl, dm = pair
    d, d_line = target
    n, s = lam.shape
    a, b, rhs = np.empty(s), np.empty(s), np.empty(s)
    for i in range(n):
        if shape[i, CONE] > 0.0:
            for k in range(s):
                rhs[k] = -2.0 * lam[i, 0] * lam[i, k]
            rhs[0] = center
            for k in range(s):
                rhs[0] -= lam[i, k] * lam[i, k]
            if corrected:
                _scale(w[i], eta[i], dz[i], True, a)
                _scale(w[i], eta[i], dy[i], False, b)
                for k in range(s):
                    rhs[0] -= a[k] * b[k]
                    if k > 0:
                        rhs[k] -= a[0] * b[k] + b[0] * a[k]
            det, dot = cone_det(lam[i]), 0.0
            for k in range(1, s):
                dot += lam[i, k] * rhs[k]
            d[i, 0] = (lam[i, 0] * rhs[0] - dot) / det
            for k in range(1, s):
                d[i, k] = (dot / lam[i, 0] - rhs[0]) / det * lam[i, k] + rhs[k] / lam[i, 0]
        if shape[i, LINE] > 0.0:
            # In unscaled terms m dl + l dm = center - l m - dl dm; d_line is the part of dm that does not depend on dl.
            d_line[i] = center - (dl[i] * dm[i] if corrected else 0.0)


@njit(cache=True, error_model="numpy")
def force_target(shape, state, scaling, target, slope, out):
    """out (n, s) = N G^T (W^-1 d), the part of the linearised u + s(u) that does not depend on dr."""
    line, m = state[2], state[3]
    w, eta = scaling[0], scaling[1]
    d, d_line = target
    n, s = out.shape
    a = np.empty(s)
    for i in range(n):
        out[i] = 0.0
        if shape[i, CONE] > 0.0:
            _scale(w[i], eta[i], d[i], True, a)
            out[i, 0] = shape[i, NORMAL] * a[0]
            for k in range(1, s):
                out[i, k] = shape[i, TANGENT] * a[k]
                out[i, 0] += slope[i, 0, k] * out[i, k]
        if shape[i, LINE] > 0.0:
            out[i, 0] += d_line[i] / line[i] - m[i]


@njit(cache=True, error_model="numpy")
def expand_direction(shape, state, scaling, target, dr, pair):
    """Directions (dz, dy, dl, dm) that belong to the force direction dr; returns the longest feasible step."""
    z, y, line, m = state
    w, eta = scaling[0], scaling[1]
    d, d_line = target
    dz, dy, dl, dm = pair
    n, s = dr.shape
    step = math.inf
    a = np.empty(s)
    for i in range(n):
        if shape[i, CONE] > 0.0:
            dz[i, 0] = shape[i, NORMAL] * dr[i, 0]
            for k in range(1, s):
                dz[i, k] = shape[i, TANGENT] * dr[i, k]
            # dy = W^-1 (d - W^-1 dz)
            _scale(w[i], eta[i], dz[i], True, a)
            for k in range(s):
                a[k] = d[i, k] - a[k]
            _scale(w[i], eta[i], a, True, dy[i])
            step = min(step, longest_step(z[i], dz[i]), longest_step(y[i], dy[i]))
        if shape[i, LINE] > 0.0:
            dl[i] = dr[i, 0]
            dm[i] = d_line[i] / line[i] - m[i] - m[i] / line[i] * dl[i]
            if dl[i] < 0.0:
                step = min(step, -line[i] / dl[i])
            if dm[i] < 0.0:
                step = min(step, -m[i] / dm[i])
    return step


@njit(cache=True, error_model="numpy")
def gap_after(shape, state, pair, step):
    """Complementarity gap after a step along `pair`, and the smallest product of paired eigenvalues on the way."""
    z, y, line, m = state
    dz, dy, dl, dm = pair
    n, s = z.shape
    gap, smallest = 0.0, math.inf
    a, b = np.empty(s), np.empty(s)
    for i in range(n):
        if shape[i, CONE] > 0.0:
            dot = 0.0
            for k in range(s):
                a[k] = z[i, k] + step * dz[i, k]
                b[k] = y[i, k] + step * dy[i, k]
                dot += a[k] * b[k]
            gap += dot
            det_a, det_b = cone_det(a), cone_det(b)
            if not (det_a > 0.0 and det_b > 0.0 and a[0] > 0.0 and b[0] > 0.0):
                return gap, -1.0
            det = det_a * det_b
            smallest = min(smallest, det / (dot + math.sqrt(max(dot * dot - det, 0.0))))
        if shape[i, LINE] > 0.0:
            product = (line[i] + step * dl[i]) * (m[i] + step * dm[i])
            gap += product
            smallest = min(smallest, product)
    return gap, smallest
