"""Coarse-graining functions integrate to one, and their integrals along branches are exact."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.coarse_graining import Gaussian, Heaviside, Lucy, share_beyond
from barchan.bodies.coarse_graining._kernels import along, slope, weight
from barchan.errors import InputError

KERNELS = (Lucy, Gaussian, Heaviside)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(80)


def radial(numbers, dimension: int) -> float:  # type: ignore[no-untyped-def]
    """Integral of the kernel over all directions and radii."""
    r = 0.5 * numbers[1] * (NODES + 1.0)
    sphere = {1: 2.0, 2: 2.0 * np.pi * r, 3: 4.0 * np.pi * r**2}[dimension]
    return float(0.5 * numbers[1] * WEIGHTS @ (np.array([weight(numbers, q) for q in r]) * sphere))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_a_kernel_integrates_to_one(kernel: type[Lucy], dimension: int) -> None:
    assert radial(kernel(0.7).numbers(dimension), dimension) == pytest.approx(1.0, abs=1e-12)


def test_the_lucy_function_is_that_of_the_seed() -> None:
    c, numbers = 1.3, Lucy(1.3).numbers(3)
    for q in (0.0, 0.2, 0.9, 0.999):
        seed = 105.0 / (16.0 * np.pi * c**3) * (-3.0 * q**4 + 8.0 * q**3 - 6.0 * q**2 + 1.0)
        assert weight(numbers, q * c) == pytest.approx(seed, rel=1e-9, abs=1e-12)
    assert weight(numbers, c) == 0.0


@pytest.mark.parametrize("kernel", [Lucy, Gaussian])
def test_the_slope_is_that_of_finite_differences(kernel: type[Lucy]) -> None:
    numbers = kernel(1.0).numbers(2)
    for r in (0.1, 0.5, 0.9):
        difference = (weight(numbers, r + 1e-6) - weight(numbers, r - 1e-6)) / 2e-6
        assert r * slope(numbers, r) == pytest.approx(difference, rel=1e-6)


vectors = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(KERNELS), vectors, vectors)
def test_the_integral_along_a_branch_is_exact(
    kernel: type[Lucy], place: np.ndarray, branch: np.ndarray
) -> None:
    numbers = kernel(0.8).numbers(3)
    # quadrature between the places where the branch enters and leaves the reach
    a, b, c = branch @ branch, 2.0 * place @ branch, place @ place - 0.64
    cuts = [0.0, 1.0]
    if a > 1e-12 and b * b > 4.0 * a * c:
        root = np.sqrt(b * b - 4.0 * a * c)
        cuts += [
            s for s in ((-b - root) / (2.0 * a), -b / (2.0 * a), (-b + root) / (2.0 * a)) if 0.0 < s < 1.0
        ]
    cuts.sort()
    total = 0.0
    for low, high in itertools.pairwise(cuts):
        s = low + 0.5 * (high - low) * (NODES + 1.0)
        values = [weight(numbers, float(np.linalg.norm(place + t * branch))) for t in s]
        total += 0.5 * (high - low) * float(WEIGHTS @ values)
    assert along(numbers, *place, *branch) == pytest.approx(total, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_shares_beyond_a_plane_go_from_one_to_nought_and_are_those_of_random_points(
    kernel: type[Lucy], dimension: int
) -> None:
    made, distances = kernel(0.8), np.array([-1.0, -0.8, -0.3, 0.0, 0.3, 0.8, 1.0])
    share = share_beyond(made, distances, dimension)
    np.testing.assert_allclose(share[[0, 1, 3, 5, 6]], [1.0, 1.0, 0.5, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(share + share[::-1], 1.0, atol=1e-7)
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (40_000, dimension))
    w = np.array([weight(made.numbers(dimension), float(r)) for r in np.linalg.norm(points, axis=1)])
    assert share[4] == pytest.approx(np.sum(w[points[:, 0] > 0.3]) / np.sum(w), abs=0.01)


def test_bad_reaches_are_named() -> None:
    for make in (lambda: Lucy(0.0), lambda: Gaussian(1.0, -1.0), lambda: Heaviside(np.inf)):
        with pytest.raises(InputError, match=r"kernel\."):
            make()
