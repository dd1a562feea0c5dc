"""Generalised Jacobians of the natural map and of Alart and Curnier's function, block by block, for Newton's method.

Seed B, 3.1.2 on the functions (1.27) and (1.29). Unchecked arrays: u, r (n, s); rho and coefficients scalar or (n,);
`Law` (laws.py) checks and calls them. Each answer is one element (J_u, J_r), both (n, s, s), of the generalised Jacobian.
"""

from __future__ import annotations

import numpy as np

from barchan.cones._checks import FloatArray
from barchan.cones.complementarity import Coefficients, de_saxce_shift


def natural_map_jacobian(
    u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients
) -> tuple[FloatArray, FloatArray]:
    """Of r - P(r - rho (u + s(u))): J_r = I - P', J_u = rho P' (I + s'). Seed B, Eq. (1.29).

    At a kink of P the smooth side towards the admissible set is taken; where u_T = 0 the gradient of |u_T| is 0.
    """
    n, s = u.shape
    step = np.broadcast_to(rho, n)
    trial = r - step[:, None] * u
    trial[:, 0] -= step * de_saxce_shift(u, law)
    trial[:, 0] += law.tensile_yield
    slope = projection_jacobian(trial, law)
    shift = np.zeros((n, s, s)) + np.eye(s)
    shift[:, 0, 1:] += np.broadcast_to(law.mu - law.dilatancy, n)[:, None] * directions(u)
    return step[:, None, None] * (slope @ shift), np.eye(s) - slope


def projection_jacobian(x: FloatArray, law: Coefficients) -> FloatArray:
    """(n, s, s) derivative of the projection on {x_N >= 0, |x_T| <= sigma_S + mu x_N} at x (n, s). Seed B, Eq. (1.17)."""
    n, s = x.shape
    mu, sigma = np.broadcast_to(law.mu, n), np.broadcast_to(law.shear_yield, n)
    length = np.linalg.norm(x[:, 1:], axis=1)
    excess = length - sigma
    face = (x[:, 0] + mu * excess) / (1.0 + mu * mu)
    inside = (x[:, 0] >= 0.0) & (excess <= mu * x[:, 0])
    flat = ~inside & (x[:, 0] < 0.0) & (excess <= 0.0)
    conical = ~inside & ~flat & (face > 0.0)
    rim = ~inside & ~flat & ~conical
    weight = 1.0 / (1.0 + mu * mu)
    safe = np.where(length > 0.0, length, 1.0)
    # Entries (N, N), (N, along T), (along T, along T) and (across T): one column each for the four regions.
    cases = [inside, flat, conical, rim]
    normal = np.select(cases, [1.0, 0.0, weight, 0.0])
    mixed = np.select(cases, [0.0, 0.0, mu * weight, 0.0])
    along = np.select(cases, [1.0, 1.0, mu * mu * weight, 0.0])
    across = np.select(cases, [1.0, 1.0, (sigma + mu * face) / safe, sigma / safe])
    unit = directions(x)
    jacobian = np.zeros((n, s, s))
    jacobian[:, 0, 0] = normal
    jacobian[:, 0, 1:] = jacobian[:, 1:, 0] = mixed[:, None] * unit
    jacobian[:, 1:, 1:] = across[:, None, None] * np.eye(s - 1)
    jacobian[:, 1:, 1:] += (along - across)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    return jacobian


def alart_curnier_jacobian(
    u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients
) -> tuple[FloatArray, FloatArray]:
    """Of `complementarity.alart_curnier`, by the cases contact or not and stick or slip. Seed B, Eq. (1.27)."""
    n, s = u.shape
    step = np.broadcast_to(rho, n)
    mu, zeta = np.broadcast_to(law.mu, n), np.broadcast_to(law.dilatancy, n)
    force = r[:, 0] + law.tensile_yield
    slide = directions(u)
    opening = u[:, 0] - zeta * np.linalg.norm(u[:, 1:], axis=1)
    contact = (force - step * opening > 0.0).astype(float)
    by_u, by_r = np.zeros((n, s, s)), np.zeros((n, s, s))
    by_u[:, 0, 0] = -step * contact
    by_u[:, 0, 1:] = (step * zeta * contact)[:, None] * slide
    by_r[:, 0, 0] = contact - 1.0

    trial = r[:, 1:] - step[:, None] * u[:, 1:]
    length = np.linalg.norm(trial, axis=1)
    reach = law.shear_yield + mu * force
    radius = np.maximum(reach, 0.0)
    slip = length > radius
    unit = directions(np.concatenate([length[:, None], trial], axis=1))
    scale = np.where(slip, radius / np.where(length > 0.0, length, 1.0), 1.0)
    tangential = scale[:, None, None] * np.eye(s - 1)
    tangential -= np.where(slip, scale, 0.0)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    by_u[:, 1:, 1:] = -step[:, None, None] * tangential
    by_r[:, 1:, 1:] = tangential - np.eye(s - 1)
    by_r[:, 1:, 0] = np.where(slip & (reach > 0.0), mu, 0.0)[:, None] * unit
    return by_u, by_r


def directions(x: FloatArray) -> FloatArray:
    """x_T / |x_T| of blocks (n, s), 0 where x_T = 0."""
    length = np.linalg.norm(x[:, 1:], axis=1)
    return np.asarray(x[:, 1:] / np.where(length > 0.0, length, np.inf)[:, None])
