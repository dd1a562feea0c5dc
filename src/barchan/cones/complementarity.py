"""Functions of (u, r) that vanish exactly on the laws of friction, and a generalised Jacobian of one of them.

Seed B: De Saxce's shift of the natural map (1.29), Alart-Curnier (1.27), Fischer-Burmeister (4.1-4.3), B.1.1.
Unchecked arrays: u, r (n, s); rho and coefficients scalar or (n,); `Law` (laws.py) checks and calls them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barchan.cones._checks import FloatArray
from barchan.cones.jordan import arrow_matrix, hypotenuse_and_determinant, inverse_arrow_matrix
from barchan.cones.projection import face_direction, project_along_face

# Below this ratio det z / |z o z| is rounding: the Fischer-Burmeister function has a kink there.
_KINK = 1e-12


class Coefficients(NamedTuple):
    """Coefficients of a law in cone coordinates, each (n,) or 0-d: seed B's mu, sigma_S, tau_c and zeta."""

    mu: FloatArray
    shear_yield: FloatArray
    tensile_yield: FloatArray
    dilatancy: FloatArray


def project_admissible(r: FloatArray, law: Coefficients) -> FloatArray:
    """Nearest admissible force: projection on {r : r + tau_c e_N in T_{mu, sigma_S}}. Seed B, Eq. (1.17)."""
    shifted = _from_apex(r, law)
    projected = project_along_face(shifted, *face_direction(law.mu), law.shear_yield)
    projected[:, 0] -= law.tensile_yield
    return projected


def de_saxce_shift(u: FloatArray, law: Coefficients) -> FloatArray:
    """Normal component (n,) of the shift: (mu - zeta) |u_T|. Seed B, Property 1.6; ERRATA 3."""
    return (law.mu - law.dilatancy) * np.linalg.norm(u[:, 1:], axis=1)


def alart_curnier(u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients) -> FloatArray:
    """Projection of the N part on the half-line and of the T part on a disc, minus r. Seed B, Eq. (1.27).

    The disc has the radius max(0, sigma_S + mu r_N) of the given force, not of its projection.
    """
    force = _from_apex(r, law)
    opening = u[:, 0] - law.dilatancy * np.linalg.norm(u[:, 1:], axis=1)
    radius = np.maximum(law.shear_yield + law.mu * force[:, 0], 0.0)
    trial = force[:, 1:] - _column(rho) * u[:, 1:]
    length = np.linalg.norm(trial, axis=1)
    scale = np.divide(radius, length, out=np.ones_like(length), where=~(length <= radius))
    value = np.empty_like(force)
    value[:, 0] = np.maximum(force[:, 0] - rho * opening, 0.0) - force[:, 0]
    value[:, 1:] = scale[:, np.newaxis] * trial - force[:, 1:]
    return value


def fischer_burmeister(u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients) -> FloatArray:
    """(u^ o u^ + r^ o r^)^(1/2) - u^ - r^ of the hat variables, (n, s), for sigma_S = 0. Seed B, (4.1)-(4.3).

    On blocks with mu = 0 the hat variables would vanish: the normal part is then the scalar function of
    (rho u_N, r_N) and the tangential part -r_T.
    """
    hat_u, hat_r = _hat_variables(u, r, rho, law)
    root, _ = hypotenuse_and_determinant(hat_u, _hidden_if_frictionless(hat_r, law))
    return root - hat_u - hat_r


def fischer_burmeister_jacobian(
    u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients
) -> tuple[FloatArray, FloatArray]:
    """An element (J_u, J_r) of the generalised Jacobian of `fischer_burmeister`, each (n, s, s).

    From z o z = u^ o u^ + r^ o r^ comes L_z dz = L_u^ du^ + L_r^ dr^, so that the derivative in r^ is
    L_z^{-1} L_r^ - I (seed B, B.1.1 prints the opposite), then the chain rule. Elements chosen at the kinks:
    where z is on the boundary of K_1, L_z^{-1} L_x becomes x_N / sqrt(u^_N^2 + r^_N^2) times I (seed B);
    where z = 0 it is I / sqrt 2; where u_T = 0 the gradient of |u_T| is 0.
    """
    hat_u, hat_r = _hat_variables(u, r, rho, law)
    by_u, by_r = _root_derivatives(hat_u, _hidden_if_frictionless(hat_r, law))
    by_r[np.broadcast_to(law.mu == 0.0, len(r)), 1:] = 0.0
    identity = np.eye(u.shape[1])
    by_u -= identity
    by_r -= identity

    tangential_norm = np.linalg.norm(u[:, 1:], axis=1)
    safe_norm = np.where(tangential_norm == 0.0, np.inf, tangential_norm)
    slip_direction = u[:, 1:] / safe_norm[:, np.newaxis]
    du = np.zeros_like(by_u)
    du[:, 0, 0] = 1.0
    du[:, 0, 1:] = _column(law.mu - law.dilatancy) * slip_direction
    du[:, 1:, 1:] = np.asarray(law.mu)[..., None, None] * identity[1:, 1:]
    by_r[:, :, 0] *= _column(_normal_scale(law))
    return (by_u @ du) * np.asarray(rho)[..., None, None], by_r


def _root_derivatives(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of z = (x o x + y o y)^(1/2) in x and y: L_z^{-1} L_x and L_z^{-1} L_y, or kink values."""
    root, determinant = hypotenuse_and_determinant(x, y)
    kink = determinant <= _KINK * np.sum(root * root, axis=1)
    safe_root = np.where(kink[:, None], np.eye(1, x.shape[1]), root)
    inverse = inverse_arrow_matrix(safe_root, np.where(kink, 1.0, determinant))
    by_x, by_y = inverse @ arrow_matrix(x), inverse @ arrow_matrix(y)
    if np.any(kink):
        normals = np.stack([x[kink, 0], y[kink, 0]])
        length = np.hypot(*normals)
        cosines = np.divide(normals, length, out=np.full_like(normals, np.sqrt(0.5)), where=length != 0.0)
        by_x[kink], by_y[kink] = cosines[..., None, None] * np.eye(x.shape[1])
    return by_x, by_y


def _hat_variables(
    u: FloatArray, r: FloatArray, rho: FloatArray, law: Coefficients
) -> tuple[FloatArray, FloatArray]:
    """u^ = rho (u~_N ; mu u_T) and r^ = (mu r_N ; r_T), complementary in K_1 on the law. Seed B, (4.2)."""
    hat_r = _from_apex(r, law)
    hat_r[:, 0] *= _normal_scale(law)
    hat_u = u * _column(rho * law.mu)
    hat_u[:, 0] = rho * (u[:, 0] + de_saxce_shift(u, law))
    return hat_u, hat_r


def _normal_scale(law: Coefficients) -> FloatArray:
    """Scale of r^_N: mu, or 1 without friction."""
    return np.where(law.mu > 0.0, law.mu, 1.0)


def _hidden_if_frictionless(hat_r: FloatArray, law: Coefficients) -> FloatArray:
    """`hat_r` without the tangential part of frictionless blocks, which their square root must not see."""
    hidden = hat_r.copy()
    hidden[np.broadcast_to(law.mu == 0.0, len(hat_r)), 1:] = 0.0
    return hidden


def _from_apex(r: FloatArray, law: Coefficients) -> FloatArray:
    """A copy of r counted from the tip of its admissible set: r + tau_c e_N."""
    force = r.copy()
    force[:, 0] += law.tensile_yield
    return force


def _column(coefficient: FloatArray) -> FloatArray:
    return np.asarray(coefficient)[..., np.newaxis]
