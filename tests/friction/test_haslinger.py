"""Haslinger's fixed point: Coulomb friction is a convex problem over cylinders whose thresholds are those of its own forces."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem, stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction.methods._inner import run_inner

LAWS = {
    "coulomb": Coulomb(0.3),
    "cone": SecondOrderCone(0.3),
    "drucker-prager": DruckerPrager(0.5, shear_yield=0.1, tensile_yield=0.05, dilatancy=0.2),
    "frictionless": Coulomb(0.0),
}


def problem_of(law: Law, s: int, seed: int = 0, n: int = 20, bodies: int = 24) -> Problem:
    bare = random_problem(seed, n, s, bodies=bodies)
    return Problem(M=bare.M, f=bare.f, H=bare.H, w=bare.w, law=law)


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("law", LAWS)
def test_the_fixed_point_has_the_velocities_of_the_problem(law: str, s: int) -> None:
    problem = problem_of(LAWS[law], s)
    fixed, swept = solve(problem, "haslinger", tol=1e-9), solve(problem, "gauss_seidel", tol=1e-10)
    assert fixed.converged and swept.converged
    np.testing.assert_allclose(fixed.u, swept.u, atol=1e-6 * np.abs(swept.u).max())


@pytest.mark.parametrize("inner", ["gauss_seidel", "aspg", "auto"])
def test_any_method_serves_inside(inner: str) -> None:
    for problem in (problem_of(LAWS["coulomb"], 3), problem_of(LAWS["coulomb"], 3, n=25, bodies=6)):
        solution = solve(problem, "haslinger", tol=1e-8, inner=inner)
        assert solution.converged
        assert certify(problem, solution.r, solution.v).residual <= 1e-8


def test_lemke_inside_makes_2d_steps_exact() -> None:
    """Few outer steps, each the solution of its convex problem."""
    solution = solve(problem_of(Coulomb(0.4), 2), "haslinger", tol=1e-9, inner="lemke")
    assert solution.converged and len(solution.history) <= 40


@pytest.mark.parametrize("law", LAWS)
def test_its_forces_solve_the_convex_problem_of_their_own_thresholds(law: str) -> None:
    """Freezing s = shear yield + mu (r_N + tensile yield) and the opening zeta |u_T| changes nothing at a solution."""
    problem = problem_of(LAWS[law], 3, seed=1)
    solution = solve(problem, "haslinger", tol=1e-9)
    mu, shear, tension, zeta = problem.parameters.T
    r, u = solution.r.reshape(-1, 3), solution.u.reshape(-1, 3)
    drift = np.zeros_like(u)
    drift[:, 0] = -zeta * np.linalg.norm(u[:, 1:], axis=1)
    cylinder = DruckerPrager(np.zeros(problem.n), shear + mu * np.maximum(r[:, 0] + tension, 0.0), tension)
    frozen = problem.variant(cylinder, drift)
    assert certify(frozen, r).residual <= 1e-8
    assert certify(problem.variant(cylinder.convexified(), drift), r).residual <= 1e-8


def test_iterations_are_those_of_the_inner_method_and_are_bounded() -> None:
    problem = problem_of(Coulomb(0.7), 3, n=25, bodies=20)
    free = solve(problem, "haslinger", tol=1e-10)
    counts = [entry.iteration for entry in free.history]
    assert counts[0] == 0 and np.all(np.diff(counts) > 0)
    assert len(counts) < counts[-1]
    bounded = solve(problem, "haslinger", tol=1e-14, max_iterations=17, inner_iterations=5)
    assert bounded.iterations == 17 and not bounded.converged
    assert np.diff([entry.iteration for entry in bounded.history]).max() <= 5
    assert solve(problem, "haslinger", max_iterations=0).iterations == 0


def test_a_warm_start_is_used_and_a_solution_is_kept() -> None:
    problem = problem_of(Coulomb(0.5), 3)
    cold = solve(problem, "haslinger", tol=1e-8)
    assert solve(problem, "haslinger", tol=1e-8, r0=cold.r).iterations == 0
    near = solve(problem, "haslinger", tol=1e-8, r0=1.001 * cold.r)
    assert near.converged and near.iterations < cold.iterations


def test_a_strong_dilatant_law_needs_the_safeguard_and_gets_it() -> None:
    """Freezing the opening overshoots where zeta is large; smaller steps still arrive."""
    problem = problem_of(SecondOrderCone(0.8), 3, seed=2, n=25, bodies=30)
    assert solve(problem, "haslinger", tol=1e-7).converged


def test_bilateral_rows_reduced_problems_and_a_pile() -> None:
    free = problem_of(Coulomb(0.4), 3, n=12, bodies=10)
    C = sp.csr_array(([1.0, -1.0, 1.0], ([0, 0, 1], [0, 3, 7])), shape=(2, 30))
    held = Problem(M=free.M, f=free.f, H=free.H, w=free.w, law=free.law, C=C, k=np.array([0.1, 0.0]))
    solution = solve(held, "haslinger", tol=1e-8)
    assert solution.converged and solution.certificate.bilateral <= 1e-12
    W = (free.H @ sp.diags_array(1.0 / free.M.diagonal()) @ free.H.T).toarray()
    reduced = Problem.reduced(W, free.H @ (free.f / free.M.diagonal()), Coulomb(np.full(12, 0.4)))
    np.testing.assert_allclose(
        solve(reduced, "haslinger", tol=1e-10).u, solve(free, "haslinger", tol=1e-10).u, atol=1e-7
    )
    pile = solve(stacked_blocks(8), "haslinger", tol=1e-9)
    assert pile.r.reshape(-1, 3)[:, 0] == pytest.approx(9.81 * np.arange(8, 0, -1), rel=1e-7)


def test_an_inner_run_stops_at_its_tolerance_or_its_limit() -> None:
    problem = problem_of(Coulomb(0.4), 3)
    start = np.zeros((problem.n, 3))
    r, iterations = run_inner(problem, "gauss_seidel", start, 1e-6, None)
    assert certify(problem, r).residual <= 1.1e-6 and iterations > 0
    rough, fewer = run_inner(problem, "gauss_seidel", start, 1e-6, 5)
    assert fewer == 5 and certify(problem, rough).residual > certify(problem, r).residual
    assert not start.any()
    kept, none = run_inner(problem, "gauss_seidel", r, 1e-5, None)
    assert none == 0 and np.array_equal(kept, r)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"inner": "magic"}, "inner = magic: must be one of auto"),
        ({"accuracy": 0.0}, "accuracy"),
        ({"accuracy": 1.0}, "accuracy"),
        ({"inner_iterations": 0}, "inner_iterations"),
        ({"operator": "guess"}, "operator"),
    ],
)
def test_unusable_options_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        solve(problem_of(Coulomb(0.4), 3), "haslinger", **options)
    with pytest.raises(InputError, match="option of inner gauss_seidel"):
        run_inner(problem_of(Coulomb(0.4), 3), "gauss_seidel", np.zeros((20, 3)), 0.1, 1, speed=2)
