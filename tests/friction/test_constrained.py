"""Bilateral constraints on a diagonal M: the operator by way of S = C M^-1 C^T is the dense one, and every method solves it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from first_order_cases import small_problem
from hypothesis import given
from hypothesis import settings as property_settings
from hypothesis import strategies as st
from problems import random_problem

from barchan.cones import Coulomb, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, methods, solve
from barchan.friction.constrained import ConstrainedDelassus
from barchan.friction.gradient_form import GradientDelassus
from barchan.friction.lumped import LumpedDelassus
from barchan.friction.methods._continuum import is_continuum
from barchan.friction.methods.gauss_seidel import prepare_sweeper
from barchan.friction.operators import build_operator
from barchan.friction.samples.immersed import immersed_column

FORMS = {
    "plane": {"cells": (6, 4)},
    "floor": {"cells": (6, 4), "floor_friction": 0.3},
    "penalised": {"cells": (6, 4), "pressure": "penalised"},
    "space": {"cells": (4, 2, 4), "filled": (2, 2, 3)},
    "space, penalised": {"cells": (4, 2, 2), "pressure": "penalised", "floor_friction": 0.2},
}
OPERATOR_METHODS = (
    "gauss_seidel", "symmetric_gauss_seidel", "sor", "jacobi", "aspg", "apgd", "spg", "projected_gradient",
)  # fmt: skip
ROUGH = {"dual_ama": 1e-4, "arrow_hurwicz": 1e-4, "clarabel_primal": 1e-5, "clarabel_dual": 1e-5}
NOT_HERE = {"lemke": "pyramids", "split_interior_point": "takes no C", "nodal": "takes no C"}


def column(form: str, associated: bool = False, **changes: Any) -> Problem:
    problem = immersed_column(**(FORMS[form] | changes)).problem  # type: ignore[arg-type]
    return problem.variant(SecondOrderCone(problem.law.mu)) if associated else problem


def eliminated(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """W and b by dense elimination with a pseudo-inverse."""
    inverse = np.diag(1.0 / problem.M.diagonal())
    C, H = problem.C.toarray(), problem.H.toarray()
    S = np.linalg.pinv(C @ inverse @ C.T, rcond=1e-12)
    P = inverse - inverse @ C.T @ S @ C @ inverse
    free = P @ problem.f + inverse @ C.T @ (S @ problem.k)
    return H @ P @ H.T, H @ free + problem.w


def constrained_contacts(seed: int, n: int, s: int, rows: int, repeated: int = 0) -> Problem:
    """Random contacts between bodies with `rows` random constraints and `repeated` combinations of them."""
    rng = np.random.default_rng(seed)
    base = random_problem(seed, n, s, bodies=2 * n)
    C = rng.standard_normal((rows, base.size))
    C = np.vstack([C, rng.standard_normal((repeated, rows)) @ C])
    return Problem(
        M=base.M,
        f=base.f,
        H=base.H,
        w=base.w,
        law=base.law,
        C=C,
        k=C @ (0.1 * rng.standard_normal(base.size)),
    )


@pytest.mark.parametrize("form", FORMS)
def test_the_operator_is_the_dense_one_around_strains(form: str) -> None:
    problem = column(form)
    operator = build_operator(problem, "matrix-free")
    assert isinstance(operator, ConstrainedDelassus) and isinstance(operator.free, GradientDelassus)
    W, b = eliminated(problem)
    r = np.random.default_rng(0).standard_normal((problem.n, problem.s))
    assert np.allclose(operator.apply(r).ravel(), W @ r.ravel(), atol=1e-10 * np.abs(W).max())
    assert np.allclose(operator.b.ravel(), b, atol=1e-10 * np.abs(b).max())
    free = sp.csr_array(problem.H) @ sp.diags_array(1.0 / problem.M.diagonal()) @ problem.H.T
    for i, block in enumerate(operator.diagonal_blocks):
        rows = slice(i * problem.s, (i + 1) * problem.s)
        assert np.allclose(block, free[rows, rows].toarray(), atol=1e-12 * np.abs(block).max())


@property_settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(2, 12),
    st.sampled_from([2, 3, 6]),
    st.integers(1, 4),
    st.integers(0, 2),
)
def test_the_operator_is_the_dense_one_around_contacts(
    seed: int, n: int, s: int, rows: int, repeated: int
) -> None:
    """Also where some of the constraints follow from others."""
    problem = constrained_contacts(seed, n, s, rows, repeated)
    operator = build_operator(problem, "matrix-free")
    assert isinstance(operator, ConstrainedDelassus) and isinstance(operator.free, LumpedDelassus)
    W, b = eliminated(problem)
    r = np.random.default_rng(seed).standard_normal((n, s))
    assert np.allclose(operator.apply(r).ravel(), W @ r.ravel(), atol=1e-9 * np.abs(W).max())
    assert np.allclose(operator.b.ravel(), b, atol=1e-9 * (1.0 + np.abs(b).max()))
    stored = build_operator(problem, "explicit").apply(r)
    assert np.allclose(operator.apply(r), stored, atol=1e-9 * np.abs(W).max())


@property_settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6), st.sampled_from([2, 3]), st.integers(1, 4), st.sampled_from(OPERATOR_METHODS[:6])
)
def test_random_problems_are_solved_without_a_stored_operator(
    seed: int, s: int, rows: int, method: str
) -> None:
    problem = constrained_contacts(seed, 5, s, rows)
    problem = problem.variant(SecondOrderCone(0.3))
    solution = solve(problem, method, tol=1e-6, operator="matrix-free")
    assert solution.converged and solution.multipliers is not None
    assert certify(problem, solution.r, solution.v).residual <= 1e-6
    assert np.abs(problem.C @ solution.v - problem.k).max() <= 1e-12 * (1.0 + np.abs(solution.v).max())


@pytest.mark.parametrize("form", ["plane", "floor", "penalised", "space"])
@pytest.mark.parametrize("method", [name for name in methods() if name not in NOT_HERE])
def test_every_method_finds_the_velocities_of_the_convex_problem(form: str, method: str) -> None:
    """Velocities of the associated law are unique: they minimise a strictly convex function."""
    problem = column(form, associated=True)
    reference = solve(column(form, associated=True), "interior_point", tol=1e-9)
    solution = solve(problem, method, tol=1e-7, max_iterations=60_000)
    assert solution.certificate.residual <= ROUGH.get(method, 1e-7)
    assert reference.v is not None and solution.v is not None
    size = np.abs(reference.v).max()
    assert np.abs(solution.v - reference.v).max() <= 1e-2 * size


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("method", ["auto", *OPERATOR_METHODS[:1], "interior_point"])
def test_coulombs_law_is_certified_to_eight_digits(form: str, method: str) -> None:
    problem = column(form, mu=0.3)
    solution = solve(problem, method, tol=1e-8, max_iterations=100_000)
    assert solution.converged and solution.certificate.residual <= 1e-8
    assert certify(problem, solution.r, solution.v).residual <= 1e-8
    assert solution.v is not None and solution.multipliers is not None
    assert np.abs(problem.C @ solution.v - problem.k).max() <= 1e-13 * np.abs(problem.C).max() * np.abs(
        solution.v
    ).max() * np.sqrt(problem.size)
    W, b = eliminated(problem)
    dense = Problem.reduced(0.5 * (W + W.T), b, problem.law, problem.s, problem.reference_force)
    assert certify(dense, solution.r).residual <= 1e-6


def test_multipliers_are_the_pressures_that_balance() -> None:
    """Without grains that yield, the water of a closed box at rest carries its own weight: p falls by rho g h per cell."""
    step = immersed_column((4, 6), filled=(1, 1))
    problem = step.problem.variant(Coulomb(0.4))
    solution = solve(problem, tol=1e-9)
    assert solution.multipliers is not None and solution.v is not None
    gap = problem.M @ solution.v - problem.f - problem.H.T @ solution.r - problem.C.T @ solution.multipliers
    assert np.abs(gap).max() <= 1e-12 * np.abs(problem.f).max()
    # Nodes of the coarse pressure, the first (which is left out) having none.
    pressure = np.append(0.0, solution.multipliers).reshape(3, 4)
    falls = -np.diff(pressure[2]) / (2.0 * step.cell)
    assert falls == pytest.approx(np.full(3, 9810.0), rel=0.02)
    with pytest.raises(InputError, match="multipliers"):
        certify(problem, solution.r, solution.v, np.zeros(3))
    wrong = certify(problem, solution.r, solution.v, 1.1 * solution.multipliers)
    assert wrong.balance > 1e-2 and solution.certificate.balance < 1e-12


@pytest.mark.parametrize("period", [1, 7, 1000])
def test_the_period_of_the_pressures_does_not_change_the_answer(period: int) -> None:
    problem = column("floor", associated=True)
    solution = solve(problem, "gauss_seidel", tol=1e-8, operator="matrix-free", pressure_every=period)
    reference = solve(problem, "interior_point", tol=1e-10)
    assert solution.converged and reference.v is not None
    assert np.allclose(solution.v, reference.v, atol=1e-3 * np.abs(reference.v).max())
    with pytest.raises(InputError, match="pressure_every"):
        solve(problem, "gauss_seidel", pressure_every=0)


def test_a_sweep_with_the_pressures_of_now_never_raises_the_energy_of_forces() -> None:
    """Block descent: x.Wx/2 + x.b falls in every sweep of the associated law, whatever pressures lag."""
    problem = column("space", associated=True)
    sweeper = prepare_sweeper(problem, "matrix-free", "secular", False)
    W, b = eliminated(problem)
    r = sweeper.start(np.zeros((problem.n, problem.s)))
    before = np.inf
    for sweep in range(40):
        sweeper.run(1, sweep, -1.0)
        sweeper.residual()
        energy = 0.5 * r.ravel() @ (W @ r.ravel()) + r.ravel() @ b
        assert energy <= before + 1e-12 * abs(energy)
        before = energy


def test_continua_with_constraints_are_known_as_such_and_contacts_are_not() -> None:
    assert is_continuum(column("plane", cells=(16, 8)))
    assert is_continuum(column("space", cells=(4, 4, 4), filled=(3, 4, 3), pressure="penalised"))
    assert not is_continuum(constrained_contacts(0, 6, 3, 2))
    assert not is_continuum(small_problem("constrained", 3, SecondOrderCone(0.3)))


def test_larger_columns_are_solved_from_step_to_step_without_storing_the_operator() -> None:
    step = immersed_column((40, 10), filled=(25, 7), floor_friction=0.3)
    r = None
    for _ in range(3):
        problem = step.problem
        solution = solve(problem, tol=1e-4, r0=r, max_iterations=5000)
        assert solution.converged and solution.v is not None
        assert isinstance(build_operator(problem), ConstrainedDelassus)
        assert solution.certificate.bilateral <= 1e-14 and solution.certificate.balance <= 1e-12
        step, r = step.following(solution.v), solution.r


def test_newton_in_velocity_space_keeps_the_constraints() -> None:
    problem = immersed_column((24, 8), filled=(12, 6)).problem
    solution = solve(problem, tol=1e-8)
    assert solution.converged and solution.certificate.bilateral <= 1e-14


@pytest.mark.parametrize("method", ["auto", "gauss_seidel", "aspg"])
def test_it_does_not_depend_on_the_number_of_threads(
    method: str, bytes_by_threads: Callable[..., list[bytes]]
) -> None:
    def swept() -> np.ndarray:
        problem = immersed_column((80, 40), filled=(60, 30)).problem
        assert problem.n >= 1500
        return np.asarray(solve(problem, method, tol=1e-8, max_iterations=60, operator="matrix-free").r)

    one, two = bytes_by_threads(swept)
    assert one == two


@pytest.mark.parametrize("s", [3, 6])
def test_without_blocks_the_saddle_point_remains(s: int) -> None:
    base = column("plane" if s == 3 else "space")
    problem = Problem(
        M=base.M, f=base.f, H=sp.bsr_array((0, base.size), blocksize=(s, 2 if s == 3 else 3)), w=np.zeros(0),
        law=Coulomb(np.zeros(0)), C=base.C, k=base.k, block_size=s,
    )  # fmt: skip
    for method in methods():
        solution = solve(problem, method, tol=1e-10)
        assert solution.converged and solution.certificate.residual <= 1e-12
        assert solution.v is not None and solution.multipliers is not None
        dense = np.linalg.solve(
            np.block([
                [problem.M.toarray(), -problem.C.T.toarray()],
                [problem.C.toarray(), np.zeros((problem.C.shape[0],) * 2)],
            ]),
            np.concatenate([problem.f, problem.k]),
        )  # fmt: skip
        assert np.allclose(solution.v, dense[: problem.size], atol=1e-10 * np.abs(solution.v).max())


def test_a_column_that_does_not_fit_is_refused() -> None:
    for wrong in (
        {"cells": (5, 4)},
        {"cells": (4,)},
        {"filled": (20, 2)},
        {"pressure": "none"},
    ):
        with pytest.raises(InputError, match="|".join(wrong)):
            immersed_column(**wrong)  # type: ignore[arg-type]
