"""Laws hold validated parameters, treat blocks independently and know how they relate to each other."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError


@pytest.fixture
def mixed_law() -> DruckerPrager:
    """Four blocks: frictionless, Coulomb, cohesive, associated."""
    return DruckerPrager([0.0, 0.5, 0.8, 0.3], [0.0, 0.0, 1.0, 0.2], 0.1, [0.0, 0.0, 0.2, 0.3])


@pytest.fixture
def pairs() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    return rng.normal(size=(4, 6)), rng.normal(size=(4, 6))


def test_parameters_are_kept_as_given_and_tabulated(mixed_law) -> None:
    assert Coulomb(1).mu == 1.0
    assert isinstance(Coulomb(np.float64(0.5)).mu, float)
    assert Coulomb(0.5).count is None
    assert mixed_law.count == 4
    assert mixed_law.tensile_yield == 0.1
    table = mixed_law.parameters(4)
    assert table.flags.c_contiguous
    assert table.dtype == np.float64
    expected = [[0.0, 0.0, 0.1, 0.0], [0.5, 0.0, 0.1, 0.0], [0.8, 1.0, 0.1, 0.2], [0.3, 0.2, 0.1, 0.3]]
    assert table.tolist() == expected
    assert Coulomb(0.5).parameters(2).tolist() == [[0.5, 0.0, 0.0, 0.0]] * 2
    assert SecondOrderCone(0.5).parameters(1).tolist() == [[0.5, 0.0, 0.0, 0.5]]


def test_a_law_cannot_change_behind_the_back_of_a_problem() -> None:
    mu = np.array([0.1, 0.2])
    law = Coulomb(mu)
    mu[0] = 9.0
    assert law.mu.tolist() == [0.1, 0.2]
    with pytest.raises(ValueError, match="read-only"):
        law.mu[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        law.mu = 0.3


def test_laws_compare_by_value_and_survive_pickling(mixed_law) -> None:
    assert Coulomb(0.5) == Coulomb(0.5)
    assert Coulomb(0.5) != Coulomb([0.5])
    assert Coulomb(0.5) != DruckerPrager(0.5)
    assert Coulomb([0.5, 0.2]) == Coulomb(np.array([0.5, 0.2]))
    assert pickle.loads(pickle.dumps(mixed_law)) == mixed_law


def test_blocks_are_independent(mixed_law, pairs) -> None:
    """The law of block i, alone, gives row i."""
    u, r = pairs
    rho = np.array([0.5, 1.0, 2.0, 3.0])
    cone = DruckerPrager(mixed_law.mu, 0.0, mixed_law.tensile_yield, mixed_law.dilatancy)
    for i in range(4):
        one = mixed_law.take(i)
        assert one.count == 1
        row = slice(i, i + 1)
        np.testing.assert_array_equal(one.project(r[row]), mixed_law.project(r)[row])
        for law, names in ((mixed_law, ("natural_map", "alart_curnier")), (cone, ("fischer_burmeister",))):
            for name in names:
                expected = getattr(law, name)(u, r, rho)[row]
                np.testing.assert_array_equal(getattr(law.take([i]), name)(u[row], r[row], rho[i]), expected)
        for whole, alone in zip(
            cone.fischer_burmeister_jacobian(u, r, rho),
            cone.take([i]).fischer_burmeister_jacobian(u[row], r[row], rho[i]),
            strict=True,
        ):
            np.testing.assert_allclose(alone, whole[row], rtol=1e-13)


def test_flat_vectors_give_flat_vectors(mixed_law, pairs) -> None:
    u, r = pairs
    np.testing.assert_array_equal(mixed_law.project(r.ravel()), mixed_law.project(r).ravel())
    np.testing.assert_array_equal(
        Coulomb(0.5).natural_map(u.ravel(), r.ravel(), 2.0, block_size=6),
        Coulomb(0.5).natural_map(u, r, 2.0).ravel(),
    )
    np.testing.assert_array_equal(mixed_law.shift(u.ravel()), mixed_law.shift(u).ravel())
    assert Coulomb(np.empty(0)).project(np.empty(0)).shape == (0,)
    assert Coulomb(0.5).natural_map(np.empty((0, 3)), np.empty((0, 3)), 1.0).shape == (0, 3)


def test_arguments_are_left_untouched(mixed_law, pairs) -> None:
    u, r = pairs
    before = u.copy(), r.copy()
    mixed_law.project(r)
    mixed_law.natural_map(u, r, 1.0)
    mixed_law.alart_curnier(u, r, 1.0)
    DruckerPrager(0.5, 0.0, 0.3).fischer_burmeister_jacobian(u, r, 1.0)
    np.testing.assert_array_equal((u, r), before)


def test_special_cases_of_drucker_prager(pairs) -> None:
    """Coulomb is DruckerPrager(mu), the second-order cone DruckerPrager(mu, dilatancy=mu)."""
    u, r = pairs
    for law, general in (
        (Coulomb(0.6), DruckerPrager(0.6)),
        (SecondOrderCone(0.6), DruckerPrager(0.6, dilatancy=0.6)),
    ):
        for name in ("natural_map", "alart_curnier", "fischer_burmeister"):
            np.testing.assert_array_equal(getattr(law, name)(u, r, 1.5), getattr(general, name)(u, r, 1.5))


def test_tensile_yield_moves_the_admissible_set(pairs) -> None:
    _, r = pairs
    shift = 0.7 * np.eye(6)[0]
    expected = DruckerPrager(0.5, 0.2).project(r + shift) - shift
    np.testing.assert_allclose(DruckerPrager(0.5, 0.2, 0.7).project(r), expected, atol=1e-15)


def test_convexified_laws_keep_their_admissible_set_and_lose_their_shift(mixed_law, pairs) -> None:
    u, r = pairs
    assert Coulomb(0.5).convexified() == SecondOrderCone(0.5)
    for law in (Coulomb(0.5), SecondOrderCone(0.5), mixed_law):
        convex = law.convexified()
        np.testing.assert_array_equal(convex.project(r), law.project(r))
        assert not convex.shift(u).any()
        assert convex.convexified() == convex


def test_with_friction_and_take(mixed_law) -> None:
    assert Coulomb(0.5).with_friction([0.1, 0.2]) == Coulomb([0.1, 0.2])
    assert SecondOrderCone(0.5).with_friction(0.2).dilatancy == 0.2
    rougher = mixed_law.with_friction(0.9)
    assert rougher.parameters(4)[:, 0].tolist() == [0.9] * 4
    assert rougher.shear_yield.tolist() == mixed_law.shear_yield.tolist()
    with pytest.raises(InputError, match=r"^dilatancy = "):
        mixed_law.with_friction(0.1)
    assert mixed_law.take(np.array([True, False, True, False])).mu.tolist() == [0.0, 0.8]
    assert mixed_law.take(slice(1, 3)) == mixed_law.take([1, 2])
    assert Coulomb(0.5).take([3, 4]) == Coulomb(0.5)
    with pytest.raises(InputError, match=r"^indices = "):
        mixed_law.take([4])


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf, [0.1, np.nan], [[0.1]], "rough", None])
@pytest.mark.parametrize("field", ["mu", "shear_yield", "tensile_yield", "dilatancy"])
def test_bad_parameters_are_refused(field, value) -> None:
    with pytest.raises(InputError, match=f"^{field} = "):
        DruckerPrager(**{"mu": 1e9, field: value})


def test_inconsistent_parameters_are_refused() -> None:
    with pytest.raises(InputError, match=r"^dilatancy = 0.6: must be at most"):
        DruckerPrager(0.5, dilatancy=0.6)
    with pytest.raises(InputError, match=r"^dilatancy = "):
        DruckerPrager([0.5, 0.1], dilatancy=[0.5, 0.2])
    with pytest.raises(InputError, match=r"^shear_yield = array of length 3"):
        DruckerPrager([0.5, 0.1], shear_yield=[0.0, 0.0, 0.0])
    with pytest.raises(TypeError):
        Law(0.5)


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda law: law.parameters(3), "n"),
        (lambda law: law.project(np.ones((3, 3))), "r"),
        (lambda law: law.project(np.ones((2, 1))), "r"),
        (lambda law: law.project(np.ones(7)), "r"),
        (lambda law: law.project(np.ones((2, 2, 3))), "r"),
        (lambda law: law.project(np.ones((2, 3)), block_size=6), "r"),
        (lambda law: law.shift(1.0), "u"),
        (lambda law: Coulomb(0.5).project(np.ones(6)), "r"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones((2, 2)), 1.0), "r"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones(6), 1.0), "r"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones((2, 3)), 0.0), "rho"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones((2, 3)), np.nan), "rho"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones((2, 3)), [1.0, np.inf]), "rho"),
        (lambda law: law.natural_map(np.ones((2, 3)), np.ones((2, 3)), np.ones(3)), "rho"),
    ],
)
def test_vectors_that_do_not_fit_are_refused(call, field) -> None:
    with pytest.raises(InputError, match=f"^{field} = "):
        call(Coulomb([0.1, 0.2]))
