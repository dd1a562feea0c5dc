"""Identities of the Jordan algebra of the second-order cone (seed B, 4.1.1 and B.1.1)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan.cones import (
    arrow_matrix,
    jordan_eigenvalues,
    jordan_hypotenuse,
    jordan_product,
    jordan_square_root,
)
from barchan.cones.jordan import hypotenuse_and_determinant, inverse_arrow_matrix
from barchan.errors import InputError

# Exact zeros matter, magnitudes whose squares underflow do not.
coordinates = st.floats(-3.0, 3.0).map(lambda value: value if abs(value) > 1e-9 else 0.0)


@st.composite
def vectors(draw, count: int):
    size = draw(st.sampled_from([2, 3, 5, 6]))
    return [np.array(draw(st.lists(coordinates, min_size=size, max_size=size))) for _ in range(count)]


def smallest_eigenvalue(x) -> float:
    return x[0] - np.linalg.norm(x[1:])


@given(vectors(3), st.floats(-2.0, 2.0))
def test_product_is_bilinear_commutative_and_has_a_unit(xs, factor) -> None:
    x, y, z = xs
    unit = np.eye(len(x))[0]
    np.testing.assert_array_equal(jordan_product(x, y), jordan_product(y, x))
    np.testing.assert_array_equal(jordan_product(x, unit), x)
    expected = jordan_product(x, z) + factor * jordan_product(y, z)
    np.testing.assert_allclose(jordan_product(x + factor * y, z), expected, atol=1e-12)


@given(vectors(2))
def test_jordan_identity(xs) -> None:
    """(x o y) o (x o x) = x o (y o (x o x)): what replaces associativity."""
    x, y = xs
    square = jordan_product(x, x)
    left = jordan_product(jordan_product(x, y), square)
    np.testing.assert_allclose(left, jordan_product(x, jordan_product(y, square)), atol=1e-11)


@given(vectors(3))
def test_product_is_associative_for_the_scalar_product(xs) -> None:
    """<x o y, z> = <y, x o z>: arrow matrices are symmetric."""
    x, y, z = xs
    assert jordan_product(x, y) @ z == pytest.approx(y @ jordan_product(x, z), abs=1e-11)


@given(vectors(1))
def test_squares_are_in_the_cone(xs) -> None:
    assert smallest_eigenvalue(jordan_product(xs[0], xs[0])) >= -1e-13


@given(vectors(1))
def test_square_of_the_root_is_the_vector_and_root_of_the_square_too(xs) -> None:
    x = xs[0].copy()
    x[0] = np.linalg.norm(x[1:]) + abs(x[0])
    root = jordan_square_root(x)
    assert smallest_eigenvalue(root) >= -1e-13
    np.testing.assert_allclose(jordan_product(root, root), x, atol=1e-13)
    np.testing.assert_allclose(jordan_square_root(jordan_product(x, x)), x, atol=2e-7)


@given(vectors(1))
def test_eigenvalues_are_those_of_the_arrow_matrix(xs) -> None:
    """L_x has the two eigenvalues of x and x_N, s - 2 times."""
    x = xs[0].copy()
    x[1] += 4.0
    direction = x[1:] / np.linalg.norm(x[1:])
    matrix, eigenvalues = arrow_matrix(x), jordan_eigenvalues(x)
    for eigenvalue, sign in zip(eigenvalues, (-1.0, 1.0), strict=True):
        eigenvector = np.concatenate([[1.0], sign * direction])
        np.testing.assert_allclose(matrix @ eigenvector, eigenvalue * eigenvector, atol=1e-13)
    across = np.zeros((len(x), len(x) - 1))
    across[1:] = np.eye(len(x) - 1) - np.outer(direction, direction)
    np.testing.assert_allclose(matrix @ across, x[0] * across, atol=1e-13)


@given(vectors(2))
def test_arrow_matrix_is_the_product_and_its_inverse_the_division(xs) -> None:
    x, y = xs
    np.testing.assert_allclose(arrow_matrix(x) @ y, jordan_product(x, y), atol=1e-13)
    z = x.copy()
    z[0] = np.linalg.norm(z[1:]) + 0.5
    determinant = np.prod(jordan_eigenvalues(z))
    inverse = inverse_arrow_matrix(z, np.asarray(determinant))
    np.testing.assert_allclose(inverse @ arrow_matrix(z), np.eye(len(z)), atol=1e-11)


@given(vectors(2))
def test_hypotenuse_squared_is_the_sum_of_squares(xs) -> None:
    x, y = xs
    z, determinant = hypotenuse_and_determinant(x, y)
    np.testing.assert_array_equal(z, jordan_hypotenuse(x, y))
    total = jordan_product(x, x) + jordan_product(y, y)
    np.testing.assert_allclose(jordan_product(z, z), total, atol=1e-12)
    assert smallest_eigenvalue(z) >= -1e-13
    assert determinant**2 == pytest.approx(np.prod(jordan_eigenvalues(total)), abs=1e-10)


@given(vectors(1), st.floats(0.1, 3.0), st.floats(0.1, 3.0))
def test_hypotenuse_keeps_its_digits_on_the_boundary_of_the_cone(xs, first, second) -> None:
    """Two boundary vectors of one ray add like the sides of a right angle, to all digits."""
    direction = xs[0].copy()
    direction[1] = 1.0
    direction[0] = np.linalg.norm(direction[1:])
    expected = np.hypot(first, second) * direction
    np.testing.assert_allclose(jordan_hypotenuse(first * direction, second * direction), expected, rtol=1e-13)


def test_zero_has_the_root_zero() -> None:
    np.testing.assert_array_equal(jordan_square_root(np.zeros(4)), np.zeros(4))
    np.testing.assert_array_equal(jordan_hypotenuse(np.zeros((2, 3)), np.zeros((2, 3))), np.zeros((2, 3)))


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="K_1"):
        jordan_square_root(np.array([1.0, 2.0, 0.0]))
    with pytest.raises(InputError, match=r"^y = "):
        jordan_product(np.ones(3), np.ones(2))
    with pytest.raises(InputError, match=r"s >= 2"):
        arrow_matrix([1.0])
