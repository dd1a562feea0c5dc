"""The gradient form is the same operator as blocks: on strain operators with walls, contacts and hubs, for any thread count."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import settings as property_settings
from hypothesis import strategies as st

import barchan.friction.operators as operators
from barchan.cones import Coulomb, chi
from barchan.friction import Problem, solve
from barchan.friction.gradient_form import GradientDelassus
from barchan.friction.methods.gauss_seidel import prepare_sweeper
from barchan.friction.operators import LumpedDelassus, build_operator
from barchan.linalg import coloured_schedule


def strain_problem(
    seed: int, rows: int, d: int, masked: bool = False, contacts: int = 0, hub: bool = False
) -> Problem:
    """A chain of `rows` strain blocks over neighbours within two nodes, then `contacts` contacts of nodes with a frame.

    `masked` holds some components (zero columns); `hub` lets the contacts also move one body, in the last block column.
    """
    rng = np.random.default_rng(seed)
    s, columns = (3, 6)[d - 2], rows + hub
    basis = chi(np.eye(s))
    free = rng.random((columns, d)) > (0.3 if masked else 0.0)
    indptr, indices, blocks = [0], [], []
    for i in range(rows):
        for j in range(max(0, i - 2), min(rows, i + 3)):
            indices.append(j)
            blocks.append((basis @ rng.standard_normal(d)) * free[j])
        indptr.append(len(indices))
    for k in range(contacts):
        block = np.zeros((s, d))
        block[:d] = np.linalg.qr(rng.standard_normal((d, d)))[0]
        j = int(k * rows / contacts)
        indices.append(j)
        blocks.append(block * free[j])
        if hub:
            indices.append(rows)
            blocks.append(-block)
        indptr.append(len(indices))
    n = rows + contacts
    H = sp.bsr_array((np.array(blocks), indices, indptr), shape=(n * s, columns * d))
    mass = rng.uniform(0.5, 2.0, columns * d)
    push = np.zeros((n, s))
    push[:, 0] = rng.uniform(0.0, 1.0, n)
    return Problem(
        M=sp.diags_array(mass),
        f=-(H.T @ push.reshape(-1)) + 0.1 * rng.standard_normal(columns * d),
        H=H,
        w=np.zeros(n * s),
        law=Coulomb(np.full(n, 0.4)),
    )


@property_settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(3, 30),
    st.sampled_from([2, 3]),
    st.booleans(),
    st.integers(0, 5),
    st.booleans(),
)
def test_it_is_the_same_matrix(seed: int, rows: int, d: int, masked: bool, contacts: int, hub: bool) -> None:
    problem = strain_problem(seed, rows, d, masked, contacts, hub and contacts > 0)
    operator = build_operator(problem, "matrix-free")
    if 2 * problem.H.indptr[rows] < len(
        problem.H.indices
    ):  # the form would not pay: blocks are kept, of the same matrix
        assert isinstance(operator, LumpedDelassus | GradientDelassus)
    else:
        assert isinstance(operator, GradientDelassus)
    W = (problem.H @ sp.diags_array(1.0 / problem.M.diagonal()) @ problem.H.T).toarray()
    r = np.random.default_rng(seed).standard_normal((problem.n, problem.s))
    scale = np.abs(W).max()
    assert np.allclose(operator.apply(r).reshape(-1), W @ r.reshape(-1), atol=1e-12 * scale)
    if not isinstance(operator, GradientDelassus):
        return
    assert operator.strain_blocks + operator.other_blocks == len(problem.H.indices)
    pointers, columns = operator.pattern
    assert np.array_equal(pointers, problem.H.indptr)
    for i in range(problem.n):
        row = slice(problem.s * i, problem.s * (i + 1))
        assert np.allclose(operator.diagonal_blocks[i], W[row, row], atol=1e-12 * scale)
        own = slice(pointers[i], pointers[i + 1])
        assert np.array_equal(np.sort(columns[own]), np.sort(problem.H.indices[own]))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("jacobi", [False, True])
def test_sweeps_take_the_same_steps_as_with_blocks(
    d: int, jacobi: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swept(form: type) -> np.ndarray:
        problem = strain_problem(4, 40, d, masked=True, contacts=8, hub=True)
        sweeper = prepare_sweeper(problem, "matrix-free", "secular", False, jacobi)
        assert isinstance(sweeper.delassus, form)
        sweeper.start(np.zeros((problem.n, problem.s)))
        sweeper.run(3, 0, -1.0)
        return sweeper.r

    by_gradients = swept(GradientDelassus)
    monkeypatch.setattr(operators, "gradient_form", lambda *_: None)
    by_blocks = swept(LumpedDelassus)
    assert np.allclose(by_gradients, by_blocks, rtol=1e-9, atol=1e-10 * np.abs(by_blocks).max())


@pytest.mark.parametrize("d", [2, 3])
def test_coloured_sweeps_solve_and_do_not_depend_on_the_number_of_threads(
    d: int, bytes_by_threads: Callable[..., list[bytes]]
) -> None:
    problem = strain_problem(11, 300, d, masked=True, contacts=60, hub=True)
    options: dict[str, Any] = {"tol": 1e-8, "parallel": True, "operator": "matrix-free"}
    assert solve(problem, "gauss_seidel", **options).certificate.law <= 1e-6
    one, two = bytes_by_threads(lambda: [solve(problem, "gauss_seidel", max_iterations=15, **options).r])
    assert one == two


def test_a_block_that_is_no_strain_is_kept_as_it_is() -> None:
    problem = strain_problem(3, 12, 3)
    H = problem.H.copy()
    H.data[7, 2, 1] *= 1.0 + 1e-6
    spoilt = Problem(M=problem.M, f=problem.f, H=H, w=problem.w, law=problem.law)
    operator = build_operator(spoilt, "matrix-free")
    assert isinstance(operator, GradientDelassus) and operator.other_blocks == 1


def test_contacts_alone_keep_their_blocks() -> None:
    rng = np.random.default_rng(1)
    H = sp.bsr_array((rng.standard_normal((20, 3, 2)), np.arange(20) % 10, np.arange(21)), shape=(60, 20))
    problem = Problem(M=sp.eye_array(20), f=np.ones(20), H=H, w=np.zeros(60), law=Coulomb(np.full(20, 0.5)))
    assert isinstance(build_operator(problem, "matrix-free"), LumpedDelassus)


def test_slabs_of_one_colour_share_no_column_and_a_hub_makes_one_serial_group() -> None:
    rows, side = 1600, 40
    x, y = np.divmod(np.arange(rows), side)
    near = [
        np.flatnonzero((abs(x - x[i]) <= 1) & (abs(y - y[i]) <= 1)).tolist() + ([rows] if i % 2 else [])
        for i in range(rows)
    ]
    pattern = sp.csr_array(
        (np.ones(sum(map(len, near))), np.concatenate(near), np.cumsum([0, *map(len, near)])),
        shape=(rows, rows + 1),
    )
    for hub in (False, True):
        known = pattern if hub else sp.csr_array(pattern[:, :rows])
        schedule = coloured_schedule(known, 8, shared_columns=True, slabs=True)
        assert np.array_equal(np.sort(schedule.order), np.arange(rows))
        colours = len(schedule.colour_ptr) - 1
        assert colours <= 6 + hub
        for colour in range(colours):
            owner = np.full(rows + 1, -1)
            for group in range(schedule.colour_ptr[colour], schedule.colour_ptr[colour + 1]):
                for i in schedule.order[schedule.group_ptr[group] : schedule.group_ptr[group + 1]]:
                    columns = known.indices[known.indptr[i] : known.indptr[i + 1]]
                    assert np.isin(owner[columns], (-1, group)).all()
                    owner[columns] = group
        if hub:
            assert len(schedule.order[schedule.group_ptr[-2] :]) == rows // 2
