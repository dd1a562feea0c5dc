"""Problems saved by other people's simulations: Gauss-Seidel and the portfolio certify every one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from barchan.friction import certify, read, solve

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
    "RockPile_tob1.dat",
    "plasticity_2d_footing_10.dat",
)


@pytest.mark.parametrize("method", ["gauss_seidel", "auto"])
@pytest.mark.parametrize("name", FILES)
def test_every_problem_is_certified(shared_data: Path, name: str, method: str) -> None:
    problem = read(shared_data / "data" / "fc" / name)
    solution = solve(problem, method, tol=1e-4, max_iterations=20_000)
    assert solution.converged, solution.certificate
    assert certify(problem, solution.r, solution.v).residual <= 1e-4
