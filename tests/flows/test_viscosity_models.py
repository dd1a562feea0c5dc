"""Viscosity models: derivatives against differences, limits between models, the seed's numbers, refusals (seed C, 3.4)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.flows.quasi_newtonian.models import (
    Bingham,
    HerschelBulkley,
    ModifiedPoliquen,
    Newtonian,
    Poliquen,
    PowerLaw,
    Schaeffer,
    Tardos,
    UserModel,
    check_derivatives,
)
from barchan.flows.quasi_newtonian.temperature import Arrhenius, WilliamsLandelFerry, WithTemperature

COUETTE = {
    "alpha": 0.15,
    "beta": 0.27,
    "delta": 0.06,
    "grain_diameter": 1e-3,
    "density": 1.0,
}
"""Seed C, 6.2.2: the constants of the Couette flow, made dimensionless with the density; P = 0.99133."""

sizes = st.floats(1e-3, 1e3)
exponents = st.floats(1.0, 4.0)
angles = st.floats(1.0, 89.0)
epsilons = st.floats(1e-5, 1.0)
frictions = {
    "alpha": st.floats(0.0, 1.0),
    "beta": st.floats(0.01, 1.0),
    "delta": st.floats(0.01, 1.0),
    "grain_diameter": st.floats(1e-4, 1.0),
    "density": st.floats(0.1, 3e3),
    "eps": epsilons,
}
every_model = st.one_of(
    st.builds(Newtonian, sizes, eps=epsilons),
    st.builds(PowerLaw, sizes, exponents, eps=epsilons),
    st.builds(Bingham, sizes, sizes, eps=epsilons),
    st.builds(HerschelBulkley, sizes, exponents, sizes, eps=epsilons),
    st.builds(Schaeffer, angles, eps=epsilons),
    st.builds(Tardos, angles, st.floats(0.0, 2.0), st.floats(0.1, 2.0), eps=epsilons),
    st.builds(Poliquen, **frictions),
    st.builds(ModifiedPoliquen, **frictions, pressure=st.floats(0.1, 1e4)),
    st.builds(
        lambda model, theta: WithTemperature(model, Arrhenius(2e3), theta),
        st.builds(Poliquen, **frictions),
        st.floats(200.0, 500.0),
    ),
    st.builds(
        lambda model, theta: WithTemperature(model, WilliamsLandelFerry(3.0, 50.0, 300.0), theta),
        st.builds(Bingham, sizes, sizes, eps=epsilons),
        st.floats(270.0, 400.0),
    ),
)


@settings(max_examples=150, deadline=None)
@given(every_model)
def test_derivatives_are_those_of_the_viscosity(model):
    """d eta/d s and d eta/d p agree with central differences to 1e-7; without pressure dependence the second is 0."""
    assert max(check_derivatives(model)) < 1e-7
    s, p = np.geomspace(1e-4, 1e4, 9), np.geomspace(1e-2, 1e4, 9)
    changed = np.any(model.viscosity(s, p) != model.viscosity(s, 2.0 * p))
    assert changed == model.uses_pressure
    assert np.any(model.derivatives(s, p)[1] != 0.0) == model.uses_pressure


@settings(max_examples=80, deadline=None)
@given(every_model, st.floats(1e-2, 1e4))
def test_faster_shear_takes_more_stress(model, pressure):
    """|sigma| = 2 eta |g| grows with |g|: the regularised problems are monotone."""
    rate = np.geomspace(1e-4, 1e4, 200)
    stress = 2.0 * model.viscosity(rate**2 + model.eps**2, np.full(200, pressure)) * rate
    assert np.all(np.diff(stress) >= -1e-12 * stress[1:])


@settings(max_examples=60, deadline=None)
@given(every_model, st.floats(1e-2, 1e4))
def test_plastic_stress_without_viscous_part_is_the_yield_stress(model, pressure):
    """As eps and |g| go to 0, |g| >> eps, |sigma| less its viscous part goes to sqrt(2) tau_y."""
    tau_y = model.yield_stress(np.array([pressure]))
    slow = model.with_eps(1e-12)
    exponent = getattr(model, "exponent", 2.0)
    if tau_y is None:
        return
    rate = np.array([1e-9])
    stress = 2.0 * slow.viscosity(rate**2 + slow.eps**2, np.array([pressure])) * rate
    viscous = 2.0 * getattr(model, "consistency", 0.0) * rate ** (exponent - 1.0)
    if isinstance(model, Tardos):
        phi = math.radians(model.angle)
        viscous = math.sqrt(2.0) * pressure * model.b * math.cos(phi) * rate**model.n
    # The regularisation takes half a millionth of the stress.
    slack = 5e-4 + 1e-5 * float(stress[0])
    assert stress - viscous == pytest.approx(math.sqrt(2.0) * tau_y, rel=1e-3, abs=slack)


@given(sizes, sizes, epsilons, exponents)
def test_models_contain_each_other(one, two, eps, exponent):
    s, p = np.geomspace(1e-6, 1e6, 30), np.linspace(-1.0, 3.0, 30)

    def same(a, b):
        assert a.viscosity(s, p) == pytest.approx(b.viscosity(s, p), rel=1e-12)
        for x, y in zip(a.derivatives(s, p), b.derivatives(s, p), strict=True):
            assert x == pytest.approx(y, rel=1e-12)

    same(HerschelBulkley(one, 2.0, two, eps=eps), Bingham(one, two, eps=eps))
    same(HerschelBulkley(one, exponent, 0.0, eps=eps), PowerLaw(one, exponent, eps=eps))
    same(PowerLaw(one, 2.0), Newtonian(one))
    same(Schaeffer(30.0, eps=eps), Tardos(30.0, 0.0, exponent, eps=eps))
    same(
        Schaeffer(math.degrees(math.asin(0.15)), eps=eps),
        Poliquen(**COUETTE | {"beta": 1e-30}, eps=eps),
    )


def test_modified_poliquen_has_the_numbers_of_the_seed():
    """eta = 0.1487 / sqrt(s) + 0.26766 / (59.7394 + sqrt(s)) (seed C, 6.2.3), to the digits printed."""
    model = ModifiedPoliquen(**COUETTE, pressure=0.99133, eps=0.01)
    s = np.geomspace(1e-4, 1e6, 60)
    rate = np.sqrt(s)
    printed = 0.1487 / rate + 0.26766 / (59.7394 + rate)
    assert model.viscosity(s, s) == pytest.approx(printed, rel=1e-5)
    # In SI units the kinematic viscosity times the density.
    si = ModifiedPoliquen(**COUETTE | {"density": 1500.0}, pressure=1487.0, eps=0.01)
    assert si.viscosity(s, s) == pytest.approx(1500.0 * printed, rel=1e-4)
    # The stress never reaches the bound of ERRATA 11.
    stress = 2.0 * model.viscosity(s + 1e-4, s) * rate
    bound = math.sqrt(2.0) * math.sqrt(2.0) * (0.15 + 0.27) * 0.99133
    assert stress.max() < bound
    assert stress.max() == pytest.approx(bound, rel=0.1)


def test_modified_poliquen_is_poliquen_at_its_pressure():
    s = np.geomspace(1e-4, 1e6, 60)
    fixed = ModifiedPoliquen(**COUETTE, pressure=2.5, factor=1.0, eps=0.01)
    free = Poliquen(**COUETTE, eps=0.01)
    p = np.full(60, 2.5)
    assert fixed.viscosity(s, -p) == pytest.approx(free.viscosity(s, p), rel=1e-12)
    assert fixed.derivatives(s, -p)[0] == pytest.approx(free.derivatives(s, p)[0], rel=1e-12)


@pytest.mark.parametrize(
    "model", [Schaeffer(30.0, eps=0.1), Tardos(30.0, 0.2, 0.5, eps=0.1), Poliquen(**COUETTE, eps=0.1)]
)
def test_negative_pressures_count_as_none(model):
    """Where p <= 0 viscosity, yield stress and derivatives vanish, and nothing is NaN."""
    s, p = np.array([0.01, 1.0, 1e4, 0.01]), np.array([-1.0, -1e-9, -1e5, 0.0])
    results = [model.viscosity(s, p), *model.derivatives(s, p), model.yield_stress(p)]
    assert np.all(np.stack(results) == 0.0)


def test_thickening_fluid_at_rest_without_regularisation():
    """m > 2: the viscosity at s = 0 is 0, and the derivative, unbounded for m < 4, is given as 0."""
    model = PowerLaw(1.0, 3.0)
    s = np.array([0.0, 4.0])
    assert model.viscosity(s, s) == pytest.approx([0.0, 2.0])
    assert model.derivatives(s, s)[0] == pytest.approx([0.0, 0.25])


def test_inertial_number_and_friction_of_poliquen():
    """The shear stress |sigma| / sqrt(2) is mu(I) p with mu(I) = alpha + beta I / (I + delta), I = |g| d / sqrt(p / rho)."""
    model = Poliquen(0.3, 0.4, 0.25, 0.02, 1500.0, eps=1e-9)
    rate, p = np.array([0.1, 3.0, 50.0]), np.array([10.0, 200.0, 3.0])
    inertial = rate * 0.02 / np.sqrt(p / 1500.0)
    stress = 2.0 * model.viscosity(rate**2, p) * rate / math.sqrt(2.0)
    assert stress / p == pytest.approx(0.3 + 0.4 * inertial / (inertial + 0.25))


def test_a_user_adds_a_model_with_one_function_and_one_derivative():
    carreau = UserModel(lambda s: (1.0 + s) ** -0.2, lambda s: -0.2 * (1.0 + s) ** -1.2)
    assert not carreau.singular and not carreau.uses_pressure
    assert max(check_derivatives(carreau)) < 1e-9
    barus = UserModel(
        lambda s, p: np.exp(1e-3 * p) / np.sqrt(s),
        lambda s, p: (-0.5 * np.exp(1e-3 * p) * s**-1.5, 1e-3 * np.exp(1e-3 * p) / np.sqrt(s)),
        eps=0.1,
        uses_pressure=True,
        yield_function=lambda p: 0.5 * p,
    )
    assert barus.singular and barus.uses_pressure
    assert max(check_derivatives(barus, pressures=np.geomspace(1.0, 1e3, 5))) < 1e-7
    assert barus.yield_stress(np.array([4.0])) == pytest.approx([2.0])
    assert barus.with_eps(0.01).eps == 0.01


@pytest.mark.parametrize("which", [0, 1])
def test_a_wrong_derivative_is_found(which):
    def derivative(s, p):
        right = [-0.5 * p * s**-1.5, s**-0.5]
        right[which] = 1.001 * right[which]
        return tuple(right)

    model = UserModel(lambda s, p: p * s**-0.5, derivative, eps=0.1, uses_pressure=True)
    errors = check_derivatives(model)
    assert errors[which] > 1e-4
    assert errors[1 - which] < 1e-9


def test_temperature_factors():
    """Arrhenius: exp(E / (R theta)); Williams-Landel-Ferry: 1 at the reference, falling above it (seed C, chapter 7)."""
    assert Arrhenius(8314.462618)(np.array([500.0, 1000.0])) == pytest.approx([math.e**2, math.e])
    law = WilliamsLandelFerry(2.0, 100.0, 350.0)
    assert law(np.array([350.0, 450.0])) == pytest.approx([1.0, math.exp(-1.0)])
    theta = np.array([[340.0, 350.0], [360.0, 370.0]])
    model = WithTemperature(Bingham(2.0, 3.0, eps=0.1), law, theta)
    s = np.full((2, 2), 0.5)
    assert model.viscosity(s, s) == pytest.approx(law(theta) * (2.0 + 1.5 * math.sqrt(2.0) / math.sqrt(0.5)))
    assert model.yield_stress(s) == pytest.approx(3.0 * law(theta))
    assert model.eps == 0.1 and model.with_eps(0.2).eps == 0.2 and model.singular
    moved = model.at_other_points(lambda field: field.mean(axis=1))
    assert moved.viscosity(s[0], s[0]) == pytest.approx(
        law(np.array([345.0, 365.0])) * model.model.viscosity(s[0], s[0])
    )
    with pytest.raises(InputError, match=r"model\.temperature"):
        model.viscosity(s[0], s[0])


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Newtonian(0.0), "dynamic_viscosity"),
        (lambda: Newtonian(-1.0), "dynamic_viscosity"),
        (lambda: Newtonian(1.0, eps=-0.1), "eps"),
        (lambda: PowerLaw(1.0, 0.0, eps=0.1), "exponent"),
        (lambda: PowerLaw(1.0, 0.9, eps=0.1), "exponent"),
        (lambda: PowerLaw(1.0, math.inf, eps=0.1), "exponent"),
        (lambda: PowerLaw(1.0, math.nan, eps=0.1), "exponent"),
        (lambda: PowerLaw(-1.0, 2.0), "consistency"),
        (lambda: PowerLaw(1.0, 1.5), "eps"),
        (lambda: PowerLaw(1.0, "m"), "exponent"),
        (lambda: Bingham(1.0, 1.0), "eps"),
        (lambda: Bingham(1.0, 1.0, eps=-1e-3), "eps"),
        (lambda: Bingham(1.0, 1.0, eps=math.nan), "eps"),
        (lambda: Bingham(-1.0, 1.0, eps=0.1), "plastic_viscosity"),
        (lambda: Bingham(1.0, -1.0, eps=0.1), "yield_point"),
        (lambda: Bingham(1.0, 1.0, eps=0.1).with_eps(0.0), "eps"),
        (lambda: HerschelBulkley(1.0, 0.0, 1.0, eps=0.1), "exponent"),
        (lambda: HerschelBulkley(1.0, 3.0, 1.0), "eps"),
        (lambda: Schaeffer(0.0, eps=0.1), "angle"),
        (lambda: Schaeffer(90.0, eps=0.1), "angle"),
        (lambda: Schaeffer(30.0), "eps"),
        (lambda: Tardos(120.0, 0.1, 0.5, eps=0.1), "angle"),
        (lambda: Tardos(30.0, -0.1, 0.5, eps=0.1), "b"),
        (lambda: Tardos(30.0, 0.1, 0.0, eps=0.1), "n"),
        (lambda: Poliquen(**COUETTE | {"alpha": -0.1}, eps=0.1), "alpha"),
        (lambda: Poliquen(**COUETTE | {"delta": 0.0}, eps=0.1), "delta"),
        (lambda: Poliquen(**COUETTE | {"alpha": 0.0, "beta": 0.0}), "beta"),
        (lambda: Poliquen(**COUETTE), "eps"),
        (lambda: ModifiedPoliquen(**COUETTE, pressure=-1.0, eps=0.1), "pressure"),
        (lambda: ModifiedPoliquen(**COUETTE, pressure=1.0), "eps"),
        (lambda: UserModel(3.0, lambda s: s), "function"),
        (lambda: UserModel(lambda s: s**-0.5, lambda s: -0.5 * s**-1.5), "eps"),
        (lambda: UserModel(lambda s: s[:1], lambda s: s).viscosity(np.ones(3), np.ones(3)), "function"),
        (lambda: UserModel(lambda s: s, np.log).derivatives(-np.ones(3), np.ones(3)), "derivative"),
        (lambda: check_derivatives(Newtonian(1.0), rates=[0.0]), "rates"),
        (lambda: Arrhenius(-1.0), "activation_energy"),
        (lambda: WilliamsLandelFerry(1.0, 0.0, 300.0), "C2"),
        (lambda: WithTemperature(Newtonian(1.0), Arrhenius(1.0), 0.0), "temperature"),
        (lambda: WithTemperature(Newtonian(1.0), Arrhenius(1.0), math.nan), "temperature"),
        (
            lambda: WithTemperature(Newtonian(1.0), WilliamsLandelFerry(1.0, 50.0, 300.0), 250.0),
            "temperature",
        ),
        (lambda: WithTemperature(Newtonian(1.0), Arrhenius(1e9), 1.0), "factor"),
        (lambda: WithTemperature(1.0, Arrhenius(1.0), 300.0), "model"),
    ],
)
def test_values_out_of_range_are_refused_by_name(make, field):
    with np.errstate(invalid="ignore"), pytest.raises(InputError) as refusal:
        make()
    assert refusal.value.field.split(".")[-1] == field
