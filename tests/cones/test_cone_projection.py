"""Theorems of convex analysis on projections on cones and truncated cones (seed B, 1.1 and A.2)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan.cones import (
    project_dual_cone,
    project_polar_cone,
    project_second_order_cone,
    project_truncated_cone,
)
from barchan.errors import InputError

SIZES = (2, 3, 4, 6)
# Exact zeros matter, magnitudes whose squares underflow do not.
coordinates = st.floats(-10.0, 10.0).map(lambda value: value if abs(value) > 1e-9 else 0.0)
apertures = st.one_of(st.sampled_from([0.0, np.inf, 1.0]), st.floats(0.01, 20.0))
yields = st.one_of(st.just(0.0), st.floats(0.0, 5.0))


@st.composite
def vectors(draw, count: int = 1):
    """`count` vectors of one block size."""
    size = draw(st.sampled_from(SIZES))
    return [np.array(draw(st.lists(coordinates, min_size=size, max_size=size))) for _ in range(count)]


def is_in_truncated_cone(x, mu, shear_yield, slack=1e-12) -> bool:
    """Membership written from the definition (1.16); +inf is the half-space."""
    if x[0] < -slack:
        return False
    return bool(np.isinf(mu) or np.linalg.norm(x[1:]) <= shear_yield + mu * x[0] + slack * (1 + mu))


def admissible(x, mu, shear_yield):
    """Some point of the truncated cone built from x without any projection."""
    normal = abs(x[0])
    norm = np.linalg.norm(x[1:])
    limit = np.inf if np.isinf(mu) else shear_yield + mu * normal
    factor = 1.0 if norm <= limit else limit / norm
    return np.concatenate([[normal], factor * x[1:]])


@given(vectors(), apertures, yields)
def test_projection_is_admissible_and_idempotent(xs, mu, shear_yield) -> None:
    projected = project_truncated_cone(xs[0], mu, shear_yield)
    assert is_in_truncated_cone(projected, mu, shear_yield, slack=1e-13 * (1 + np.linalg.norm(xs[0])))
    np.testing.assert_allclose(
        project_truncated_cone(projected, mu, shear_yield), projected, rtol=0, atol=1e-13
    )


@given(vectors(count=2), apertures, yields)
def test_projection_is_the_nearest_point(xs, mu, shear_yield) -> None:
    """Variational inequality: <x - P x, y - P x> <= 0 for every admissible y."""
    x, y = xs[0], admissible(xs[1], mu, shear_yield)
    projected = project_truncated_cone(x, mu, shear_yield)
    assert (x - projected) @ (y - projected) <= 1e-11


@given(vectors(count=2), apertures, yields)
def test_projection_does_not_expand_distances(xs, mu, shear_yield) -> None:
    """Firm non-expansiveness: |P x - P y|^2 <= <P x - P y, x - y>."""
    x, y = xs
    difference = project_truncated_cone(x, mu, shear_yield) - project_truncated_cone(y, mu, shear_yield)
    assert difference @ difference <= difference @ (x - y) + 1e-11


@given(vectors(), apertures, yields)
def test_admissible_points_stay_where_they_are(xs, mu, shear_yield) -> None:
    inside = admissible(0.999 * xs[0], mu, shear_yield)
    np.testing.assert_allclose(project_truncated_cone(inside, mu, shear_yield), inside, rtol=0, atol=1e-14)


@given(vectors(), apertures)
def test_without_shear_yield_a_truncated_cone_is_the_second_order_cone(xs, mu) -> None:
    np.testing.assert_array_equal(
        project_truncated_cone(xs[0], mu, 0.0), project_second_order_cone(xs[0], mu)
    )


@given(vectors(), apertures)
def test_moreau_decomposition(xs, mu) -> None:
    """x is the orthogonal sum of its projections on the cone and on the polar cone."""
    x = xs[0]
    on_cone, on_polar = project_second_order_cone(x, mu), project_polar_cone(x, mu)
    np.testing.assert_allclose(on_cone + on_polar, x, rtol=0, atol=1e-13)
    assert abs(on_cone @ on_polar) <= 1e-11
    np.testing.assert_array_equal(on_polar, -project_dual_cone(-x, mu))


@given(vectors(), apertures)
def test_dual_cone_is_the_cone_of_inverse_aperture(xs, mu) -> None:
    """Property 1.1, with 1/0 = inf and 1/inf = 0."""
    inverse = 0.0 if np.isinf(mu) else (np.inf if mu == 0.0 else 1.0 / mu)
    expected = project_second_order_cone(xs[0], inverse)
    np.testing.assert_allclose(project_dual_cone(xs[0], mu), expected, rtol=0, atol=1e-13)


@given(vectors(count=2), apertures)
def test_dual_vectors_have_non_negative_products_and_are_all_of_them(xs, mu) -> None:
    """K* = {y : <y, z> >= 0 for all z in K}: always so in K*; outside, some z in K gives less."""
    z, y = project_second_order_cone(xs[0], mu), project_dual_cone(xs[1], mu)
    assert y @ z >= -1e-12
    outside_by = np.linalg.norm(xs[1] - y)
    witness = project_second_order_cone(-xs[1], mu)
    assert xs[1] @ witness <= -0.99 * outside_by**2 + 1e-12


@given(vectors(), st.floats(0.01, 20.0), st.floats(0.01, 100.0))
def test_projection_on_a_cone_is_homogeneous(xs, mu, factor) -> None:
    scaled = project_second_order_cone(factor * xs[0], mu)
    np.testing.assert_allclose(scaled, factor * project_second_order_cone(xs[0], mu), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        ((3.0, 0.0, 1.0), (3.0, 0.0, 1.0)),
        ((-2.0, 0.6, 0.8), (0.0, 0.6, 0.8)),
        ((-4.0, 0.0, 3.0), (0.0, 0.0, 2.0)),
        ((0.0, 0.0, 4.0), (1.0, 0.0, 3.0)),
        ((-1.0, 0.0, -4.0), (0.5, 0.0, -2.5)),
    ],
)
def test_each_face_of_the_truncated_cone(x, expected) -> None:
    """Inside, disc, rim and conical face (twice), by hand for mu = 1 and shear yield 2."""
    np.testing.assert_allclose(project_truncated_cone(np.array(x), 1.0, 2.0), expected, atol=1e-15)


def test_one_aperture_for_each_block() -> None:
    rng = np.random.default_rng(1)
    x, mu, shear_yield = rng.normal(size=(50, 6)), rng.uniform(0, 2, 50), rng.uniform(0, 1, 50)
    mu[:2] = 0.0, np.inf
    rows = [project_truncated_cone(x[i], mu[i], shear_yield[i]) for i in range(50)]
    np.testing.assert_array_equal(project_truncated_cone(x, mu, shear_yield), rows)
    rows = [project_dual_cone(x[i], mu[i]) for i in range(50)]
    np.testing.assert_array_equal(project_dual_cone(x, mu), rows)


@pytest.mark.parametrize("component", [0, 1, 2])
@pytest.mark.parametrize("x", [(1.0, 0.1, 0.2), (-1.0, 0.1, 0.2), (-1.0, 5.0, 0.2)])
def test_nan_is_never_projected_on_an_admissible_point(x, component) -> None:
    spoiled = np.array(x)
    spoiled[component] = np.nan
    assert np.isnan(project_truncated_cone(spoiled, 0.5, 1.0)).any()
    assert np.isnan(project_second_order_cone(spoiled, 0.5)).any()
    assert np.isnan(project_second_order_cone(spoiled, np.inf)).any()


@pytest.mark.parametrize("mu", [-0.1, np.nan, "rough", [0.1, 0.2]])
def test_bad_apertures_are_refused(mu) -> None:
    with pytest.raises(InputError, match=r"^mu = "):
        project_second_order_cone(np.ones(3), mu)
    with pytest.raises(InputError, match=r"^mu = "):
        project_polar_cone(np.ones(3), mu)


def test_other_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match=r"^shear_yield = .*non-negative"):
        project_truncated_cone(np.ones(3), 1.0, -1.0)
    for vector in (1.0, [1.0], ["a", "b"]):
        with pytest.raises(InputError, match=r"^x = "):
            project_second_order_cone(vector, 1.0)
