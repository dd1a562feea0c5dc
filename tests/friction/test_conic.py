"""Conic programs: primal and dual find the velocities that Gauss-Seidel finds, for every associated law, with constraints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction.conic import force_cones, opening_cones
from barchan.friction.samples import family, sample

METHODS = ("clarabel_dual", "clarabel_primal")
LAWS: dict[str, Law] = {
    "cone": SecondOrderCone(0.4),
    "frictionless": SecondOrderCone(0.0),
    "uneven": SecondOrderCone(np.linspace(0.0, 1.5, 20)),
    "yielding": DruckerPrager(0.4, shear_yield=0.05, tensile_yield=0.02, dilatancy=0.4),
    "cylinder": DruckerPrager(0.0, shear_yield=0.1),
    "mixed": DruckerPrager(
        np.tile([0.0, 0.3], 10),
        shear_yield=np.tile([0.0, 0.0, 0.1, 0.1], 5),
        tensile_yield=0.01,
        dilatancy=np.tile([0.0, 0.3], 10),
    ),
}


def reduced(problem: Problem) -> Problem:
    """The same problem as u = W r + b."""
    H = sp.csr_array(problem.H)
    W = H @ problem.factor.solve(H.T.toarray())
    b = H @ problem.factor.solve(problem.f) + problem.w
    return Problem.reduced(W=W, b=b, law=problem.law, block_size=problem.s)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("method", METHODS)
def test_programs_solve_every_associated_law_in_both_forms(method: str, s: int, law: str) -> None:
    full = random_problem(3, 20, s, bodies=12, law=LAWS[law])
    other = solve(full, "gauss_seidel", tol=1e-9)
    for problem in (full, reduced(full)):
        solution = solve(problem, method, tol=5e-8)
        assert solution.converged, solution.certificate
        assert certify(problem, solution.r, solution.v).residual <= 5e-8
        assert np.allclose(solution.u, other.u, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_bilateral_constraints_hold_even_when_rows_repeat(method: str) -> None:
    base = sample(20, 3, 1.0, 0.5, seed=3, constraints=4).problem
    problem = replace(
        base, law=base.law.convexified(), C=sp.vstack([base.C, base.C[:2]]), k=np.append(base.k, base.k[:2])
    )
    solution = solve(problem, method, tol=1e-8)
    assert solution.converged
    assert problem.C @ solution.v == pytest.approx(problem.k, abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_an_operator_that_is_not_quite_symmetric_is_solved_as_given(method: str) -> None:
    problem = reduced(random_problem(3, 20, 3, bodies=20, law=SecondOrderCone(0.5)))
    skew = np.random.default_rng(0).standard_normal((60, 60))
    largest = np.abs(problem.W.data).max()
    crooked = problem.W.toarray() + 1e-3 * largest * (skew - skew.T) / np.abs(skew - skew.T).max()
    solution = solve(replace(problem, W=crooked), method, tol=1e-8)
    assert solution.converged and len(solution.history) > 2


@pytest.mark.parametrize("method", METHODS)
def test_a_law_that_is_not_associated_is_refused(method: str) -> None:
    problem = random_problem(1, 4, 3, bodies=4, law=Coulomb(0.5))
    with pytest.raises(InputError, match=r"law = Coulomb: must be associated .*cadoux"):
        solve(problem, method)


@pytest.mark.parametrize("method", METHODS)
def test_the_budget_of_iterations_is_kept_and_failure_is_said(method: str) -> None:
    problem = random_problem(1, 20, 3, bodies=8, law=SecondOrderCone(0.5))
    for budget in (0, 3):
        solution = solve(problem, method, tol=1e-10, max_iterations=budget)
        assert not solution.converged and solution.iterations <= budget
        assert solution.status == "iteration limit reached"


@pytest.mark.parametrize("method", METHODS)
def test_an_infeasible_program_is_no_success(method: str) -> None:
    _, problem = family("unsolvable")[4]
    solution = solve(replace(problem, law=problem.law.convexified()), method, tol=1e-8)
    assert not solution.converged


def test_cone_rows_say_exactly_what_is_admissible() -> None:
    rng = np.random.default_rng(5)
    n, s = 400, 3
    law = DruckerPrager(
        np.tile([0.0, 0.5], n // 2),
        shear_yield=np.tile([0.0, 0.0, 0.2, 0.2], n // 4),
        tensile_yield=0.1,
    )
    r = rng.normal(scale=0.5, size=(n, s))
    r[::2] = law.project(r)[::2]
    inside = np.ones(n, dtype=bool)
    for group in force_cones(law.parameters(n), s):
        rows = group.select @ r.ravel() + group.offset
        owner = group.select.indices // s
        if group.kind == "second-order":
            blocks = rows.reshape(-1, s)
            np.logical_and.at(
                inside, owner[::s], blocks[:, 0] >= np.linalg.norm(blocks[:, 1:], axis=1) - 1e-12
            )
        else:
            good = rows >= -1e-12 if group.kind == "nonnegative" else np.abs(rows) <= 1e-12
            np.logical_and.at(inside, owner, good)
    assert (inside == (np.abs(law.project(r) - r).max(axis=1) < 1e-12)).all()
    assert 0 < inside.sum() < n


def test_opening_rows_are_the_dual_of_the_friction_cone() -> None:
    slope = np.array([0.0, 0.5])
    half, cone = sorted(opening_cones(slope, 3), key=lambda group: group.kind)
    u = np.array([1.0, 5.0, 5.0, 1.0, 1.2, -1.6])
    assert half.select @ u == pytest.approx([1.0])
    rows = cone.select @ u
    assert rows[0] == pytest.approx(np.linalg.norm(rows[1:]))
