"""The made-to-measure problems keep what they promise: known solutions, existence or its refutation, and weight carried."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction import certify, solve
from barchan.friction.samples import FAMILIES, family, pile, sample

RATIOS = (0.1, 0.3, 1.0, 3.0, 10.0)


def bytes_of(problem):
    """Everything that defines the problem, as bytes."""
    matrices = [sp.csr_array(problem.M), sp.csr_array(problem.H)]
    if problem.C is not None:
        matrices.append(problem.C)
    arrays = [part for matrix in matrices for part in (matrix.data, matrix.indices, matrix.indptr)]
    return [array.tobytes() for array in (*arrays, problem.f, problem.w, problem.parameters)]


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("mu", [0.0, 0.4, (0.0, 1.5)])
def test_the_known_solution_is_one(s, ratio, mu):
    made = sample(20, s, ratio, mu, seed=3, constraints=2)
    assert certify(made.problem, made.forces, made.velocity).residual < 1e-11


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("constraints", [0, 2])
def test_interior_velocity_proves_existence(s, ratio, constraints):
    """Criterion H(0) of Theorem 2.1: C v = k and H v + w inside the dual cones."""
    made = sample(20, s, ratio, (0.0, 1.5), seed=4, constraints=constraints)
    problem, v = made.problem, made.interior
    u = (problem.H @ v + problem.w).reshape(-1, s)
    assert (u[:, 0] > problem.law.mu * np.linalg.norm(u[:, 1:], axis=1)).all()
    if constraints:
        assert problem.C.shape[0] == constraints
        assert np.allclose(problem.C @ v, problem.k, rtol=0.0, atol=1e-11 * np.abs(v).max())


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("constraints", [0, 2])
def test_farkas_multiplier_refutes_existence(s, ratio, constraints):
    """y >= 0 with H_N^T y = 0 gives y . u_N = y . w_N < 0 for every velocity; in reduced form W y e_N = 0, b . y e_N < 0."""
    made = sample(9, s, ratio, 0.5, seed=5, constraints=constraints, solvable=False)
    problem, y = made.problem, made.refutation
    assert made.velocity is None and made.forces is None and made.interior is None
    along = np.zeros(9 * s)
    along[::s] = y
    pull = problem.H.T @ along
    W = problem.H @ problem.factor.solve(problem.H.T.toarray())
    b = problem.H @ problem.factor.solve(problem.f) + problem.w
    assert (y >= 0.0).all() and y.any()
    assert np.abs(pull).max() < 1e-13
    assert np.abs(W @ along).max() < 1e-12 * np.abs(W).max()
    assert b @ along < -0.1 and problem.w @ along < -0.1


def test_no_method_solves_what_has_no_solution():
    problem = sample(9, 3, 1.0, 0.5, seed=5, solvable=False).problem
    assert not solve(problem, "gauss_seidel", tol=1e-8, max_iterations=500).converged


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("s", [2, 3, 6])
def test_ratio_is_as_asked(s, ratio):
    problem = sample(30, s, ratio).problem
    rounding = 0.5 / s / (1.0 / ratio)
    assert problem.n * s / problem.size == pytest.approx(ratio, rel=max(rounding, 1e-12))


def test_ratio_is_exact_when_it_can_be():
    for ratio in (0.1, 0.5, 1.0, 3.0, 10.0):
        problem = sample(30, 6, ratio).problem
        assert problem.n * 6 == pytest.approx(ratio * problem.size, rel=1e-14)


@pytest.mark.parametrize("condition", [1.0, 10.0, 1e4])
def test_mass_is_positive_definite_and_conditioned_as_asked(condition):
    M = sample(8, 3, 0.5, condition=condition, seed=2).problem.M.toarray()
    assert np.array_equal(M, M.T)
    for body in range(8):
        block = M[6 * body : 6 * body + 6, 6 * body : 6 * body + 6]
        assert np.linalg.cond(block) == pytest.approx(condition, rel=1e-8)
        M[6 * body : 6 * body + 6, 6 * body : 6 * body + 6] = 0.0
    assert not M.any()


def test_each_contact_couples_one_or_two_bodies():
    H = sample(40, 3, 1.0, seed=1).problem.H
    assert H.blocksize == (3, 3)
    assert set(np.diff(H.indptr)) == {1, 2}


def test_all_regimes_occur():
    made = sample(12, 3, 2.0, 0.5, seed=6)
    assert sorted(np.bincount(made.status)) == [4, 4, 4]


@pytest.mark.parametrize("name", FAMILIES)
def test_same_seed_same_bytes(name):
    first, second = family(name, seed=7), family(name, seed=7)
    assert [label for label, _ in first] == [label for label, _ in second]
    assert all(bytes_of(a) == bytes_of(b) for (_, a), (_, b) in zip(first, second, strict=True))
    other = family(name, seed=8)
    assert any(bytes_of(a) != bytes_of(b) for (_, a), (_, b) in zip(first, other, strict=True))


@pytest.mark.parametrize("name", FAMILIES)
def test_names_tell_members_apart(name):
    names = [label for label, _ in family(name)]
    assert len(set(names)) == len(names)


def test_table_is_large_enough_and_spans_the_sizes():
    problems = [problem for _, problem in family("table")]
    assert len(problems) >= 100
    assert all(10 <= problem.n <= 200 and problem.s == 3 for problem in problems)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_resting_pile_carries_its_weight(dimension, jitter):
    """Nothing moves, so floor and walls give back in a step what gravity brings."""
    made = pile(30, seed=2, dimension=dimension, closed=True, jitter=jitter)
    solution = solve(made.problem, "gauss_seidel", tol=1e-8, max_iterations=20_000)
    assert solution.converged
    lift = made.lift(solution.r)
    outside = made.bodies[:, 1] < 0
    assert lift[outside].sum() == pytest.approx(made.weight, rel=1e-6)
    assert 0.5 * made.weight < lift[made.floor].sum() <= made.weight * (1.0 + 1e-6)


def test_frictionless_floor_alone_carries_the_weight():
    made = pile(30, seed=2, mu=0.0, closed=True, jitter=0.0)
    solution = solve(made.problem, "gauss_seidel", tol=1e-8, max_iterations=20_000)
    assert solution.converged
    assert made.lift(solution.r)[made.floor].sum() == pytest.approx(made.weight, rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_impulse_and_momentum_balance(dimension):
    """What gravity brings is either taken by floor and walls or still there as momentum, whatever moves and turns."""
    made = pile(25, seed=3, dimension=dimension, speed=0.05, uneven=True)
    rng = np.random.default_rng(0)
    r = rng.standard_normal(made.problem.n * dimension)
    dof = made.problem.size // 25
    momentum = (made.problem.f + made.problem.H.T @ r).reshape(25, dof)[:, dimension - 1].sum()
    taken = made.lift(r)[made.bodies[:, 1] < 0].sum()
    start = made.problem.f.reshape(25, dof)[:, dimension - 1].sum()
    assert momentum - taken == pytest.approx(start, rel=1e-10)


@pytest.mark.parametrize("dimension", [2, 3])
def test_contacts_do_not_feel_a_rolling_pair_or_a_common_motion(dimension):
    """Rigid motions open no contact between bodies; a spin slides past the wall at radius times spin."""
    made = pile(40, seed=1, dimension=dimension, spread=0.02)
    spins = 1 if dimension == 2 else 3
    rng = np.random.default_rng(1)
    translation, spin = rng.standard_normal(dimension), rng.standard_normal(spins)
    if dimension == 2:
        swirl = spin[0] * np.column_stack([-made.positions[:, 1], made.positions[:, 0]])
    else:
        swirl = np.cross(spin, made.positions)
    v = np.column_stack([translation + swirl, np.tile(spin, (40, 1))])
    u = (made.problem.H @ v.ravel()).reshape(-1, dimension)
    between = made.bodies[:, 1] >= 0
    gap = made.gaps[between] * np.linalg.norm(spin)
    assert between.any() and (~between).any()
    # The two contact points are a gap apart, which a spin sees; the normal component never does.
    assert (np.linalg.norm(u[between], axis=1) <= np.abs(gap) + 1e-12).all()
    assert np.abs(u[between, 0]).max() < 1e-12


def test_gaps_may_close_within_the_step():
    made = pile(40, seed=1, jitter=0.02, time_step=0.01)
    w = made.problem.w.reshape(-1, 3)
    assert np.allclose(w[:, 0], np.maximum(made.gaps, 0.0) / 0.01, atol=1e-8)
    assert not w[:, 1:].any()
    assert (made.gaps <= 0.05 * 0.01).all()


def test_restitution_throws_closed_contacts_back():
    made = pile(1, jitter=0.0, speed=1.0, restitution=0.5, seed=4)
    before = made.problem.H @ made.problem.factor.solve(made.problem.f)  # with the pull of gravity
    w = made.problem.w.reshape(-1, 3)[made.floor, 0]
    fall = before.reshape(-1, 3)[made.floor, 0] + 9.81 * 0.005
    assert w == pytest.approx(0.5 * np.minimum(fall, 0.0))


def test_large_pile_has_some_five_contacts_a_body():
    made = pile(2000)
    assert 4.0 < made.problem.n / 2000 < 6.0
    frames = made.frames
    assert np.allclose(frames @ frames.transpose(0, 2, 1), np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"n": 0}, "n"),
        ({"n": 2, "solvable": False}, "n"),
        ({"n": 5, "s": 1}, "s"),
        ({"n": 5, "ratio": 0.0}, "ratio"),
        ({"n": 5, "ratio": 6.0}, "ratio"),
        ({"n": 5, "ratio": float("nan")}, "ratio"),
        ({"n": 5, "mu": -0.1}, "mu"),
        ({"n": 5, "mu": (1.0, 0.5)}, "mu"),
        ({"n": 5, "constraints": 8}, "constraints"),
        ({"n": 5, "constraints": -1}, "constraints"),
        ({"n": 5, "condition": 0.5}, "condition"),
    ],
)
def test_samples_refuse_what_cannot_be_made(options, named):
    with pytest.raises(InputError) as caught:
        sample(**options)
    assert caught.value.field == named


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"n_bodies": 0}, "n_bodies"),
        ({"n_bodies": 3, "dimension": 4}, "dimension"),
        ({"n_bodies": 3, "mu": float("nan")}, "mu"),
        ({"n_bodies": 3, "radius": 0.0}, "radius"),
        ({"n_bodies": 3, "jitter": -1.0}, "jitter"),
        ({"n_bodies": 3, "spread": 1.0}, "spread"),
        ({"n_bodies": 3, "time_step": float("inf")}, "time_step"),
    ],
)
def test_piles_refuse_what_cannot_be_made(options, named):
    with pytest.raises(InputError) as caught:
        pile(**options)
    assert caught.value.field == named


def test_unknown_family_lists_the_known_ones():
    with pytest.raises(InputError, match="small"):
        family("large")
