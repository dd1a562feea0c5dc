"""Islands: connected components of W, solved apart from each other, by sweeps and by a Newton that never makes things worse."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import random_problem
from scipy.sparse.csgraph import connected_components

from barchan.cones import Coulomb, DruckerPrager, Law
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction._islands import find_islands
from barchan.friction._proximal_newton import project_with_jacobian, proximal_newton_island
from barchan.friction.local._decompose import PROXIMAL, local_blocks
from barchan.friction.methods._island_solver import HASTY, LARGEST_NEWTON, NEWTON_STEPS, PATIENT, IslandSolver
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.friction.residual import law_residual
from barchan.friction.samples import family, pile, sample

patterns = st.integers(1, 12).flatmap(
    lambda n: st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=14).map(
        lambda pairs: sp.csr_array((np.ones(len(pairs)), np.array(pairs).reshape(-1, 2).T), shape=(n, n))
    )
)


def reduced(problem: Problem) -> Problem:
    """The same problem as u = W r + b."""
    H = sp.csr_array(problem.H)
    W = H @ problem.factor.solve(H.T.toarray())
    b = H @ problem.factor.solve(problem.f) + problem.w
    return Problem.reduced(W=0.5 * (W + W.T), b=b, law=problem.law, block_size=problem.s)


def side_by_side(problems: list[Problem], order: np.ndarray) -> Problem:
    """Problems that do not touch, as one, its blocks in the given order."""
    s = problems[0].s
    rows = (order[:, None] * s + np.arange(s)).ravel()
    W = sp.csr_array(sp.block_diag([problem.W for problem in problems]))[rows][:, rows]
    b = np.concatenate([problem.b for problem in problems])[rows]
    mu = np.concatenate([problem.parameters[:, 0] for problem in problems])[order]
    return Problem.reduced(W=W, b=b, law=Coulomb(mu), block_size=s)


def island_solver(problem: Problem, r0: np.ndarray | None = None) -> IslandSolver:
    """Its solver, with the residual of r0 known."""
    delassus = build_operator(problem, "explicit")
    assert isinstance(delassus, StoredDelassus)
    solver = IslandSolver(problem, delassus, np.zeros((problem.n, problem.s)) if r0 is None else r0)
    solver.sweep(np.arange(len(solver.sizes)), 0.0, 0, 0)
    return solver


def squared_residuals(solver: IslandSolver) -> np.ndarray:
    """Of each island, computed from the forces by the law's own natural map."""
    problem = solver.problem
    u = (solver.rows.matrix() @ solver.r.ravel()).reshape(solver.r.shape) + solver.b
    miss = (problem.law.natural_map(u, solver.r, problem.rho) ** 2).sum(axis=1)
    return np.array([miss[solver.blocks(k)].sum() for k in range(len(solver.sizes))])


def scattered(seed: int, parts: int = 4, s: int = 3, mu: float = 0.5) -> Problem:
    """Several random problems side by side, shuffled."""
    apart = [reduced(random_problem(seed + k, 3 + 2 * k, s, bodies=4 + 2 * k, mu=mu)) for k in range(parts)]
    return side_by_side(apart, np.random.default_rng(seed).permutation(sum(p.n for p in apart)))


@given(patterns)
def test_islands_are_the_connected_components(pattern: sp.csr_array) -> None:
    pointers, members = find_islands(pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32))
    count, label = connected_components(pattern, directed=False)
    assert len(pointers) == count + 1
    assert sorted(members) == list(range(pattern.shape[0]))
    islands = [list(blocks) for blocks in np.split(members, pointers[1:-1])]
    expected = [list(np.flatnonzero(label == k)) for k in range(count)]
    assert all(blocks == sorted(blocks) for blocks in islands)
    assert sorted(islands) == sorted(expected)
    assert [blocks[0] for blocks in islands] == sorted(blocks[0] for blocks in islands)


@pytest.mark.parametrize("method", ["auto", "proximal_newton"])
@pytest.mark.parametrize("s", [2, 3, 6])
def test_two_copies_that_do_not_touch_have_the_forces_of_one(method: str, s: int) -> None:
    """Also when their blocks alternate."""
    alone = reduced(random_problem(4, 10, s, bodies=12, mu=0.4))
    twice = side_by_side([alone, alone], np.arange(20).reshape(2, 10).T.ravel())
    single, both = solve(alone, method, tol=1e-11), solve(twice, method, tol=1e-11)
    assert single.converged and both.converged
    forces = both.r.reshape(10, 2, s)
    size = np.abs(single.r).max()
    assert forces[:, 0].ravel() == pytest.approx(single.r, abs=1e-8 * size)
    assert forces[:, 1].ravel() == pytest.approx(single.r, abs=1e-8 * size)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_residuals_of_islands_are_those_of_the_law_and_add_up(s: int) -> None:
    problem = scattered(1, s=s)
    start = np.random.default_rng(0).standard_normal((problem.n, s))
    solver = island_solver(problem, start)
    assert np.array_equal(solver.r, start)
    assert solver.residual == pytest.approx(squared_residuals(solver), rel=1e-10)
    solver.sweep(np.arange(len(solver.sizes)), 0.0, 3)
    assert solver.residual == pytest.approx(squared_residuals(solver), rel=1e-8)
    u = (problem.W @ solver.r.ravel() + problem.b).reshape(-1, s)
    assert solver.law_residual == pytest.approx(law_residual(problem, solver.r, u)[0], rel=1e-8)


def test_sweeps_stay_on_the_islands_asked_for_and_meet_the_share() -> None:
    solver = island_solver(scattered(2))
    everything = np.arange(len(solver.sizes))
    solver.sweep(everything, 0.0, 1, 1)
    before = solver.r.copy()
    tolerance = 1e-6
    allowed = solver.allowed(tolerance)
    solver.effort[:] = 1e9  # any number of sweeps is worth it
    work = solver.sweep(np.array([1]), tolerance, 2000)
    other = np.setdiff1d(np.arange(solver.problem.n), solver.blocks(1))
    assert np.array_equal(solver.r[other], before[other])
    assert not np.array_equal(solver.r[solver.blocks(1)], before[solver.blocks(1)])
    assert solver.residual[1] <= allowed[1]
    assert 1 not in solver.unsolved(tolerance)
    # Work counts sweeps of the whole: those of the island, by its share of the blocks.
    assert work == pytest.approx((solver.spent[1] - 1) * solver.sizes[1] / solver.problem.n)


def test_sweeps_end_at_the_share_the_limit_or_where_another_method_is_cheaper() -> None:
    """The worth of an island, in sweeps, only ever shortens its turn; with none it ends at the first judgement."""
    spent = {}
    for worth in (0.0, 1.0, 1e9):
        solver = island_solver(scattered(2))
        everything = np.arange(len(solver.sizes))
        solver.sweep(everything, 0.0, 1, 1)
        solver.effort[:] = worth
        solver.sweep(everything, 1e-9, 300, 5)
        spent[worth] = solver.spent - 1
        solved = solver.residual <= solver.allowed(1.01e-9)
        assert (solved | (spent[worth] <= 300)).all()
        assert worth < 1e9 or (solved | (spent[worth] == 300)).all()
    assert (spent[0.0] <= 10).all() and (spent[0.0] < spent[1e9]).any()
    assert (spent[0.0] <= spent[1.0]).all() and (spent[1.0] <= spent[1e9]).all()


@pytest.mark.parametrize("digits", range(1, 9))
def test_the_share_of_an_island_is_that_of_its_blocks(digits: int) -> None:
    """Small islands may not spend what belongs to the whole."""
    tolerance = 10.0**-digits
    for seed in range(4):
        solver = island_solver(scattered(seed))
        everything = np.arange(len(solver.sizes))
        solver.sweep(everything, 0.0, 10, 10)
        solver.effort[:] = 1e9
        allowed = solver.allowed(tolerance)
        solver.sweep(everything, tolerance, 5000, 1)
        assert (solver.residual <= allowed).all()


def test_islands_within_their_share_solve_the_whole() -> None:
    solver = island_solver(scattered(3))
    solver.sweep(np.arange(len(solver.sizes)), 0.0, 1, 1)
    solver.residual[:] = solver.allowed(1e-5)
    assert solver.law_residual == pytest.approx(1e-5) and len(solver.unsolved(1e-5)) == 0
    solver.residual[2] *= 1.01
    assert solver.unsolved(1e-5).tolist() == [2] and solver.law_residual > 1e-5


@pytest.mark.parametrize("attempt", [0, 1])
@pytest.mark.parametrize("budget", [1, 2, 5])
@pytest.mark.parametrize("mu", [0.3, 1.5])
def test_newton_never_returns_worse_forces_than_it_got(attempt: int, budget: int, mu: float) -> None:
    for seed in range(6):
        problem = scattered(seed, mu=mu)
        start = np.random.default_rng(seed).standard_normal((problem.n, 3))
        solver = island_solver(problem, start)
        before = squared_residuals(solver)
        solver.newton(solver.unsolved(1e-12), 1e-12, budget, attempt)
        after = squared_residuals(solver)
        assert (after <= before * (1.0 + 1e-12)).all()
        assert solver.residual == pytest.approx(after, rel=1e-6, abs=1e-20)


@pytest.mark.parametrize("policy", [HASTY, PATIENT], ids=["hasty", "patient"])
def test_the_best_iterate_of_an_island_is_returned_after_steps_uphill(policy: tuple) -> None:
    """Proximal steps are taken uphill too; what comes back is still the least residual, and belongs to the forces."""
    term, settings = policy
    for seed in range(12):
        problem = reduced(sample(12, 3, 3.0, (0.3, 1.5), seed=seed).problem)
        root = np.sqrt(problem.rho)[:, None]
        scale = np.repeat(root[:, 0], 3)
        a, b = scale[:, None] * problem.W.toarray() * scale, root * problem.b.reshape(-1, 3)
        laws, weight = problem.parameters, problem.rho

        def residual(x: np.ndarray, problem=problem, root=root) -> float:
            u = (problem.W @ (root * x).ravel() + problem.b).reshape(-1, 3)
            return float((problem.law.natural_map(u, root * x, problem.rho) ** 2).sum())

        far = 3.0 * np.random.default_rng(seed).standard_normal((12, 3))
        for start, budgets in ((far, (1, 2, 4, 8, 16, 32)), (np.zeros((12, 3)), (8, 24))):
            for budget in budgets:
                x = start.copy()
                found, used, _ = proximal_newton_island(
                    a, b, laws, weight, x, 0.0, term, budget, NEWTON_STEPS, settings
                )
                assert found == pytest.approx(residual(x), rel=1e-6, abs=1e-24)
                assert found <= residual(start) * (1.0 + 1e-9) and 0 < used <= budget


def test_restarts_other_methods_and_long_sweeps_keep_only_what_improves() -> None:
    problem = reduced(pile(12, 3, (0.1, 0.9), jitter=0.02, uneven=True).problem)
    solver = island_solver(problem)
    solver.sweep(np.arange(len(solver.sizes)), 0.0, 20)

    def wander(part: Problem, recorder, r0: np.ndarray, max_iterations: int | None = None) -> None:
        recorder.record(1, 0.0, r0 + 1.0)  # a lie about forces that are no better

    for act in (
        lambda k: solver.restart(k, 1e-12, 2, 1, 0),
        lambda k: solver.ask(wander, k, 1e-12, 1),
        lambda k: solver.sweep_on(np.array([k]), 1e-12, 1),
    ):
        for island in range(len(solver.sizes)):
            before = squared_residuals(solver)
            act(island)
            after = squared_residuals(solver)
            assert (after <= before * (1.0 + 1e-12)).all()
            assert solver.residual == pytest.approx(after, rel=1e-6, abs=1e-20)


RANDOM = [
    (random_problem, {"n": n, "s": s, "bodies": bodies, "mu": mu})
    for s in (2, 3, 6)
    for mu in (0.3, 0.8, 1.5)
    for n, bodies in ((12, 16), (20, 8), (18, 3))
]


@pytest.mark.parametrize(("make", "options"), RANDOM)
def test_proximal_newton_reaches_ten_digits(make, options: dict[str, float]) -> None:
    """With regular W (more bodies than contacts), and with W of rank far below its size."""
    for seed in range(3):
        problem = make(seed, **options)
        solution = solve(problem, "proximal_newton", tol=1e-10)
        assert solution.converged, (seed, solution.certificate)
        assert certify(problem, solution.r, solution.v).residual <= 1e-10


def test_proximal_newton_keeps_bilateral_constraints_and_yields() -> None:
    made = sample(20, 3, 3.0, (0.0, 1.5), seed=5, constraints=4)
    assert np.linalg.matrix_rank(reduced(made.problem).W.toarray()) < 60
    held = solve(made.problem, "proximal_newton", tol=1e-10)
    assert held.converged and held.certificate.bilateral <= 1e-10
    law = DruckerPrager(0.6, shear_yield=0.1, tensile_yield=0.05, dilatancy=0.2)
    for s in (2, 3, 6):
        assert solve(random_problem(1, 15, s, bodies=8, law=law), "proximal_newton", tol=1e-10).converged


def test_proximal_newton_counts_factorisations_and_keeps_to_their_number() -> None:
    problem = random_problem(1, 20, 3, bodies=24, mu=1.2)
    free = solve(problem, "proximal_newton", tol=1e-10)
    assert free.converged and 5 < free.iterations < 200
    for limit in (1, 2, 5):
        bounded = solve(problem, "proximal_newton", tol=1e-10, max_iterations=limit)
        assert bounded.iterations == limit and not bounded.converged


def test_proximal_newton_refuses_an_island_too_large_for_it() -> None:
    n = LARGEST_NEWTON // 3 + 1
    chain = sp.diags_array([np.full(n - 1, -0.1), np.ones(n), np.full(n - 1, -0.1)], offsets=[-1, 0, 1])
    W = sp.csr_array(sp.kron(chain, sp.eye_array(3)))
    with pytest.raises(InputError, match="method = proximal_newton"):
        solve(Problem.reduced(W=W, b=np.full(3 * n, -1.0), law=Coulomb(0.3), block_size=3), "proximal_newton")


TRUNCATED = st.tuples(st.floats(0.0, 1.5), st.floats(0.0, 1.0), st.floats(0.0, 1.0))


@settings(max_examples=60)
@given(st.integers(0, 10_000), st.sampled_from([2, 3, 6]), TRUNCATED)
def test_the_jacobian_is_that_of_the_projection(
    seed: int, s: int, parameters: tuple[float, float, float]
) -> None:
    """Random points are smooth ones, almost surely."""
    mu, sigma, tau = parameters
    law: Law = DruckerPrager(mu, shear_yield=sigma, tensile_yield=tau)
    x = 2.0 * np.random.default_rng(seed).standard_normal(s)
    out, jacobian = np.empty(s), np.empty((s, s))
    moves = project_with_jacobian(x, mu, sigma, tau, out, jacobian)
    assert out == pytest.approx(law.project(x[None])[0], abs=1e-14)
    assert moves or not jacobian.any()
    assert jacobian == pytest.approx(jacobian.T, abs=1e-14)
    h = 1e-6
    points = np.concatenate([x + h * np.eye(s), x - h * np.eye(s)])
    images = law.project(points)
    slopes = (images[:s] - images[s:]).T / (2.0 * h)
    second = np.abs(images[:s] + images[s:] - 2.0 * out).max()
    if second < 1e-9:  # no kink within h
        assert jacobian == pytest.approx(slopes, abs=1e-4)


@pytest.mark.parametrize("s", [2, 3, 6])
def test_block_decompositions_rebuild_the_schur_complement(s: int) -> None:
    rng = np.random.default_rng(s)
    factors = rng.standard_normal((30, s, s))
    blocks = factors @ factors.transpose(0, 2, 1) + 0.01 * np.eye(s)
    regular, rows = local_blocks(blocks)
    assert regular == pytest.approx(blocks, abs=1e-12)
    for block, row in zip(regular, rows, strict=True):
        normal, coupling, values = row[0], row[1:s], row[s : 2 * s - 1]
        vectors = row[2 * s - 1 :].reshape(s - 1, s - 1)
        schur = block[1:, 1:] - np.outer(block[1:, 0], block[0, 1:]) / block[0, 0]
        assert normal == block[0, 0]
        assert vectors.T @ vectors == pytest.approx(np.eye(s - 1), abs=1e-12)
        assert vectors @ np.diag(values) @ vectors.T == pytest.approx(schur, abs=1e-10 * np.abs(block).max())
        assert coupling == pytest.approx(vectors.T @ block[1:, 0] / normal, abs=1e-12)


def test_singular_blocks_get_a_proximal_term_and_lose_their_asymmetry() -> None:
    flat = np.diag([1.0, 2.0, 0.0])
    skew = np.diag([1.0, 2.0, 3.0]) + 0.1 * (np.eye(3, k=1) - np.eye(3, k=-1))
    regular, _ = local_blocks(np.array([flat, np.zeros((3, 3)), skew]))
    assert regular[0] == pytest.approx(flat + PROXIMAL * np.eye(3))
    assert regular[1] == pytest.approx(PROXIMAL * 1.5 * np.eye(3))  # mean eigenvalue of the others: 1 and 2
    assert regular[2] == pytest.approx(np.diag([1.0, 2.0, 3.0]))


def test_every_island_of_a_family_is_the_problem_of_its_blocks() -> None:
    """`Problem.part`: same rates, same law, nothing of the others."""
    rng = np.random.default_rng(3)
    for _, problem in family("small")[::6]:
        solver = island_solver(problem)
        r = rng.standard_normal((problem.n, problem.s))
        u = build_operator(problem, "explicit").apply(r) + solver.b
        for island in range(len(solver.sizes)):
            blocks = solver.blocks(island)
            part = problem.part(blocks, solver._matrix(blocks), solver.b[blocks])
            assert (part.n, part.s, part.is_reduced) == (len(blocks), problem.s, True)
            assert part.W @ r[blocks].ravel() + part.b == pytest.approx(u[blocks].ravel(), abs=1e-10)
            assert np.array_equal(part.parameters, problem.parameters[blocks])
            assert part.rho == pytest.approx(problem.rho[blocks])
            assert math.isfinite(certify(part, r[blocks]).residual)
