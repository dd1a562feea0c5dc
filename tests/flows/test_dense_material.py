"""Materials of dense flows: laws in cone coordinates, mu(I), viscosities, refused values (ERRATA 1; seed B, 0.3.3)."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.dense import Material, MuI, RateViscosity


@pytest.mark.parametrize("d", [2, 3])
def test_laws_bound_the_physical_stresses(d):
    """sqrt(J2) <= sigma_S + mu_hat (p + c) in the coordinates N = sqrt(d/2) p, |T| = sqrt(J2)."""
    law = Material(mu=0.6, bingham=0.1, tensile_yield=0.3, dilatancy=0.2).law_at(np.zeros((4, d)))
    p = 1.7
    normal = np.sqrt(d / 2.0) * p
    bound = law.shear_yield + law.mu * (normal + law.tensile_yield)
    assert bound == pytest.approx(np.full(4, 0.1 + 0.6 * (p + 0.3)))
    assert law.dilatancy / law.mu == pytest.approx(np.full(4, 1.0 / 3.0))


def test_fields_vary_in_space():
    points = np.random.default_rng(0).random((5, 2))
    law = Material(mu=lambda x: x[:, 0], bingham=lambda x: 2 * x[:, 1]).law_at(points)
    assert law.mu == pytest.approx(points[:, 0])
    assert law.shear_yield == pytest.approx(2 * points[:, 1])
    with pytest.raises(InputError, match=r"material\.bingham"):
        Material(bingham=lambda x: -x[:, 0]).law_at(points)
    with pytest.raises(InputError, match=r"material\.mu"):
        Material(mu=lambda x: x).law_at(points)
    with pytest.raises(InputError, match="dilatancy"):
        Material(mu=lambda x: x[:, 0], dilatancy=0.9).law_at(np.array([[0.5, 0.0]]))


def test_inertial_friction_runs_from_static_to_dynamic():
    law = MuI(0.3, 0.6, reference=0.4, grain_diameter=0.1)
    one = np.ones(1)
    assert law.at(0 * one, one, one) == pytest.approx(0.3)
    assert law.at(1e9 * one, one, one) == pytest.approx(0.6)
    # I = rate d / sqrt(p / rho) = reference gives the mean.
    assert law.at(4.0 * 2.0 * one, 4.0 * one, one) == pytest.approx(0.45)
    assert law.at(one, 0 * one, one) == pytest.approx(0.6)
    assert law.at(0 * one, 0 * one, one) == pytest.approx(0.3)
    rates = np.linspace(0.0, 50.0, 40)
    assert (np.diff(law.at(rates, np.ones(40), np.ones(40))) > 0.0).all()


def test_rate_viscosities_stay_within_their_bounds():
    law = RateViscosity(lambda rate: 1.0 / rate, smallest=0.1, largest=10.0)
    with np.errstate(divide="ignore"):
        assert law.at(np.array([0.0, 0.5, 1e9])) == pytest.approx([10.0, 2.0, 0.1])
    with pytest.raises(InputError, match="function"):
        RateViscosity(lambda rate: 1.0).at(np.ones(3))


def test_dimensionless_materials_are_those_of_the_numbers():
    material = Material.dimensionless(20.0, 0.3, mu=0.5)
    assert (material.viscosity, material.bingham, material.mu, material.density) == (0.05, 0.3, 0.5, 1.0)
    assert Material.dimensionless(np.inf).viscosity == 0.0


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Material(mu=-0.1), r"material\.mu"),
        (lambda: Material(bingham=-1.0), r"material\.bingham"),
        (lambda: Material(viscosity=np.inf), r"material\.viscosity"),
        (lambda: Material(mu=0.2, dilatancy=0.3), r"material\.dilatancy"),
        (lambda: Material(mu=MuI(0.2, 0.5), dilatancy=0.3), r"material\.dilatancy"),
        (lambda: Material(density="heavy"), r"material\.density"),
        (lambda: Material.dimensionless(0.0), "reynolds"),
        (lambda: Material.dimensionless(-1.0), "reynolds"),
        (lambda: Material.dimensionless(float("nan")), "reynolds"),
        (lambda: MuI(0.5, 0.4), "mu_dynamic"),
        (lambda: MuI(0.3, 0.4, reference=0.0), "reference"),
        (lambda: RateViscosity(3.0), "function"),
        (lambda: RateViscosity(lambda r: r, smallest=2.0, largest=1.0), "smallest"),
    ],
)
def test_values_out_of_range_are_refused_by_name(make, field):
    with pytest.raises(InputError, match=field):
        make()
