"""The Jordan algebra whose squares fill the second-order cone K_1: product, spectrum, roots, arrow matrices.

Seed B, section 4.1.1, Eqs. (4.1), (4.4), (4.5), and B.1.1; vectors (..., s) are ordered (N; T...), s >= 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from barchan.cones._checks import FloatArray, as_vectors, require_same_shape
from barchan.errors import InputError

# A vector this close to K_1 (relative to |x|) is rounding away from it; farther out it has no square root.
_MEMBERSHIP_TOLERANCE = 1e-12


def jordan_product(x: ArrayLike, y: ArrayLike) -> FloatArray:
    """x o y = (x . y ; x_N y_T + y_N x_T), commutative but not associative, with unit (1; 0).

    `x`, `y` : (..., s) of the same shape, which the result has too.
    Raises InputError on shapes that do not fit. Source: seed B, 4.1.1.
    """
    left, right = _pair(x, y)
    product = np.empty_like(left)
    product[..., 0] = np.sum(left * right, axis=-1)
    product[..., 1:] = left[..., :1] * right[..., 1:] + right[..., :1] * left[..., 1:]
    return product


def jordan_eigenvalues(x: ArrayLike) -> FloatArray:
    """Eigenvalues (x_N - |x_T|, x_N + |x_T|) of x (..., s), as (..., 2); x is in K_1 when the first is >= 0.

    Raises InputError when s < 2. Source: seed B, Eq. (4.4).
    """
    vectors = as_vectors("x", x)
    tangential_norm = np.linalg.norm(vectors[..., 1:], axis=-1)
    return np.stack([vectors[..., 0] - tangential_norm, vectors[..., 0] + tangential_norm], axis=-1)


def jordan_square_root(x: ArrayLike) -> FloatArray:
    """The unique z in K_1 with z o z = x, for x in K_1, (..., s) to (..., s).

    z_N is the mean of the roots of the eigenvalues; 2 z_N z_T = x_T then gives z_T without a direction.
    Raises InputError when a vector is outside K_1 by more than rounding. Source: seed B, Eqs. (4.4)-(4.5).
    """
    vectors = as_vectors("x", x)
    eigenvalues = jordan_eigenvalues(vectors)
    if np.any(eigenvalues[..., 0] < -_MEMBERSHIP_TOLERANCE * np.linalg.norm(vectors, axis=-1)):
        raise InputError("x", x, "in the cone K_1 (x_N >= |x_T|) to have a Jordan square root")
    normal = np.sqrt(np.maximum(eigenvalues, 0.0)).mean(axis=-1)
    return _with_tangential_part(normal, 0.5 * vectors[..., 1:])


def jordan_hypotenuse(x: ArrayLike, y: ArrayLike) -> FloatArray:
    """(x o x + y o y)^(1/2), the root in the Fischer-Burmeister function, for x, y (..., s) of one shape.

    Exact to rounding even when the sum of squares is on the boundary of K_1, where squaring first would leave
    half of the digits. Raises InputError on shapes that do not fit. Source: seed B, Eq. (4.1) and B.1.1.
    """
    left, right = _pair(x, y)
    return hypotenuse_and_determinant(left, right)[0]


def hypotenuse_and_determinant(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """z = (x o x + y o y)^(1/2), (..., s), and det z = z_N^2 - |z_T|^2 >= 0, (...), unchecked.

    With w = x_N x_T + y_N y_T and a = |x|^2 + |y|^2 the eigenvalues of z o z are a -+ 2|w| (seed B, B.1.1).
    Lagrange's identity turns their product det^2 into a sum of squares,
    (x_N^2 - |x_T|^2 + y_N^2 - |y_T|^2)^2 + 4 |x_N y_T - y_N x_T|^2, without the cancellation of a - 2|w|;
    the small eigenvalue follows from it and the large one.
    """
    half_sum = x[..., :1] * x[..., 1:] + y[..., :1] * y[..., 1:]
    crossed = x[..., :1] * y[..., 1:] - y[..., :1] * x[..., 1:]
    determinant = np.hypot(_signed_square(x) + _signed_square(y), 2.0 * np.linalg.norm(crossed, axis=-1))
    total = np.sum(x * x + y * y, axis=-1)
    large_root = np.sqrt(total + 2.0 * np.linalg.norm(half_sum, axis=-1))
    small_root = np.divide(determinant, large_root, out=np.zeros_like(large_root), where=large_root != 0.0)
    return _with_tangential_part(0.5 * (large_root + small_root), half_sum), determinant


def arrow_matrix(x: ArrayLike) -> FloatArray:
    """Matrix L_x of the product by x, L_x y = x o y: (..., s) to (..., s, s). Raises InputError when s < 2.

    Its eigenvalues are those of x (once each) and x_N (s - 2 times). Source: seed B, B.1.1.
    """
    vectors = as_vectors("x", x)
    size = vectors.shape[-1]
    matrix = vectors[..., :1, np.newaxis] * np.eye(size)
    matrix[..., 0, 1:] = vectors[..., 1:]
    matrix[..., 1:, 0] = vectors[..., 1:]
    return matrix


def inverse_arrow_matrix(z: FloatArray, determinant: FloatArray) -> FloatArray:
    """Inverse of L_z, (..., s, s), from z (..., s) in the interior of K_1 and det z (...), unchecked.

    L_z^{-1} = [[z_N, -z_T'], [-z_T, (det I + z_T z_T') / z_N]] / det. It is not the arrow matrix of the
    Jordan inverse of z, although seed B, B.1.1 writes it L_{z^-1}.
    """
    tangential = z[..., 1:]
    over_determinant = 1.0 / determinant[..., np.newaxis]
    over_normal = 1.0 / z[..., :1]
    inverse = np.empty((*z.shape, z.shape[-1]))
    inverse[..., 0, 0] = z[..., 0] * over_determinant[..., 0]
    inverse[..., 0, 1:] = -tangential * over_determinant
    inverse[..., 1:, 0] = inverse[..., 0, 1:]
    outer = tangential[..., :, np.newaxis] * (tangential * over_normal * over_determinant)[..., np.newaxis, :]
    inverse[..., 1:, 1:] = over_normal[..., np.newaxis] * np.eye(z.shape[-1] - 1) + outer
    return inverse


def _pair(x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    left, right = as_vectors("x", x), as_vectors("y", y)
    require_same_shape("y", right, left, "x")
    return left, right


def _signed_square(x: FloatArray) -> FloatArray:
    """x_N^2 - |x_T|^2 (...), factored so that it vanishes to rounding on the boundary of the cone."""
    tangential_norm = np.linalg.norm(x[..., 1:], axis=-1)
    return (x[..., 0] - tangential_norm) * (x[..., 0] + tangential_norm)


def _with_tangential_part(normal: FloatArray, half_product: FloatArray) -> FloatArray:
    """(z_N ; half_product / z_N), with T = 0 where z_N = 0, which in K_1 forces the whole vector to 0."""
    root = np.zeros((*half_product.shape[:-1], half_product.shape[-1] + 1))
    root[..., 0] = normal
    divisor = normal[..., np.newaxis]
    np.divide(half_product, divisor, out=root[..., 1:], where=divisor != 0.0)
    return root
