"""One-block solvers: whatever the block, the answer satisfies the law, and the different methods agree."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction.local import solve_block


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
    for method in ("enumerative", "hybrid"):
        r, u = solve_block(law, W, b, method)
        assert violation(law, W, r, u) < 1e-7, method
    if associated:
        exact, _ = solve_block(law, W, b)
        assert np.allclose(r, exact, atol=1e-7 * (1.0 + np.linalg.norm(exact)))


def test_newton_solves_most_six_dimensional_blocks() -> None:
    solved = 0
    for seed in range(200):
        W, b = random_block(seed, 6, 1.0)
        law = Coulomb(0.5)
        r, u = solve_block(law, W, b, "fischer-burmeister")
        solved += violation(law, W, r, u) < 1e-8
    assert solved >= 190


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
        solve_block(DruckerPrager(0.5, shear_yield=1.0), np.eye(3), np.ones(3), "hybrid")
    with pytest.raises(InputError, match="secular"):
        solve_block(Coulomb(0.5), np.eye(3), np.ones(3), "newton")
