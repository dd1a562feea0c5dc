"""Solvers: every law, operator and method ends with a certificate it does not compute itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem, stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, methods, solve
from barchan.friction.operators import build_operator

LAWS = {
    "coulomb": lambda n: Coulomb(np.full(n, 0.4)),
    "cone": lambda n: SecondOrderCone(np.full(n, 0.4)),
    "drucker-prager": lambda n: DruckerPrager(
        np.full(n, 0.4), shear_yield=0.05, tensile_yield=0.02, dilatancy=0.4
    ),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("method", ["gauss_seidel", "aspg"])
def test_any_method_solves_any_law(method: str, s: int, law: str) -> None:
    n = 20
    problem = random_problem(3, n, s, bodies=24, law=LAWS[law](n))
    solution = solve(problem, method, tol=1e-8)
    assert solution.converged
    assert certify(problem, solution.r, solution.v).residual <= 1e-8
    assert solution.history[0].iteration == 0 and solution.iterations > 0


@pytest.mark.parametrize("s", [3, 6])
def test_explicit_and_matrix_free_sweeps_agree(s: int) -> None:
    problem = random_problem(5, 30, s, bodies=15)
    explicit = solve(problem, "gauss_seidel", tol=1e-10, operator="explicit")
    free = solve(problem, "gauss_seidel", tol=1e-10, operator="matrix-free")
    assert explicit.converged and free.converged
    assert np.allclose(explicit.u, free.u, atol=1e-7)


def test_operators_are_the_same_matrix() -> None:
    problem = random_problem(7, 12, 3, bodies=8)
    W = (problem.H @ sp.diags_array(1.0 / problem.M.diagonal()) @ problem.H.T).toarray()
    r = np.random.default_rng(0).standard_normal((12, 3))
    for kind in ("explicit", "matrix-free"):
        operator = build_operator(problem, kind)
        assert np.allclose(operator.apply(r).ravel(), W @ r.ravel())
        for i in range(12):
            assert np.allclose(operator.diagonal_blocks[i], W[3 * i : 3 * i + 3, 3 * i : 3 * i + 3])


@pytest.mark.parametrize("operator", ["explicit", "matrix-free"])
def test_parallel_sweeps_do_not_depend_on_the_number_of_threads(
    operator: str, bytes_by_threads: Callable[..., list[bytes]]
) -> None:
    problem = random_problem(11, 400, 3, bodies=300)
    options = {"tol": 1e-6, "max_iterations": 15, "parallel": True, "operator": operator}
    one, two = bytes_by_threads(lambda: [solve(problem, "gauss_seidel", **options).r])
    assert one == two


@pytest.mark.parametrize("method", ["gauss_seidel", "aspg", "auto"])
def test_a_pile_carries_its_weight(method: str) -> None:
    levels = 10
    solution = solve(stacked_blocks(levels), method, tol=1e-9)
    assert solution.converged
    assert solution.r.reshape(-1, 3)[:, 0] == pytest.approx(9.81 * np.arange(levels, 0, -1), rel=1e-7)
    assert np.abs(solution.v).max() < 10 * 1e-9 * np.linalg.norm(solution.r)


def test_every_local_solver_serves_gauss_seidel() -> None:
    problem = random_problem(2, 25, 3, bodies=40)
    for name in ("secular", "enumerative", "fischer-burmeister", "fischer-burmeister+enumerative"):
        assert solve(problem, "gauss_seidel", tol=1e-7, local_solver=name).converged, name


def test_general_mass_matrix_and_bilateral_constraints() -> None:
    base = random_problem(4, 10, 3, bodies=40)
    rng = np.random.default_rng(1)
    m = base.size
    coupling = sp.random_array((m, m), density=0.05, rng=rng)
    M = sp.csr_array(coupling @ coupling.T + sp.eye_array(m))
    C = sp.csr_array(rng.standard_normal((3, m)))
    k = rng.standard_normal(3)
    for constraints in ({}, {"C": C, "k": k}):
        problem = Problem(M=M, f=base.f, H=base.H, w=base.w, law=base.law, **constraints)
        for method in ("gauss_seidel", "aspg"):
            solution = solve(problem, method, tol=1e-8)
            assert solution.converged, (method, solution.certificate)
            if constraints:
                assert C @ solution.v == pytest.approx(k, abs=1e-8)


def test_block_diagonal_mass_is_inverted_block_by_block() -> None:
    base = random_problem(6, 15, 3, bodies=10, dofs=6)
    rng = np.random.default_rng(2)
    parts = []
    for _ in range(10):
        a = rng.standard_normal((6, 6))
        parts.append(a @ a.T + np.eye(6))
    problem = Problem(M=sp.block_diag(parts), f=base.f, H=base.H, w=base.w, law=base.law)
    assert problem.factor.kind == "blocks"
    rhs = rng.standard_normal(60)
    assert problem.M @ problem.factor.solve(rhs) == pytest.approx(rhs)
    assert solve(problem, "gauss_seidel", tol=1e-8).converged


def test_singular_blocks_are_solved_by_the_proximal_term() -> None:
    # Two coincident contacts in 3D whose second tangent is blind: W_ii has rank 2.
    H = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]] * 2)
    problem = Problem(M=np.eye(2), f=np.array([0.4, -1.0]), H=H, w=np.zeros(6), law=Coulomb(np.full(2, 0.3)))
    solution = solve(problem, "gauss_seidel", tol=1e-8)
    assert solution.converged
    assert solution.r.reshape(2, 3)[:, 0].sum() == pytest.approx(1.0, rel=1e-6)
    assert solution.r.reshape(2, 3)[:, 1].sum() == pytest.approx(-0.3, rel=1e-6)


def test_sleeping_changes_the_work_not_the_answer() -> None:
    problem = random_problem(9, 60, 3, bodies=120)
    awake = solve(problem, "gauss_seidel", tol=1e-8, sleeping=False)
    asleep = solve(problem, "gauss_seidel", tol=1e-8, sleeping=True)
    assert awake.converged and asleep.converged
    assert np.allclose(awake.u, asleep.u, atol=1e-5)


def test_an_unreached_tolerance_is_said_and_the_best_iterate_kept() -> None:
    problem = random_problem(13, 40, 3, bodies=12)
    solution = solve(problem, "gauss_seidel", tol=1e-12, max_iterations=4)
    assert not solution.converged and "limit" in solution.message
    assert solution.certificate.law == pytest.approx(min(h.residual for h in solution.history), rel=1e-6)


def test_callback_may_stop_the_solve() -> None:
    seen = []
    solution = solve(
        random_problem(13, 40, 3, bodies=12),
        tol=1e-12,
        callback=lambda p, r: seen.append(p) or True,
    )
    assert len(seen) == 1 and not solution.converged


def test_no_contact_is_solved_trivially() -> None:
    problem = Problem(
        M=np.eye(2),
        f=np.array([1.0, 2.0]),
        H=np.zeros((0, 2)),
        w=np.zeros(0),
        law=Coulomb(np.zeros(0)),
        block_size=3,
    )
    solution = solve(problem)
    assert solution.converged and solution.v == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"method": "simplex"}, "method"),
        ({"tol": -1.0}, "tol"),
        ({"r0": np.zeros(2)}, "r0"),
        ({"method": "gauss_seidel", "colour": 3}, "option"),
        ({"method": "gauss_seidel", "operator": "dense"}, "operator"),
    ],
)
def test_bad_requests_name_the_field(options: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        solve(random_problem(1, 4, 3, bodies=4), **options)


def test_method_names() -> None:
    assert {"auto", "gauss_seidel", "aspg"} <= set(methods())
