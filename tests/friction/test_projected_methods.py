"""Projected methods: they solve every convex problem, descend, agree on Coulomb problems; tangent cones obey Moreau."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from first_order_cases import CASES, CONVEX_LAWS, COUNT, small_problem
from hypothesis import example, given, settings
from hypothesis import strategies as st
from problems import stacked_blocks

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction._kernels import project_blocks
from barchan.friction.methods._norms import eigenvalue_bound
from barchan.friction.methods._scaled import scaled_problem
from barchan.friction.methods._shift import LaggedShift
from barchan.friction.methods._tangent_cone import project_tangent_blocks

METHODS = {
    "projected_gradient": {},
    "tangent_gradient": {},
    "tangent_gradient two": {"tangent": "two-projections"},
    "spg": {},
    "apgd": {},
    "aspg": {},
}
DESCENTS = {
    "projected_gradient": {},
    "tangent_gradient": {},
    "tangent_gradient two": {"tangent": "two-projections"},
    "spg monotone": {"memory": 1},
}


def name_of(label: str) -> str:
    return label.split()[0]


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("label", METHODS)
def test_convex_problems_are_solved(label: str, s: int) -> None:
    for shape, law in CASES:
        problem = small_problem(shape, s, CONVEX_LAWS[law](COUNT))
        solution = solve(problem, name_of(label), tol=1e-6, **METHODS[label])
        assert solution.converged, (shape, law, solution.certificate)
        assert certify(problem, solution.r, solution.v).residual <= 1e-6


@pytest.mark.parametrize("label", [*METHODS, "projected_gradient alart-curnier"])
def test_coulomb_problems_have_the_rates_that_gauss_seidel_finds(label: str) -> None:
    options = METHODS.get(label, {"function": "alart-curnier"})
    for s, shape in ((2, "lumped"), (3, "constrained"), (6, "reduced")):
        problem = small_problem(shape, s, Coulomb(np.full(COUNT, 0.3)))
        reference = solve(problem, "gauss_seidel", tol=1e-9)
        solution = solve(problem, name_of(label), tol=1e-8, **options)
        assert reference.converged and solution.converged
        assert solution.u == pytest.approx(reference.u, abs=1e-6)


@pytest.mark.parametrize("label", [*METHODS, "projected_gradient alart-curnier"])
def test_plasticity_with_partial_dilatancy(label: str) -> None:
    law = DruckerPrager(np.full(COUNT, 0.5), shear_yield=0.05, tensile_yield=0.02, dilatancy=0.2)
    options = METHODS.get(label, {"function": "alart-curnier"})
    assert solve(small_problem("lumped", 3, law), name_of(label), tol=1e-7, **options).converged


@pytest.mark.parametrize("label", DESCENTS)
def test_the_dual_objective_never_increases(label: str) -> None:
    problem = small_problem("reduced", 3, SecondOrderCone(np.full(COUNT, 0.6)))
    values: list[float] = []

    def note(_: object, r: np.ndarray) -> None:
        x = r.reshape(-1)
        values.append(float(0.5 * x @ (problem.W @ x) + x @ problem.b))

    start = np.random.default_rng(0).standard_normal(3 * COUNT)
    solve(problem, name_of(label), tol=1e-9, r0=start, callback=note, check_every=1, **DESCENTS[label])
    assert len(values) > 5
    assert (np.diff(values) <= 1e-14 * max(map(abs, values))).all()


def test_accelerated_descent_obeys_nesterovs_bound() -> None:
    # f(x_k) - f* <= 2 L |x_0 - x*|^2 / (k + 1)^2, in the equilibrated unknowns, without restart.
    problem = small_problem("lumped", 3, SecondOrderCone(np.full(COUNT, 0.6)))
    scaled = scaled_problem(problem)

    def objective(x: np.ndarray) -> float:
        return float(0.5 * np.vdot(x, scaled.rates(x) + scaled.root * scaled.delassus.b))

    best = solve(problem, "spg", tol=1e-13).r.reshape(COUNT, 3) / scaled.root
    values: list[float] = []
    solve(
        problem,
        "apgd",
        tol=1e-12,
        max_iterations=40,
        restart=False,
        curvature=scaled.lipschitz,
        check_every=1,
        callback=lambda _, r: values.append(objective(r / scaled.root)),
    )
    bound = 2.0 * scaled.lipschitz * float(np.vdot(best, best)) / (np.arange(1, len(values)) + 1.0) ** 2
    assert (np.array(values[1:]) - objective(best) <= bound + 1e-12).all()


@st.composite
def points_and_directions(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An admissible point of a (truncated) cone, often on a face, rim or tip; a direction; the law's parameters."""
    s = draw(st.sampled_from([2, 3, 6]))
    number = st.floats(-2.0, 2.0).map(lambda x: round(x, 2))
    mu = draw(st.sampled_from([0.0, 0.3, 1.5]))
    sigma = draw(st.sampled_from([0.0, 0.5]))
    tau = draw(st.sampled_from([0.0, 0.1]))
    laws = np.array([[mu, sigma, tau, 0.0]])
    outside = np.array([draw(st.lists(number, min_size=s, max_size=s))])
    point = np.empty((1, s))
    project_blocks(outside, laws, point)
    return point, np.array([draw(st.lists(number, min_size=s, max_size=s))]), laws


@settings(max_examples=200, deadline=None)
@given(points_and_directions())
@example(
    (np.array([[0.0, 0.5]]), np.array([[0.5, 2.0]]), np.array([[1.5, 0.5, 0.0, 0.0]]))
)  # from the rim onto the face
@example(
    (np.array([[0.0, 0.5]]), np.array([[-1.0, 0.1]]), np.array([[1.5, 0.5, 0.0, 0.0]]))
)  # onto the rim itself
def test_tangent_cone_projection_is_moreaus_decomposition(case: tuple[np.ndarray, ...]) -> None:
    x, y, laws = case
    tangent, back = np.empty_like(x), np.empty_like(x)
    project_tangent_blocks(x, y, laws, tangent)
    normal = y - tangent
    assert abs(np.vdot(tangent, normal)) <= 1e-12 * max(1.0, np.vdot(y, y))
    project_blocks(x + normal, laws, back)
    assert back == pytest.approx(x, abs=1e-12)  # normal is in the normal cone at x
    for step in (1e-3, 1e-5):
        project_blocks(x + step * tangent, laws, back)
        assert np.linalg.norm(back - x - step * tangent) <= 1e3 * step**2  # tangent is in the tangent cone


def test_eigenvalue_bounds_hold_and_are_tight() -> None:
    rng = np.random.default_rng(4)
    for size, rank in ((1, 1), (3, 2), (40, 40), (200, 30)):
        root = rng.standard_normal((size, rank)) * np.geomspace(1.0, 1e-3, rank)
        matrix = root @ root.T
        largest = np.linalg.eigvalsh(matrix)[-1]
        bound = eigenvalue_bound(lambda x, matrix=matrix: matrix @ x, (size,))
        assert largest <= bound <= 1.12 * largest
    assert eigenvalue_bound(lambda x: 0.0 * x, (7,)) == 0.0


def test_the_shift_lags_only_when_progress_stops() -> None:
    problem = small_problem("lumped", 3, Coulomb(np.full(COUNT, 0.5)))
    scaled = scaled_problem(problem)
    u = np.random.default_rng(0).standard_normal((COUNT, 3))
    shift = LaggedShift(scaled, np.zeros_like(u))
    for iteration in range(300):
        shift.watch(iteration, 0.99**iteration)
    assert shift.rate == 1.0
    shift.follow(u)
    assert shift.value == pytest.approx(scaled.shift(u))
    for iteration in range(300, 1300):
        shift.watch(iteration, 1.0)
    assert 0.0 < shift.rate < 0.1
    before = shift.value
    shift.follow(2.0 * u)
    assert shift.value == pytest.approx((1.0 - shift.rate) * before + shift.rate * scaled.shift(2.0 * u))


@pytest.mark.parametrize("label", METHODS)
def test_blocks_that_cannot_move_and_frictionless_ones(label: str) -> None:
    # The second block has W_ii = 0 and separates; the first two have no friction.
    W = np.diag([1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 3.0])
    b = np.array([-1.0, 0.1, 0.0, 0.5, 0.0, 0.0, -2.0, 0.2, 0.0])
    problem = Problem.reduced(W, b, Coulomb(np.array([0.0, 0.0, 0.5])))
    solution = solve(problem, name_of(label), tol=1e-9, **METHODS[label])
    assert solution.converged
    assert solution.r.reshape(3, 3) == pytest.approx(
        np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, -0.2, 0.0]]), abs=1e-6
    )


@pytest.mark.parametrize("label", METHODS)
def test_a_solution_is_recognised_and_runs_repeat(label: str) -> None:
    problem = stacked_blocks(5)
    run: Callable[..., object] = lambda **more: solve(problem, name_of(label), **METHODS[label], **more)  # noqa: E731
    first, second = run(tol=1e-9), run(tol=1e-9)
    assert first.r.tobytes() == second.r.tobytes()
    again = run(tol=1e-8, r0=first.r)
    assert again.converged and again.iterations == 0
    assert [h.iteration for h in first.history] == sorted(h.iteration for h in first.history)
    assert not run(tol=1e-12, max_iterations=2).converged


@pytest.mark.parametrize(
    ("method", "options", "field"),
    [
        ("projected_gradient", {"step": -1.0}, "step"),
        ("projected_gradient", {"function": "natural"}, "function"),
        ("projected_gradient", {"check_every": 0}, "check_every"),
        ("tangent_gradient", {"tangent": "none"}, "tangent"),
        ("tangent_gradient", {"probe": 0.0}, "probe"),
        ("spg", {"memory": 0}, "memory"),
        ("spg", {"shift_rate": 1.5}, "shift_rate"),
        ("apgd", {"curvature": float("nan")}, "curvature"),
        ("apgd", {"operator": "dense"}, "operator"),
        ("aspg", {"shift_every": 0}, "shift_every"),
    ],
)
def test_bad_options_are_named(method: str, options: dict, field: str) -> None:
    with pytest.raises(InputError, match=field):
        solve(stacked_blocks(3), method, **options)
