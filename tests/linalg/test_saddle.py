"""The saddle point of bilateral constraints: the same velocities through S = C M^-1 C^T and through M and C together."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import settings as property_settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.linalg import saddle_solver


def random_case(
    seed: int, m: int, rows: int, repeated: int
) -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    mass = 10.0 ** rng.uniform(-2.0, 2.0, m)
    C = rng.standard_normal((rows, m)) * (rng.random((rows, m)) < 0.5)
    C[:, :rows] += np.eye(rows)
    C = np.vstack([C, rng.standard_normal((repeated, rows)) @ C])[rng.permutation(rows + repeated)]
    return sp.csr_array(sp.diags_array(mass)), sp.csr_array(C), mass, rng.standard_normal(m)


@property_settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(4, 30), st.integers(1, 4), st.integers(0, 3))
def test_both_ways_give_the_same_velocities(seed: int, m: int, rows: int, repeated: int) -> None:
    M, C, mass, wanted = random_case(seed, m, rows, repeated)
    k = C @ wanted
    load = np.random.default_rng(seed).standard_normal((m, 2))
    right = np.stack([k, np.zeros_like(k)], axis=1)
    eliminated, together = saddle_solver(M, C, k, 1.0 / mass), saddle_solver(M, C, k)
    assert eliminated.schur is not None and together.schur is None
    first, second = eliminated.solve(load, right), together.solve(load, right)
    scale = 1.0 + np.abs(first[0]).max()
    assert np.allclose(first[0], second[0], atol=1e-6 * scale)
    for v, _ in (first, second):
        assert np.allclose(C @ v, right, atol=1e-8 * scale)
    assert np.allclose(M @ first[0], load + C.T @ first[1], atol=1e-10 * mass.max() * scale)
    one = eliminated.solve(load[:, 0], k)
    assert np.allclose(one[0], first[0][:, 0], atol=1e-10 * scale)


def test_rows_that_follow_from_others_have_no_multiplier() -> None:
    M = sp.eye_array(5, format="csr")
    C = sp.csr_array([[1.0, 0, 0, 0, 0], [0, 1.0, 1.0, 0, 0], [1.0, 1.0, 1.0, 0, 0], [0, 0, 0, 0, 0]])
    saddle = saddle_solver(M, C, np.zeros(4), np.ones(5))
    assert saddle.schur is not None
    _, multipliers = saddle.solve(np.arange(5.0), np.zeros(4))
    assert np.count_nonzero(multipliers) <= 2 and multipliers[3] == 0.0


def test_rows_that_contradict_each_other_are_refused() -> None:
    M = sp.eye_array(3, format="csr")
    C = sp.csr_array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    with pytest.raises(InputError, match="contradict"):
        saddle_solver(M, C, np.array([1.0, 1.0]), np.ones(3))
    v, _ = saddle_solver(M, C, np.array([1.0, 2.0]), np.ones(3)).solve(np.zeros(3), np.array([1.0, 2.0]))
    assert v == pytest.approx([0.5, 0.5, 0.0])


def test_more_rows_than_velocities_are_allowed_when_they_agree() -> None:
    M, C = sp.eye_array(2, format="csr"), sp.csr_array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    k = C @ np.array([3.0, -1.0])
    v, _ = saddle_solver(M, C, k, np.ones(2)).solve(np.zeros(2), k)
    assert v == pytest.approx([3.0, -1.0])
