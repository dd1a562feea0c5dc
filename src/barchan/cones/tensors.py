"""Symmetric tensors as cone vectors (the orthonormal map chi) and the friction coefficients of plasticity.

Seed B: Definition 6.1 and Properties 6.1-6.2 (chi), 0.3.2 (Mohr-Coulomb, Drucker-Prager), 1.3.2; ERRATA 1.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from barchan.cones._checks import FloatArray, as_numbers
from barchan.errors import InputError

Variant = Literal["circumscribed", "interpolated", "inscribed"]

_ROOT3 = float(np.sqrt(3.0))


def _chi_basis() -> dict[int, FloatArray]:
    """Orthonormal bases (s, d, d) of the symmetric tensors for <s, t> = s:t/2, the trace direction first."""
    plane = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]], dtype=np.float64)
    space = np.zeros((6, 3, 3))
    space[0] = np.sqrt(2.0 / 3.0) * np.eye(3)
    space[1] = np.diag([1.0, -1.0, 0.0])
    space[2] = np.diag([-1.0, -1.0, 2.0]) / _ROOT3
    for component, (row, column) in zip((3, 4, 5), ((0, 1), (0, 2), (1, 2)), strict=True):
        space[component, row, column] = space[component, column, row] = 1.0
    return {2: plane, 3: space}


_BASIS = _chi_basis()
_DIMENSION_OF_SIZE = {basis.shape[0]: dimension for dimension, basis in _BASIS.items()}


def tensor_block_size(d: int) -> int:
    """Number of components of a symmetric d x d tensor, 3 in 2D and 6 in 3D; InputError for another d."""
    return _basis(d).shape[0]


def chi(x: ArrayLike) -> FloatArray:
    """Symmetric tensors (..., d, d) of the cone vectors x (..., s), s = 3 (2D) or 6 (3D), in the unit of x.

    (a; b, c) -> a I + [[b, c], [c, -b]] in 2D and
    (a; b, c, d, e, f) -> sqrt(2/3) a I + [[b - c/sqrt3, d, e], [d, -b - c/sqrt3, f], [e, f, 2c/sqrt3]] in 3D:
    an isometry from the usual scalar product to <s, t> = s:t/2, with N = Tr/sqrt(2d) and T the deviator.
    Raises InputError when s is neither 3 nor 6. Source: seed B, Definition 6.1.
    """
    vectors = as_numbers("x", x)
    dimension = _DIMENSION_OF_SIZE.get(vectors.shape[-1]) if vectors.ndim else None
    if dimension is None:
        raise InputError("x", f"array of shape {vectors.shape}", "of shape (..., 3) in 2D or (..., 6) in 3D")
    basis = _BASIS[dimension]
    tensors: FloatArray = vectors @ basis.reshape(len(basis), -1)
    return tensors.reshape(*vectors.shape[:-1], dimension, dimension)


def chi_inverse(t: ArrayLike) -> FloatArray:
    """Cone vectors (..., s) of the tensors t (..., d, d), d = 2 or 3; the antisymmetric part of t is ignored.

    Inverse of `chi` on symmetric tensors and, for any tensor, its adjoint: x . chi_inverse(t) = chi(x):t/2.
    Raises InputError on another shape. Source: seed B, Definition 6.1 and Eq. (6.28).
    """
    tensors = as_numbers("t", t)
    if tensors.ndim < 2 or tensors.shape[-1] != tensors.shape[-2] or tensors.shape[-1] not in _BASIS:
        raise InputError("t", f"array of shape {tensors.shape}", "of shape (..., 2, 2) or (..., 3, 3)")
    basis = _BASIS[tensors.shape[-1]].reshape(-1, tensors.shape[-1] ** 2)
    flat = tensors.reshape(*tensors.shape[:-2], basis.shape[1])
    vectors: FloatArray = flat @ (0.5 * basis.T)
    return vectors


@overload
def normalised_friction(mu_hat: float, d: int) -> float: ...
@overload
def normalised_friction(mu_hat: FloatArray, d: int) -> FloatArray: ...
def normalised_friction(mu_hat: Any, d: int) -> Any:
    """Coefficient mu = sqrt(2/d) mu_hat of the cone coordinates, |T| <= mu N, from the physical one.

    `mu_hat` >= 0 bounds sqrt(J2) by mu_hat p, p = -Tr(sigma)/d; float or array, and so is the result.
    Raises InputError on a negative or NaN coefficient or on a d that is not 2 or 3.
    Source: ERRATA 1; seed B, 1.3.2.
    """
    _basis(d)
    return _like(mu_hat, np.sqrt(2.0 / d) * _non_negative("mu_hat", mu_hat))


@overload
def physical_friction(mu: float, d: int) -> float: ...
@overload
def physical_friction(mu: FloatArray, d: int) -> FloatArray: ...
def physical_friction(mu: Any, d: int) -> Any:
    """Coefficient mu_hat = sqrt(d/2) mu, the inverse of `normalised_friction`; same errors. ERRATA 1."""
    _basis(d)
    return _like(mu, np.sqrt(d / 2.0) * _non_negative("mu", mu))


@overload
def friction_from_angle(phi_radians: float, d: int, variant: Variant = ...) -> float: ...
@overload
def friction_from_angle(phi_radians: FloatArray, d: int, variant: Variant = ...) -> FloatArray: ...
def friction_from_angle(phi_radians: Any, d: int, variant: Variant = "circumscribed") -> Any:
    """Physical coefficient mu_hat of the Drucker-Prager cone that stands for a Mohr-Coulomb angle.

    Parameters
    ----------
    phi_radians : friction angle in [0, pi/2], radians, float or array (and so is the result).
    d : 2, where both surfaces coincide (mu_hat = sin phi) and `variant` changes nothing, or 3.
    variant : in 3D the cone is "circumscribed" to the Mohr-Coulomb hexagon (holds its outer vertices,
        triaxial compression), "interpolated" (holds its inner vertices, triaxial extension), or "inscribed".

    Raises InputError on an angle outside the range, another d or an unknown variant.
    Source: seed B, 0.3.2; ERRATA 1.
    """
    _require_variant(d, variant)
    angle = as_numbers("phi_radians", phi_radians)
    if not np.all((angle >= 0.0) & (angle <= np.pi / 2)):
        raise InputError("phi_radians", phi_radians, "an angle between 0 and pi/2 radians")
    sine = np.sin(angle)
    if d == 2:
        return _like(phi_radians, sine)
    if variant == "circumscribed":
        return _like(phi_radians, 2.0 * _ROOT3 * sine / (3.0 - sine))
    if variant == "interpolated":
        return _like(phi_radians, 2.0 * _ROOT3 * sine / (3.0 + sine))
    return _like(phi_radians, sine / np.sqrt(1.0 + sine**2 / 3.0))


@overload
def angle_from_friction(mu_hat: float, d: int, variant: Variant = ...) -> float: ...
@overload
def angle_from_friction(mu_hat: FloatArray, d: int, variant: Variant = ...) -> FloatArray: ...
def angle_from_friction(mu_hat: Any, d: int, variant: Variant = "circumscribed") -> Any:
    """Mohr-Coulomb angle (radians, in [0, pi/2]) of a physical coefficient: `friction_from_angle` inverted.

    `mu_hat` lies between 0 and its value at pi/2: 1 in 2D; in 3D sqrt(3) circumscribed, sqrt(3)/2 otherwise.
    Raises InputError outside that range, on another d or an unknown variant. Source: seed B, 0.3.2; ERRATA 1.
    """
    _require_variant(d, variant)
    coefficient = _non_negative("mu_hat", mu_hat)
    largest = friction_from_angle(np.pi / 2, d, variant)
    # One rounding step beyond the end of the range still is pi/2: round trips must not fail there.
    if not np.all(coefficient <= largest * (1.0 + 4.0 * np.finfo(np.float64).eps)):
        raise InputError("mu_hat", mu_hat, f"at most {largest:.6g}, its value for an angle of pi/2")
    if d == 2:
        sine = coefficient
    elif variant == "circumscribed":
        sine = 3.0 * coefficient / (2.0 * _ROOT3 + coefficient)
    elif variant == "interpolated":
        sine = 3.0 * coefficient / (2.0 * _ROOT3 - coefficient)
    else:
        sine = coefficient / np.sqrt(1.0 - coefficient**2 / 3.0)
    return _like(mu_hat, np.arcsin(np.minimum(sine, 1.0)))


def _basis(d: int) -> FloatArray:
    if d not in _BASIS:
        raise InputError("d", d, "2 or 3")
    return _BASIS[d]


def _require_variant(d: int, variant: str) -> None:
    _basis(d)
    if variant not in ("circumscribed", "interpolated", "inscribed"):
        raise InputError("variant", variant, "circumscribed, interpolated or inscribed")


def _non_negative(field: str, value: ArrayLike) -> FloatArray:
    numbers = as_numbers(field, value)
    if not np.all((numbers >= 0.0) & np.isfinite(numbers)):
        raise InputError(field, value, "non-negative and finite")
    return numbers


def _like(given: Any, result: FloatArray) -> float | FloatArray:
    """A float for a number, an array for an array."""
    return float(result) if np.ndim(given) == 0 else np.asarray(result)


@lru_cache(maxsize=2)
def strain_tensor(d: int) -> FloatArray:
    """(s, d, d): T with T[:, c, k] g_k = 2 chi^-1(sym(e_c (x) g)); the 2 makes up for <s, t> = s:t/2.

    Strain operators have blocks T g: a velocity along axis c whose shape function has the gradient g.
    """
    unit = np.eye(d)
    outer = np.einsum("ca,kb->ckab", unit, unit)
    symmetric = 0.5 * (outer + np.swapaxes(outer, -1, -2))
    tensor = np.ascontiguousarray(np.moveaxis(2.0 * chi_inverse(symmetric), -1, 0))
    return tensor
