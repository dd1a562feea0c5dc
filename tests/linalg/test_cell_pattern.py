"""Assembly by known places equals summing triplets; fixed unknowns leave rows and columns of the identity."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.linalg.cell_pattern import CellPattern


def scattered(cells: int, n: int, size: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of unknowns (cells, n) and element matrices."""
    random = np.random.default_rng(seed)
    unknowns = np.stack([random.permutation(size)[:n] for _ in range(cells)])
    return unknowns.astype(np.int32), random.standard_normal((cells, n, n))


def summed(unknowns: np.ndarray, elements: np.ndarray, size: int) -> np.ndarray:
    """(size, size) dense sum."""
    n = unknowns.shape[1]
    rows = np.repeat(unknowns, n, axis=1).ravel()
    columns = np.tile(unknowns, (1, n)).ravel()
    return sp.coo_array((elements.ravel(), (rows, columns)), shape=(size, size)).toarray()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 12), st.integers(1, 5), st.integers(5, 15), st.integers(0, 1000))
def test_assembly_is_the_sum_of_element_matrices(cells, n, size, seed):
    unknowns, elements = scattered(cells, n, size, seed) if cells else (np.zeros((0, n)), np.zeros((0, n, n)))
    pattern = CellPattern(unknowns, size)
    data = pattern.assemble(elements)
    assert np.allclose(
        pattern.matrix(data).toarray(), summed(unknowns.astype(int), elements, size), atol=1e-13
    )


def test_pattern_is_that_of_the_cells_with_the_whole_diagonal():
    """Columns are sorted; unknowns of no cell keep their diagonal entry."""
    pattern = CellPattern(np.array([[4, 0], [2, 0]]), 6)
    rows = [pattern.indices[a:b].tolist() for a, b in zip(pattern.indptr, pattern.indptr[1:], strict=False)]
    assert rows == [[0, 2, 4], [1], [0, 2], [3], [0, 4], [5]]


def test_positions_lead_to_the_entries_of_their_pair_of_unknowns():
    unknowns, _ = scattered(9, 4, 12)
    pattern = CellPattern(unknowns, 12)
    owner = np.repeat(np.arange(12), np.diff(pattern.indptr))
    assert np.array_equal(
        owner[pattern.positions], np.broadcast_to(unknowns[:, :, None], pattern.positions.shape)
    )
    assert np.array_equal(
        pattern.indices[pattern.positions], np.broadcast_to(unknowns[:, None, :], pattern.positions.shape)
    )


def test_fixed_unknowns_have_rows_and_columns_of_the_identity():
    unknowns, elements = scattered(9, 4, 12)
    pattern = CellPattern(unknowns, 13)
    fixed = np.zeros(13, dtype=bool)
    fixed[[0, 3, 12]] = True
    found = pattern.matrix(pattern.assemble(elements, fixed)).toarray()
    wanted = summed(unknowns, elements, 13)
    wanted[fixed] = wanted[:, fixed] = 0.0
    wanted[fixed, fixed] = 1.0
    assert np.allclose(found, wanted, atol=1e-14)


def test_assembly_gives_the_same_bytes_on_one_thread_and_two(bytes_by_threads):
    unknowns, elements = scattered(500, 9, 300)
    fixed = np.random.default_rng(2).random(300) < 0.1

    def compute():
        pattern = CellPattern(unknowns, 300)
        return pattern.positions, pattern.assemble(elements), pattern.assemble(elements, fixed)

    one, two = bytes_by_threads(compute)
    assert one == two


@pytest.mark.parametrize("wrong", [5, -1])
def test_numbers_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(InputError, match=f"cell_unknowns = {wrong}"):
        CellPattern(np.array([[0, wrong]]), 5)
