"""Orthogonal projections on second-order cones, their dual and polar cones, and truncated cones.

Seed B: Definition 1.1 (cone K_mu), Property 1.1 (its dual is K_{1/mu}), Eq. (1.16), ERRATA 8 (truncation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from barchan.cones._checks import FloatArray, as_coefficient, as_vectors


def project_second_order_cone(x: ArrayLike, mu: ArrayLike) -> FloatArray:
    """Nearest point of K_mu = {x_N >= 0, |x_T| <= mu x_N}.

    Parameters
    ----------
    x : (..., s) vectors ordered (N; T...), s >= 2, any unit.
    mu : aperture >= 0, scalar or broadcastable to (...); 0 is a half-line, +inf the half-space N >= 0.

    Returns the projections, (..., s).
    Raises InputError on a negative or NaN `mu` or on shapes that do not fit.
    Source: seed B, Definition 1.1.
    """
    vectors = as_vectors("x", x)
    cosine, sine = face_direction(as_coefficient("mu", mu, vectors.shape[:-1]))
    return project_along_face(vectors, cosine, sine, 0.0)


def project_dual_cone(x: ArrayLike, mu: ArrayLike) -> FloatArray:
    """Nearest point of the dual cone K_mu* = {y : <y, z> >= 0 for every z in K_mu} = K_{1/mu}.

    Same arguments, errors and shapes as `project_second_order_cone`; `mu` = 0 gives the half-space and +inf
    the half-line. Source: seed B, Property 1.1.
    """
    vectors = as_vectors("x", x)
    cosine, sine = face_direction(as_coefficient("mu", mu, vectors.shape[:-1]))
    return project_along_face(vectors, sine, cosine, 0.0)


def project_polar_cone(x: ArrayLike, mu: ArrayLike) -> FloatArray:
    """Nearest point of the polar cone of K_mu, minus its dual, so that x = P_K(x) + P_polar(x) (Moreau).

    Same arguments, errors, shapes as `project_second_order_cone`. Source: seed B, Property 1.1, Theorem A.4.
    """
    return -project_dual_cone(-as_vectors("x", x), mu)


def project_truncated_cone(x: ArrayLike, mu: ArrayLike, shear_yield: ArrayLike) -> FloatArray:
    """Nearest point of the truncated cone T = {x_N >= 0, |x_T| <= shear_yield + mu x_N}.

    Parameters
    ----------
    x : (..., s) vectors ordered (N; T...), s >= 2.
    mu : aperture >= 0, scalar or broadcastable to (...); 0 is a half-cylinder, +inf the half-space N >= 0.
    shear_yield : radius of the disc at N = 0, in the unit of `x`, >= 0, scalar or broadcastable to (...).

    Returns the projections, (..., s).
    Raises InputError on a negative or NaN coefficient or on shapes that do not fit.
    Source: seed B, Eq. (1.16) with ERRATA 8.
    """
    vectors = as_vectors("x", x)
    cosine, sine = face_direction(as_coefficient("mu", mu, vectors.shape[:-1]))
    return project_along_face(
        vectors, cosine, sine, as_coefficient("shear_yield", shear_yield, vectors.shape[:-1])
    )


def face_direction(mu: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit direction (cosine, sine) = (1, mu) / sqrt(1 + mu^2) of the conical face, in the (N, |T|) plane.

    It stays finite for mu = 0 and mu = +inf, and exchanging its two components is taking the dual cone.
    """
    length = np.hypot(1.0, mu)
    with np.errstate(invalid="ignore"):
        return 1.0 / length, np.where(np.isinf(mu), 1.0, mu / length)


def project_along_face(
    x: FloatArray, cosine: FloatArray, sine: FloatArray, shear_yield: FloatArray | float
) -> FloatArray:
    """Unchecked projection of x (..., s) on the truncated cone whose face has the direction (cosine, sine).

    The set is a body of revolution, so the projection happens in the (N, |T|) half-plane, where four cases
    meet: inside; N < 0 under the disc, onto (0, T); beyond the rim, onto (0, shear_yield); else onto the
    conical face.
    NaN in a vector stays NaN in its projection: no solver may mistake it for an admissible point.
    """
    normal = x[..., 0]
    tangential_norm = np.linalg.norm(x[..., 1:], axis=-1)
    excess = tangential_norm - shear_yield
    inside = (normal >= 0.0) & (cosine * excess <= sine * normal)
    under_disc = (normal < 0.0) & (excess <= 0.0)
    # Abscissa of the nearest point on the line of the face, counted from the rim; negative values stop at the
    # rim.
    abscissa = np.maximum(cosine * normal + sine * excess, 0.0)
    kept = inside | under_disc
    radius = shear_yield + sine * abscissa
    shrinks = ~kept & ~(tangential_norm == 0.0)
    scale = np.divide(radius, tangential_norm, out=np.ones(normal.shape), where=shrinks)
    projected = np.empty_like(x)
    projected[..., 0] = np.where(inside, normal, np.where(under_disc, 0.0, cosine * abscissa))
    projected[..., 1:] = scale[..., np.newaxis] * x[..., 1:]
    return projected
