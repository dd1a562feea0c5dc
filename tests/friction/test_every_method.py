"""What every method keeps to, whichever it is; and `auto`: bounded, reproducible, never worse than what it has seen."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.sparse as sp
from problems import lone_vertices, random_problem, stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, methods, solve
from barchan.friction.methods import METHODS
from barchan.friction.samples import family, pile, sample

SIZES = (2, 3, 6)
COUNT = 6
LAWS: dict[str, Law] = {
    "convex": SecondOrderCone(np.linspace(0.0, 0.6, COUNT)),
    "frictionless": SecondOrderCone(0.0),
    "coulomb": Coulomb(np.linspace(0.0, 0.6, COUNT)),
    "truncated": DruckerPrager(0.4, shear_yield=0.05, tensile_yield=0.02, dilatancy=0.4),
}
CONIC, NOT_CONIC = ("clarabel_dual", "clarabel_primal"), "law = .*associated"
# What the docstrings announce: (method, law or "", block size or 0) and how the refusal reads.
REFUSALS = {
    **{(name, "coulomb", 0): NOT_CONIC for name in CONIC},
    ("newton_fischer_burmeister", "truncated", 0): "law = with a shear yield",
    ("lemke", "", 6): "method = lemke: must be a method for blocks of size 6",
    **{("nodal", "", s): f"method = nodal: must be another one for blocks of size {s}" for s in (2, 6)},
}
# A pyramid of four sides is no cone: in 3D its answer is as far from the law as its facets are.
FACETED = {("lemke", "convex", 3), ("lemke", "coulomb", 3), ("lemke", "truncated", 3)}
FAMILY, UNSOLVABLE = dict(family("small")), dict(family("unsolvable"))


def tiny(s: int, law: str) -> Problem:
    return random_problem(1, COUNT, s, bodies=12, law=LAWS[law])


def suited(method: str, law: str) -> Problem:
    """A tiny problem that the method takes: the nodal one knows vertices in space only."""
    return lone_vertices(1, COUNT, LAWS[law]) if method == "nodal" else tiny(2, law)


def refusal(method: str, law: str, s: int) -> str | None:
    """How the documented refusal reads, None where the method must solve the problem."""
    for key, says in REFUSALS.items():
        if key[0] == method and key[1] in ("", law) and key[2] in (0, s):
            return says
    return None


# Every method


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("s", SIZES)
@pytest.mark.parametrize("method", METHODS)
def test_easy_problems_are_solved_or_refused_as_documented(method: str, s: int, law: str) -> None:
    problem = suited(method, law) if (method, s) == ("nodal", 3) else tiny(s, law)
    says = refusal(method, law, s)
    if says is not None:
        with pytest.raises(InputError, match=says):
            solve(problem, method, tol=1e-4)
        return
    solution = solve(problem, method, tol=1e-4)
    assert solution.r.shape == (COUNT * s,) and np.isfinite(solution.r).all()
    assert certify(problem, solution.r, solution.v).residual == pytest.approx(solution.certificate.residual)
    if (method, law, s) in FACETED:
        assert solution.certificate.residual < 0.5
    else:
        assert solution.converged and solution.certificate.residual <= 1e-4


@pytest.mark.parametrize("form", ["full", "reduced"])
@pytest.mark.parametrize("method", METHODS)
def test_no_contact_at_all_is_solved_trivially(method: str, form: str) -> None:
    for s in SIZES:
        law, w = SecondOrderCone(0.4), np.zeros(0)
        if form == "full":
            M, f = sp.eye_array(4), np.arange(4.0)
            problem = Problem(M=M, f=f, H=sp.csr_array((0, 4)), w=w, law=law, block_size=s)
        else:
            problem = Problem.reduced(np.zeros((0, 0)), w, law, block_size=s)
        solution = solve(problem, method, tol=1e-12)
        assert solution.converged and solution.r.shape == (0,)
        if form == "full":
            assert solution.v == pytest.approx(np.arange(4.0))


@pytest.mark.parametrize("method", METHODS)
def test_separating_bodies_feel_no_forces(method: str) -> None:
    base = suited(method, "convex")
    w = np.zeros(base.s * COUNT)
    w[:: base.s] = 5.0
    problem = Problem(M=base.M, f=np.zeros(base.size), H=base.H, w=w, law=base.law)
    solution = solve(problem, method, tol=1e-8)
    assert solution.converged and not solution.r.any()
    assert np.array_equal(solution.u, w)


@pytest.mark.parametrize("method", METHODS)
def test_same_bytes_on_repeated_runs(method: str) -> None:
    law = "convex" if method in CONIC else "coulomb"
    first, second = (solve(suited(method, law), method, tol=1e-6) for _ in range(2))
    assert first.r.tobytes() == second.r.tobytes()
    assert [entry[:2] for entry in first.history] == [entry[:2] for entry in second.history]


@pytest.mark.parametrize("method", METHODS)
def test_iterations_are_counted_upwards_and_the_best_one_is_returned(method: str) -> None:
    """Also when they run out: the certificate of what is returned is the least residual of the history."""
    problem = suited(method, "convex")
    for limit in (2, None):
        solution = solve(problem, method, tol=1e-13, max_iterations=limit or 300)
        counts = [entry.iteration for entry in solution.history]
        assert counts == sorted(counts) and solution.iterations == counts[-1]
        assert counts[0] == 0 and solution.history[0].residual > 0.0
        least = min(entry.residual for entry in solution.history)
        assert solution.certificate.residual == pytest.approx(least, rel=1e-3, abs=1e-13) or np.isinf(least)


@pytest.mark.parametrize("method", METHODS)
def test_no_iterations_leave_the_start_as_it_is(method: str) -> None:
    """Or make it admissible, as methods do that only know admissible forces."""
    problem = suited(method, "convex")
    start = np.abs(np.random.default_rng(0).standard_normal((COUNT, problem.s)))
    solution = solve(problem, method, r0=start, max_iterations=0)
    assert solution.iterations == 0 and len(solution.history) >= 1
    kept = np.allclose(solution.r, start.ravel(), rtol=1e-12)
    assert kept or solution.r == pytest.approx(problem.law.project(start).ravel(), rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_solution_is_recognised(method: str) -> None:
    problem = suited(method, "convex")
    start = solve(problem, "gauss_seidel", tol=1e-12).r
    solution = solve(problem, method, tol=1e-6, r0=start)
    assert solution.converged and solution.iterations == 0
    assert solution.r == pytest.approx(start, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_neither_problem_nor_start_is_changed(method: str) -> None:
    problem = suited(method, "convex")
    start = np.ones((COUNT, problem.s))
    before = [x.copy() for x in (problem.w, problem.f, problem.H.data, problem.M.data, problem.parameters)]
    solve(problem, method, r0=start, tol=1e-6)
    after = (problem.w, problem.f, problem.H.data, problem.M.data, problem.parameters)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert (start == 1.0).all()


def test_the_registry_is_what_solve_knows_and_each_entry_says_where_it_comes_from() -> None:
    assert methods() == tuple(METHODS)
    for name, method in METHODS.items():
        assert method.run.__name__ == name and method.run.__doc__
        assert method.source and method.idea
        with pytest.raises(InputError, match=f"option of {name}"):
            solve(tiny(2, "convex"), name, nonsense=1)


# auto


@pytest.mark.parametrize("name", FAMILY)
def test_auto_solves_the_family_to_eight_digits(name: str) -> None:
    problem = FAMILY[name]
    solution = solve(problem, "auto", tol=1e-8)
    assert solution.converged, solution.certificate
    assert certify(problem, solution.r, solution.v).residual <= 1e-8


def hard() -> list[Problem]:
    """Problems on which ten sweeps do not suffice."""
    return [
        random_problem(3, 20, 3, bodies=24, law=Coulomb(1.2)),
        pile(12, 3, (0.1, 0.9), jitter=0.02, uneven=True).problem,
        sample(30, 6, 3.0, (0.0, 1.5), seed=2).problem,
    ]


@pytest.mark.parametrize("number", range(3))
def test_auto_is_reproducible_and_its_history_goes_forward(number: int) -> None:
    first, second = (solve(hard()[number], "auto", tol=1e-10) for _ in range(2))
    assert first.converged and first.iterations > 10
    assert first.r.tobytes() == second.r.tobytes()
    assert [entry[:2] for entry in first.history] == [entry[:2] for entry in second.history]
    for before, after in itertools.pairwise(first.history):
        assert before.iteration <= after.iteration and before.seconds <= after.seconds


@pytest.mark.parametrize("number", range(3))
def test_auto_keeps_to_its_work_and_returns_the_best_it_has_seen(number: int) -> None:
    """`max_iterations` counts sweeps; work in other coin is rounded to whole steps of it."""
    problem = hard()[number]
    reached = []
    for limit in (0, 1, 5, 10, 11, 20, 40, 400):
        solution = solve(problem, "auto", tol=1e-12, max_iterations=limit)
        assert solution.iterations <= limit
        assert solution.iterations == limit or limit > 10
        least = min(entry.residual for entry in solution.history)
        assert np.isinf(least) or solution.certificate.residual == pytest.approx(least, rel=1e-3, abs=1e-13)
        reached.append(solution.certificate.residual)
    assert reached[-1] < 1e-3 * reached[2]


def test_auto_keeps_a_solution_and_profits_from_a_warm_start() -> None:
    for problem in hard():
        cold = solve(problem, "auto", tol=1e-8)
        again = solve(problem, "auto", tol=1e-8, r0=cold.r)
        assert again.converged and again.iterations == 0 and np.array_equal(again.r, cold.r)
        near = cold.r * (1.0 + 1e-6 * np.random.default_rng(0).standard_normal(cold.r.shape))
        warm = solve(problem, "auto", tol=1e-8, r0=near)
        assert warm.converged and warm.iterations <= cold.iterations


@pytest.mark.parametrize("s", SIZES)
def test_auto_solves_a_single_contact_in_each_of_its_regimes(s: int) -> None:
    tangent = np.concatenate([[1.0], np.zeros(s - 2)])
    W = np.eye(s)
    for push, slide, expected in (
        (1.0, 0.0, np.concatenate([[0.0], 0.0 * tangent])),
        (-1.0, 0.3, np.concatenate([[1.0], -0.3 * tangent])),
        (-1.0, 0.9, np.concatenate([[1.0], -0.5 * tangent])),
    ):
        b = np.concatenate([[push], slide * tangent])
        solution = solve(Problem.reduced(W, b, Coulomb(0.5), block_size=s), "auto", tol=1e-10)
        assert solution.converged and solution.r == pytest.approx(expected, abs=1e-9)


def test_auto_copes_with_blocks_that_nothing_moves() -> None:
    W = np.zeros((9, 9))
    W[:3, :3] = np.eye(3)
    for b in ([-1.0, 0.2, 0, 1.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 1.0, 0.3, 0, 0.5, 0, 0]):
        problem = Problem.reduced(W, np.array(b), Coulomb(0.5), block_size=3)
        solution = solve(problem, "auto", tol=1e-10)
        assert solution.converged
        assert solution.r[:3] == pytest.approx([max(-b[0], 0.0), -b[1] if b[0] < 0.0 else 0.0, 0.0])
    nothing = solve(Problem.reduced(np.zeros((6, 6)), np.eye(6)[0], Coulomb(0.5), block_size=3), "auto")
    assert nothing.converged and not nothing.r.any()


def assert_found_unsolvable(names: list[str]) -> None:
    for name in names:
        solution = solve(UNSOLVABLE[name], "auto", tol=1e-8)
        assert not solution.converged and solution.status == "no solution"


def test_auto_says_that_there_is_no_solution() -> None:
    assert_found_unsolvable(["s2-ratio0.3-unsolvable", "s3-ratio1-unsolvable", "s6-ratio3-unsolvable"])


@pytest.mark.slow
def test_auto_says_so_whatever_the_problem() -> None:
    """On some, forces grow so slowly that every attempt is made before the question is asked."""
    assert_found_unsolvable(list(UNSOLVABLE))


def test_auto_stops_when_the_callback_says_so_and_sweeps_as_often_as_asked() -> None:
    problem = hard()[0]
    stopped = solve(problem, "auto", tol=1e-12, callback=lambda entry, r: entry.residual < 0.1)
    assert stopped.status == "stopped by callback" and 1e-12 < stopped.certificate.residual < 0.1
    assert solve(stacked_blocks(3), "auto", tol=1e-6, min_iterations=50).iterations >= 50
