"""Existence: verdicts agree with how the problems were made, and every proof can be checked by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.friction import Problem, solve
from barchan.friction.existence import existence
from barchan.friction.operators import build_operator
from barchan.friction.samples import family, sample

UNSOLVABLE = family("unsolvable")


def reduced(problem: Problem) -> Problem:
    """The same problem as u = W r + b."""
    operator = build_operator(problem, "explicit")
    W = operator.rows.matrix()  # type: ignore[attr-defined]
    return Problem.reduced(W=sp.csr_array(W), b=operator.b.ravel(), law=problem.law, block_size=problem.s)


def wedge(gap: float, mu: float = 0.5, ground: float = 0.0) -> Problem:
    """A point mass between two parallel walls that come nearer by `gap` (negative: they part)."""
    H = np.vstack([np.eye(3), -np.eye(3)])
    w = np.array([-0.5 * gap, ground, 0.0] * 2)
    return Problem(M=np.eye(3), f=np.zeros(3), H=H, w=w, law=Coulomb(np.full(2, mu)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("constraints", [0, 3])
def test_an_opening_motion_is_found_where_one_was_built_in(s: int, seed: int, constraints: int) -> None:
    made = sample(15, s, 2.0, (0.0, 1.2), seed, constraints=constraints)
    for problem in (made.problem, reduced(made.problem)):
        verdict = existence(problem)
        assert verdict.verdict == "exists" and verdict.margin > 1e-4
        assert verdict.opening is not None
        u = verdict.opening.reshape(-1, s)
        mu = problem.parameters[:, 0]
        assert (u[:, 0] > mu * np.linalg.norm(u[:, 1:], axis=1)).all()


@pytest.mark.parametrize("law", ["coulomb", "yielding", "associated"])
@pytest.mark.parametrize(("name", "problem"), UNSOLVABLE, ids=[name for name, _ in UNSOLVABLE])
def test_a_problem_without_solution_is_refuted_by_forces(name: str, problem: Problem, law: str) -> None:
    laws = {
        "coulomb": problem.law,
        "yielding": DruckerPrager(0.4, shear_yield=0.1, tensile_yield=0.1, dilatancy=0.2),
        "associated": SecondOrderCone(0.4),
    }
    problem = replace(problem, law=laws[law])
    for form in (problem, reduced(problem)):
        verdict = existence(form)
        assert verdict.verdict == "none" and verdict.reach > 1e6
        y = verdict.blame
        assert y is not None
        blocks = y.reshape(-1, form.s)
        slope = form.parameters[:, 3]
        slack = 1e-12 * np.abs(y).max()
        assert (np.linalg.norm(blocks[:, 1:], axis=1) <= slope * blocks[:, 0] + slack).all()
        pull = form.W.T @ y if form.is_reduced else form.H.T @ y
        work = (form.b if form.is_reduced else form.w) @ y
        assert work < 0.0
        assert np.linalg.norm(pull) < 1e-8 * abs(work)


def test_walls_that_close_part_or_stay() -> None:
    assert existence(wedge(gap=1.0)).verdict == "none"
    assert existence(wedge(gap=-1.0)).verdict == "exists"
    assert existence(wedge(gap=0.0)).verdict == "undecided"


def test_polyhedral_cones_at_rest_need_no_interior() -> None:
    assert existence(wedge(gap=0.0, mu=0.0)).verdict == "exists"


def test_constraints_can_take_the_solution_away() -> None:
    push = {"C": np.array([[1.0, 0.0, 0.0]])}
    floor = Problem(M=np.eye(3), f=np.zeros(3), H=np.eye(3), w=np.zeros(3), law=Coulomb(np.array([0.5])))
    assert existence(replace(floor, **push, k=np.array([1.0]))).verdict == "exists"
    verdict = existence(replace(floor, **push, k=np.array([-1.0])))
    assert verdict.verdict == "none"
    assert verdict.blame is not None and verdict.blame_bilateral is not None
    balance = floor.H.T @ verdict.blame + push["C"].T @ verdict.blame_bilateral
    assert np.abs(balance).max() < 1e-12
    assert -verdict.blame_bilateral @ [-1.0] < 0.0


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_verdicts_do_not_depend_on_units(factor: float) -> None:
    for _, problem in (*UNSOLVABLE[:2], *family("small")[20:22]):
        scaled = replace(problem, f=factor * problem.f, w=factor * problem.w)
        heavy = replace(problem, M=factor * problem.M, f=factor * problem.f)
        verdicts = {existence(form).verdict for form in (problem, scaled, heavy)}
        assert len(verdicts) == 1


def test_no_contact_always_has_a_solution() -> None:
    problem = Problem(
        M=np.eye(2), f=np.ones(2), H=np.zeros((0, 2)), w=np.zeros(0), law=Coulomb(np.zeros(0)), block_size=3
    )
    assert existence(problem).verdict == "exists"


class TestSolve:
    def test_asked_first_the_method_is_not_run_in_vain(self) -> None:
        solution = solve(UNSOLVABLE[4][1], "gauss_seidel", check_existence=True)
        assert not solution.converged and solution.status == "no solution"
        assert solution.message.startswith("no solution exists: ")
        assert solution.iterations == 0 and solution.existence is not None

    def test_auto_explains_a_failure_by_itself(self) -> None:
        solution = solve(UNSOLVABLE[4][1], tol=1e-12)
        assert solution.status == "no solution" and solution.iterations > 0

    def test_a_limit_of_the_user_is_no_reason_to_ask(self) -> None:
        solution = solve(UNSOLVABLE[4][1], tol=1e-12, max_iterations=5)
        assert solution.status == "iteration limit reached" and solution.existence is None

    def test_a_solution_that_exists_is_found(self) -> None:
        solution = solve(family("small")[10][1], tol=1e-6, check_existence=True)
        assert solution.converged and solution.status == "converged"
        assert solution.existence is not None and solution.existence.verdict == "exists"
