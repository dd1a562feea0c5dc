"""Inertial number, effective friction and the fit of mu(I) follow the conventions of the material they calibrate."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.bodies.coarse_graining import MuI, effective_friction, fit_mu_i, inertial_number, to_material
from barchan.errors import InputError
from barchan.flows.mpm.material import Material

NUMBERS = np.geomspace(0.003, 0.6, 12)


def test_simple_shear_has_half_its_velocity_gradient_and_the_ratio_of_its_stresses() -> None:
    gradient = np.array([[[0.0, 3.0], [0.0, 0.0]]])
    assert inertial_number(gradient, np.array([4.0]), 0.1, 9.0)[0] == pytest.approx(1.5 * 0.1 * 1.5)
    assert effective_friction(np.array([[[5.0, 2.0], [2.0, 5.0]]]))[0] == pytest.approx(0.4)
    # in space: sqrt(J2) / p of uniaxial stress is (1/sqrt(3)) s / (s/3)
    assert effective_friction(np.diag([0.0, 0.0, 2.0])[None])[0] == pytest.approx(np.sqrt(3.0))


def test_without_pressure_friction_is_unknown_and_the_inertial_number_without_bound() -> None:
    assert np.isnan(effective_friction(np.zeros((1, 2, 2))))[0]
    gradients = np.array([[[0.0, 1.0], [0.0, 0.0]], np.zeros((2, 2))])
    assert inertial_number(gradients, np.array([0.0, 1.0]), 1.0, 1.0).tolist() == [np.inf, 0.0]


def test_the_fit_finds_the_law_that_made_the_data_and_its_errors_are_honest() -> None:
    """Of 60 noisy samples, the true mu(I) lies within two standard errors of most fits."""
    truth = MuI(0.28, 0.75, 0.25, np.zeros((3, 3)))
    exact = fit_mu_i(NUMBERS, truth.friction(NUMBERS))
    np.testing.assert_allclose([exact.mu_s, exact.mu_2, exact.I_0], [0.28, 0.75, 0.25], rtol=1e-5)
    rng, inside = np.random.default_rng(0), 0
    for _ in range(60):
        noisy = truth.friction(NUMBERS) + rng.normal(0.0, 0.005, len(NUMBERS))
        law = fit_mu_i(NUMBERS, noisy, np.full(len(NUMBERS), 0.005))
        inside += int(abs(law.friction(0.1) - truth.friction(0.1)) < 2.0 * law.friction_error(0.1)[0])
    assert 50 <= inside <= 60
    assert np.all(law.errors > 0.0)
    assert law.friction_error(0.1)[0] < 0.005


def test_nearly_straight_data_leave_the_slope_known_and_the_reference_not() -> None:
    numbers = np.linspace(0.005, 0.1, 10)
    rng = np.random.default_rng(1)
    law = fit_mu_i(numbers, 0.26 + 1.9 * numbers + rng.normal(0.0, 0.002, 10), np.full(10, 0.002))
    assert law.errors[2] > 0.3 * law.I_0
    np.testing.assert_allclose(law.friction(numbers), 0.26 + 1.9 * numbers, atol=0.006)


def test_a_fitted_law_calibrates_the_continuum_with_the_same_friction() -> None:
    law = fit_mu_i(NUMBERS, MuI(0.3, 0.7, 0.3, np.zeros((3, 3))).friction(NUMBERS))
    material = Material(**to_material(law, 2500.0, 0.002, 0.6))
    rate, pressure = np.array([1.0, 20.0]), np.array([50.0, 300.0])
    numbers = rate * 0.002 * np.sqrt(2500.0 / pressure)
    np.testing.assert_allclose(material.friction_at(rate, pressure), law.friction(numbers), rtol=1e-12)
    assert material.max_volume_fraction == 0.6


@pytest.mark.parametrize(
    ("numbers", "friction", "errors", "field"),
    [
        ([0.1, 0.2, 0.3], [0.3, 0.3, 0.3], None, "inertial"),
        ([0.0, 0.1, 0.2, 0.3], [0.3] * 4, None, "inertial"),
        ([0.1, 0.1, 0.2, 0.2], [0.3] * 4, None, "inertial"),
        ([0.1, 0.2, 0.3, 0.4], [0.3] * 3, None, "friction"),
        ([0.1, 0.2, 0.3, 0.4], [0.3, np.nan, 0.3, 0.3], None, "friction"),
        ([0.1, 0.2, 0.3, 0.4], [0.3] * 4, [0.0] * 4, "errors"),
    ],
)
def test_bad_data_are_named(
    numbers: list[float], friction: list[float], errors: list[float] | None, field: str
) -> None:
    with pytest.raises(InputError) as caught:
        fit_mu_i(numbers, friction, errors)
    assert caught.value.field == field


def test_a_material_needs_a_volume_fraction() -> None:
    with pytest.raises(InputError, match="volume_fraction"):
        to_material(MuI(0.3, 0.5, 0.3, np.zeros((3, 3))), 2500.0, 0.001, 1.0)
