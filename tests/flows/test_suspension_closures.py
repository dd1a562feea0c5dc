"""Closures of the two-phase model: drag by its settling law, effective viscosity, dimensionless numbers, announcements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.flows.mpm import Material
from barchan.flows.suspension.checks import notes
from barchan.flows.suspension.drag import DENSEST, CarmanKozeny, Quadratic, RichardsonZaki
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.numbers import numbers
from barchan.flows.suspension.phases import phases
from barchan.flows.suspension.viscosity import Constant, Einstein, FrankelAcrivos, KriegerDougherty

G = 9.81


def mixture(
    grains=2500.0, fluid=1000.0, viscosity=1e-3, diameter=1e-4, drag=None, phi_max=0.6, law=None, own=0.0, **material
) -> Mixture:  # fmt: skip
    """Fine sand in water unless told otherwise."""
    solid = Material(density=grains, friction=0.5, max_volume_fraction=phi_max, viscosity=own, **material)
    return Mixture(solid, fluid, viscosity, diameter, drag or RichardsonZaki(), law or Constant())


DRAGS = [
    RichardsonZaki(),
    RichardsonZaki(3.0),
    CarmanKozeny(),
    CarmanKozeny(150.0),
    Quadratic(),
    Quadratic(1.0, 4.0),
]
LAWS = [Constant(), Einstein(), KriegerDougherty(), KriegerDougherty(2.0), FrankelAcrivos()]
drags = st.one_of(
    st.builds(RichardsonZaki, st.floats(2.0, 6.0)),
    st.builds(CarmanKozeny, st.floats(50.0, 300.0)),
    st.builds(Quadratic, st.floats(0.1, 2.0), st.floats(1.5, 5.0)),
)
mixtures = st.builds(
    mixture,
    grains=st.floats(200.0, 8000.0),
    fluid=st.floats(1.0, 2000.0),
    viscosity=st.floats(1e-5, 10.0),
    diameter=st.floats(1e-5, 1e-2),
    drag=drags,
)


# -- drag ------------------------------------------------------------------------------------------------------------


@given(mixtures, st.floats(1e-4, 0.9))
def test_the_two_balances_settle_at_the_closures_own_law(made, phi):
    """Steady grains and fluid in a closed vessel: (8.8), (8.9) and u_v = 0 for u_g, u_f and dp/dz, z downwards."""
    assume(abs(made.alpha) > 1e-3)  # neutrally buoyant grains stay, at any drag
    law = float(made.settling_velocity(phi, G))
    xi = float(made.drag.coefficient(phi, abs(law) / (1.0 - phi), made))
    heavy, light = made.grains.density * phi, made.fluid_density * (1.0 - phi)
    equations = [[phi, 1.0 - phi, 0.0], [xi, -xi, phi], [-xi, xi, 1.0 - phi]]
    grains, fluid, gradient = np.linalg.solve(equations, [0.0, heavy * G, light * G])
    # The pore pressure bears the weight of the whole mixture, and drag a small difference of large weights.
    tolerance = 1e-9 * (heavy + light) * G / xi
    assert grains == pytest.approx(law, rel=1e-9, abs=tolerance)
    assert fluid == pytest.approx(-phi * law / (1.0 - phi), rel=1e-9, abs=tolerance)
    assert gradient == pytest.approx((heavy + light) * G, rel=1e-9)


def test_richardson_and_zaki_settle_at_their_power_and_the_seeds_coefficient_two_powers_slower():
    made, phi = mixture(), np.linspace(0.0, 0.6, 13)
    terminal = 1500.0 * G * 1e-8 / (18.0 * 1e-3)
    assert made.terminal_velocity(G) == pytest.approx(terminal, rel=1e-14)
    np.testing.assert_allclose(made.settling_velocity(phi, G), terminal * (1.0 - phi) ** 4.65, rtol=1e-13)
    printed = 18.0 * 1e-3 / 1e-8 * phi * (1.0 - phi) ** -4.65
    np.testing.assert_allclose(RichardsonZaki(6.65).coefficient(phi, 0.0, made), printed, rtol=1e-13)


def test_carman_and_kozeny_let_the_fluid_seep_through_grains_at_rest_by_darcys_law():
    """Fluid driven through grains held at rest: its balance is (1 - phi) dp/dz = xi w, its flux (1 - phi) |w|."""
    made, phi, flux = mixture(drag=CarmanKozeny()), np.linspace(0.2, 0.8, 7), 1e-3
    permeability = 1e-8 * (1.0 - phi) ** 3 / (180.0 * phi**2)
    speed = flux / (1.0 - phi)
    gradient = made.drag.coefficient(phi, speed, made) * speed / (1.0 - phi)
    np.testing.assert_allclose(gradient, 1e-3 * flux / permeability, rtol=1e-13)


@pytest.mark.parametrize("drag", DRAGS, ids=str)
def test_few_grains_feel_the_drag_of_single_spheres(drag):
    made, phi, speed, diameter = mixture(drag=drag), 1e-9, 0.37, 1e-4
    on_each = float(drag.coefficient(phi, speed, made)) * speed * (math.pi * diameter**3 / 6.0) / phi
    if drag.linear:
        expected = 3.0 * math.pi * 1e-3 * diameter * speed
    else:
        expected = drag.drag_coefficient * math.pi * diameter**2 / 4.0 * 1000.0 * speed**2 / 2.0
    assert on_each == pytest.approx(expected, rel=1e-7)


@given(drags, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 5.0))
def test_drag_grows_with_the_grains_which_settle_ever_slower(drag, one, other, speed):
    made = mixture(drag=drag)
    less, more = np.sort([one, other])
    xi = drag.coefficient(np.array([less, more]), np.array([speed, speed]), made)
    assert 0.0 <= xi[0] <= xi[1] * (1.0 + 1e-12) < np.inf
    falling = made.settling_velocity(np.array([less, more]), G)
    assert falling[0] >= falling[1] * (1.0 - 1e-12) > 0.0


@pytest.mark.parametrize("drag", DRAGS, ids=str)
def test_drag_is_zero_without_grains_and_bounded_where_fluid_vanishes(drag):
    made, speed = mixture(drag=drag), np.full(4, 0.1)
    xi = drag.coefficient(np.array([0.0, -1e-12, DENSEST, 1.2]), speed, made)
    assert xi[0] == 0.0 and xi[1] == 0.0 and np.all(np.isfinite(xi)) and xi[2] == xi[3]
    assert drag.coefficient(np.array([0.1, 0.2, 0.3]), 0.1, made).shape == (3,)
    assert drag.coefficient(0.3, speed, made).shape == (4,)


def test_only_quadratic_drag_depends_on_the_speed():
    made, speed, phi = mixture(), np.array([0.0, 1.0, 2.0]), np.full(3, 0.3)
    for drag in DRAGS:
        xi = drag.coefficient(phi, speed, made)
        if drag.linear:
            assert np.ptp(xi) == 0.0 and xi[0] > 0.0
        else:
            assert xi[0] == 0.0 and xi[2] == pytest.approx(2.0 * xi[1], rel=1e-14)


@pytest.mark.parametrize("drag", DRAGS, ids=str)
def test_light_grains_rise_as_fast_as_heavy_ones_of_the_opposite_buoyancy_fall(drag):
    falling = mixture(grains=1400.0, drag=drag).settling_velocity(0.2, G)
    rising = mixture(grains=600.0, drag=drag).settling_velocity(0.2, G)
    assert falling > 0.0 and rising == pytest.approx(-falling, rel=1e-12)
    assert mixture(grains=1000.0, drag=drag).settling_velocity(0.2, G) == 0.0


# -- effective viscosity ---------------------------------------------------------------------------------------------


@given(st.sampled_from(LAWS), st.floats(0.3, 0.95), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_grains_never_thin_the_fluid_and_stiffen_it_the_more_the_denser(law, phi_max, one, other):
    less, more = np.sort([one, other])
    ratio = law.ratio(np.array([0.0, less, more]), phi_max)
    assert ratio[0] == 1.0 and 1.0 <= ratio[1] <= ratio[2] * (1.0 + 1e-12) and np.isfinite(ratio[2])


@given(st.floats(0.3, 0.95))
def test_few_grains_obey_einstein_under_krieger_and_dougherty(phi_max):
    phi = 1e-6
    slope = (KriegerDougherty().ratio(phi, phi_max) - 1.0) / phi
    assert slope == pytest.approx(2.5, rel=1e-5)
    assert (Einstein().ratio(phi, phi_max) - 1.0) / phi == pytest.approx(2.5, rel=1e-9)


def test_viscosities_as_printed():
    phi = np.array([0.2, 0.4, 0.55])
    np.testing.assert_allclose(Constant().ratio(phi, 0.6), 1.0)
    np.testing.assert_allclose(KriegerDougherty().ratio(phi, 0.6), (1.0 - phi / 0.6) ** -1.5, rtol=1e-13)
    np.testing.assert_allclose(KriegerDougherty(2.0).ratio(phi, 0.6), (1.0 - phi / 0.6) ** -2.0, rtol=1e-13)
    printed = 9.0 / 8.0 / ((0.6 / phi) ** (1.0 / 3.0) - 1.0)
    np.testing.assert_allclose(FrankelAcrivos().ratio(phi, 0.6), printed, rtol=1e-12)


def test_frankel_and_acrivos_lubricate_dense_grains_and_leave_few_ones_alone():
    gaps = np.array([0.05, 0.02, 0.011])
    dense = FrankelAcrivos().ratio(0.6 * (1.0 - gaps), 0.6) * gaps
    np.testing.assert_allclose(dense, 27.0 / 8.0, rtol=0.05)
    assert np.all(FrankelAcrivos().ratio(0.6 * np.array([0.0, 0.05, 0.10]), 0.6) == 1.0)
    assert FrankelAcrivos().ratio(0.6 * 0.11, 0.6) > 1.0


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_viscosity_stops_growing_where_grains_touch(law):
    ratio = law.ratio(np.array([0.594, 0.6, 0.65]), 0.6)
    assert np.all(np.isfinite(ratio)) and np.all(ratio < 1e5)
    if not isinstance(law, Einstein):
        assert np.ptp(ratio) == pytest.approx(0.0, abs=1e-9 * ratio[0])


# -- numbers ---------------------------------------------------------------------------------------------------------


@given(mixtures, st.floats(0.01, 100.0), st.floats(0.1, 30.0), st.floats(0.0, 0.6))
def test_numbers_are_as_their_definitions_relate_them(made, length, gravity, phi):
    found = numbers(made, length, gravity, phi)
    assert found.regime * found.reynolds * found.epsilon == pytest.approx(found.stokes, rel=1e-11)
    assert found.grain_reynolds == pytest.approx(found.stokes * found.reynolds * found.epsilon, rel=1e-11)
    assert found.alpha + 1.0 == pytest.approx(made.grains.density / made.fluid_density, rel=1e-12)
    if made.drag.linear:
        size = abs(found.alpha) / 18.0 * found.epsilon
        assert found.stokes == pytest.approx(size * found.epsilon * found.reynolds, rel=1e-11, abs=1e-300)
        assert found.regime == pytest.approx(size, rel=1e-11, abs=1e-300)
    if isinstance(made.drag, RichardsonZaki):
        assert found.xi == pytest.approx((1.0 - max(phi, 1e-9)) ** (1.0 - made.drag.exponent), rel=1e-9)


factors = st.floats(0.01, 100.0)


@given(st.sampled_from(DRAGS), factors, factors, factors, st.floats(0.0, 0.55))
def test_numbers_do_not_depend_on_the_units(drag, length, time, mass, phi):
    density, speed = mass / length**3, length / time
    here = numbers(mixture(drag=drag), 0.3, G, phi, 2.0)
    made = mixture(
        2500.0 * density, 1000.0 * density, 1e-3 * mass / (length * time), 1e-4 * length, drag=drag
    )
    there = numbers(made, 0.3 * length, G * speed / time, phi, 2.0 * speed)
    for name, value in here.figures().items():
        assert there.figures()[name] == pytest.approx(value, rel=1e-8), name


def test_the_columns_of_the_seed_differ_in_regime_as_it_says():
    """Seed B, 8.4.3: grains of 1 mm in air, water and a viscous fluid, a basin 100 grains high, and triple grains."""
    air = numbers(mixture(2600.0, 1.0, 1e-5, 1e-3), 0.1, G, 0.6).regime
    water = numbers(mixture(2600.0, 1000.0, 1e-3, 1e-3), 0.1, G, 0.6).regime
    viscous = numbers(mixture(2600.0, 1000.0, 1.0, 1e-3), 0.1, G, 0.6).regime
    triple = numbers(mixture(2600.0, 1000.0, 1.0, 3e-3), 0.1, G, 0.6).regime
    assert 1.0 < air < 2.0
    assert water == pytest.approx(viscous, rel=1e-12) and 5e-4 < water < 2e-3
    assert triple == pytest.approx(3.0 * viscous, rel=1e-12)


def test_numbers_without_gravity_or_viscosity():
    still = numbers(mixture(), 1.0, 0.0, 0.3)
    assert (still.reynolds, still.stokes, still.regime, still.grain_reynolds) == (0.0, 0.0, 0.0, 0.0)
    assert still.xi > 1.0
    driven = numbers(mixture(), 1.0, 0.0, 0.3, speed=1e-4)
    assert driven.reynolds == pytest.approx(100.0, rel=1e-12) and driven.stokes == 0.0
    for drag in DRAGS:
        ideal = numbers(mixture(viscosity=0.0, drag=drag), 1.0, G, 0.3)
        assert ideal.figures()["reynolds_number"] is None and not math.isnan(ideal.regime)
        assert math.isinf(ideal.stokes) == drag.linear


# -- announcements ---------------------------------------------------------------------------------------------------


def test_nothing_is_said_about_fine_sand_in_water():
    assert notes(mixture(), [0.01, 0.01], G, length=1.0) == []


def test_grains_that_rise_are_announced():
    assert any("rise" in text for text in notes(mixture(grains=900.0), 0.01, G))
    assert not any("rise" in text for text in notes(mixture(grains=1000.0), 0.01, G))


def test_a_drag_out_of_its_range_is_announced():
    coarse, fine = {"diameter": 1e-3}, {"diameter": 5e-5}
    fast = notes(mixture(**coarse), 0.01, G)
    assert len(fast) == 1 and "Quadratic" in fast[0]
    assert notes(mixture(**coarse, drag=Quadratic()), 0.01, G) == []
    slow = notes(mixture(**fine, drag=Quadratic()), 0.01, G)
    assert len(slow) == 1 and "RichardsonZaki" in slow[0]
    assert notes(mixture(**coarse), 0.01, gravity=0.0) == []
    assert notes(mixture(viscosity=0.0, drag=Quadratic()), 0.01, G) == []


def test_darcys_limit_is_announced_and_needs_a_linear_drag():
    assert notes(mixture(), 0.01, G, length=1.0, darcy=True) == []
    light = mixture(fluid=1.0, viscosity=1.8e-5, diameter=3e-4)
    assert any("Stokes number" in text for text in notes(light, 0.01, G, length=1.0, darcy=True))
    with pytest.raises(InputError, match=r"mixture\.drag"):
        notes(mixture(drag=Quadratic()), 0.01, G, darcy=True)


def test_grains_larger_than_a_cell_are_refused():
    assert notes(mixture(diameter=2e-4, viscosity=0.1), [0.01, 2e-4], G) == []
    with pytest.raises(InputError, match=r"mixture\.grain_diameter"):
        notes(mixture(diameter=2.1e-4), [0.01, 2e-4], G)


def test_the_grains_of_friction_are_those_of_drag_unless_said_otherwise():
    made = mixture(diameter=2e-4, friction_increment=0.2)
    assert made.grains.grain_diameter == 2e-4 and notes(made, 0.01, G)[1:] == []
    other = mixture(friction_increment=0.2, grain_diameter=5e-4)
    assert other.grains.grain_diameter == 5e-4
    assert any("mu(I)" in text for text in notes(other, 0.01, G))


# -- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("mixture.grains.max_volume_fraction", {"phi_max": 1.0}),
        ("mixture.grains.viscosity", {"own": 1.0}),
        ("mixture.fluid_density", {"fluid": 0.0}),
        ("mixture.fluid_density", {"fluid": math.nan}),
        ("mixture.fluid_viscosity", {"viscosity": -1e-3}),
        ("mixture.fluid_viscosity", {"viscosity": "thick"}),
        ("mixture.grain_diameter", {"diameter": 0.0}),
        ("mixture.grain_diameter", {"diameter": math.inf}),
        ("mixture.drag", {"drag": 18.0}),
        ("mixture.drag", {"drag": RichardsonZaki}),
        ("mixture.effective_viscosity", {"law": "einstein"}),
        ("mixture.effective_viscosity", {"law": Einstein}),
    ],
)
def test_a_mixture_that_makes_no_sense_is_refused(field, change):
    with pytest.raises(InputError) as refused:
        mixture(**change)
    assert refused.value.field == field


@pytest.mark.parametrize(
    "build",
    [
        lambda: RichardsonZaki(-1.0),
        lambda: RichardsonZaki(math.inf),
        lambda: CarmanKozeny(0.0),
        lambda: Quadratic(0.0),
        lambda: Quadratic(0.44, -2.0),
        lambda: KriegerDougherty(0.0),
        lambda: KriegerDougherty(-1.5),
        lambda: Mixture("sand", 1000.0, 1e-3, 1e-4),
        lambda: numbers(mixture(), 0.0, G, 0.3),
        lambda: numbers(mixture(), 1.0, -G, 0.3),
        lambda: numbers(mixture(), 1.0, G, 1.0),
        lambda: numbers(mixture(), 1.0, G, -0.1),
        lambda: numbers(mixture(), 1.0, G, 0.3, speed=0.0),
    ],
)
def test_closures_and_numbers_refuse_values_out_of_range(build):
    with pytest.raises(InputError):
        build()


# -- closures and the algebra of nodes -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drag", "darcy"), [(d, darcy) for d in DRAGS for darcy in (False, d.linear)], ids=str
)
def test_steps_of_the_node_algebra_end_at_the_settling_velocity(drag, darcy):
    """A closed vessel node by node: steps in which the pore stress keeps u_v = 0, until nothing changes."""
    made, phi, dt, volume = mixture(diameter=2e-4, drag=drag), np.array([0.01, 0.1, 0.3, 0.55]), 5e-3, 1e-6
    grains, fluid = np.zeros((4, 2)), np.zeros((4, 2))
    for _ in range(400):
        xi = drag.coefficient(phi, np.linalg.norm(grains - fluid, axis=1), made)
        masses = made.grains.density * phi * volume, made.fluid_density * (1.0 - phi) * volume
        algebra = phases(*masses, phi, xi * volume, dt, 2, darcy=darcy)
        guess = algebra.predicted(grains, fluid, np.array([0.0, -G]))
        force = -algebra.volume_average(*guess) / algebra.volume_compliance
        grains, rest = algebra.with_volume_force(*guess, force)
        fluid = algebra.fluid(grains, rest)
    np.testing.assert_allclose(-grains[:, 1], made.settling_velocity(phi, G), rtol=1e-9)
    np.testing.assert_allclose(phi * grains[:, 1] + (1.0 - phi) * fluid[:, 1], 0.0, atol=1e-12)
