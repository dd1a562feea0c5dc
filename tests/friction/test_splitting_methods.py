"""Splitting methods: Jacobi, symmetric and over-relaxed Gauss-Seidel, directions of sweeping, and what local solves came to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem

from barchan.cones import Coulomb, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, Solution, certify, solve
from barchan.friction.local import LOCAL_SOLVERS, LocalCounts
from barchan.friction.operators import build_operator

SPLITTINGS = ("jacobi", "symmetric_gauss_seidel", "sor")


def after(problem: Problem, method: str, iterations: int, **options: object) -> Solution:
    """The best iterate of exactly `iterations` iterations."""
    return solve(problem, method, tol=1e-300, max_iterations=iterations, **options)


@pytest.mark.parametrize("associated", [False, True])
@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("method", SPLITTINGS)
def test_splittings_reach_the_certificate(method: str, s: int, associated: bool) -> None:
    mu = np.full(20, 0.4)
    problem = random_problem(3, 20, s, bodies=24, law=SecondOrderCone(mu) if associated else Coulomb(mu))
    for operator in ("explicit", "matrix-free"):
        solution = solve(problem, method, tol=1e-8, operator=operator)
        assert solution.converged
        assert certify(problem, solution.r, solution.v).residual <= 1e-8


@pytest.mark.parametrize("method", SPLITTINGS)
def test_splittings_find_the_velocity_of_gauss_seidel(method: str) -> None:
    problem = random_problem(5, 30, 3, bodies=15)
    reference = solve(problem, "gauss_seidel", tol=1e-10)
    assert np.allclose(solve(problem, method, tol=1e-10).u, reference.u, atol=1e-7)


def test_bilateral_constraints_are_carried() -> None:
    base = random_problem(4, 10, 3, bodies=40)
    rng = np.random.default_rng(1)
    C, k = sp.csr_array(rng.standard_normal((3, base.size))), rng.standard_normal(3)
    problem = Problem(M=base.M, f=base.f, H=base.H, w=base.w, law=base.law, C=C, k=k)
    for method in SPLITTINGS:
        solution = solve(problem, method, tol=1e-8)
        assert solution.converged
        assert C @ solution.v == pytest.approx(k, abs=1e-8)


def test_jacobi_does_not_depend_on_the_order_of_the_blocks() -> None:
    problem = random_problem(7, 15, 3, bodies=8)
    order = np.random.default_rng(0).permutation(15)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    H = sp.csr_array(problem.H)[rows]
    shuffled = Problem(M=problem.M, f=problem.f, H=H, w=problem.w[rows], law=problem.law, block_size=3)
    for operator in ("explicit", "matrix-free"):
        options = {"operator": operator, "damping": 0.3}
        one = after(problem, "jacobi", 7, **options).r
        assert np.allclose(after(shuffled, "jacobi", 7, **options).r, one[rows], rtol=1e-10, atol=1e-12)
        swept = after(problem, "gauss_seidel", 7, operator=operator).r
        assert not np.allclose(
            after(shuffled, "gauss_seidel", 7, operator=operator).r, swept[rows], atol=1e-6
        )


@pytest.mark.parametrize("seed", range(4))
def test_damped_jacobi_decreases_the_energy_of_the_convexified_problem(seed: int) -> None:
    problem = random_problem(seed, 25, 3, bodies=10, law=SecondOrderCone(np.full(25, 0.6)))
    delassus = build_operator(problem)
    energies = []

    def note(_: object, r: np.ndarray) -> None:
        energies.append(float((r * (0.5 * delassus.apply(r) + delassus.b)).sum()))

    after(problem, "jacobi", 40, callback=note, check_every=1)
    # Round-off of the energy, whose decrease ends when the method has converged.
    assert (np.diff(energies) <= 1e-12 * abs(energies[-1])).all()
    assert energies[-1] < energies[0]


def test_every_direction_finds_the_same_velocity() -> None:
    problem = random_problem(5, 30, 3, bodies=15)
    alternating = solve(problem, "gauss_seidel", tol=1e-10)
    for direction in ("forward", "symmetric"):
        solution = solve(problem, "gauss_seidel", tol=1e-10, direction=direction)
        assert solution.converged
        assert np.allclose(solution.u, alternating.u, atol=1e-7)


def test_a_symmetric_iteration_is_two_alternating_sweeps() -> None:
    problem = random_problem(6, 20, 3, bodies=9)
    symmetric = after(problem, "symmetric_gauss_seidel", 10, operator="explicit")
    assert symmetric.r.tobytes() == after(problem, "gauss_seidel", 20, operator="explicit").r.tobytes()
    assert symmetric.iterations == 10
    option = after(problem, "gauss_seidel", 10, direction="symmetric", operator="explicit")
    assert option.r.tobytes() == symmetric.r.tobytes()


def test_sor_with_factor_one_is_gauss_seidel() -> None:
    problem = random_problem(6, 20, 3, bodies=9)
    swept = after(problem, "gauss_seidel", 9, direction="forward").r
    assert after(problem, "sor", 9, relaxation=1.0).r.tobytes() == swept.tobytes()
    assert after(problem, "sor", 9).r.tobytes() != swept.tobytes()


@pytest.mark.parametrize(
    "name", [*(n for n in LOCAL_SOLVERS if not n.endswith("+secular")), "fischer-burmeister+secular"]
)
def test_every_local_solver_serves_the_sweeps(name: str) -> None:
    problem = random_problem(2, 25, 3, bodies=40)
    counts = LocalCounts()
    solution = solve(problem, "gauss_seidel", tol=1e-7, max_iterations=400, local_solver=name, counts=counts)
    assert counts.solves == 25 * solution.iterations
    assert counts.failures <= 0.01 * counts.solves
    # Alone the pyramid answers another law; its fail-safe answers a share of the blocks, the others' hardly any.
    assert solution.converged != (name == "pyramid")
    if "+" not in name:
        assert counts.failsafe_calls == 0
    else:
        assert (counts.failsafe_calls > 0.1 * counts.solves) == name.startswith("pyramid")


def test_counts_add_up_over_runs_and_do_not_change_the_answer() -> None:
    problem = random_problem(6, 20, 3, bodies=9)
    counts = LocalCounts()
    counted = after(problem, "jacobi", 10, counts=counts, damping=0.4)
    assert counts.solves == 200
    after(problem, "sor", 5, counts=counts, operator="matrix-free")
    assert counts.solves == 300 and counts.failures == 0
    assert after(problem, "jacobi", 10, damping=0.4).r.tobytes() == counted.r.tobytes()


def test_the_pyramid_alone_converges_to_a_force_of_its_own_law() -> None:
    mu = 0.5
    problem = random_problem(2, 25, 3, bodies=40, mu=mu)
    seen: list[np.ndarray] = []
    solve(
        problem, "gauss_seidel", tol=1e-300, max_iterations=600, local_solver="pyramid",
        callback=lambda _, r: seen.append(r.copy()),
    )  # fmt: skip
    r = seen[-1]
    assert np.abs(r - seen[-2]).max() < 1e-10 * np.abs(r).max()
    delassus = build_operator(problem)
    u = delassus.apply(r) + delassus.b
    along = delassus.b[:, 1:] / np.linalg.norm(delassus.b[:, 1:], axis=1)[:, None]
    for axis in (along, np.stack([-along[:, 1], along[:, 0]], axis=1)):
        force, slip = (r[:, 1:] * axis).sum(axis=1), (u[:, 1:] * axis).sum(axis=1)
        assert force == pytest.approx(np.clip(force - slip, -mu * r[:, 0], mu * r[:, 0]), abs=1e-8)
    assert np.minimum(r[:, 0], u[:, 0]) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("operator", ["explicit", "matrix-free"])
def test_parallel_jacobi_does_not_depend_on_the_number_of_threads(
    operator: str, bytes_by_threads: Callable[..., list[bytes]]
) -> None:
    problem = random_problem(11, 300, 3, bodies=200)
    options = {"parallel": True, "operator": operator, "damping": 0.5}
    one, two = bytes_by_threads(lambda: [after(problem, "jacobi", 10, **options).r])
    assert one == two


@pytest.mark.parametrize(
    ("method", "options", "field"),
    [
        ("gauss_seidel", {"direction": "backward"}, "direction"),
        ("sor", {"relaxation": 2.0}, "relaxation"),
        ("jacobi", {"damping": 0.0}, "relaxation"),
        ("jacobi", {"local_solver": "newton"}, "local_solver"),
        ("symmetric_gauss_seidel", {"operator": "dense"}, "operator"),
    ],
)
def test_bad_options_are_named(method: str, options: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        solve(random_problem(1, 4, 3, bodies=4), method, **options)
