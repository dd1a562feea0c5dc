"""Cadoux's fixed point around any inner method, Newton's method on three functions, and the variants both rest on."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest
import scipy.sparse as sp
from first_order_cases import small_problem
from problems import random_problem, stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction.methods.cadoux import _Mixer
from barchan.friction.operators import build_operator
from barchan.friction.samples import pile, sample

INNER = ("interior_point", "clarabel_dual", "clarabel_primal", "gauss_seidel", "aspg", "apgd")
# `barchan.friction.methods` is also the name of a function, so dotted access would not find the module.
NEWTON_MODULE = sys.modules["barchan.friction.methods.newton"]
NEWTON = ("newton_alart_curnier", "newton_de_saxce", "newton_fischer_burmeister")
# Friction low enough for rates to be unique, or nearly so: all methods then find the same.
UNIQUE = {
    "free": lambda: random_problem(2, 15, 3, bodies=12, law=Coulomb(0.4)),
    "2d reduced": lambda: small_problem("reduced", 2, Coulomb(0.3)),
    "constrained": lambda: small_problem("constrained", 3, Coulomb(0.3)),
    "uneven": lambda: random_problem(2, 15, 3, bodies=12, law=Coulomb(np.linspace(0.0, 1.5, 15))),
    "tensors": lambda: random_problem(3, 12, 6, bodies=12, law=Coulomb(0.4)),
    "plastic": lambda: random_problem(
        2, 15, 3, bodies=12, law=DruckerPrager(0.5, shear_yield=0.1, tensile_yield=0.05, dilatancy=0.2)
    ),
}


# Variants


@pytest.mark.parametrize("shape", ["lumped", "general", "constrained", "reduced"])
def test_a_variant_is_the_problem_made_afresh(shape: str) -> None:
    """Same operator and rates as with the law and drift given from the start; what is factorised is shared."""
    base = small_problem(shape, 3, Coulomb(0.3))
    law, drift = SecondOrderCone(np.linspace(0.1, 0.8, base.n)), np.linspace(-1.0, 1.0, base.n * 3)
    variant = base.variant(law, drift)
    if base.is_reduced:
        fresh = Problem.reduced(base.W, base.b + drift, law, block_size=3)
    else:
        fresh = Problem(M=base.M, f=base.f, H=base.H, w=base.w + drift, law=law, C=base.C, k=base.k)
    mine, theirs = build_operator(variant), build_operator(fresh)
    r = np.random.default_rng(0).standard_normal((base.n, 3))
    assert mine.apply(r) == pytest.approx(theirs.apply(r), abs=1e-12)
    assert mine.b == pytest.approx(theirs.b, abs=1e-12)
    assert np.array_equal(variant.parameters, fresh.parameters) and np.array_equal(variant.rho, fresh.rho)
    assert certify(variant, r).residual == pytest.approx(certify(fresh, r).residual, rel=1e-9)
    assert variant.diagonal_blocks is base.diagonal_blocks


def test_drifts_of_variants_of_variants_add_up_and_the_origin_is_the_first() -> None:
    base = small_problem("lumped", 3, Coulomb(0.3))
    w = base.w.copy()
    first = base.variant(base.law, np.ones(base.n * 3))
    second = first.variant(base.law.convexified(), 2.0 * np.ones((base.n, 3)))
    assert second.origin is first.origin is base.origin
    assert second.w == pytest.approx(w + 3.0) and np.array_equal(base.w, w)
    assert second.drift - base.drift == pytest.approx(3.0)
    assert build_operator(second).b == pytest.approx(build_operator(base).b + 3.0)
    with pytest.raises(InputError):
        base.variant(Coulomb(np.full(base.n + 1, 0.3)))


# Cadoux


@pytest.mark.parametrize("memory", [5, 0])
@pytest.mark.parametrize("name", UNIQUE)
def test_any_inner_method_leads_to_the_rates_that_gauss_seidel_finds(name: str, memory: int) -> None:
    problem = UNIQUE[name]()
    reference = solve(problem, "gauss_seidel", tol=1e-10, max_iterations=20_000)
    assert reference.converged
    for inner in INNER:
        solution = solve(problem, "cadoux", tol=1e-7, inner=inner, memory=memory)
        assert solution.converged, (inner, solution.certificate)
        assert certify(problem, solution.r, solution.v).residual <= 1e-7
        assert solution.u == pytest.approx(reference.u, abs=3e-6 * np.abs(reference.u).max()), inner


@pytest.mark.parametrize("name", UNIQUE)
def test_the_primal_formulation_has_the_same_rates(name: str) -> None:
    problem = UNIQUE[name]()
    dual, primal = (solve(problem, "cadoux", tol=1e-7, formulation=form) for form in ("dual", "primal"))
    assert dual.converged and primal.converged
    assert primal.u == pytest.approx(dual.u, abs=3e-6 * np.abs(dual.u).max())


@pytest.mark.parametrize("law", [SecondOrderCone(0.6), DruckerPrager(0.6, 0.1, 0.05, dilatancy=0.6)])
@pytest.mark.parametrize("inner", INNER)
def test_an_associated_law_has_no_shift_and_takes_one_outer_iteration(inner: str, law) -> None:
    """Inner problems as exact as the tolerance asks; the coarse ones of the default only add to it."""
    problem = random_problem(5, 15, 3, bodies=20, law=law)
    exact = solve(problem, "cadoux", tol=1e-7, inner=inner, accuracy=1e-12)
    assert exact.converged and exact.iterations == 1
    assert solve(problem, "cadoux", tol=1e-7, inner=inner).iterations <= 6


def test_a_solution_is_a_fixed_point_and_solves_the_convex_problem_of_its_own_shift() -> None:
    """Property 2.1 of seed B."""
    problem = UNIQUE["uneven"]()
    solution = solve(problem, "cadoux", tol=1e-9)
    assert solution.converged
    u = solution.u.reshape(-1, 3)
    drift = np.zeros_like(u)
    drift[:, 0] = problem.parameters[:, 0] * np.linalg.norm(u[:, 1:], axis=1)
    frozen = problem.variant(problem.law.convexified(), drift)
    assert certify(frozen, solution.r).residual <= 1e-8
    assert solve(problem, "cadoux", tol=1e-8, r0=solution.r).iterations == 0


def test_high_friction_and_hyperstatic_piles() -> None:
    problems = (
        random_problem(2, 15, 3, bodies=12, law=Coulomb(1.2)),
        pile(12, 3, (0.1, 0.9), jitter=0.02, uneven=True).problem,
        sample(20, 3, 3.0, (0.0, 1.0), seed=4, constraints=3).problem,
    )
    for problem in problems:
        solution = solve(problem, "cadoux", tol=1e-6)
        assert solution.converged, solution.certificate
    assert solve(stacked_blocks(8), "cadoux", tol=1e-9).r[::3] == pytest.approx(
        9.81 * np.arange(8, 0, -1), rel=1e-6
    )


def test_acceleration_saves_outer_iterations() -> None:
    problem = random_problem(2, 15, 3, bodies=5, law=Coulomb(0.6))
    fast, plain = (solve(problem, "cadoux", tol=1e-7, memory=memory) for memory in (5, 0))
    assert fast.converged and fast.iterations < plain.iterations


def test_each_outer_iteration_is_recorded_once_and_they_are_bounded() -> None:
    problem = UNIQUE["uneven"]()
    solution = solve(problem, "cadoux", tol=1e-13, max_iterations=4)
    assert [entry.iteration for entry in solution.history] == [0, 1, 2, 3, 4]
    assert solution.certificate.residual <= min(entry.residual for entry in solution.history) * (1.0 + 1e-6)
    assert solve(problem, "cadoux", max_iterations=0).iterations == 0
    rough = solve(problem, "cadoux", tol=1e-13, max_iterations=3, inner="gauss_seidel", inner_iterations=1)
    fine = solve(problem, "cadoux", tol=1e-13, max_iterations=3, inner="gauss_seidel")
    assert rough.certificate.residual > fine.certificate.residual


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"formulation": "mixed"}, "formulation = mixed"),
        ({"inner": "magic"}, "inner = magic"),
        ({"accuracy": 0.0}, "accuracy"),
        ({"accuracy": 1.0}, "accuracy"),
        ({"memory": -1}, "memory"),
    ],
)
def test_unusable_options_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        solve(UNIQUE["free"](), "cadoux", **options)


def mixed(mixer: _Mixer, image, point: np.ndarray, steps: int) -> list[float]:
    """Distances |F(s) - s| along the mixer's iterates of the map `image`."""
    gaps = []
    for _ in range(steps):
        gaps.append(float(np.linalg.norm(image(point) - point)))
        point = mixer.following(point, image(point))
        assert (point >= 0.0).all()
    return gaps


def test_anderson_solves_an_affine_map_in_as_many_steps_as_it_has_dimensions() -> None:
    rng = np.random.default_rng(0)
    matrix = 0.9 * np.linalg.qr(rng.standard_normal((3, 3)))[0]
    fixed = np.full(3, 5.0)

    def image(s: np.ndarray) -> np.ndarray:
        return fixed + matrix @ (s - fixed)

    assert mixed(_Mixer(5), image, fixed + 0.1 * rng.standard_normal(3), 6)[-1] < 1e-9
    assert mixed(_Mixer(0), image, fixed + 0.1 * rng.standard_normal(3), 6)[-1] > 1e-3


def test_strides_grow_along_a_drift_and_shrink_in_a_cycle() -> None:
    drifting, turning = _Mixer(0), _Mixer(0)
    mixed(drifting, lambda s: s + 1.0, np.zeros(2), 5)
    assert drifting.stride > 4.0
    mixed(turning, lambda s: 10.0 - s, np.full(2, 2.0), 2)
    assert turning.stride < 1.0
    # The map s -> 10 - s only turns round by itself; shorter strides settle at 5.
    assert mixed(_Mixer(0), lambda s: 10.0 - s, np.full(2, 2.0), 12)[-1] < 1e-2
    assert mixed(_Mixer(0), lambda s: s - 1.0, np.full(2, 3.0), 6)[-1] <= 1.5  # stopped at zero


# Newton


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("method", NEWTON)
def test_newton_ends_quadratically(method: str, s: int) -> None:
    """Full steps from near a solution with strict complementarity: each residual is of the order of the last one squared."""
    made = sample(12, s, 0.5, 0.4, seed=s, condition=10.0)
    noise = 1.0 + 1e-3 * np.random.default_rng(1).standard_normal(made.forces.shape)
    solution = solve(made.problem, method, tol=1e-12, r0=noise * made.forces, line_search=False)
    assert solution.converged and solution.iterations <= 6
    residuals = [entry.residual for entry in solution.history]
    for before, after in itertools.pairwise(residuals):
        assert after <= 100.0 * before**2 + 1e-9 * before + 1e-13
    assert solution.r == pytest.approx(made.forces.ravel(), abs=1e-7 * np.abs(made.forces).max())


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("method", NEWTON)
def test_newton_solves_regular_problems_from_zero_forces(method: str, s: int) -> None:
    for seed in range(4):
        problem = random_problem(seed, 15, s, bodies=18, law=Coulomb(0.3))
        solution = solve(problem, method, tol=1e-11)
        assert solution.converged and solution.iterations <= 60
        assert certify(problem, solution.r, solution.v).residual <= 1e-11


@pytest.mark.parametrize("method", NEWTON)
def test_sparse_and_dense_factorisations_make_the_same_steps(method: str, monkeypatch) -> None:
    problem = random_problem(0, 15, 3, bodies=18, law=Coulomb(0.3))
    dense = solve(problem, method, tol=1e-10)
    monkeypatch.setattr(NEWTON_MODULE, "LARGEST_DENSE", 0)
    sparse = solve(problem, method, tol=1e-10)
    assert sparse.converged and sparse.u == pytest.approx(dense.u, abs=1e-7)


def singular(kind: str) -> Problem:
    """Contacts given twice; a vanishing W; blocks that nothing moves beside one that moves."""
    if kind == "repeated":
        once = stacked_blocks(2)
        H = sp.csr_array(sp.vstack([once.H, once.H, once.H]))
        return Problem(M=once.M, f=once.f, H=H, w=np.zeros(18), law=Coulomb(np.full(6, 0.6)))
    if kind == "nothing":
        return Problem.reduced(
            np.zeros((6, 6)), np.array([-1.0, 0, 0, 1, 0.5, 0]), Coulomb(0.5), block_size=3
        )
    W = np.zeros((6, 6))
    W[:3, :3] = np.eye(3)
    return Problem.reduced(W, np.array([-1.0, 0.2, 0, 1.0, 0, 0]), Coulomb(0.5), block_size=3)


@pytest.mark.parametrize("line_search", [True, False])
@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("kind", ["repeated", "nothing", "partly"])
@pytest.mark.parametrize("method", NEWTON)
def test_singular_jacobians_do_not_crash(
    method: str, kind: str, dense: bool, line_search: bool, monkeypatch
) -> None:
    if not dense:
        monkeypatch.setattr(NEWTON_MODULE, "LARGEST_DENSE", 0)
    problem = singular(kind)
    solution = solve(problem, method, tol=1e-8, max_iterations=60, line_search=line_search)
    assert np.isfinite(solution.r).all()
    if kind == "partly":
        assert solution.converged
        assert solution.r[:3] == pytest.approx([1.0, -0.2, 0.0], abs=1e-7)
    elif kind == "repeated" and line_search:
        assert solution.converged
        assert solution.u == pytest.approx(0.0, abs=1e-6)
        assert solution.r[0::3].reshape(3, 2).sum(axis=0) == pytest.approx([2 * 9.81, 9.81], rel=1e-6)
    elif kind == "nothing":
        assert not solution.converged  # u = b whatever the forces, and b closes: there is no solution


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("method", NEWTON)
def test_without_a_direction_newton_takes_steps_of_the_fixed_point(
    method: str, dense: bool, monkeypatch
) -> None:
    """r <- P(r - rho (u + s(u))), where J is singular to the last digit."""
    monkeypatch.setattr(NEWTON_MODULE, "PROXIMAL", 0.0)
    if not dense:
        monkeypatch.setattr(NEWTON_MODULE, "LARGEST_DENSE", 0)
    problem = singular("nothing")
    b = problem.b.reshape(2, 3)
    start = np.array([[1.0, 0.1, 0.0], [1.0, 0.1, 0.0]])
    solution = solve(problem, method, tol=1e-8, r0=start, max_iterations=1)
    assert np.isfinite(solution.history[-1].residual)
    if method == "newton_de_saxce":
        stepped = problem.law.project(start - problem.rho[:, None] * (b + problem.law.shift(b)))
        expected = certify(problem, stepped).residual
        assert solution.history[-1].residual == pytest.approx(expected, rel=1e-9)


def test_newton_history_bounds_and_refusals() -> None:
    problem = random_problem(1, 15, 3, bodies=18, law=Coulomb(0.3))
    for method in NEWTON:
        solution = solve(problem, method, tol=1e-12, max_iterations=3)
        assert [entry.iteration for entry in solution.history] == [0, 1, 2, 3]
        assert solve(problem, method, tol=1e-8, r0=solve(problem, method, tol=1e-10).r).iterations == 0
    with pytest.raises(InputError, match="shear yield"):
        solve(problem.variant(DruckerPrager(0.3, shear_yield=0.1)), "newton_fischer_burmeister")
