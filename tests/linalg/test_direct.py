"""Direct solvers: every kind of matrix against dense algebra, refusals, one analysis for many matrices, both libraries."""

from __future__ import annotations

import gc
import weakref

import numba
import numpy as np
import pytest
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg import PatternSolver, factorise, one_blas_thread, pardiso
from barchan.linalg import factor as factor_module
from barchan.linalg import pattern_solver as pattern_module
from barchan.linalg.factor import sparse_solver

KINDS = ("positive", "indefinite", "structural")
needs_pardiso = pytest.mark.skipif(not pardiso.available(), reason="pypardiso is not installed")


@pytest.fixture(params=["pardiso", "superlu"])
def library(request, monkeypatch):
    """Each of the two libraries in turn."""
    if request.param == "superlu":
        monkeypatch.setattr(pattern_module, "available", lambda: False)
        monkeypatch.setattr(factor_module, "available", lambda: False)
    elif not pardiso.available():
        pytest.skip("pypardiso is not installed")
    return request.param


def grid_matrix(kind: str, size: int = 20, seed: int = 0) -> sp.csr_array:
    """A matrix on a square grid with random entries, definite or not, symmetric or not."""
    rng = np.random.default_rng(seed)
    line = sp.diags_array([np.ones(size - 1), np.ones(size - 1)], offsets=[-1, 1])
    links = sp.csr_array(sp.kron(line, sp.eye_array(size)) + sp.kron(sp.eye_array(size), line))
    links.data = -rng.random(links.nnz)
    if kind != "structural":
        links = sp.csr_array(sp.triu(links) + sp.triu(links).T)
    diagonal = np.abs(links).sum(axis=1) + 0.1 + rng.random(size**2)
    if kind == "indefinite":
        diagonal[rng.random(size**2) < 0.5] *= -1.0
    matrix = sp.csr_array(links + sp.diags_array(diagonal))
    matrix.sort_indices()
    return matrix


def given_as(matrix: sp.csr_array, half: bool) -> sp.csr_array:
    matrix = sp.csr_array(sp.triu(matrix)) if half else matrix
    matrix.sort_indices()
    return matrix


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_solutions_are_those_of_dense_algebra(library, kind, half) -> None:
    if half and kind == "structural":
        pytest.skip("a structurally symmetric matrix is given whole")
    matrix = grid_matrix(kind)
    solver = PatternSolver(given_as(matrix, half), kind)
    rng = np.random.default_rng(1)
    for seed in (0, 5, 6):
        other = grid_matrix(kind, seed=seed)
        assert solver.factorise(given_as(other, half).data)
        right = rng.standard_normal((matrix.shape[0], 3))
        wanted = np.linalg.solve(other.toarray(), right)
        assert np.allclose(solver.solve(right), wanted, rtol=1e-9, atol=1e-9)
        assert np.allclose(solver.solve(right[:, 1]), wanted[:, 1], rtol=1e-9, atol=1e-9)


def test_an_indefinite_matrix_is_not_positive(library) -> None:
    good, bad = grid_matrix("positive"), grid_matrix("positive")
    bad.setdiag(np.where(np.arange(bad.shape[0]) == 37, -1.0, bad.diagonal()))
    solver = PatternSolver(good, "positive")
    assert not solver.factorise(bad.data)
    assert solver.factorise(good.data)
    assert np.allclose(good @ solver.solve(np.ones(good.shape[0])), 1.0)


@pytest.mark.parametrize("kind", ["indefinite", "structural"])
def test_singular_matrices_are_told(library, kind) -> None:
    matrix = grid_matrix(kind)
    solver = PatternSolver(matrix, kind)
    row = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    singular = np.where((row == 55) | (matrix.indices == 55), 0.0, matrix.data)
    assert not solver.factorise(singular)
    assert solver.factorise(matrix.data)


@needs_pardiso
def test_a_pivot_that_was_replaced_does_no_harm_where_refinement_mends_it() -> None:
    # Eliminating the first unknown would divide by zero; the matrix itself is orthogonal.
    matrix = sp.csr_array((np.array([0.0, 1.0, 1.0, 0.0]), ([0, 0, 1, 1], [0, 1, 0, 1])), shape=(2, 2))
    solver = PatternSolver(matrix, "indefinite")
    assert solver.factorise(matrix.data)
    assert np.allclose(solver.solve(np.array([2.0, 3.0])), [3.0, 2.0])


@pytest.mark.parametrize("kind", KINDS)
def test_entries_that_are_not_finite_are_told(library, kind) -> None:
    matrix = grid_matrix(kind)
    data = matrix.data.copy()
    data[0] = np.nan
    assert not PatternSolver(matrix, kind).factorise(data)


def test_patterns_that_cannot_be_factorised_are_refused() -> None:
    matrix = grid_matrix("positive", 3)
    with pytest.raises(InputError, match="symmetric"):
        PatternSolver(matrix, "definite")
    with pytest.raises(InputError, match="pattern"):
        PatternSolver(sp.csr_array(matrix[:2]), "positive")
    hollow = sp.csr_array(matrix - sp.diags_array(matrix.diagonal()))
    hollow.eliminate_zeros()
    with pytest.raises(InputError, match="diagonal"):
        PatternSolver(hollow, "structural")
    with pytest.raises(InputError, match="data"):
        PatternSolver(matrix, "positive").factorise(np.ones(3))


@needs_pardiso
def test_memory_is_given_back_with_the_solver(monkeypatch) -> None:
    released = []
    monkeypatch.setattr(pardiso, "_release", lambda *given: released.append(given))
    matrix = grid_matrix("positive")
    solver = PatternSolver(matrix, "positive")
    alive = weakref.ref(solver)
    solver.factorise(matrix.data)
    del solver
    gc.collect()
    assert alive() is None and len(released) == 1


@needs_pardiso
def test_pardiso_keeps_its_threads_where_blas_is_held_to_one(monkeypatch) -> None:
    mkl, seen = pardiso.library(), []

    class Spy:
        MKL_Set_Num_Threads_Local = mkl.MKL_Set_Num_Threads_Local

        @staticmethod
        def pardiso(*given):
            seen.append(mkl.MKL_Get_Max_Threads())
            return mkl.pardiso(*given)

    matrix = grid_matrix("positive")
    solver = PatternSolver(matrix, "positive")
    before = mkl.MKL_Get_Max_Threads()
    monkeypatch.setattr(pardiso, "library", lambda: Spy)
    with one_blas_thread():
        solver.factorise(matrix.data)
    assert seen == [numba.get_num_threads()]
    assert mkl.MKL_Get_Max_Threads() == before


@needs_pardiso
def test_a_second_factorisation_gives_the_same_bytes() -> None:
    matrix = grid_matrix("structural", 60)
    solver = PatternSolver(matrix, "structural")
    right, found = np.ones((matrix.shape[0], 2)), []
    for _ in range(3):
        solver.factorise(matrix.data)
        found.append(solver.solve(right))
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_large_positive_matrices_are_solved_and_indefinite_ones_refused(library, monkeypatch) -> None:
    monkeypatch.setattr(factor_module, "LARGEST_SUPERLU", 100)
    matrix = grid_matrix("positive")
    factor = factorise(matrix)
    right = np.random.default_rng(0).standard_normal((matrix.shape[0], 4))
    assert factor.kind == "sparse"
    assert np.allclose(matrix @ factor.solve(right), right)
    assert np.allclose(matrix @ factor.solve(right[:, 0]), right[:, 0])
    skew = sp.diags_array([0.4], shape=matrix.shape, offsets=[1])
    with pytest.raises(InputError, match="M"):
        factorise(sp.csr_array(matrix + skew))
    # Positive diagonal, one negative eigenvalue.
    line = sp.diags_array([1.0, 1.0, 1.0], shape=(400, 400), offsets=[-1, 0, 1], format="csr")
    with pytest.raises(InputError, match="positive definite"):
        factorise(line)


def test_the_root_of_a_factor_is_one_of_the_inverse(library, monkeypatch) -> None:
    monkeypatch.setattr(factor_module, "LARGEST_SUPERLU", 50)
    matrix = grid_matrix("positive", 12)
    root = factorise(matrix).root(np.eye(matrix.shape[0]))
    assert np.allclose(root @ root.T, np.linalg.inv(matrix.toarray()), atol=1e-12)


def test_a_matrix_with_an_empty_row_is_singular(library) -> None:
    matrix = sp.csr_array(sp.diags_array([1.0, 0.0, 2.0]))
    matrix.eliminate_zeros()
    with pytest.raises(InputError, match="singular"):
        sparse_solver(matrix, "A", positive=False)


def test_saddle_points_are_solved(library) -> None:
    rng = np.random.default_rng(2)
    matrix, C = grid_matrix("positive", 10), sp.random_array((7, 100), density=0.2, rng=rng)
    saddle = sp.csr_array(sp.block_array([[matrix, -C.T], [C, None]]))
    x = rng.standard_normal(107)
    assert np.allclose(sparse_solver(saddle, "C", positive=False)(saddle @ x), x)
