"""The pattern of M + H^T D H holds that matrix for any block diagonal D, on any number of threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.linalg import GramPattern


@st.composite
def cases(draw):
    """(M, H, s, D): sparse symmetric M, blocks of H with empty rows, empty blocks and repeated sets of columns."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    s, m, groups = draw(st.integers(1, 6)), draw(st.integers(1, 12)), draw(st.integers(0, 6))
    blocks = []
    for _ in range(groups):
        mask = rng.random((s, m)) < draw(st.sampled_from([0.0, 0.2, 0.6]))
        blocks += [mask * rng.standard_normal((s, m)) for _ in range(draw(st.integers(1, 4)))]
    H = sp.csr_array(np.concatenate([*blocks, np.zeros((0, m))]))
    A = sp.random_array((m, m), density=0.2, rng=rng)
    return sp.csr_array(A + A.T), H, s, rng.standard_normal((len(blocks), s, s))


def dense(M, H, D) -> np.ndarray:
    H = H.toarray().reshape(*D.shape[:2], M.shape[0])
    return M.toarray() + np.einsum("iak,iab,ibl->kl", H, D, H)


@given(cases())
def test_entries_are_those_of_the_sum(case) -> None:
    M, H, s, D = case
    assert np.allclose(GramPattern(M, H, s).matrix(D).toarray(), dense(M, H, D), atol=1e-12)


@given(cases())
def test_upper_triangle_for_symmetric_blocks(case) -> None:
    M, H, s, D = case
    D = D + D.transpose(0, 2, 1)
    matrix = GramPattern(M, H, s, upper=True).matrix(D)
    assert np.allclose(matrix.toarray(), np.triu(dense(M, H, D)), atol=1e-12)
    assert (matrix.indices >= np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))).all()


@given(cases())
def test_the_pattern_is_sorted_with_a_whole_diagonal_and_nothing_more_than_needed(case) -> None:
    M, H, s, _ = case
    pattern = GramPattern(M, H, s)
    matrix = pattern.matrix()
    assert np.allclose(matrix.toarray(), M.toarray())
    blocks = abs(H).toarray().reshape(-1, s, M.shape[0]).sum(axis=1) > 0.0
    wanted = (
        (M.toarray() != 0.0)
        | (blocks.T.astype(int) @ blocks.astype(int) > 0)
        | np.eye(M.shape[0], dtype=bool)
    )
    rows = np.repeat(np.arange(pattern.m), np.diff(pattern.indptr))
    assert list(zip(rows, pattern.indices, strict=True)) == list(zip(*np.nonzero(wanted), strict=True))


def test_consecutive_blocks_with_the_same_columns_form_one_group() -> None:
    rng = np.random.default_rng(0)
    H = np.zeros((5, 2, 6))
    H[:3, :, :4], H[3:, :, 2:] = rng.standard_normal((3, 2, 4)), rng.standard_normal((2, 2, 4))
    pattern = GramPattern(sp.eye_array(6), sp.csr_array(H.reshape(10, 6)), 2)
    assert (pattern.n, pattern.groups) == (5, 2)


def test_block_compressed_rows_serve_as_well() -> None:
    rng = np.random.default_rng(3)
    H = sp.csr_array(rng.standard_normal((12, 8)) * (rng.random((12, 8)) < 0.3))
    D, M = rng.standard_normal((4, 3, 3)), sp.eye_array(8)
    other = GramPattern(M, sp.bsr_array(H, blocksize=(3, 2)), 3).matrix(D)
    assert np.allclose(other.toarray(), GramPattern(M, H, 3).matrix(D).toarray(), atol=1e-13)


def test_the_same_bytes_on_one_thread_and_on_two() -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    rng = np.random.default_rng(1)
    H = sp.random_array((600, 150), density=0.05, rng=rng, format="csr")
    M, D = sp.eye_array(150), rng.standard_normal((200, 3, 3))
    found = []
    before = numba.get_num_threads()
    for threads in (1, 2):
        numba.set_num_threads(threads)
        try:
            found.append(GramPattern(M, H, 3).matrix(D))
        finally:
            numba.set_num_threads(before)
    assert np.array_equal(found[0].indices, found[1].indices) and np.array_equal(found[0].data, found[1].data)


def test_out_is_written_to_and_indices_are_shared() -> None:
    pattern = GramPattern(sp.eye_array(2), sp.csr_array(np.ones((2, 2))), 2)
    out = np.empty(pattern.nnz)
    assert pattern.data(np.ones((1, 2, 2)), out) is out
    assert out.tolist() == [5.0, 4.0, 4.0, 5.0]
    assert np.shares_memory(pattern.matrix(np.ones((1, 2, 2))).indices, pattern.indices)


@pytest.mark.parametrize(
    ("M", "H", "s", "field"),
    [
        (np.eye(3)[:2], np.ones((2, 3)), 2, "M"),
        (np.eye(3), np.ones((2, 2)), 2, "H"),
        (np.eye(3), np.ones((5, 3)), 2, "s"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(M, H, s, field) -> None:
    with pytest.raises(InputError) as error:
        GramPattern(sp.csr_array(M), sp.csr_array(H), s)
    assert error.value.field == field


def test_blocks_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="D"):
        GramPattern(sp.eye_array(2), sp.csr_array(np.ones((2, 2))), 2).data(np.ones((2, 2, 2)))
