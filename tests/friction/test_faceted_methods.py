"""Problems under the faceted law: solved by its own methods, certified by its own natural map, refused by all others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import random_problem, stacked_blocks

from barchan.cones import Coulomb, FacetedCoulomb
from barchan.errors import InputError
from barchan.friction import Problem, certify, methods, solve, write
from barchan.friction.local import solve_block
from barchan.friction.methods import FACETED_METHODS, METHODS
from barchan.friction.operators import build_operator

SIZES = (2, 3, 6)


def violations(problem: Problem, r: np.ndarray, u: np.ndarray) -> float:
    """How far (u, r) is from the law as it is written, without any projection: forces relative to |r|, powers to |u| |r|."""
    blocks, rates = r.reshape(problem.n, problem.s), u.reshape(problem.n, problem.s)
    bound = problem.law.mu * blocks[:, 0]
    excess = np.max(np.abs(blocks[:, 1:]), axis=1) - bound
    force = np.linalg.norm(blocks)
    power = force * np.linalg.norm(rates)
    missing = (
        bound[:, None] * np.abs(rates[:, 1:]) + blocks[:, 1:] * rates[:, 1:]
    )  # dissipated less than the law wants
    return max(
        *(np.max(x, initial=0.0) / force for x in (-blocks[:, 0], excess)),
        np.max(-rates[:, 0], initial=0.0) / np.linalg.norm(rates),
        np.max(np.abs(blocks[:, 0] * rates[:, 0])) / power,
        np.max(np.abs(missing)) / power,
    )


def problem_of(s: int, seed: int = 1, n: int = 12, form: str = "lumped", mu: float = 0.4) -> Problem:
    base = random_problem(seed, n, s, bodies=2 * n, law=FacetedCoulomb(np.linspace(0.0, mu, n)))
    if form == "lumped":
        return base
    W = np.stack([build_operator(base, "explicit").apply(e.reshape(n, s)).ravel() for e in np.eye(n * s)])
    return Problem.reduced(W, build_operator(base, "explicit").b.ravel(), base.law, block_size=s)


@pytest.mark.parametrize("form", ["lumped", "reduced"])
@pytest.mark.parametrize("s", SIZES)
@pytest.mark.parametrize("method", FACETED_METHODS)
def test_its_methods_solve_it(method: str, s: int, form: str) -> None:
    problem = problem_of(s, form=form)
    solution = solve(problem, method, tol=1e-9)
    assert solution.converged and certify(problem, solution.r, solution.v).residual <= 1e-9
    assert solution.certificate.residual == pytest.approx(solution.history[-1].residual, rel=1e-3, abs=1e-14)
    assert violations(problem, solution.r, solution.u) < 1e-7
    again = solve(problem, method, tol=1e-9)
    assert again.r.tobytes() == solution.r.tobytes()


@settings(max_examples=30)
@given(st.integers(0, 2**31), st.sampled_from(SIZES), st.floats(0.0, 0.5))
def test_the_certificate_knows_the_law(seed: int, s: int, mu: float) -> None:
    """Whatever small problem converges satisfies the law as it is written; forces of the exact law do not pass for it."""
    problem = problem_of(s, seed, 6, mu=mu)
    solution = solve(problem, tol=1e-10, max_iterations=4000)
    if solution.converged and solution.r.any() and solution.u.any():
        assert violations(problem, solution.r, solution.u) < 1e-6


@pytest.mark.parametrize("form", ["lumped", "reduced"])
def test_with_one_tangential_component_it_is_coulombs(form: str) -> None:
    faceted = problem_of(2, form=form)
    exact = faceted.variant(Coulomb(faceted.law.mu))
    expected = solve(exact, "gauss_seidel", tol=1e-11)
    assert solve(faceted, tol=1e-11).u == pytest.approx(expected.u, abs=1e-8)
    assert certify(faceted, expected.r, expected.v).residual < 1e-10


@pytest.mark.parametrize("s", [3, 6])
def test_the_exact_answer_is_not_the_faceted_one_where_blocks_slide(s: int) -> None:
    faceted = problem_of(s)
    exact = solve(faceted.variant(Coulomb(faceted.law.mu)), tol=1e-8)
    assert exact.converged and certify(faceted, exact.r, exact.v).residual > 1e-3


@given(st.integers(0, 2**31), st.sampled_from(SIZES), st.floats(0.0, 1.5))
def test_a_single_block_is_solved_component_by_component(seed: int, s: int, mu: float) -> None:
    """With a diagonal W the answer is known: normal force first, then each component clipped to the box."""
    rng = np.random.default_rng(seed)
    W, b = np.diag(rng.uniform(0.5, 2.0, s)), rng.normal(size=s)
    r, _ = solve_block(FacetedCoulomb(mu), W, b, "faceted")
    normal = max(-b[0] / W[0, 0], 0.0)
    expected = np.append(normal, np.clip(-b[1:] / np.diag(W)[1:], -mu * normal, mu * normal))
    np.testing.assert_allclose(r, expected, atol=1e-12)


def test_a_pile_bears_its_weight() -> None:
    pile = stacked_blocks(5)
    solution = solve(pile.variant(FacetedCoulomb(0.6)), tol=1e-8)
    assert solution.converged
    assert solution.r.reshape(5, 3)[:, 0] == pytest.approx(9.81 * np.arange(5, 0, -1), rel=1e-6)


@pytest.mark.parametrize("parallel", [False, True])
def test_coloured_sweeps_reach_the_same_answer(parallel: bool) -> None:
    problem = problem_of(3, n=40)
    solution = solve(problem, "faceted_gauss_seidel", tol=1e-10, parallel=parallel)
    reference = solve(problem, tol=1e-10)
    assert solution.converged and solution.u == pytest.approx(reference.u, abs=1e-7)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "auto"])
def test_methods_of_friction_refuse_facets(method: str) -> None:
    with pytest.raises(InputError, match="the others need a cone without facets"):
        solve(problem_of(3), method)


def test_round_laws_know_nothing_of_the_faceted_method_and_files_of_the_law() -> None:
    assert "faceted_gauss_seidel" not in methods()
    problem = problem_of(3)
    with pytest.raises(InputError, match="method = faceted_gauss_seidel"):
        solve(problem.variant(Coulomb(0.3)), "faceted_gauss_seidel")
    with pytest.raises(InputError, match="problem files know no facets"):
        write("faceted.hdf5", problem)
    with pytest.raises(InputError, match="option of auto"):
        solve(problem, nonsense=1)
