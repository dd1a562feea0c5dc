"""The methods that seed B 6.4 proposes for flows, and ours, on a small creeping silo: one problem, one certificate."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from barchan.flows.dense import DenseFlow, Material, NoSlip, Symmetry
from barchan.friction import Problem, certify, solve
from barchan.linalg.krylov import KrylovSolver
from barchan.spaces.meshes import silo
from barchan.spaces.mixed import MixedSpace

module = importlib.import_module("barchan.friction.methods.split_interior_point")


def small_silo(vertices: int = 100, stress: str = "P1d", **material: Any) -> DenseFlow:
    mesh = silo(2.0, 4.0, 4.0, vertices)
    conditions = {"axis": Symmetry(), "wall": NoSlip(), "bottom": NoSlip()}
    return DenseFlow(MixedSpace(mesh, "P2", stress), Material(**{"mu": 0.4, **material}), conditions)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return small_silo().problem()


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("projected_gradient", {"operator": "matrix-free"}),
        ("apgd", {"operator": "matrix-free"}),
        ("spg", {"operator": "matrix-free"}),
        ("aspg", {"operator": "matrix-free"}),
        ("cadoux", {"inner": "clarabel_dual"}),
        ("cadoux", {"formulation": "primal"}),
        ("split_interior_point", {}),
        ("auto", {}),
    ],
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values())),
)
def test_every_proposed_method_reaches_three_digits(
    problem: Problem, method: str, options: dict[str, Any]
) -> None:
    solution = solve(problem, method, tol=1e-3, **options)
    assert certify(problem, solution.r, solution.v).residual <= 1e-3


def test_ours_agrees_with_the_conic_library_on_the_associated_flow() -> None:
    """With zeta = mu the velocities are unique: the minimum of a convex functional (seed B, Eq. 6.37)."""
    problem = small_silo(dilatancy=0.4).problem()
    ours = solve(problem, "split_interior_point", tol=1e-6)
    theirs = solve(problem, "clarabel_primal", tol=1e-6)
    assert ours.converged and ours.iterations <= 25
    assert ours.v is not None and theirs.v is not None
    assert np.linalg.norm(ours.v - theirs.v) <= 1e-3 * np.linalg.norm(theirs.v)


@pytest.mark.parametrize("stress", ["P0", "P1", "P1d"])
def test_stress_spaces_are_solved_to_six_digits(stress: str) -> None:
    problem = small_silo(stress=stress).problem()
    solution = solve(problem, "split_interior_point", tol=1e-6)
    assert certify(problem, solution.r, solution.v).residual <= 1e-6
    assert solution.iterations <= 60


def test_krylov_solves_in_place_of_factors_give_the_same_flow(monkeypatch: pytest.MonkeyPatch) -> None:
    flow = small_silo()
    direct = solve(flow.problem(), "split_interior_point", tol=1e-5)

    def in_parts(pattern: Any, kind: str, points: np.ndarray, components: np.ndarray) -> KrylovSolver:
        return KrylovSolver(pattern, kind, points, components, part=250)

    monkeypatch.setattr(module, "solver_for", in_parts)
    iterative = solve(flow.problem(), "split_interior_point", tol=1e-5)
    assert direct.converged and iterative.converged
    assert iterative.iterations == pytest.approx(direct.iterations, abs=3)
    assert direct.v is not None and iterative.v is not None
    assert np.linalg.norm(direct.v - iterative.v) <= 2e-2 * np.linalg.norm(direct.v)


def test_time_steps_start_from_the_one_before() -> None:
    """Each is certified, and some need no factorisation at all: `auto` stays with gradients as long as they do."""
    flow = small_silo(vertices=250, viscosity=0.01)
    states = [flow.at_rest()]
    for _ in range(6):
        states.append(flow.step(states[-1], 0.1, 1e-4))
    assert all(state.converged for state in states[1:])
    assert min(state.iterations for state in states[2:]) <= 200
