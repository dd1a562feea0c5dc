"""Matrices of dense blocks along the diagonal: factors, inverse and H M^-1 H^T agree with dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction import Problem, solve
from barchan.friction.lumped import LumpedDelassus
from barchan.friction.operators import StoredDelassus, build_operator
from barchan.linalg import factorise
from barchan.linalg._dense_block_kernels import largest_asymmetry
from barchan.linalg.dense_blocks import DenseBlocks


def blocks_and_rows(seed: int, s: int = 3) -> tuple[np.ndarray, sp.csr_array, list[int]]:
    """A matrix of dense blocks whose unknowns are shuffled, some rows of H on one to three of them, and their orders."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 12, rng.integers(2, 7)).tolist()
    parts = [rng.normal(size=(m, m)) for m in sizes]
    shuffled = rng.permutation(sum(sizes))
    M = sp.block_diag([a @ a.T + 0.3 * np.eye(len(a)) for a in parts]).toarray()[np.ix_(shuffled, shuffled)]
    n = int(rng.integers(1, 9))
    H = np.zeros((n * s, len(M)))
    for i in range(n):
        touched = rng.choice(len(M), min(len(M), int(rng.integers(1, 6))), replace=False)
        H[i * s : (i + 1) * s, touched] = rng.normal(size=(s, len(touched)))
    return M, sp.csr_array(H), sizes


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_solves_inverse_and_products_are_those_of_the_matrix(seed: int) -> None:
    M, H, sizes = blocks_and_rows(seed)
    factor = factorise(sp.csr_array(M))
    assert max(sizes) == 1 or factor.kind == "blocks"
    if factor.blocks is None:
        return
    right = np.random.default_rng(seed).normal(size=(len(M), 2))
    np.testing.assert_allclose(M @ factor.solve(right), right, atol=1e-9)
    np.testing.assert_allclose(M @ factor.solve(right[:, 0]), right[:, 0], atol=1e-9)
    np.testing.assert_allclose(factor.inverse.toarray(), np.linalg.inv(M), atol=1e-9)  # type: ignore[union-attr]
    whitened = factor.blocks.whitened(H, 3)
    wanted = H @ np.linalg.solve(M, H.T.toarray())
    rows = whitened.gram()
    found = rows.matrix().toarray()
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert np.array_equal(found, found.T)
    diagonal = np.array([wanted[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(wanted) // 3)])
    np.testing.assert_allclose(whitened.diagonal(), diagonal, atol=1e-9)


def test_blocks_given_as_such_are_those_of_the_sparse_matrix() -> None:
    rng = np.random.default_rng(0)
    parts = [a @ a.T + np.eye(len(a)) for a in (rng.normal(size=(m, m)) for m in (3, 1, 5))]
    factor = DenseBlocks.of_blocks(np.concatenate([part.ravel() for part in parts]), np.array([3, 1, 5]))
    right = rng.normal(size=9)
    np.testing.assert_allclose(sp.block_diag(parts) @ factor.solve(right), right, atol=1e-12)
    parts[2][0, 0] = -1.0
    with pytest.raises(InputError, match="positive definite"):
        DenseBlocks.of_blocks(np.concatenate([part.ravel() for part in parts]), np.array([3, 1, 5]))


def test_large_components_are_dense_blocks_when_they_are_full_or_many() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(100, 100))
    full = sp.csr_array(a @ a.T + 100.0 * np.eye(100))
    chain = sp.csr_array(sp.diags_array([-1.0, 2.1, -1.0], offsets=[-1, 0, 1], shape=(100, 100)))
    assert factorise(full).kind == "blocks" and factorise(chain).kind == "sparse"
    assert factorise(sp.csr_array(sp.block_diag(4 * [chain]))).kind == "blocks"
    assert factorise(sp.csr_array(sp.block_diag(3 * [chain]))).kind == "sparse"


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_asymmetry_is_the_largest_difference_with_the_transpose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dense = np.where(rng.random((7, 7)) < 0.4, rng.normal(size=(7, 7)), 0.0)
    dense = np.where(rng.random((7, 7)) < 0.5, dense, dense + dense.T)
    matrix = sp.csr_array(dense)
    found = largest_asymmetry(matrix.indptr, matrix.indices, matrix.data)
    assert found == pytest.approx(np.max(np.abs(dense - dense.T)), abs=1e-15)


def test_sweeps_on_stored_and_factored_operators_give_the_same_forces() -> None:
    rng = np.random.default_rng(5)
    count, m, n = 12, 7, 30
    parts = [a @ a.T + np.eye(m) for a in rng.normal(size=(count, m, m))]
    H = np.zeros((3 * n, count * m))
    for i in range(n):
        for c in rng.choice(count, 2, replace=False):
            H[3 * i : 3 * i + 3, c * m : (c + 1) * m] = rng.normal(size=(3, m))
    problem = Problem(
        M=sp.block_diag(parts),
        f=rng.normal(size=count * m),
        H=H,
        w=np.zeros(3 * n),
        law=Coulomb(np.full(n, 0.4)),
    )
    assert isinstance(build_operator(problem, "explicit"), StoredDelassus)
    assert isinstance(build_operator(problem, "matrix-free"), LumpedDelassus)
    found = [solve(problem, "gauss_seidel", tol=1e-10, operator=kind) for kind in ("explicit", "matrix-free")]
    assert all(solution.converged for solution in found)
    np.testing.assert_allclose(found[0].v, found[1].v, atol=1e-7)
