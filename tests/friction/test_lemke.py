"""Lemke's method finds solutions of copositive linear complementarity problems; in 2D their two edges are Coulomb's cone."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from problems import random_problem

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction._lemke import LARGEST_LCP, lcp_residual, solve_lcp
from barchan.friction.methods.lemke import Faceted, edges, faceted
from barchan.friction.operators import Delassus, build_operator

LAWS = {
    "coulomb": Coulomb(0.4),
    "cone": SecondOrderCone(0.4),
    "drucker-prager": DruckerPrager(0.4, shear_yield=0.05, tensile_yield=0.02, dilatancy=0.1),
    "frictionless": Coulomb(0.0),
}


def with_law(problem: Problem, law: Law) -> Problem:
    return Problem(M=problem.M, f=problem.f, H=problem.H, w=problem.w, law=law, block_size=problem.s)


def pyramids(problem: Problem, sides: int = 4) -> Faceted:
    delassus = build_operator(problem, "explicit")
    return faceted(problem, delassus, edges(-delassus.b[:, 1:], sides))


def energy(delassus: Delassus, r: np.ndarray) -> float:
    """r . W r / 2 + b . r, least for the associated law (seed B, Eq. 2.21)."""
    return float((r * (0.5 * delassus.apply(r) + delassus.b)).sum())


# Small whole numbers make ties, which is where a pivoting rule may cycle.
MATRICES = st.integers(1, 6).flatmap(lambda n: arrays(float, (n + 1, n), elements=st.integers(-2, 2)))


@settings(max_examples=60)
@given(A=MATRICES, seed=st.integers(0, 1000))
def test_a_positive_definite_problem_has_the_one_solution_that_enumeration_finds(
    A: np.ndarray, seed: int
) -> None:
    random = np.random.default_rng(seed)
    size = A.shape[1]
    skew = random.integers(-2, 3, (size, size))
    M, q = A.T @ A + np.eye(size) + skew - skew.T, random.integers(-3, 4, size).astype(float)
    result = solve_lcp(M, q)
    assert result.status == "solved"
    for active in product([False, True], repeat=size):
        z, chosen = np.zeros(size), np.flatnonzero(active)
        z[chosen] = np.linalg.solve(M[np.ix_(chosen, chosen)], -q[chosen])
        if z.min() >= -1e-10 and (M @ z + q).min() >= -1e-10:
            np.testing.assert_allclose(result.z, z, atol=1e-9)


@settings(max_examples=60)
@given(A=MATRICES, seed=st.integers(0, 1000))
def test_a_singular_semi_definite_problem_is_solved_when_it_is_feasible(A: np.ndarray, seed: int) -> None:
    """q = w - M z with w, z >= 0 makes it so; M = A^T A of low rank is copositive-plus."""
    random = np.random.default_rng(seed)
    M = A[: max(1, len(A) // 2)].T @ A[: max(1, len(A) // 2)]
    q = random.integers(0, 3, len(M)) - M @ random.integers(0, 3, len(M))
    result = solve_lcp(M, q)
    assert result.status == "solved"
    assert lcp_residual(M, q, result.z) <= 1e-9


def test_an_infeasible_problem_ends_on_a_ray_and_a_short_path_says_so() -> None:
    assert solve_lcp(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-1.0, -1.0])).status == "ray"
    assert solve_lcp(np.zeros((1, 1)), np.array([-1.0])).status == "ray"
    M, q = np.eye(5), -np.arange(1.0, 6.0)
    assert solve_lcp(M, q, max_pivots=2)[1:] == ("pivot limit", 2)
    assert solve_lcp(M, q, max_pivots=0)[1:] == ("pivot limit", 0)
    assert solve_lcp(1e-9 * M, 1e9 * q).z == pytest.approx(-1e18 * q)


@pytest.mark.parametrize("s", [2, 3])
@pytest.mark.parametrize("law", LAWS)
def test_the_friction_matrix_is_copositive_and_semi_definite_when_associated(law: str, s: int) -> None:
    """z . M z = r . W r + (mu - zeta) sum x lambda."""
    problem = with_law(random_problem(1, 8, s, bodies=3), LAWS[law])
    M = pyramids(problem).M
    mu, _, _, zeta = problem.parameters.T
    random = np.random.default_rng(0)
    for _ in range(50):
        z = random.exponential(size=len(M))
        coupling = ((mu - zeta) * z[: problem.n] * z[-problem.n :]).sum()
        assert z @ M @ z >= coupling - 1e-9
    if (mu == zeta).all():
        assert np.linalg.eigvalsh(M + M.T)[0] >= -1e-9


@pytest.mark.parametrize("bodies", [6, 30])
@pytest.mark.parametrize("law", LAWS)
def test_two_edges_are_the_cone_in_2d(law: str, bodies: int) -> None:
    """With 6 bodies W is singular: forces differ, velocities do not."""
    problem = with_law(random_problem(0, 25, 2, bodies=bodies), LAWS[law])
    direct, swept = solve(problem, "lemke", tol=1e-10), solve(problem, "gauss_seidel", tol=1e-10)
    assert direct.converged and swept.converged
    assert 0 < direct.iterations < 200
    scale = max(1.0, np.abs(swept.u).max())
    np.testing.assert_allclose(direct.u, swept.u, atol=1e-8 * scale)


def test_bilateral_rows_are_carried() -> None:
    free = random_problem(4, 12, 2, bodies=10)
    C = sp.csr_array(([1.0, -1.0, 1.0], ([0, 0, 1], [0, 2, 5])), shape=(2, 20))
    problem = Problem(M=free.M, f=free.f, H=free.H, w=free.w, law=free.law, C=C, k=np.array([0.1, 0.0]))
    solution = solve(problem, "lemke", tol=1e-9)
    assert solution.converged and solution.certificate.bilateral <= 1e-12


def test_more_sides_approach_the_round_cone_as_the_inverse_square() -> None:
    """Pulling the tangential forces of the round cone in by cos(pi / q) puts them into the pyramid, which is inside the cone.

    So the energy of the associated law lies above that of the cone by no more than the pull costs, O(1 / q^2).
    """
    problem = with_law(random_problem(6, 8, 3, bodies=12), SecondOrderCone(0.4))
    swept = solve(problem, "gauss_seidel", tol=1e-13)
    delassus = build_operator(problem, "explicit")
    round_r, sliding = swept.r.reshape(-1, 3), swept.u.reshape(-1, 3) * [0.0, 1.0, 1.0]
    tangential = round_r * [0.0, 1.0, 1.0]
    gaps = []
    for sides in (4, 8, 16, 32, 64, 128):
        r = solve(problem, "lemke", sides=sides).r.reshape(-1, 3)
        gaps.append(energy(delassus, r) - energy(delassus, round_r))
        pull = 1.0 - np.cos(np.pi / sides)
        cost = -pull * (sliding * tangential).sum()
        cost += 0.5 * pull**2 * (tangential * delassus.apply(tangential)).sum()
        assert -1e-12 <= gaps[-1] <= cost + 1e-12
    assert gaps[0] > 200.0 * gaps[-1]


def test_more_sides_approach_coulombs_velocities_as_the_inverse() -> None:
    """Sliding forces point to the nearest edge, at most pi / q away from where they should."""
    problem = random_problem(6, 8, 3, bodies=12)
    u = solve(problem, "gauss_seidel", tol=1e-12).u
    for sides in (4, 8, 16, 32, 64, 128):
        missed = solve(problem, "lemke", sides=sides)
        assert not missed.converged
        assert np.linalg.norm(missed.u - u) <= 0.5 * np.sin(np.pi / sides) * np.linalg.norm(u)


def test_a_contact_that_slides_along_its_free_velocity_is_exact_and_another_is_not() -> None:
    """An edge lies against the free velocity; W = I keeps the sliding on that line, an anisotropic W does not."""
    b = np.array([-1.0, 2.0, 1.0])
    exact = solve(Problem.reduced(np.eye(3), b, Coulomb(np.array([0.3]))), "lemke", tol=1e-12)
    assert exact.converged
    assert exact.r == pytest.approx([1.0, -0.6 / np.sqrt(5.0), -0.3 / np.sqrt(5.0)])
    W = np.diag([1.0, 1.0, 5.0])
    missed = solve(Problem.reduced(W, b, Coulomb(np.array([0.3]))), "lemke", tol=1e-6)
    assert not missed.converged and 1e-3 < missed.certificate.residual < 0.3


def test_the_pyramid_of_the_associated_law_minimises_the_energy_over_its_forces() -> None:
    """Seed B, Eq. 2.21."""
    problem = with_law(random_problem(2, 6, 3, bodies=8), SecondOrderCone(0.5))
    pyramid, delassus = pyramids(problem), build_operator(problem, "explicit")
    result = solve_lcp(pyramid.M, pyramid.q)
    best = energy(delassus, pyramid.forces(result.z))
    random = np.random.default_rng(3)
    for _ in range(200):
        z = result.z + random.choice([1e-3, 0.1, 1.0]) * random.standard_normal(len(result.z))
        x, beta = np.maximum(z[:6], 0.0), np.maximum(z[6:30], 0.0).reshape(6, 4)
        beta *= np.minimum(1.0, 0.5 * x / np.maximum(beta.sum(axis=1), 1e-300))[:, None]
        assert energy(delassus, pyramid.forces(np.concatenate([x, beta.ravel()]))) >= best - 1e-9


def test_what_has_no_solution_is_not_solved() -> None:
    """A contact that nothing can keep from closing: W = 0 and b_N < 0."""
    solution = solve(
        Problem.reduced(np.zeros((2, 2)), np.array([-1.0, 0.0]), Coulomb(np.array([0.5]))), "lemke"
    )
    assert not solution.converged and np.isfinite(solution.r).all()


def test_no_start_is_made_worse_and_a_solution_is_kept() -> None:
    problem = random_problem(0, 10, 2, bodies=12)
    solved = solve(problem, "lemke", tol=1e-9)
    again = solve(problem, "lemke", tol=1e-9, r0=solved.r)
    assert again.iterations == 0 and certify(problem, again.r, again.v).residual <= 1e-9
    assert solve(problem, "lemke", max_iterations=0).iterations == 0


def test_what_lemke_is_not_for_is_refused() -> None:
    with pytest.raises(InputError, match="blocks of size 6"):
        solve(random_problem(0, 5, 6, bodies=6), "lemke")
    for sides in (2, 5):
        with pytest.raises(InputError, match="even and at least 4"):
            solve(random_problem(0, 5, 3, bodies=6), "lemke", sides=sides)
    n = LARGEST_LCP // 4 + 1
    big = Problem.reduced(sp.eye_array(2 * n), -np.ones(2 * n), Coulomb(np.full(n, 0.1)))
    with pytest.raises(InputError, match=f"at most {LARGEST_LCP} rows"):
        solve(big, "lemke")
    for M, q in ((np.eye(2), np.ones(3)), (np.full((1, 1), np.nan), np.ones(1))):
        with pytest.raises(InputError, match="M, q"):
            solve_lcp(M, q)
