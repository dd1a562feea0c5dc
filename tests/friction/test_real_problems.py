"""Problems saved by other people's simulations: every one of them is certified, the general ones to eight digits."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from barchan.friction import Problem, certify, read, solve

HARDEST = "RockPile_tob1.dat"
FILES = (
    "Box_Stacks-i0122-82-5.hdf5",
    "BoxesStack1-i100000-32.hdf5.dat",
    "Capsules-i100-889.dat",
    "Capsules-i101-404.dat",
    "Capsules-i122-1617.dat",
    "Confeti-ex03-Fc3D-SBM.dat",
    "Confeti-ex13-Fc3D-SBM.dat",
    "FrictionContactProblem00031.dat",
    "FrictionContactProblem00237.dat",
    "GFC3D_OneContact.dat",
    "LMGC_100_PR_PerioBox-i00361-60-03000.hdf5",
    "OneObject-i100000-316.hdf5.dat",
    HARDEST,
    "plasticity_2d_footing_10.dat",
)
BUT_THE_HARDEST = tuple(name for name in FILES if name != HARDEST)


@cache
def load(path: Path) -> Problem:
    return read(path)


def certified(problem: Problem, method: str, tol: float, **options: object) -> int:
    """Iterations of a solve whose certificate is what was asked for."""
    solution = solve(problem, method, tol=tol, **options)
    assert solution.converged, solution.certificate
    assert certify(problem, solution.r, solution.v).residual <= tol
    return solution.iterations


def problem_of(shared_data: Path, name: str) -> Problem:
    return load(shared_data / "data" / "fc" / name)


@pytest.mark.parametrize("name", FILES)
def test_every_problem_is_certified(shared_data: Path, name: str) -> None:
    certified(problem_of(shared_data, name), "gauss_seidel", 1e-4, max_iterations=20_000)


@pytest.mark.parametrize("name", BUT_THE_HARDEST)
def test_auto_reaches_eight_digits(shared_data: Path, name: str) -> None:
    certified(problem_of(shared_data, name), "auto", 1e-8)


@pytest.mark.slow
def test_auto_reaches_eight_digits_on_the_hardest_too(shared_data: Path) -> None:
    certified(problem_of(shared_data, HARDEST), "auto", 1e-8)


def test_auto_certifies_the_hardest_without_its_last_resorts(shared_data: Path) -> None:
    certified(problem_of(shared_data, HARDEST), "auto", 1e-4, max_iterations=20_000)


@pytest.mark.parametrize("name", FILES)
def test_interior_point_solves_the_convexification_in_few_factorisations(
    shared_data: Path, name: str
) -> None:
    problem = problem_of(shared_data, name)
    assert certified(problem.variant(problem.law.convexified()), "interior_point", 1e-8) <= 40


@pytest.mark.slow
@pytest.mark.parametrize("name", BUT_THE_HARDEST)
def test_cadoux_reaches_six_digits(shared_data: Path, name: str) -> None:
    certified(problem_of(shared_data, name), "cadoux", 1e-6)
