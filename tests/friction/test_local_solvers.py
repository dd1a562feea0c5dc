"""One-block solvers: whatever the block, the answer satisfies the law, and the different methods agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction.local import LOCAL_SOLVERS, BlockAnswer, answer_block, solve_block
from barchan.friction.local._alart_curnier import solve_alart_curnier
from barchan.friction.local._contact import contact_error, fischer_burmeister_contact
from barchan.friction.local._contact_alart_curnier import alart_curnier_contact
from barchan.friction.local._dispatch import scratch
from barchan.friction.local._fischer_burmeister import solve_fischer_burmeister


def random_block(seed: int, s: int, stiffness_spread: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = np.linalg.qr(rng.standard_normal((s, s)))[0]
    eigenvalues = 10.0 ** rng.uniform(-stiffness_spread, 0.0, s)
    return q @ np.diag(eigenvalues) @ q.T, rng.standard_normal(s)


def violation(law: Law, W: np.ndarray, r: np.ndarray, u: np.ndarray) -> float:
    """Natural map relative to the force scale of the block."""
    s = len(r)
    rho = s / np.trace(W)
    scale = max(np.linalg.norm(r), rho * np.linalg.norm(u))
    return float(np.linalg.norm(law.natural_map(u[None], r[None], rho)) / scale)


seeds = st.integers(0, 2**31)


@given(seeds, st.sampled_from([2, 3, 4, 6]), st.floats(0.0, 1.5))
def test_secular_solves_coulomb_exactly(seed: int, s: int, mu: float) -> None:
    W, b = random_block(seed, s, 2.0)
    law = Coulomb(mu)
    r, u = solve_block(law, W, b)
    assert violation(law, W, r, u) < 1e-9


@given(seeds, st.sampled_from([2, 3, 6]), st.floats(0.01, 1.5))
def test_secular_solves_the_associated_law_exactly(seed: int, s: int, mu: float) -> None:
    W, b = random_block(seed, s, 2.0)
    law = SecondOrderCone(mu)
    r, u = solve_block(law, W, b)
    assert violation(law, W, r, u) < 1e-9


@given(seeds, st.sampled_from([2, 3, 6]), st.floats(0.01, 1.2), st.floats(0.0, 1.0))
def test_secular_solves_partial_dilatancy(seed: int, s: int, mu: float, fraction: float) -> None:
    W, b = random_block(seed, s, 1.0)
    law = DruckerPrager(mu, dilatancy=fraction * mu)
    r, u = solve_block(law, W, b)
    assert violation(law, W, r, u) < 1e-8


@example(10145619, 3, 0.0, 1.0, 1.0)
@given(seeds, st.sampled_from([3, 6]), st.floats(0.0, 1.0), st.floats(0.01, 2.0), st.floats(0.0, 1.0))
def test_secular_solves_associated_yield_stress(
    seed: int, s: int, mu: float, shear: float, tensile: float
) -> None:
    W, b = random_block(seed, s, 1.0)
    law = DruckerPrager(mu, shear_yield=shear, tensile_yield=tensile, dilatancy=mu)
    r, u = solve_block(law, W, b)
    assert violation(law, W, r, u) < 1e-8


@given(seeds, st.sampled_from([2, 3]), st.floats(0.05, 1.2), st.booleans())
def test_enumeration_and_newton_agree_with_the_secular_solver(
    seed: int, s: int, mu: float, associated: bool
) -> None:
    W, b = random_block(seed, s, 1.0)
    law: Law = SecondOrderCone(mu) if associated else Coulomb(mu)
    for method in ("enumerative", "fischer-burmeister+enumerative"):
        r, u = solve_block(law, W, b, method)
        assert violation(law, W, r, u) < 1e-7, method
    if associated:
        exact, _ = solve_block(law, W, b)
        assert np.allclose(r, exact, atol=1e-7 * (1.0 + np.linalg.norm(exact)))


# Iterative solvers of the exact law, and the failures to be expected of each in a hundred associated blocks at most.
ITERATIVE = {"duriez": 35, "alart-curnier": 15, "alart-curnier-damped": 8, "fischer-burmeister": 1}
FAIL_SAFE = tuple(name for name in LOCAL_SOLVERS if name.endswith("+enumerative"))


def answers(
    name: str, s: int, count: int, associated: bool = False
) -> list[tuple[Law, np.ndarray, BlockAnswer]]:
    """Random blocks of all sorts, solved by one local solver: (law, W, answer)."""
    solved = []
    for seed in range(count):
        W, b = random_block(seed, s, 1.5)
        mu = 1.5 * np.random.default_rng(seed).random()
        law: Law = SecondOrderCone(mu) if associated else Coulomb(mu)
        solved.append((law, W, answer_block(law, W, b, name)))
    return solved


@pytest.mark.parametrize("associated", [False, True])
@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("name", ITERATIVE)
def test_iterative_solvers_solve_their_law_or_say_that_they_failed(
    name: str, s: int, associated: bool
) -> None:
    failures = 0
    for law, W, answer in answers(name, s, 100, associated):
        failures += answer.failed
        assert answer.failed or violation(law, W, answer.r, answer.u) < 1e-7
        assert not answer.used_failsafe
    assert failures <= ITERATIVE[name]


@pytest.mark.parametrize("name", FAIL_SAFE)
@pytest.mark.parametrize("s", [2, 3])
def test_with_the_enumerative_fail_safe_no_block_fails(name: str, s: int) -> None:
    alone = answers("enumerative", s, 150)
    for (law, W, answer), (_, _, enumerated) in zip(answers(name, s, 150), alone, strict=True):
        assert answer.failed <= enumerated.failed
        assert answer.failed or violation(law, W, answer.r, answer.u) < 1e-7


@pytest.mark.parametrize("primary", ["pyramid", *ITERATIVE])
def test_with_the_secular_fail_safe_no_block_of_size_six_fails(primary: str) -> None:
    for law, W, answer in answers(f"{primary}+secular", 6, 60):
        assert not answer.failed
        assert violation(law, W, answer.r, answer.u) < 1e-7


def test_the_fail_safe_is_called_only_where_the_primary_solver_failed() -> None:
    # The pyramid misses Coulomb's law on the blocks that slide aslant, and there only.
    alone = answers("pyramid", 3, 200)
    called = 0
    for (law, W, first), (_, _, second) in zip(alone, answers("pyramid+enumerative", 3, 200), strict=True):
        assert second.used_failsafe == (violation(law, W, first.r, first.u) > 1e-8)
        called += second.used_failsafe
    assert 20 < called < 180


@given(seeds, st.sampled_from([2, 3, 6]), st.floats(0.0, 1.5), st.floats(0.0, 1.0))
def test_the_pyramid_solver_satisfies_the_faceted_law(seed: int, s: int, mu: float, fraction: float) -> None:
    W, b = random_block(seed, s, 1.0)
    answer = answer_block(DruckerPrager(mu, dilatancy=fraction * mu), W, b, "pyramid")
    assert not answer.failed
    # Tangential coordinates along b_T and across it, by another route than the solver's.
    across = np.eye(s - 1)
    across[:, 0] = b[1:]
    frame = np.linalg.qr(across)[0]
    r_t, u_t = answer.r[1:], answer.u[1:]
    if s > 3:
        # Several directions across: any frame serves, so that only what does not depend on it is checked.
        r_t, u_t = frame[:, :1].T @ r_t, frame[:, :1].T @ u_t
    elif s == 3:
        r_t, u_t = frame.T @ r_t, frame.T @ u_t
    scale = max(np.linalg.norm(answer.r), np.linalg.norm(b))
    assert (np.abs(r_t) <= mu * answer.r[0] + 1e-8 * scale).all()
    assert r_t == pytest.approx(np.clip(r_t - u_t, -mu * answer.r[0], mu * answer.r[0]), abs=1e-7 * scale)
    if s < 4:
        opening = answer.u[0] - fraction * mu * np.abs(u_t).sum()
        assert min(answer.r[0], opening) == pytest.approx(0.0, abs=1e-7 * scale)


def test_the_pyramid_agrees_with_coulomb_when_the_block_slides_along_its_axis() -> None:
    W, b = np.diag([2.0, 1.0, 1.0]), np.array([-1.0, 3.0, -4.0])
    exact, _ = solve_block(Coulomb(0.4), W, b)
    assert solve_block(Coulomb(0.4), W, b, "pyramid")[0] == pytest.approx(exact)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_the_secular_solver_copes_with_nearly_singular_blocks_and_every_law(s: int) -> None:
    rng = np.random.default_rng(s)
    for seed in range(400):
        W, b = random_block(seed, s, 8.0)
        mu, shear, tensile = rng.uniform(0.01, 1.5), rng.integers(2) * rng.random(), rng.random()
        for zeta in (0.0, mu * rng.random(), mu):
            law = DruckerPrager(mu, shear_yield=shear, tensile_yield=tensile, dilatancy=zeta)
            r, u = solve_block(law, W, b)
            assert violation(law, W, r, u) < 1e-9


@given(seeds, st.floats(0.05, 1.5), st.sampled_from([0.0, 0.4, 1.0]), st.integers(0, 4), st.booleans())
def test_the_unrolled_contact_kernels_make_the_steps_of_the_general_ones(
    seed: int, mu: float, fraction: float, steps: int, damped: bool
) -> None:
    W, b = random_block(seed, 3, 1.0)
    zeta = fraction * mu
    start = np.random.default_rng(seed + 1).standard_normal(3)
    # A step to stick leaves u_T = 0 to rounding, whose direction a dilatant step of Alart-Curnier then depends on.
    few = min(steps, 2 if zeta == 0.0 else 1)
    for unrolled, general in (
        (
            lambda r: fischer_burmeister_contact(W, b, mu, zeta, r, 1e-12, 1e-15, steps + 1),
            lambda r: solve_fischer_burmeister(3, W, b, mu, zeta, r, 1e-12, 1e-15, steps + 1, *scratch(3)),
        ),
        (
            lambda r: alart_curnier_contact(W, b, mu, zeta, r, 1e-12, 1e-15, few, damped),
            lambda r: solve_alart_curnier(3, W, b, mu, zeta, r, 1e-12, 1e-15, few, damped, *scratch(3)),
        ),
    ):
        one, other = start.copy(), start.copy()
        assert unrolled(one) == pytest.approx(general(other), rel=1e-4, abs=1e-7)
        assert one == pytest.approx(other, rel=1e-4, abs=1e-6)


def test_the_unrolled_newton_halves_the_steps_that_the_general_one_halves() -> None:
    # Bad directions come with ill-conditioned blocks; the unrolled kernel recognises the good ones by a bound.
    for seed in range(400):
        W, b = random_block(seed, 3, 4.0)
        start = np.random.default_rng(seed + 1).standard_normal(3)
        one, other = start.copy(), start.copy()
        fischer_burmeister_contact(W, b, 1.0, 0.0, one, 1e-12, 1e-15, 5)
        solve_fischer_burmeister(3, W, b, 1.0, 0.0, other, 1e-12, 1e-15, 5, *scratch(3))
        assert one == pytest.approx(other, rel=1e-5, abs=1e-6)


@given(seeds, st.floats(0.05, 1.5), st.floats(0.0, 1.0))
def test_the_contact_certificate_is_the_relative_natural_map(seed: int, mu: float, fraction: float) -> None:
    W, b = random_block(seed, 3, 1.0)
    law = DruckerPrager(mu, dilatancy=fraction * mu)
    r = np.random.default_rng(seed + 1).standard_normal(3)
    rho = 3.0 / np.trace(W)
    expected = np.linalg.norm(law.natural_map((W @ r + b)[None], r[None], rho))
    expected /= max(np.linalg.norm(r), rho * np.linalg.norm(b))
    assert np.sqrt(contact_error(W, b, mu, fraction * mu, r)) == pytest.approx(expected)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_every_solver_of_the_exact_law_solves_blocks_that_stick_or_take_off(s: int) -> None:
    names = [name for name in LOCAL_SOLVERS if name != "pyramid" and (s < 4 or "enumerative" not in name)]
    for seed in range(20):
        W, b = random_block(seed, s, 6.0)
        rng = np.random.default_rng(seed)
        force = np.concatenate(([1.0], 0.3 * rng.standard_normal(s - 1) / s))
        opening = np.concatenate(([1.5 * np.linalg.norm(b[1:])], b[1:]))
        law = DruckerPrager(1.0, dilatancy=rng.random())
        for name in names:
            stuck = answer_block(law, W, -W @ force, name)
            assert not stuck.failed and not stuck.used_failsafe
            assert stuck.u == pytest.approx(0.0, abs=1e-9)
            open_block = answer_block(law, W, opening, name, rng.standard_normal(s))
            assert not open_block.failed and (open_block.r == 0.0).all()


def test_a_block_that_separates_carries_no_force() -> None:
    r, u = solve_block(Coulomb(0.7), np.eye(3), np.array([0.2, 3.0, -1.0]))
    assert (r == 0.0).all() and np.allclose(u, [0.2, 3.0, -1.0])


def test_sliding_force_opposes_slip_and_saturates_the_cone() -> None:
    mu = 0.3
    r, u = solve_block(Coulomb(mu), np.eye(3), np.array([-1.0, 2.0, 0.0]))
    assert r == pytest.approx([1.0, -mu, 0.0])
    assert u == pytest.approx([0.0, 2.0 - mu, 0.0])


def test_unsuited_local_solvers_are_refused() -> None:
    with pytest.raises(InputError, match="local_solver"):
        solve_block(Coulomb(0.5), np.eye(6), np.ones(6), "enumerative")
    with pytest.raises(InputError, match="yield"):
        solve_block(
            DruckerPrager(0.5, shear_yield=1.0), np.eye(3), np.ones(3), "fischer-burmeister+enumerative"
        )
    with pytest.raises(InputError, match="secular"):
        solve_block(Coulomb(0.5), np.eye(3), np.ones(3), "newton")
