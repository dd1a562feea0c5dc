"""Exact solution of one block by a scalar secular equation, for any block size and any law of the family.

With J = diag(-mu zeta, 1, ..., 1) a sliding block satisfies (W + a J) r = -b for some a > 0 and |r_T| = sigma + mu r_N.
In the eigenbasis of the Schur complement T = W_TT - w w^T / W_NN both r_N and r_T are rational in a: one scalar equation
remains (issue note; seed B 4.1.2 gives the quartic of the case s = 3). Cost: O(s^2) once per block solve, O(s) per step.
"""

from __future__ import annotations

import math

from numba import njit

_MAX_STEPS = 60
_PRECISION = 1e-13
_NO_FRICTION = 1e-14
_MAX_DILATANT = 260
_FARTHEST = 1e30


@njit(cache=True, error_model="numpy")
def _evaluate(a, s, local, c, normal_start, mu, sigma, zeta, t):
    """Force of the candidate `a`: writes the tangential part in the eigenbasis to `t`.

    Returns (radius, |t|, r_N) with radius = sigma + mu r_N; the sliding block has u_N = zeta a radius.
    """
    numerator = normal_start
    spread = 1.0 / local[0]
    for j in range(s - 1):
        inverse = 1.0 / (local[s + j] + a)
        numerator += local[1 + j] * c[j] * inverse
        spread += local[1 + j] * local[1 + j] * inverse
    denominator = 1.0 - a * zeta * mu * spread
    radius = (sigma + mu * numerator) / denominator
    square = 0.0
    for j in range(s - 1):
        t[j] = -(c[j] + a * zeta * local[1 + j] * radius) / (local[s + j] + a)
        square += t[j] * t[j]
    return radius, math.sqrt(square), (numerator + a * zeta * sigma * spread) / denominator


@njit(cache=True, error_model="numpy")
def _pole(s, local, coupling):
    """The a > 0 at which W + a J becomes singular (convex decreasing denominator: Newton climbs from the left)."""
    a = 0.0
    for _ in range(_MAX_STEPS):
        value = 1.0 - a * coupling / local[0]
        slope = -coupling / local[0]
        for j in range(s - 1):
            shifted = local[s + j] + a
            square = local[1 + j] * local[1 + j]
            value -= coupling * square * a / shifted
            slope -= coupling * square * local[s + j] / (shifted * shifted)
        step = -value / slope
        a += step
        if abs(step) <= _PRECISION * a:
            break
    return a


@njit(cache=True, error_model="numpy")
def _slide(s, local, c, normal_start, mu, sigma, a0, t):
    """Root of q(a)/|r_T(a)| = 1, q = sigma + mu r_N, without dilatancy: (a, r_N); nearly linear in a, safeguarded Newton."""
    low = 0.0
    high = math.inf
    a = a0 if a0 > 0.0 else 0.0
    normal = 0.0
    if s == 2:
        # One tangential direction: its sign is known and the equation is linear.
        side = 1.0 if c[0] > 0.0 else -1.0
        pivot = 1.0 - side * local[1] * mu
        if pivot > 0.0:
            normal = (normal_start + side * local[1] * sigma) / pivot
            radius = sigma + mu * normal
            a = abs(c[0]) / radius - local[2]
            if radius > 0.0 and a >= 0.0:
                t[0] = -side * radius
                return a, normal
            a = 0.0
    for _ in range(_MAX_STEPS):
        normal = normal_start
        square = 0.0
        normal_slope = 0.0
        square_slope = 0.0
        for j in range(s - 1):
            inverse = 1.0 / (local[s + j] + a)
            t[j] = -c[j] * inverse
            normal -= local[1 + j] * t[j]
            square += t[j] * t[j]
            normal_slope += local[1 + j] * t[j] * inverse
            square_slope -= t[j] * t[j] * inverse
        length = math.sqrt(square)
        radius = sigma + mu * normal
        gap = radius - length
        if gap < 0.0:
            low = a
        else:
            high = a
        if abs(gap) <= _PRECISION * length:
            break
        # Newton on radius / length = 1, whose slope is this over the length times `square`.
        slope = mu * normal_slope * square - radius * square_slope
        trial = a - gap * square / slope if slope > 0.0 else -1.0
        if not (low < trial < high):
            trial = 0.5 * (low + high) if high < math.inf else 2.0 * low + local[2 * s - 2]
        if high < math.inf and high - low <= _PRECISION * high:
            break
        a = trial
    return a, normal


@njit(cache=True, error_model="numpy")
def _gap(a, s, local, c, normal_start, mu, sigma, zeta, side):
    """Side P - |T| of a dilatant block, its slope and a_eff, with P = D q, T = D r_T and D = 1 - a mu zeta S free of the pole.

    Returns (gap, slope, |T|, the harmonic mean of the lambda_j + a weighted by T_j^2).
    """
    head, head_slope = sigma + mu * normal_start, 0.0
    spread, spread_slope = 1.0 / local[0], 0.0
    for j in range(s - 1):
        inverse = 1.0 / (local[s + j] + a)
        term = mu * local[1 + j] * c[j] * inverse
        head += term
        head_slope -= term * inverse
        term = local[1 + j] * local[1 + j] * inverse
        spread += term
        spread_slope -= term * inverse
    scale = 1.0 - a * zeta * mu * spread
    scale_slope = -zeta * mu * (spread + a * spread_slope)
    drift, drift_slope = zeta * a * head, zeta * (head + a * head_slope)
    square = 0.0
    cross = 0.0
    weighted = 0.0
    for j in range(s - 1):
        inverse = 1.0 / (local[s + j] + a)
        tail = -(c[j] * scale + local[1 + j] * drift) * inverse
        cross -= tail * (c[j] * scale_slope + local[1 + j] * drift_slope + tail) * inverse
        square += tail * tail
        weighted += tail * tail * inverse
    length = math.sqrt(square)
    return side * head - length, side * head_slope - cross / length, length, square / weighted


@njit(cache=True, error_model="numpy")
def _slide_dilatant(s, local, c, normal_start, mu, sigma, zeta, a0, t):
    """Sliding root with dilatancy (mu, zeta > 0), on the side of the pole where the radius is positive: (a, r_N).

    Newton on the gap times (lambda + a), which is linear for an isotropic block, kept in a bracket; bisection if it dawdles.
    r_N = -inf when there is no root: the block then sits on the truncation.
    """
    pole = _pole(s, local, mu * zeta)
    head = sigma + mu * normal_start
    for j in range(s - 1):
        head += mu * local[1 + j] * c[j] / (local[s + j] + pole)
    left = head > 0.0
    if not left:
        # Towards a = inf: without a change of sign the cone does not meet the block.
        head = sigma + mu * normal_start
        square = 0.0
        for j in range(s - 1):
            square += (zeta * (mu * c[j] / local[0] - local[1 + j] * head)) ** 2
        if -head > math.sqrt(square):
            return 0.0, -math.inf
    side = 1.0 if left else -1.0
    low, high = (0.0, pole) if left else (pole, math.inf)
    a = a0 if low < a0 < high else 0.0 if left else 2.0 * pole
    for step in range(_MAX_DILATANT):
        gap, slope, length, shifted = _gap(a, s, local, c, normal_start, mu, sigma, zeta, side)
        if (gap > 0.0) == left:
            high = a
        else:
            low = a
        if abs(gap) <= _PRECISION * length or low >= high * (1.0 - 4e-16):
            break
        trial = a - gap / (slope + gap / shifted)
        if step >= _MAX_STEPS or not (low < trial < high):
            if high == math.inf and low > _FARTHEST * pole:
                return 0.0, -math.inf
            trial = 0.5 * (low + high) if high < math.inf else 2.0 * low
        if trial == a:
            break
        a = trial
    _, _, normal = _evaluate(a, s, local, c, normal_start, mu, sigma, zeta, t)
    return a, normal


@njit(cache=True, error_model="numpy")
def _slide_detached(s, local, c, mean, sigma, t):
    """|r_T| <= sigma with r_N = 0 (truncation face and rim): tangential minimiser of the block, radius sigma; returns a.

    1/|r_T(a)| is concave and increasing: Newton climbs to 1/sigma from the left without overshooting. The inverse of
    W_TT + a = T + a + W_NN l l' is written with differences of products, which nearly singular blocks need.
    """
    a = 0.0
    for _ in range(_MAX_STEPS):
        spread = 1.0
        for j in range(s - 1):
            spread += local[0] * local[1 + j] * local[1 + j] / (local[s + j] + a)
        square = 0.0
        decay = 0.0
        for j in range(s - 1):
            full = c[j] + local[1 + j] * mean
            total = full
            for k in range(s - 1):
                weight = local[0] * local[1 + k] / (local[s + k] + a)
                total += weight * (local[1 + k] * c[j] - local[1 + j] * c[k])
            inverse = 1.0 / (local[s + j] + a)
            t[j] = -total * inverse / spread
            square += t[j] * t[j]
            decay += t[j] * t[j] * inverse
            for k in range(j):
                turn = local[1 + k] * t[j] - local[1 + j] * t[k]
                decay += local[0] * turn * turn * inverse / (local[s + k] + a)
        # decay / spread = r_T . (W_TT + a)^-1 r_T = -d|r_T|^2/da / 2.
        length = math.sqrt(square)
        if length <= sigma * (1.0 + _PRECISION):
            break
        step = (length / sigma - 1.0) * square * spread / decay
        if not step > 1e-16 * a:
            break
        a += step
    return a


@njit(cache=True, error_model="numpy")
def solve_secular(s, local, b, mu, sigma, tau, zeta, a0, r, c, t):
    """Solve u = W r + b with (u, r) in the law, exactly.

    `local` (row of `local_blocks`), `b` (s,), law parameters, `a0` a guess of the sliding multiplier (0: none); writes the
    force to `r` (s,), uses scratch `c`, `t` (s-1,). Returns the multiplier a with u_T = -a r_T (0 when not sliding).
    """
    if mu < _NO_FRICTION:
        mu, zeta = 0.0, 0.0
    if zeta < _NO_FRICTION:
        zeta = 0.0
    # The force is measured from the tensile limit: r = r' - tau e_N, hence b' = b - tau W e_N.
    b_normal = b[0] - tau * local[0]
    tangential = 0.0
    for j in range(s - 1):
        value = 0.0
        for k in range(s - 1):
            value += local[2 * s - 1 + k * (s - 1) + j] * b[1 + k]
        c[j] = value - local[1 + j] * b[0]
        # Q^T b'_T = c + w/W_NN b'_N: the shift cancels in c.
        full = c[j] + local[1 + j] * b_normal
        tangential += full * full
    normal_start = -b_normal / local[0]
    a = 0.0
    normal = 0.0
    if sigma == 0.0 and (b_normal >= zeta * math.sqrt(tangential) or mu == 0.0):
        for j in range(s - 1):
            t[j] = 0.0
        normal = max(0.0, normal_start)
        if mu > 0.0:
            normal = 0.0
    else:
        radius, length, normal = _evaluate(0.0, s, local, c, normal_start, mu, sigma, 0.0, t)
        if normal < 0.0 or length > radius:
            detached = False
            if sigma > 0.0 and zeta == 0.0:
                # A truncated cone: without normal force the block may still carry a tangential one.
                a = _slide_detached(s, local, c, b_normal, sigma, t)
                rate = b_normal
                for j in range(s - 1):
                    rate += local[0] * local[1 + j] * t[j]
                detached = rate >= 0.0
                normal = 0.0
            if not detached:
                if zeta > 0.0:
                    a, normal = _slide_dilatant(s, local, c, normal_start, mu, sigma, zeta, a0, t)
                else:
                    a, normal = _slide(s, local, c, normal_start, mu, sigma, a0, t)
                if sigma > 0.0 and not normal >= 0.0:
                    normal = 0.0
                    a = _slide_detached(s, local, c, b_normal, sigma, t)
    r[0] = normal - tau
    for k in range(s - 1):
        value = 0.0
        for j in range(s - 1):
            value += local[2 * s - 1 + k * (s - 1) + j] * t[j]
        r[1 + k] = value
    return a
