"""Interior point: identities of the Nesterov-Todd scaling, and every convex problem solved in few factorisations."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from problems import random_problem

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, Solution, certify, solve
from barchan.friction import _barrier as barrier
from barchan.friction.samples import family, pile, sample

FACTORISATIONS = 40
SYSTEMS = ("forces", "velocities")
N = 20
CONVEX: dict[str, Law] = {
    "cone": SecondOrderCone(0.4),
    "steep": SecondOrderCone(1.5),
    "frictionless": SecondOrderCone(0.0),
    "uneven": SecondOrderCone(np.linspace(0.0, 1.5, N)),
    "yielding": DruckerPrager(0.4, shear_yield=0.05, tensile_yield=0.02, dilatancy=0.4),
    "cylinder": DruckerPrager(0.0, shear_yield=0.1),
    "mixed": DruckerPrager(
        np.tile([0.0, 0.3], N // 2),
        shear_yield=np.tile([0.0, 0.0, 0.1, 0.1], N // 4),
        tensile_yield=0.01,
        dilatancy=np.tile([0.0, 0.3], N // 2),
    ),
}
MODERATE: dict[str, Law] = {
    "coulomb": Coulomb(0.3),
    "uneven": Coulomb(np.linspace(0.0, 0.6, N)),
    "yielding": DruckerPrager(0.5, shear_yield=0.1, tensile_yield=0.05, dilatancy=0.2),
}


def solved(problem: Problem, **options: str) -> Solution:
    """Solved to 1e-8 within the factorisations allowed, as the certificate says."""
    solution = solve(problem, "interior_point", tol=1e-8, **options)
    assert solution.iterations <= FACTORISATIONS
    assert solution.converged, solution.certificate
    assert certify(problem, solution.r, solution.v).residual <= 1e-8
    return solution


def reduced(problem: Problem) -> Problem:
    """The same problem as u = W r + b."""
    H = sp.csr_array(problem.H)
    W = H @ problem.factor.solve(H.T.toarray())
    b = H @ problem.factor.solve(problem.f) + problem.w
    return Problem.reduced(W=0.5 * (W + W.T), b=b, law=problem.law, block_size=problem.s)


# Scaling


@st.composite
def inside(draw, count: int):
    """`count` points of one size inside K_1, some close to its boundary: (x_N - |x_T|) / x_N from 1e-4 to 1."""
    s = draw(st.sampled_from([2, 3, 4, 6]))
    points = []
    for _ in range(count):
        rng = np.random.default_rng(draw(st.integers(0, 10_000)))
        direction = rng.standard_normal(s - 1)
        gap, size = 10.0 ** draw(st.floats(-4.0, 0.0)), 10.0 ** draw(st.floats(-2.0, 2.0))
        tangent = (1.0 - gap) * direction / np.linalg.norm(direction)
        points.append(size * np.concatenate([[1.0], tangent]))
    return points


def scaling_of(z: np.ndarray, y: np.ndarray, mu: float = 1.0):
    """Theta, w, eta, lam and the gap of one cone block in the state (z, y)."""
    s = len(z)
    shape = barrier.shape_table(np.array([[mu, 0.0, 0.0, mu]]))
    state = (z[None].copy(), y[None].copy(), np.ones(1), np.ones(1))
    scaling = (np.zeros((1, s)), np.ones(1), np.zeros((1, s)))
    theta, slope = np.zeros((1, s, s)), np.zeros((1, s, s))
    gap = barrier.scale_blocks(shape, state, scaling, theta, slope)
    return theta[0], scaling[0][0], scaling[1][0], scaling[2][0], gap


def scaled(w: np.ndarray, eta: float, x: np.ndarray, inverse: bool) -> np.ndarray:
    out = np.empty_like(x)
    barrier._scale(w, eta, x, inverse, out)
    return out


@given(inside(2))
def test_scaling_takes_both_variables_to_the_same_point(points) -> None:
    """W y = W^-1 z = lam, W W^-1 = I, and the gap is |lam|^2."""
    z, y = points
    _, w, eta, lam, gap = scaling_of(z, y)
    size = np.abs(lam).max()
    assert scaled(w, eta, y, False) == pytest.approx(lam, abs=1e-12 * size)
    assert scaled(w, eta, z, True) == pytest.approx(lam, abs=1e-8 * size)
    assert scaled(w, eta, scaled(w, eta, z, False), True) == pytest.approx(z, rel=1e-6, abs=1e-6 * z[0])
    assert barrier.cone_det(w) == pytest.approx(1.0, rel=1e-6)
    assert gap == pytest.approx(z @ y, rel=1e-12) and gap == pytest.approx(lam @ lam, rel=1e-8)


@given(inside(2))
def test_theta_is_positive_definite_and_maps_forces_to_multipliers(points) -> None:
    """Theta = W^-2: symmetric, Theta z = y, and its inverse P(w) maps y to z."""
    z, y = points
    theta, w, eta, _, _ = scaling_of(z, y)
    assert np.array_equal(theta, theta.T)
    scale = np.abs(theta).max()
    assert np.linalg.eigvalsh(theta)[0] > -1e-14 * scale
    assert np.linalg.det(theta / scale) > -1e-14
    assert theta @ z == pytest.approx(y, abs=1e-12 * scale * z[0] + 1e-8 * y[0])
    flip = np.diag(np.concatenate([[1.0], -np.ones(len(z) - 1)]))
    square = eta**2 * (2.0 * np.outer(w, w) - flip)
    assert square @ y == pytest.approx(z, abs=1e-12 * np.abs(square).max() * y[0] + 1e-8 * z[0])
    for k in range(len(z)):
        unit = np.eye(len(z))[k]
        twice = scaled(w, eta, scaled(w, eta, unit, False), False)
        assert twice == pytest.approx(square[k], abs=1e-10 * np.abs(square).max())


@given(inside(2), st.floats(0.05, 1.5))
def test_theta_in_force_space_carries_the_friction_coefficient(points, mu: float) -> None:
    """z = (r_N, r_T / mu): Theta r = G^T y, the velocity dual to the force."""
    z, y = points
    theta = scaling_of(z, y, mu)[0]
    r = np.concatenate([z[:1], mu * z[1:]])
    expected = np.concatenate([y[:1], y[1:] / mu])
    assert theta @ r == pytest.approx(expected, abs=1e-12 * np.abs(theta).max() * z[0] + 1e-8 * y[0] / mu)


@given(inside(2), st.floats(0.01, 100.0), st.floats(0.01, 100.0))
def test_a_yield_adds_the_half_line_to_the_normal_part(points, line: float, multiplier: float) -> None:
    """m / l on the normal row and nothing else; a block without friction and yield is the half-line alone."""
    z, y = points
    s = len(z)
    laws = np.array([[0.5, 0.5, 0.0, 0.2], [0.0, 0.0, 0.0, 0.0]])
    cone, held = barrier.shape_table(laws)
    without = cone.copy()
    without[barrier.LINE] = 0.0
    tables = np.array([cone, without, held])
    state = (np.tile(z, (3, 1)), np.tile(y, (3, 1)), np.full(3, line), np.full(3, multiplier))
    theta, slope = np.zeros((3, s, s)), np.zeros((3, s, s))
    gap = barrier.scale_blocks(tables, state, (np.zeros((3, s)), np.ones(3), np.zeros((3, s))), theta, slope)
    added = np.zeros((s, s))
    added[0, 0] = multiplier / line
    assert theta[0] == pytest.approx(theta[1] + added, rel=1e-12)
    assert np.array_equal(theta[2], added) and np.array_equal(slope[2], np.eye(s))
    assert gap == pytest.approx(2.0 * (z @ y) + 2.0 * line * multiplier, rel=1e-12)
    slip = np.linalg.norm(y[1:])
    assert slope[0, 0, 1:] * slip == pytest.approx(-0.3 * y[1:])


@given(inside(1), st.integers(0, 10_000), st.sampled_from([1.0, 1e-3, 1e3]))
def test_the_longest_step_ends_on_the_boundary(points, seed: int, size: float) -> None:
    x = points[0]
    d = size * np.random.default_rng(seed).standard_normal(len(x))
    step = barrier.longest_step(x, d)
    assert step > 0.0
    if np.isinf(step):
        assert d[0] >= np.linalg.norm(d[1:]) * (1.0 - 1e-12)
        return
    end = x + step * d
    scale = abs(x[0]) + step * np.linalg.norm(d)
    assert abs(end[0] - np.linalg.norm(end[1:])) <= 1e-9 * scale
    for part in (0.0, 0.3, 0.9, 0.999):
        point = x + part * step * d
        assert point[0] > np.linalg.norm(point[1:])


@given(inside(2), st.floats(0.0, 10.0))
def test_recession_directions_never_end(points, size: float) -> None:
    assert barrier.longest_step(points[0], size * points[1]) == np.inf
    assert barrier.longest_step(points[0], -points[0]) == pytest.approx(1.0, rel=1e-6)


@given(inside(2))
def test_smallest_product_is_the_smaller_eigenvalue_of_the_scaled_pair(points) -> None:
    """(lam_N - |lam_T|)^2, and it says -1 outside the cone."""
    z, y = points
    lam = scaling_of(z, y)[3]
    shape = barrier.shape_table(np.array([[1.0, 0.0, 0.0, 1.0]]))
    state = (z[None], y[None], np.ones(1), np.ones(1))
    still = tuple(np.zeros_like(part) for part in state)
    gap, smallest = barrier.gap_after(shape, state, still, 1.0)
    assert gap == pytest.approx(z @ y, rel=1e-12)
    assert smallest == pytest.approx((lam[0] - np.linalg.norm(lam[1:])) ** 2, rel=1e-5)
    out = (-2.0 * z[None], still[1], still[2], still[3])
    assert barrier.gap_after(shape, state, out, 1.0)[1] == -1.0


def test_the_shape_table_tells_which_constraints_hold_a_block() -> None:
    laws = np.array([[0.5, 0.0, 0.0, 0.5], [0.5, 0.1, 0.0, 0.2], [0.0, 0.1, 0.3, 0.0], [0.0, 0.0, 0.3, 0.0]])
    table = barrier.shape_table(laws)
    assert table[:, barrier.CONE].tolist() == [1.0, 1.0, 1.0, 0.0]
    assert table[:, barrier.LINE].tolist() == [0.0, 1.0, 1.0, 1.0]
    assert table[:, barrier.EXCESS] == pytest.approx([0.0, 0.3, 0.0, 0.0])


# Problems


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("law", CONVEX)
@pytest.mark.parametrize("bodies", [24, 12, 5])
def test_convex_problems_are_solved_by_both_systems_with_the_same_rates(
    bodies: int, law: str, s: int
) -> None:
    """W of full rank, and of rank far below its size."""
    problem = random_problem(3, N, s, bodies=bodies, law=CONVEX[law])
    u = [solved(problem, system=system).u for system in SYSTEMS]
    assert u[0] == pytest.approx(u[1], abs=1e-5 * max(np.abs(u[0]).max(), 1.0))


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("law", CONVEX)
def test_rates_are_those_that_gauss_seidel_finds(law: str, s: int) -> None:
    problem = random_problem(6, N, s, bodies=15, law=CONVEX[law])
    other = solve(problem, "gauss_seidel", tol=1e-10, max_iterations=50_000)
    assert other.converged
    for form in (problem, reduced(problem)):
        assert solved(form).u == pytest.approx(other.u, abs=1e-5 * max(np.abs(other.u).max(), 1.0))


@pytest.mark.parametrize("s", [2, 3, 6])
def test_bilateral_constraints_are_kept_by_both_systems(s: int) -> None:
    made = sample(N, s, 1.0, 0.5, seed=3, constraints=4).problem
    problem = made.variant(made.law.convexified())
    solutions = [solved(problem, system=system) for system in SYSTEMS]
    for solution in solutions:
        assert problem.C @ solution.v == pytest.approx(problem.k, abs=1e-9 * np.abs(solution.v).max())
    size = np.abs(solutions[0].u).max()
    assert solutions[0].u == pytest.approx(solutions[1].u, abs=1e-5 * size)
    for system in SYSTEMS:
        assert solve(problem, "interior_point", tol=1e-7, system=system, polish=False).converged


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_family_of_convex_problems_is_solved_in_few_factorisations(system: str) -> None:
    for _, problem in family("small")[:: 1 if system == "forces" else 3]:
        solved(problem.variant(problem.law.convexified()), system=system)


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("law", MODERATE)
def test_moderate_friction_that_is_not_associated_needs_no_outer_loop(law: str, s: int) -> None:
    for bodies in (24, 12, 5):
        solved(random_problem(3, N, s, bodies=bodies, law=MODERATE[law]))


def test_hyperstatic_piles_converge() -> None:
    made = pile(30, 2, 0.5, closed=True).problem
    problem = made.variant(made.law.convexified())
    W = reduced(problem).W.toarray()
    assert np.linalg.matrix_rank(W) < len(W)
    solved(problem)


def test_work_is_bounded_and_bad_requests_are_refused() -> None:
    problem = random_problem(1, N, 3, bodies=24, law=SecondOrderCone(0.5))
    assert solve(problem, "interior_point", tol=1e-8, max_iterations=3).iterations == 3
    assert solve(problem, "interior_point", max_iterations=0).iterations == 0
    history = solve(problem, "interior_point", tol=1e-8).history
    assert [entry.iteration for entry in history] == list(range(len(history)))
    with pytest.raises(InputError, match="system = guess"):
        solve(problem, "interior_point", system="guess")
    with pytest.raises(InputError, match="system = velocities"):
        solve(reduced(problem), "interior_point", system="velocities")


def test_a_solution_is_recognised_and_the_path_does_not_depend_on_the_start() -> None:
    """A good start enters the record, neither shortens the path nor ends it."""
    problem = random_problem(1, N, 3, bodies=24, law=SecondOrderCone(0.5))
    cold = solve(problem, "interior_point", tol=1e-8)
    again = solve(problem, "interior_point", tol=1e-8, r0=cold.r)
    assert again.iterations == 0 and np.array_equal(again.r, cold.r)
    noise = 1.0 + 1e-4 * np.random.default_rng(0).standard_normal(cold.r.shape)
    warm = solve(problem, "interior_point", tol=1e-8, r0=noise * cold.r)
    assert warm.history[0].residual < 1e-3 < cold.history[0].residual
    assert [entry.residual for entry in warm.history[1:8]] == [entry.residual for entry in cold.history[1:8]]
    assert warm.converged


@pytest.mark.parametrize("system", SYSTEMS)
def test_without_polishing_the_path_ends_close(system: str) -> None:
    """What the path itself gives where W cannot be stored, hence not be polished."""
    for bodies in (24, 12, 5):
        for law in CONVEX.values():
            problem = random_problem(3, N, 3, bodies=bodies, law=law)
            assert solve(problem, "interior_point", tol=1e-7, system=system, polish=False).converged
