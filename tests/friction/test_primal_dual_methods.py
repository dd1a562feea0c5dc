"""Primal-dual methods: steps admissible by theorem suffice for every convex problem; constraints, noise and limits."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from first_order_cases import CASES, CONVEX_LAWS, COUNT, small_problem
from problems import stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction.methods._primal import primal_data
from barchan.friction.methods._scaled import scaled_problem

METHODS = {
    "admm": {},
    "admm plain": {"accelerated": False, "balanced": False},
    "admm linearised": {"linearised": True},
    "admm linearised plain": {"linearised": True, "accelerated": False},
    "ama": {},
    "ama plain": {"accelerated": False},
    "dual_ama": {},
    "dual_ama plain": {"accelerated": False},
    "arrow_hurwicz": {},
    "chambolle_pock": {},
    "chambolle_pock plain": {"accelerated": False},
}


def name_of(label: str) -> str:
    return label.split()[0]


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("label", METHODS)
def test_convex_problems_are_solved(label: str, s: int) -> None:
    for shape, law in CASES:
        problem = small_problem(shape, s, CONVEX_LAWS[law](COUNT))
        solution = solve(problem, name_of(label), tol=1e-6, **METHODS[label])
        assert solution.converged, (shape, law, solution.certificate)
        assert certify(problem, solution.r, solution.v).residual <= 1e-6


@pytest.mark.parametrize("label", METHODS)
def test_coulomb_problems_have_the_rates_that_gauss_seidel_finds(label: str) -> None:
    for s, shape in ((2, "lumped"), (3, "constrained"), (6, "reduced")):
        problem = small_problem(shape, s, Coulomb(np.full(COUNT, 0.3)))
        reference = solve(problem, "gauss_seidel", tol=1e-9)
        solution = solve(problem, name_of(label), tol=1e-8, **METHODS[label])
        assert reference.converged and solution.converged
        assert solution.u == pytest.approx(reference.u, abs=1e-6)


@pytest.mark.parametrize("label", METHODS)
def test_plasticity_with_partial_dilatancy(label: str) -> None:
    law = DruckerPrager(np.full(COUNT, 0.5), shear_yield=0.05, tensile_yield=0.02, dilatancy=0.2)
    for shape in ("lumped", "constrained"):
        assert solve(small_problem(shape, 3, law), name_of(label), tol=1e-7, **METHODS[label]).converged


@pytest.mark.parametrize("step", [0.3, 1.0, 1.9])
@pytest.mark.parametrize("damping", [0.01, 1.0, 30.0])
def test_arrow_hurwicz_converges_below_its_step_limit_for_every_damping(step: float, damping: float) -> None:
    problem = small_problem("lumped", 3, SecondOrderCone(np.full(COUNT, 0.5)))
    largest = np.linalg.eigvalsh(_dense(problem))[-1]
    solution = solve(problem, "arrow_hurwicz", tol=1e-6, force_step=step / largest, damping=damping)
    assert solution.converged


def test_chambolle_pock_converges_at_the_limit_of_its_steps() -> None:
    problem = small_problem("lumped", 3, SecondOrderCone(np.full(COUNT, 0.5)))
    largest = np.linalg.eigvalsh(_dense(problem))[-1]
    for tau in (0.02, 0.5, 3.0):
        options = {"velocity_step": tau, "force_step": 1.0 / (tau * largest), "accelerated": False}
        assert solve(problem, "chambolle_pock", tol=1e-6, **options).converged


def _dense(problem: Problem) -> np.ndarray:
    scaled = scaled_problem(problem)
    size = problem.n * problem.s
    columns = [scaled.product(row.reshape(problem.n, problem.s)).ravel() for row in np.eye(size)]
    return np.array(columns).T


@pytest.mark.parametrize("shape", ["lumped", "general", "reduced"])
def test_primal_data_reproduce_the_scaled_problem(shape: str) -> None:
    problem = small_problem(shape, 3, Coulomb(np.full(COUNT, 0.5)))
    data = primal_data(problem)
    operators = data.operators
    M, H = operators.M.toarray(), operators.H.toarray() if sp.issparse(operators.H) else operators.H
    assert M.diagonal() == pytest.approx(1.0)
    assert H @ np.linalg.solve(M, H.T) == pytest.approx(_dense(problem), abs=1e-12)
    zero = scaled_problem(problem).rates(np.zeros((COUNT, 3)))
    assert H @ np.linalg.solve(M, data.f) + data.w == pytest.approx(zero.ravel(), abs=1e-12)
    assert operators.exact
    load = np.arange(len(data.f), dtype=float)
    for beta, gamma in ((0.0, 0.0), (0.7, 0.0), (0.3, 2.0)):
        matrix = M + beta * np.eye(len(M)) + gamma * H.T @ H
        assert matrix @ operators.solver(beta, gamma)(load) == pytest.approx(load, abs=1e-10)


def test_variants_share_what_is_factorised() -> None:
    problem = small_problem("constrained", 3, Coulomb(np.full(COUNT, 0.5)))
    other = problem.variant(SecondOrderCone(np.full(COUNT, 0.5)), drift=np.ones(3 * COUNT))
    assert primal_data(other).operators is primal_data(problem).operators
    assert primal_data(other).w == pytest.approx(primal_data(problem).w + np.sqrt(np.repeat(problem.rho, 3)))
    assert solve(other, "admm", tol=1e-6).converged


@pytest.mark.parametrize("label", ["admm", "admm linearised", "dual_ama"])
def test_noise_in_a_stored_delassus_operator_is_honoured(label: str) -> None:
    # Files hold W with asymmetry up to 0.25 %: the certificate takes W as given, no M and H can reproduce it.
    clean = small_problem("reduced", 3, Coulomb(np.full(COUNT, 0.3)))
    noise = (
        1e-3 * np.random.default_rng(0).standard_normal((3 * COUNT, 3 * COUNT)) * abs(clean.W.toarray()).max()
    )
    W = clean.W.toarray() + noise - noise.T
    problem = Problem.reduced(W, clean.b, clean.law, block_size=3)
    assert not primal_data(problem).operators.exact
    assert solve(problem, name_of(label), tol=1e-7, **METHODS[label]).converged


@pytest.mark.parametrize("label", METHODS)
def test_blocks_that_cannot_move_and_frictionless_ones(label: str) -> None:
    W = np.diag([1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 3.0])
    b = np.array([-1.0, 0.1, 0.0, 0.5, 0.0, 0.0, -2.0, 0.2, 0.0])
    problem = Problem.reduced(W, b, Coulomb(np.array([0.0, 0.0, 0.5])))
    solution = solve(problem, name_of(label), tol=1e-8, **METHODS[label])
    assert solution.converged
    assert solution.r.reshape(3, 3) == pytest.approx(
        np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, -0.2, 0.0]]), abs=1e-6
    )


def test_no_motion_at_all_possible() -> None:
    problem = Problem.reduced(np.zeros((4, 4)), np.array([1.0, 0.0, 2.0, 0.0]), Coulomb(np.full(2, 0.5)))
    for label, options in METHODS.items():
        solution = solve(problem, name_of(label), **options)
        assert solution.converged and not solution.r.any(), label


@pytest.mark.parametrize("label", METHODS)
def test_a_solution_is_recognised_and_runs_repeat(label: str) -> None:
    problem = stacked_blocks(4)
    first, second = (solve(problem, name_of(label), tol=1e-9, **METHODS[label]) for _ in range(2))
    assert first.r.tobytes() == second.r.tobytes()
    again = solve(problem, name_of(label), tol=1e-8, r0=first.r, **METHODS[label])
    assert again.converged and again.iterations == 0
    assert not solve(problem, name_of(label), tol=1e-12, max_iterations=2, **METHODS[label]).converged


def test_a_reduced_problem_too_large_to_decompose_is_refused() -> None:
    size = 2 * 3001
    problem = Problem.reduced(sp.eye_array(size, format="csr"), np.ones(size), Coulomb(0.5), block_size=2)
    for method in ("admm", "dual_ama"):
        with pytest.raises(InputError, match="at most"):
            solve(problem, method)


@pytest.mark.parametrize(
    ("method", "options", "field"),
    [
        ("admm", {"penalty": -1.0}, "penalty"),
        ("admm", {"shift_rate": 0.0}, "shift_rate"),
        ("ama", {"penalty": 0.0}, "penalty"),
        ("dual_ama", {"velocity_step": -0.1}, "velocity_step"),
        ("dual_ama", {"damping": float("inf")}, "damping"),
        ("arrow_hurwicz", {"damping": -1.0}, "damping"),
        ("arrow_hurwicz", {"force_step": -1.0}, "force_step"),
        ("chambolle_pock", {"velocity_step": 0.0}, "velocity_step"),
        ("chambolle_pock", {"smallest_step": -1.0}, "smallest_step"),
        ("chambolle_pock", {"check_every": 0}, "check_every"),
    ],
)
def test_bad_options_are_named(method: str, options: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        solve(stacked_blocks(3), method, **options)
