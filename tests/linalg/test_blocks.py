"""Block rows hold the matrix they were cut from, whatever the order, repetition or absence of its entries."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from barchan.linalg import block_rows, diagonal_blocks_of_square

# Sums of small whole numbers are exact in any order.
entries = st.integers(-8, 8).map(float)


@st.composite
def compressed_rows(draw, square: bool = False):
    """(matrix, s, q): raw compressed rows with unsorted and repeated columns, stored zeros and empty rows."""
    s, n = draw(st.integers(1, 4)), draw(st.integers(0, 5))
    q, columns = (s, n) if square else (draw(st.integers(1, 4)), draw(st.integers(1, 5)))
    wide = max(columns * q, 1)
    rows = draw(
        st.lists(
            st.lists(st.tuples(st.integers(0, wide - 1), entries), max_size=7),
            min_size=n * s,
            max_size=n * s,
        )
    )
    pointers = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(int)
    pairs = [pair for row in rows for pair in row]
    indices = np.array([column for column, _ in pairs], dtype=draw(st.sampled_from([np.int32, np.int64])))
    values = np.array([value for _, value in pairs], dtype=float)
    matrix = sp.csr_array((values, indices, pointers.astype(indices.dtype)), shape=(n * s, columns * q))
    return matrix, s, q


def stored_blocks(matrix: sp.csr_array, s: int, q: int) -> set[tuple[int, int]]:
    """Positions of the blocks in which something is stored."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return set(zip((rows // s).tolist(), (matrix.indices // q).tolist(), strict=True))


@given(compressed_rows())
def test_cutting_keeps_the_matrix_and_stores_each_block_once(case) -> None:
    matrix, s, q = case
    before = matrix.indices.copy(), matrix.data.copy()
    rows = block_rows(matrix, s, q)
    assert np.array_equal(rows.matrix().toarray(), matrix.toarray())
    assert (rows.n, rows.columns, rows.data.shape[1:]) == (matrix.shape[0] // s, matrix.shape[1] // q, (s, q))
    row_of = np.repeat(np.arange(rows.n), np.diff(rows.indptr))
    positions = list(zip(row_of.tolist(), rows.indices.tolist(), strict=True))
    assert positions == sorted(stored_blocks(matrix, s, q))
    assert np.array_equal(matrix.indices, before[0]) and np.array_equal(matrix.data, before[1])


@given(compressed_rows())
def test_kernels_get_the_types_they_are_compiled_for(case) -> None:
    rows = block_rows(*case)
    assert rows.indptr.dtype == rows.indices.dtype == np.int32
    assert rows.data.dtype == np.float64 and rows.data.flags.c_contiguous


@given(compressed_rows(square=True))
def test_diagonal_blocks_are_those_of_the_matrix(case) -> None:
    matrix, s, _ = case
    blocks = diagonal_blocks_of_square(block_rows(matrix, s, s))
    dense = matrix.toarray()
    assert blocks.shape == (len(dense) // s, s, s)
    for i, block in enumerate(blocks):
        assert np.array_equal(block, dense[i * s : (i + 1) * s, i * s : (i + 1) * s])


@pytest.mark.parametrize("form", [sp.csr_array, sp.csc_array, sp.coo_array, sp.csr_matrix, np.asarray])
def test_every_form_of_a_matrix_gives_the_same_blocks(form) -> None:
    rng = np.random.default_rng(0)
    dense = rng.standard_normal((12, 15)) * (rng.random((12, 15)) < 0.2)
    rows = block_rows(form(dense), 4, 3)
    assert np.array_equal(rows.matrix().toarray(), dense)


@pytest.mark.parametrize("blocksize", [(4, 3), (2, 3), (4, 5), (1, 1)])
def test_other_block_sizes_are_cut_again(blocksize: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    dense = rng.standard_normal((12, 15)) * (rng.random((12, 15)) < 0.3)
    rows = block_rows(sp.bsr_array(dense, blocksize=blocksize), 4, 3)
    assert rows.data.shape[1:] == (4, 3)
    assert np.array_equal(rows.matrix().toarray(), dense)


def test_unsorted_blocks_of_block_rows_are_sorted() -> None:
    data = np.arange(12.0).reshape(3, 2, 2)
    matrix = sp.bsr_array((data, np.array([2, 0, 1]), np.array([0, 2, 3])), shape=(4, 6))
    dense = matrix.toarray()
    rows = block_rows(matrix, 2, 2)
    assert rows.indices.tolist() == [0, 2, 1]
    assert np.array_equal(rows.matrix().toarray(), dense)
    assert np.array_equal(matrix.toarray(), dense)


def test_blocks_given_twice_are_added_up_and_the_given_matrix_stays_as_it_is() -> None:
    data = np.arange(16.0).reshape(4, 2, 2)
    matrix = sp.bsr_array((data.copy(), np.array([1, 0, 1, 0]), np.array([0, 3, 4])), shape=(4, 4))
    dense = matrix.toarray()
    rows = block_rows(matrix, 2, 2)
    assert rows.indices.tolist() == [0, 1, 0]
    assert np.array_equal(rows.matrix().toarray(), dense)
    assert np.array_equal(diagonal_blocks_of_square(rows)[0], dense[:2, :2])
    assert matrix.indices.tolist() == [1, 0, 1, 0] and np.array_equal(matrix.data, data)


def test_whole_numbers_become_floats() -> None:
    rows = block_rows(sp.csr_array(np.arange(16).reshape(4, 4)), 2, 2)
    assert rows.data.dtype == np.float64
    assert np.array_equal(rows.matrix().toarray(), np.arange(16.0).reshape(4, 4))
