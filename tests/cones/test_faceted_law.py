"""The faceted law: its projection is nearest, its functions vanish exactly on it, with one tangent it is Coulomb's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barchan.cones import Coulomb, FacetedCoulomb
from barchan.cones._faceted_kernels import faceted_normal_of, faceted_residual_squared
from barchan.errors import InputError

seeds = st.integers(0, 2**31)
sizes = st.sampled_from([2, 3, 6])
frictions = st.one_of(st.just(0.0), st.floats(1e-3, 5.0))


def on_the_law(rng: np.random.Generator, n: int, s: int, mu: float) -> tuple[np.ndarray, np.ndarray]:
    """Random u, r (n, s) on the law: take-off in a third of the blocks, elsewhere each component sticks or slides."""
    r, u = rng.uniform(0.1, 2.0, (n, s)), np.zeros((n, s))
    bound = mu * r[:, :1]
    slides = rng.random((n, s - 1)) < 0.5
    signs = rng.choice([-1.0, 1.0], (n, s - 1))
    r[:, 1:] = np.where(slides, -signs, rng.uniform(-0.99, 0.99, (n, s - 1))) * bound
    u[:, 1:] = np.where(slides, signs * rng.uniform(0.1, 1.0, (n, s - 1)), 0.0)
    flies = rng.random(n) < 1 / 3
    r[flies], u[flies] = 0.0, rng.normal(size=(int(flies.sum()), s))
    u[flies, 0] = np.abs(u[flies, 0])
    return u, r


@given(seeds, sizes, frictions)
def test_the_projection_is_the_nearest_admissible_force(seed: int, s: int, mu: float) -> None:
    """Admissible, and no other admissible force makes an acute angle with the way to x: the definition for a convex set."""
    rng = np.random.default_rng(seed)
    law, x = FacetedCoulomb(mu), rng.normal(size=(20, s))
    p = law.project(x)
    assert (np.abs(p[:, 1:]) <= mu * p[:, :1] + 1e-12).all() and (p[:, 0] >= 0.0).all()
    others = rng.uniform(0.0, 3.0, (200, 1)) * np.column_stack(
        [np.ones(200), mu * rng.choice([-1.0, 0.3, 1.0], (200, s - 1))]
    )
    assert np.max((x - p) @ others.T) <= 1e-12  # in the polar cone, and
    np.testing.assert_allclose(np.sum((x - p) * p, axis=1), 0.0, atol=1e-12)  # orthogonal to the projection
    np.testing.assert_allclose([faceted_normal_of(row, mu) for row in x], p[:, 0], atol=1e-14)
    np.testing.assert_allclose(law.project(p), p, atol=1e-14)


@given(seeds, sizes, frictions, st.floats(0.1, 10.0))
def test_both_functions_vanish_on_the_law(seed: int, s: int, mu: float, rho: float) -> None:
    u, r = on_the_law(np.random.default_rng(seed), 30, s, mu)
    law = FacetedCoulomb(mu)
    np.testing.assert_allclose(law.natural_map(u, r, rho), 0.0, atol=1e-11)
    np.testing.assert_allclose(law.alart_curnier(u, r, rho), 0.0, atol=1e-11)


@given(seeds, st.floats(0.1, 2.0))
def test_neither_vanishes_off_the_law(seed: int, mu: float) -> None:
    """Each way to break the law, one at a time: pull, penetration, bond, too much friction, too little, along the slip."""
    rng = np.random.default_rng(seed)
    law, a = FacetedCoulomb(mu), rng.uniform(0.1, 1.0)
    broken = [
        ([0.0, 0.0, 0.0], [-a, 0.0, 0.0]),
        ([-a, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([a, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [1.0, mu + a, 0.0]),
        ([0.0, a, 0.0], [1.0, -0.5 * mu, 0.0]),
        ([0.0, a, a], [1.0, -mu, mu]),
    ]
    for u, r in broken:
        pair = np.array([u]), np.array([r])
        assert np.linalg.norm(law.natural_map(*pair, 1.0)) > 0.01
        assert np.linalg.norm(law.alart_curnier(*pair, 1.0)) > 0.01


@given(seeds, sizes, frictions)
def test_the_kernel_computes_the_natural_map(seed: int, s: int, mu: float) -> None:
    rng = np.random.default_rng(seed)
    u, r = rng.normal(size=(2, 20, s))
    expected = np.sum(FacetedCoulomb(mu).natural_map(u, r, 0.7) ** 2, axis=1)
    found = [faceted_residual_squared(r[i], u[i], mu, 0.7, np.empty(s)) for i in range(20)]
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-20)


@given(seeds, frictions)
def test_with_one_tangential_component_it_is_coulombs(seed: int, mu: float) -> None:
    u, r = np.random.default_rng(seed).normal(size=(2, 20, 2))
    faceted, exact = FacetedCoulomb(mu), Coulomb(mu)
    np.testing.assert_allclose(faceted.project(r), exact.project(r), atol=1e-14)
    for name in ("natural_map", "alart_curnier"):
        np.testing.assert_allclose(
            getattr(faceted, name)(u, r, 0.5), getattr(exact, name)(u, r, 0.5), atol=1e-13
        )


def test_friction_grows_with_the_number_of_components_that_slide() -> None:
    """The artefact: sliding along q axes at once is resisted by sqrt(q) mu, whatever the exact law says."""
    for q in range(1, 6):
        u = np.zeros((1, 6))
        u[0, 1 : 1 + q] = 1.0
        r = np.zeros((1, 6))
        r[0, 0], r[0, 1 : 1 + q] = 1.0, -0.4
        np.testing.assert_allclose(FacetedCoulomb(0.4).natural_map(u, r, 1.0), 0.0, atol=1e-14)
        assert np.linalg.norm(r[0, 1:]) == pytest.approx(np.sqrt(q) * 0.4)


def test_extreme_coefficients_and_values_are_projected_without_overflow() -> None:
    x = np.array([[-1.0, 3.0, 4.0], [2.0, -1.0, 0.5]])
    np.testing.assert_allclose(
        FacetedCoulomb(1e200).project(x), [[0.0, 3.0, 4.0], [2.0, -1.0, 0.5]], atol=1e-12
    )
    np.testing.assert_array_equal(FacetedCoulomb(0.0).project(x), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert np.isnan(FacetedCoulomb(0.5).project(np.array([[np.nan, 1.0, 1.0]]))).any()
    assert np.isnan(faceted_normal_of(np.array([np.nan, 1.0]), 0.5))


def test_it_is_a_law_like_the_others() -> None:
    law = FacetedCoulomb([0.1, 0.2, 0.3])
    assert law.count == 3 and law.take([2]) == FacetedCoulomb([0.3]) and law != Coulomb([0.1, 0.2, 0.3])
    assert law.parameters(3).tolist() == [[0.1, 0, 0, 0], [0.2, 0, 0, 0], [0.3, 0, 0, 0]]
    assert not hasattr(law, "convexified") and not hasattr(law, "fischer_burmeister")
    with pytest.raises(InputError, match="mu"):
        FacetedCoulomb(-0.1)
