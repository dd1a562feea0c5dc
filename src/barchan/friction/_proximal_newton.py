"""Proximal nonsmooth Newton on De Saxce's function for one island, dense and in equilibrated unknowns.

Each outer step solves the problem with W + eps I and b - eps x_k (seed B Eq. 3.14 on the whole island instead of one block)
by Newton's method with line search on the natural map (seed B 3.1.2, Eq. 1.29); its fixed points solve the problem itself.
The term makes the Newton matrices regular where W is not; it shrinks while that goes well. Cost: a dense factorisation
of the blocks that are in contact, per Newton step.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from barchan.cones._kernels import project_half_plane

_SMALLEST_TERM = 1e-13
_SHORTEST_STEP = 0.02
_CLEAR_GAIN = 0.8


@njit(cache=True, error_model="numpy")
def project_with_jacobian(x, mu, sigma, tau, out, jacobian):
    """Projection of a block x (s,) on the admissible set, and one element (s, s) of its generalised Jacobian.

    Returns False when that element is zero.
    """
    s = len(x)
    t2 = 0.0
    for i in range(1, s):
        t2 += x[i] * x[i]
    length = math.sqrt(t2)
    normal = x[0] + tau
    n, scale = project_half_plane(normal, length, mu, sigma)
    out[0] = n - tau
    for i in range(1, s):
        out[i] = scale * x[i]
    # Derivatives of (n, |t|) -> (n, |t| scale): conical face, flat face n = 0, rim, interior, apex.
    nn, nt, tt = 1.0, 0.0, 1.0
    excess = length - sigma
    if not (normal >= 0.0 and excess <= mu * normal):
        if n > 0.0:
            d = 1.0 / (1.0 + mu * mu)
            nn, nt, tt = d, mu * d, mu * mu * d
        elif excess <= 0.0:
            nn = 0.0
        else:
            nn, tt = 0.0, 0.0
    jacobian[0, 0] = nn
    for i in range(1, s):
        e = x[i] / length if length > 0.0 else 0.0
        jacobian[0, i] = nt * e
        jacobian[i, 0] = nt * e
        for j in range(1, s):
            f = x[j] / length if length > 0.0 else 0.0
            jacobian[i, j] = (tt - scale) * e * f + (scale if i == j else 0.0)
    return nn != 0.0 or scale != 0.0


@njit(cache=True, error_model="numpy")
def natural_map_at(u, laws, x, f, jacobians, active):
    """F = x - P(x - u - s(u)) into f (n, s), P' into jacobians (n, s, s), P' != 0 into active (n,); returns |F|^2."""
    n, s = x.shape
    point = np.empty(s)
    total = 0.0
    for i in range(n):
        slip = 0.0
        for k in range(s):
            point[k] = x[i, k] - u[i, k]
            if k > 0:
                slip += u[i, k] * u[i, k]
        point[0] -= (laws[i, 0] - laws[i, 3]) * math.sqrt(slip)
        active[i] = project_with_jacobian(point, laws[i, 0], laws[i, 1], laws[i, 2], f[i], jacobians[i])
        for k in range(s):
            f[i, k] = x[i, k] - f[i, k]
            total += f[i, k] * f[i, k]
    return total


@njit(cache=True, error_model="numpy")
def rate_derivative(u, law, jacobian, out):
    """out (s, s) = P' (I + s'(u)) of one block: what a change of its rates u (s,) does to P, with the sign turned."""
    s = len(u)
    slip = 0.0
    for k in range(1, s):
        slip += u[k] * u[k]
    slip = math.sqrt(slip)
    for k in range(s):
        out[k, 0] = jacobian[k, 0]
        for m in range(1, s):
            out[k, m] = jacobian[k, m]
            if slip > 0.0:
                out[k, m] += jacobian[k, 0] * (law[0] - law[3]) * u[m] / slip


@njit(cache=True, error_model="numpy")
def _natural_map(a, b, laws, x, eps, center, u, f, jacobians, active):
    """u = (A + eps) x + b - eps center, and `natural_map_at` it; returns |F|^2."""
    n, s = x.shape
    flat = np.dot(a, x.reshape(-1))
    for i in range(n):
        for k in range(s):
            u[i, k] = flat[i * s + k] + b[i, k] + eps * (x[i, k] - center[i, k])
    return natural_map_at(u, laws, x, f, jacobians, active)


@njit(cache=True, error_model="numpy")
def _newton_direction(a, laws, eps, u, f, jacobians, active):
    """Solve (I - P' + P' S' (A + eps)) d = -F; blocks with P' = 0 have d = -F and leave the system."""
    n, s = u.shape
    place = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        place[i] = count
        if active[i]:
            count += 1
    direction = -f
    if count == 0:
        return direction
    matrix = np.empty((count * s, count * s))
    rhs = np.empty(count * s)
    product = np.empty((s, s))
    for i in range(n):
        if not active[i]:
            continue
        rate_derivative(u[i], laws[i], jacobians[i], product)
        for k in range(s):
            row = place[i] * s + k
            rhs[row] = -f[i, k]
            for j in range(n):
                for m in range(s):
                    value = 0.0
                    for q in range(s):
                        value += product[k, q] * a[i * s + q, j * s + m]
                    if i == j:
                        value += eps * product[k, m] - jacobians[i, k, m]
                        if k == m:
                            value += 1.0
                    if active[j]:
                        matrix[row, place[j] * s + m] = value
                    else:
                        rhs[row] += value * f[j, m]
    solved = np.linalg.solve(matrix, rhs)
    for i in range(n):
        if active[i]:
            for k in range(s):
                direction[i, k] = solved[place[i] * s + k]
    return direction


@njit(cache=True, error_model="numpy")
def _newton(a, b, laws, x, eps, center, goal, steps, arrays):
    """Newton steps with line search until |F|^2 <= goal; x is updated; returns (|F|^2, steps made)."""
    u, f, jacobians, active, trial = arrays
    square = _natural_map(a, b, laws, x, eps, center, u, f, jacobians, active)
    made = 0
    while made < steps and square > goal:
        direction = _newton_direction(a, laws, eps, u, f, jacobians, active)
        made += 1
        length = 1.0
        while True:
            trial[:] = x + length * direction
            following = _natural_map(a, b, laws, trial, eps, center, u, f, jacobians, active)
            if following <= (1.0 - 2e-3 * length) * square or length < _SHORTEST_STEP:
                break
            length *= 0.5
        if not math.isfinite(following):
            return math.inf, made
        x[:] = trial
        square = following
    return square, made


@njit(cache=True, error_model="numpy")
def proximal_newton_island(a, b, laws, weight, x, goal, eps, budget, inner, policy):
    """Outer proximal steps from x (n, s), updated to the best iterate.

    a (n s, n s), b (n, s), laws (n, 4) : the island in equilibrated unknowns x = r / root; weight (n,) = root^2 gives the
    squared law residual, wanted <= goal.  eps : first proximal term, relative to A (whose blocks have mean eigenvalue 1).
    budget : factorisations.  inner : of one outer step.  policy : (few, shrink, grow, accuracy): an outer step is solved
    when |F| is `accuracy` of what it was; in `few` Newton steps or less the term shrinks, unsolved it grows.
    Returns (squared law residual, factorisations, last eps).
    """
    few, shrink, grow, accuracy = policy
    n, s = x.shape
    arrays = (
        np.empty((n, s)),
        np.empty((n, s)),
        np.empty((n, s, s)),
        np.empty(n, np.bool_),
        np.empty((n, s)),
    )
    residual = _weighted(a, b, laws, weight, x, arrays)
    best, best_x = residual, x.copy()
    used = 0
    while best > goal and used < budget:
        unweighted = 0.0
        for i in range(n):
            for k in range(s):
                unweighted += arrays[1][i, k] ** 2
        target = accuracy**2 * unweighted
        trial = x.copy()
        square, made = _newton(a, b, laws, trial, eps, x, target, min(inner, budget - used), arrays)
        used += max(made, 1)
        following = _weighted(a, b, laws, weight, trial, arrays)
        # A solved proximal step is taken even uphill: the residual is no merit function of the non-associated problem.
        if square <= target or following < _CLEAR_GAIN * residual:
            x[:] = trial
            residual = following
        else:
            _weighted(a, b, laws, weight, x, arrays)
        if square > target:
            eps = min(grow * eps, 1.0)
        elif made <= few:
            eps = max(shrink * eps, _SMALLEST_TERM)
        if residual < best:
            best = residual
            best_x[:] = x
    x[:] = best_x
    return best, used, eps


@njit(cache=True, error_model="numpy")
def _weighted(a, b, laws, weight, x, arrays):
    """Squared law residual of x; leaves F in arrays[1]."""
    u, f, jacobians, active, _ = arrays
    _natural_map(a, b, laws, x, 0.0, x, u, f, jacobians, active)
    total = 0.0
    for i in range(len(x)):
        for k in range(x.shape[1]):
            total += weight[i] * f[i, k] ** 2
    return total


@njit(cache=True, error_model="numpy")
def newton_islands(chosen, islands, w, b, laws, rho, allowed, settings, r, residual, used):
    """Proximal Newton on the islands `chosen`, in place where it improves; factorisations go to `used` (k,).

    w : W as block rows (indptr, indices, data).  allowed, residual (k,) : squared law residuals.
    settings : (first proximal term, budget, steps of an outer step, policy (few, shrink, grow, accuracy)).
    """
    indptr, indices, data = w
    term, budget, inner, policy = settings
    pointers, members = islands
    s = b.shape[1]
    place = np.empty(len(b), np.int64)
    for island in chosen:
        blocks = members[pointers[island] : pointers[island + 1]]
        n = len(blocks)
        for k in range(n):
            place[blocks[k]] = k
        a = np.zeros((n * s, n * s))
        local_b, local_laws, weight, x = np.empty((n, s)), np.empty((n, 4)), np.empty(n), np.empty((n, s))
        for k in range(n):
            i = blocks[k]
            root = math.sqrt(rho[i])
            weight[k] = rho[i]
            for c in range(s):
                local_b[k, c] = root * b[i, c]
                x[k, c] = r[i, c] / root
            for c in range(4):
                local_laws[k, c] = laws[i, c] / root if c == 1 or c == 2 else laws[i, c]
            for entry in range(indptr[i], indptr[i + 1]):
                j = indices[entry]
                scale = root * math.sqrt(rho[j])
                for c in range(s):
                    for d in range(s):
                        a[k * s + c, place[j] * s + d] = scale * data[entry, c, d]
        square, used[island], _ = proximal_newton_island(
            a, local_b, local_laws, weight, x, allowed[island], term, budget, inner, policy
        )
        if square < residual[island]:
            residual[island] = square
            for k in range(n):
                i = blocks[k]
                for c in range(s):
                    r[i, c] = x[k, c] * math.sqrt(rho[i])
