"""The complementarity functions vanish exactly on the disjunctive laws (1.1), (1.20) of seed B.

Pairs (u, r) on the law are built from its cases, and `violation` measures how far any pair is from them;
neither knows a projection, a change of variable or a Jordan product.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.cones._kernels import natural_map_residual_squared, project_block
from barchan.cones.jordan import hypotenuse_and_determinant
from barchan.errors import InputError

SIZES = (2, 3, 4, 6)
# Exact zeros matter, magnitudes whose squares underflow do not.
coordinates = st.floats(-3.0, 3.0).map(lambda value: value if abs(value) > 1e-9 else 0.0)
CASES = ("separated", "sheared apart", "stuck", "sliding")


class Block(NamedTuple):
    mu: float
    shear_yield: float
    tensile_yield: float
    dilatancy: float
    rho: float

    @property
    def law(self) -> DruckerPrager:
        return DruckerPrager(self.mu, self.shear_yield, self.tensile_yield, self.dilatancy)


@st.composite
def blocks(draw, cone: bool = False):
    """Coefficients of one block; `cone` leaves the shear yield out."""
    zero_or = lambda low, high: st.one_of(st.just(0.0), st.floats(low, high))  # noqa: E731
    mu = draw(zero_or(0.05, 3.0))
    shear_yield = 0.0 if cone else draw(zero_or(0.05, 2.0))
    dilatancy = mu * draw(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0)))
    return Block(mu, shear_yield, draw(zero_or(0.05, 2.0)), dilatancy, draw(st.floats(0.1, 10.0)))


@st.composite
def vectors(draw, count: int):
    size = draw(st.sampled_from(SIZES))
    return [np.array(draw(st.lists(coordinates, min_size=size, max_size=size))) for _ in range(count)]


def pair_on_law(case: str, block: Block, seeds) -> tuple[np.ndarray, np.ndarray]:
    """A pair (u, r) of one case of the law (1.20), from two arbitrary vectors."""
    u, r = np.zeros_like(seeds[0]), np.zeros_like(seeds[1])
    slip = seeds[0][1:]
    speed = np.linalg.norm(slip)
    direction = slip / speed if speed else np.eye(len(slip))[0]
    pressure = abs(seeds[1][0])
    if case == "separated":
        u[0] = abs(seeds[0][0])
        r[1:] = bounded(seeds[1][1:], block.shear_yield)
    elif case == "sheared apart":
        u[0] = block.dilatancy * speed + abs(seeds[0][0])
        u[1:] = slip
        r[1:] = -block.shear_yield * direction
    elif case == "stuck":
        r[0] = pressure
        r[1:] = bounded(seeds[1][1:], block.shear_yield + block.mu * pressure)
    elif case == "sliding":
        u[0] = block.dilatancy * speed
        u[1:] = slip
        r[0] = pressure
        r[1:] = -(block.shear_yield + block.mu * pressure) * direction
    r[0] -= block.tensile_yield
    return u, r


def bounded(vector, radius: float):
    length = np.linalg.norm(vector)
    return vector if length <= radius else vector * (radius / length)


def violation(u, r, block: Block) -> float:
    """How far (u, r) is from satisfying (1.20): the largest defect of its equations and inequalities."""
    pressure = r[0] + block.tensile_yield
    speed = np.linalg.norm(u[1:])
    opening = u[0] - block.dilatancy * speed
    strength = block.shear_yield + block.mu * max(pressure, 0.0)
    return max(
        -pressure,
        -opening,
        min(pressure, opening),
        np.linalg.norm(r[1:]) - strength,
        np.linalg.norm(speed * r[1:] + strength * u[1:]) / 10.0,
    )


def functions(block: Block):
    names = ["natural_map", "alart_curnier"]
    return [getattr(block.law, name) for name in names + ["fischer_burmeister"] * (block.shear_yield == 0)]


@pytest.mark.parametrize("case", CASES)
@given(block=blocks(), seeds=vectors(2))
def test_every_function_vanishes_on_the_law(case, block, seeds) -> None:
    u, r = pair_on_law(case, block, seeds)
    assert violation(u, r, block) <= 1e-12
    for function in functions(block):
        assert np.abs(function(u[None], r[None], block.rho)).max() <= 1e-11 * max(1.0, block.rho)


@given(block=blocks(), pair=vectors(2))
def test_no_function_vanishes_off_the_law(block, pair) -> None:
    u, r = pair
    for function in functions(block):
        value = np.linalg.norm(function(u[None], r[None], block.rho))
        assert value >= 2e-3 * violation(u, r, block) - 1e-15


@pytest.mark.parametrize("case", CASES)
@given(block=blocks(), seeds=vectors(4))
def test_leaving_the_law_is_seen(case, block, seeds) -> None:
    """A small push off the law, in u or in r, makes every function non-zero in proportion."""
    u, r = pair_on_law(case, block, seeds[:2])
    for push_u, push_r in ((0.01 * seeds[2], 0.0), (0.0, 0.01 * seeds[3])):
        pushed = u + push_u, r + push_r
        for function in functions(block):
            value = np.linalg.norm(function(pushed[0][None], pushed[1][None], block.rho))
            assert value >= 2e-3 * violation(*pushed, block) - 1e-15


@given(block=blocks(cone=True), pair=vectors(2))
def test_convexified_law_is_complementarity_of_dual_cones(block, pair) -> None:
    """With dilatancy mu there is no shift and the natural map vanishes for u in K*, r in K, u . r = 0."""
    law = SecondOrderCone(block.mu)
    u, force = pair
    on_cone = law.project(force[None])[0]
    complement = on_cone - force
    assert not law.shift(u[None]).any()
    for name in ("natural_map", "alart_curnier", "fischer_burmeister"):
        value = getattr(law, name)(complement[None], on_cone[None], block.rho)
        assert np.abs(value).max() <= 1e-11 * max(1.0, block.rho)


@given(block=blocks(), pair=vectors(2))
def test_de_saxce_shift_is_normal_and_proportional_to_the_slip(block, pair) -> None:
    u = pair[0]
    expected = np.zeros_like(u)
    expected[0] = (block.mu - block.dilatancy) * np.linalg.norm(u[1:])
    np.testing.assert_allclose(block.law.shift(u[None])[0], expected, rtol=1e-14)


def finite_difference(function, x, step=1e-5):
    """Central differences of a function of one block, with Richardson's extrapolation (error in step^4)."""
    columns = []
    for direction in np.eye(len(x)):
        slopes = [
            (function(x + h * direction) - function(x - h * direction)) / (2 * h) for h in (step, 2 * step)
        ]
        columns.append((4 * slopes[0] - slopes[1]) / 3)
    return np.array(columns).T


@pytest.mark.parametrize("size", [2, 3, 6])
@pytest.mark.parametrize(
    "coefficients", [(0.4, 0.0, 0.0), (1.0, 0.0, 0.0), (0.7, 0.3, 0.2), (0.8, 0.0, 0.8), (0.0, 0.0, 0.0)]
)
def test_jacobian_is_the_derivative_at_smooth_points(size, coefficients) -> None:
    mu, tension, dilatancy = coefficients
    law = DruckerPrager(mu, 0.0, tension, dilatancy)
    rng = np.random.default_rng(size)
    u, r = rng.normal(size=(2, 40, size))
    u[:, 1] += np.sign(u[:, 1])
    rho = rng.uniform(0.2, 3.0, 40)
    jacobian_u, jacobian_r = law.fischer_burmeister_jacobian(u, r, rho)
    assert jacobian_u.shape == jacobian_r.shape == (40, size, size)
    for i in range(40):
        single = lambda v, f: law.fischer_burmeister(v[None], f[None], rho[i])[0]  # noqa: B023, E731
        expected_u = finite_difference(lambda v: single(v, r[i]), u[i])  # noqa: B023
        expected_r = finite_difference(lambda f: single(u[i], f), r[i])  # noqa: B023
        for actual, expected in ((jacobian_u[i], expected_u), (jacobian_r[i], expected_r)):
            assert np.linalg.norm(actual - expected) <= 1e-6 * np.linalg.norm(expected)


@given(block=blocks(cone=True), pair=vectors(2))
def test_jacobian_derives_the_function_wherever_it_is_smooth(block, pair) -> None:
    """The same on points hypothesis looks for, frictionless and almost singular ones included."""
    u, r = pair
    hat_u = block.rho * np.concatenate([[u[0]], block.mu * u[1:]])
    hat_u[0] += block.rho * (block.mu - block.dilatancy) * np.linalg.norm(u[1:])
    hat_r = np.concatenate([[block.mu * (r[0] + block.tensile_yield)], r[1:]])
    root, determinant = hypotenuse_and_determinant(hat_u, hat_r)
    if block.mu == 0.0:
        assume(np.hypot(u[0], r[0] + block.tensile_yield) > 0.1)
    else:
        assume(np.linalg.norm(u[1:]) > 0.1 and determinant > 0.1 * max(1.0, root @ root))
    law = block.law
    jacobian_u, jacobian_r = law.fischer_burmeister_jacobian(u[None], r[None], block.rho)
    expected_u = finite_difference(lambda v: law.fischer_burmeister(v[None], r[None], block.rho)[0], u)
    expected_r = finite_difference(lambda f: law.fischer_burmeister(u[None], f[None], block.rho)[0], r)
    np.testing.assert_allclose(jacobian_u[0], expected_u, atol=1e-6 * (1 + np.abs(expected_u).max()))
    np.testing.assert_allclose(jacobian_r[0], expected_r, atol=1e-6 * (1 + np.abs(expected_r).max()))


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_jacobian_is_finite_and_bounded_at_the_kinks(mu) -> None:
    """Nothing moves; r on the boundary with u = 0 (z on the boundary of K_1); no slip."""
    u = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]])
    r = np.array([[0.0, 0, 0], [2, 0, 2 * mu], [2, 0, mu], [0, 0, 0]])
    for jacobian in Coulomb(mu).fischer_burmeister_jacobian(u, r, 1.0):
        assert np.all(np.isfinite(jacobian))
        assert np.all(np.linalg.norm(jacobian, 2, axis=(1, 2)) <= 4.0)


@given(factor=st.floats(0.1, 5.0), mu=st.floats(0.1, 2.0))
def test_kink_value_on_the_boundary_is_a_limit_of_jacobians(factor, mu) -> None:
    """At u = 0 and r on the boundary, the derivative along r is that of points inside the cone: 0."""
    r = factor * np.array([[1.0, 0.6 * mu, 0.8 * mu]])
    _, jacobian_r = Coulomb(mu).fischer_burmeister_jacobian(np.zeros((1, 3)), r, 1.0)
    np.testing.assert_allclose(jacobian_r[0] @ r[0], 0.0, atol=1e-12)


@given(block=blocks(), pair=vectors(2))
def test_kernels_are_the_same_mathematics(block, pair) -> None:
    u, r = pair
    mu, shear_yield, tensile_yield, dilatancy, rho = block
    projected = np.empty_like(r)
    project_block(r, mu, shear_yield, tensile_yield, projected)
    np.testing.assert_allclose(projected, block.law.project(r[None])[0], rtol=0, atol=1e-14)
    in_place = r.copy()
    project_block(in_place, mu, shear_yield, tensile_yield, in_place)
    np.testing.assert_array_equal(in_place, projected)
    residual = natural_map_residual_squared(r, u, mu, shear_yield, tensile_yield, dilatancy, rho)
    expected = np.sum(block.law.natural_map(u[None], r[None], rho) ** 2)
    assert residual == pytest.approx(expected, rel=1e-10, abs=1e-20)


def test_kernel_projects_on_the_half_space_for_infinite_friction() -> None:
    out = np.empty(3)
    for mu in (np.inf, 1e200):
        project_block(np.array([-1.0, 2.0, 3.0]), mu, 0.0, 0.0, out)
        assert out.tolist() == [0.0, 2.0, 3.0]
        project_block(np.array([1.0, 2.0, 3.0]), mu, 0.0, 0.0, out)
        assert out.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("where", ["u", "r"])
@pytest.mark.parametrize("component", [0, 1])
def test_nan_never_passes_for_a_solution(where, component) -> None:
    for r in ((1.0, 0.1, 0.2), (-2.0, 0.1, 0.2), (0.0, 0.0, 0.0)):
        pair = {"u": np.zeros((1, 3)), "r": np.array([r])}
        pair[where][0, component] = np.nan
        law = DruckerPrager(0.5, 1.0)
        assert np.isnan(law.natural_map(**pair, rho=1.0)).any()
        assert np.isnan(law.alart_curnier(**pair, rho=1.0)).any()
        assert np.isnan(Coulomb(0.5).fischer_burmeister(**pair, rho=1.0)).any()
        assert np.isnan(natural_map_residual_squared(pair["r"][0], pair["u"][0], 0.5, 1.0, 0.0, 0.0, 1.0))


def test_fischer_burmeister_needs_a_cone() -> None:
    for call in ("fischer_burmeister", "fischer_burmeister_jacobian"):
        with pytest.raises(InputError, match=r"^shear_yield = .*self-dual"):
            getattr(DruckerPrager(0.5, shear_yield=[0.0, 1.0]), call)(np.ones((2, 3)), np.ones((2, 3)), 1.0)
