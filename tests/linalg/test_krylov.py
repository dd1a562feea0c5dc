"""The iterative solver reaches its tolerance on elastic bricks with contrasts of twelve orders, as interior points make."""

from __future__ import annotations

from itertools import product

import numba
import numpy as np
import pytest
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg import GramPattern, KrylovSolver, PatternSolver, pardiso, solver_for
from barchan.linalg.coarse import rigid_motions
from barchan.linalg.krylov import _bisected, conjugate_gradients, gmres

SIZE = 8
STRAINS = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]


def brick() -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness and strain rates of a clamped cube of trilinear bricks; places and components of unknowns, places of points."""
    corners = np.array(list(product((0, 1), repeat=3)))
    gauss = 0.5 + np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(12.0)
    local = np.zeros((8, 6, 8, 3))
    for q, x in enumerate(gauss):
        value = np.where(corners == 1, x, 1.0 - x)
        slope = np.where(corners == 1, 1.0, -1.0)
        gradient = np.stack(
            [slope[:, i] * value[:, (i + 1) % 3] * value[:, (i + 2) % 3] for i in range(3)], axis=-1
        )
        for row, (i, j) in enumerate(STRAINS):
            local[q, row, :, i] += 0.5 * gradient[:, j]
            local[q, row, :, j] += 0.5 * gradient[:, i]
    cells = np.array(list(product(range(SIZE), repeat=3)))
    node = (cells[:, None, :] + corners) @ np.array([(SIZE + 1) ** 2, SIZE + 1, 1])
    columns = (3 * node[:, :, None] + np.arange(3)).reshape(-1, 24)
    data = np.broadcast_to(local.reshape(8, 6, 24), (len(cells), 8, 6, 24))
    indices = np.broadcast_to(columns[:, None, None, :], data.shape)
    shape = (data.size // 24, 3 * (SIZE + 1) ** 3)
    full = sp.csr_array((data.ravel(), indices.ravel(), np.arange(0, data.size + 1, 24)), shape=shape)
    nodes = np.array(list(product(range(SIZE + 1), repeat=3)))
    free = np.flatnonzero(((nodes > 0) & (nodes < SIZE)).all(axis=1))
    H = sp.csr_array(full[:, (3 * free[:, None] + np.arange(3)).ravel()])
    places = np.repeat(nodes[free].astype(float), 3, axis=0)
    points = (cells[:, None, :] + gauss).reshape(-1, 3)
    return sp.csr_array(H.T @ H), H, places, np.tile(np.arange(3), len(free)), points


M, H, PLACES, COMPONENTS, POINTS = brick()


def blocks(kind: str) -> np.ndarray:
    """Symmetric positive definite blocks (n, 6, 6) between 1e-6 and 1e6."""
    rng = np.random.default_rng(0)
    n = len(POINTS)
    full = rng.standard_normal((n, 6, 6))
    full = full @ full.transpose(0, 2, 1) / 6.0 + np.eye(6)
    if kind == "at random":
        return full * 10.0 ** rng.uniform(-6.0, 6.0, n)[:, None, None]
    if kind == "stiff plugs":
        x = 3.0 * POINTS / SIZE
        plug = np.sin(2.1 * x[:, 0]) * np.cos(1.7 * x[:, 1] + x[:, 2]) > 0.1
        return full * np.where(plug, 1e6, 1e-6)[:, None, None]
    # One stiff direction per cell, as where a block slides along its cone.
    direction = np.repeat(rng.standard_normal((n // 8, 6)), 8, axis=0)
    return 1e6 * direction[:, :, None] * direction[:, None, :] + 1e-6 * np.eye(6)


@pytest.mark.parametrize("kind", ["at random", "stiff plugs", "one direction"])
def test_positive_matrices_of_strong_contrast(kind: str) -> None:
    pattern = GramPattern(M, H, 6, upper=True)
    solver = KrylovSolver(pattern.matrix(), "positive", PLACES, COMPONENTS, part=200)
    data = pattern.data(blocks(kind))
    assert solver.factorise(data)
    right = np.random.default_rng(1).standard_normal((pattern.m, 2))
    x = solver.solve(right)
    whole = pattern.matrix(blocks(kind))
    whole = whole + sp.triu(whole, 1).T
    residual = np.linalg.norm(whole @ x - right, axis=0) / np.linalg.norm(right, axis=0)
    assert (residual <= 1.01e-8).all() and np.allclose(residual, solver.residuals)
    assert len(solver.iterations) == 2 and 1 < max(solver.iterations) <= 150


@pytest.mark.parametrize("kind", ["at random", "stiff plugs"])
def test_nonsymmetric_matrices_of_strong_contrast(kind: str) -> None:
    D = blocks(kind)
    # A non-associated flow rule shears the blocks: D (I - mu e_N t^T)^-1.
    D = D @ np.linalg.inv(np.eye(6) - 0.3 * np.outer(np.eye(6)[0], np.eye(6)[3]))
    pattern = GramPattern(M, H, 6)
    solver = KrylovSolver(pattern.matrix(), "structural", PLACES, COMPONENTS, part=200, tolerance=1e-7)
    assert solver.factorise(pattern.data(D))
    right = np.ones(pattern.m)
    x = solver.solve(right)
    assert x.shape == right.shape
    assert np.linalg.norm(pattern.matrix(D) @ x - right) <= 1.01e-7 * np.linalg.norm(right)
    assert max(solver.iterations) <= 200


def test_the_answers_are_those_of_the_direct_solver_and_patterns_serve_again() -> None:
    pattern = GramPattern(M, H, 6, upper=True)
    direct = PatternSolver(pattern.matrix(), "positive")
    whole = KrylovSolver(pattern.matrix(), "positive", PLACES, COMPONENTS, tolerance=1e-12, part=300)
    for scale in (1.0, 50.0):
        data = pattern.data(np.broadcast_to(scale * np.eye(6), (len(POINTS), 6, 6)))
        assert direct.factorise(data) and whole.factorise(data)
        right = np.cos(np.arange(pattern.m))
        assert np.allclose(whole.solve(right), direct.solve(right), rtol=1e-8, atol=1e-10)


def test_the_same_bytes_on_one_thread_and_on_two() -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    pattern = GramPattern(M, H, 6, upper=True)
    found, before = [], numba.get_num_threads()
    for threads in (1, 2):
        numba.set_num_threads(threads)
        try:
            solver = KrylovSolver(pattern.matrix(), "positive", PLACES, COMPONENTS, part=200)
            solver.factorise(pattern.data(blocks("at random")))
            found.append(solver.solve(np.ones(pattern.m)))
        finally:
            numba.set_num_threads(before)
    assert np.array_equal(found[0], found[1])


@pytest.mark.skipif(not pardiso.available(), reason="pypardiso is not installed")
def test_the_direct_solver_is_taken_while_its_factors_fit() -> None:
    pattern = GramPattern(M, H, 6, upper=True)
    given = (pattern.matrix(), "positive", PLACES, COMPONENTS)
    needed = solver_for(*given)
    assert isinstance(needed, PatternSolver)
    foreseen = needed.megabytes
    assert needed.factorise(pattern.data(blocks("at random")))
    assert foreseen is not None and needed.megabytes == pytest.approx(foreseen, rel=0.2)
    assert isinstance(solver_for(*given, memory=0.5 * foreseen), KrylovSolver)


def test_matrices_that_cannot_be_factorised_are_told() -> None:
    pattern = GramPattern(M, H, 6, upper=True)
    solver = KrylovSolver(pattern.matrix(), "positive", PLACES, COMPONENTS, part=300)
    data = pattern.data(blocks("at random"))
    assert not solver.factorise(-data)
    assert not solver.factorise(np.full_like(data, np.nan))
    with pytest.raises(InputError, match="data"):
        solver.factorise(data[:-1])


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"symmetric": "indefinite"}, "symmetric"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"points": PLACES[:-1]}, "points"),
        ({"components": COMPONENTS[:-1]}, "components"),
    ],
)
def test_bad_input_is_refused(change, field) -> None:
    given = {"symmetric": "positive", "points": PLACES, "components": COMPONENTS} | change
    with pytest.raises(InputError) as error:
        KrylovSolver(M, **given)
    assert error.value.field == field


@pytest.mark.parametrize("method", [conjugate_gradients, gmres])
def test_both_methods_end_after_as_many_steps_as_there_are_eigenvalues(method) -> None:
    diagonal = np.repeat([1.0, 3.0, 10.0, 200.0], 20)
    b = np.random.default_rng(4).standard_normal(80)
    x, iterations = method(lambda v: diagonal * v, b, lambda v: v, 1e-12, 50)
    assert np.allclose(x, b / diagonal) and 4 <= iterations <= 5


@pytest.mark.parametrize("method", [conjugate_gradients, gmres])
def test_a_right_side_of_zero_needs_no_step(method) -> None:
    x, iterations = method(lambda v: v, np.zeros(5), lambda v: v, 1e-8, 10)
    assert iterations == 0 and not x.any()


@pytest.mark.parametrize("d", [2, 3])
def test_rigid_motions_do_not_strain(d: int) -> None:
    rng = np.random.default_rng(5)
    nodes = rng.standard_normal((7, d))
    modes = rigid_motions(np.repeat(nodes, d, axis=0), np.tile(np.arange(d), 7)).reshape(7, d, -1)
    assert np.linalg.matrix_rank(modes.reshape(7 * d, -1)) == d * (d + 1) // 2
    for a, b in ((0, 1), (2, 5), (3, 6)):
        stretch = np.einsum("ik,i->k", modes[a] - modes[b], nodes[a] - nodes[b])
        assert np.allclose(stretch, 0.0)


def test_parts_cover_everything_once_and_keep_the_unknowns_of_a_point_together() -> None:
    parts = _bisected(PLACES, 100)
    assert np.array_equal(np.sort(np.concatenate(parts)), np.arange(len(PLACES)))
    assert max(len(part) for part in parts) <= 100
    for part in parts:
        assert len(part) == 3 * len(np.unique(part // 3))
