"""The traces that scale the certificate: exact by solves, and estimated by random vectors where solves would take too long."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from barchan.cones import Coulomb
from barchan.friction import Problem
from barchan.friction import problem as problem_module
from barchan.linalg import delassus as delassus_module
from barchan.linalg import delassus_diagonal, delassus_trace, factorise


def plate(size: int) -> tuple[sp.csr_array, sp.csr_array]:
    """Stiffness (m, m) and strain rates (3 n, m) of a clamped plate of bilinear quadrilaterals, four points each."""
    grid = np.arange((size + 1) ** 2).reshape(size + 1, size + 1)
    corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]], axis=-1).reshape(-1, 4)
    points = 0.5 + np.array([-1.0, 1.0]) / np.sqrt(12.0)
    rows = []
    for y in points:
        for x in points:
            along_x, along_y = [-(1 - y), 1 - y, -y, y], [-(1 - x), -x, 1 - x, x]
            local = np.zeros((3, 4, 2))
            local[0, :, 0], local[0, :, 1] = along_x, along_y
            local[1, :, 0], local[1, :, 1] = along_x, -np.array(along_y)
            local[2, :, 0], local[2, :, 1] = along_y, along_x
            rows.append(local.reshape(3, 8))
    columns = (2 * corners[:, :, None] + np.arange(2)).reshape(-1, 8)
    data = np.broadcast_to(np.array(rows), (len(columns), 4, 3, 8))
    indices = np.broadcast_to(columns[:, None, None, :], data.shape)
    full = sp.csr_array(
        (data.ravel(), indices.ravel(), np.arange(0, data.size + 1, 8)), shape=(data.size // 8, 2 * grid.size)
    )
    free = (2 * grid[1:-1, 1:-1].reshape(-1, 1) + np.arange(2)).ravel()
    H = sp.csr_array(full[:, free])
    return sp.csr_array(H.T @ H), H


def exact(M, H) -> np.ndarray:
    W = H.toarray() @ np.linalg.solve(M.toarray(), H.toarray().T)
    return np.stack([W[i : i + 3, i : i + 3] for i in range(0, len(W), 3)])


@pytest.mark.parametrize("size", [2, 3, 7, 12])
def test_diagonal_blocks_are_those_of_the_dense_operator(size) -> None:
    M, H = plate(size)
    assert np.allclose(delassus_diagonal(factorise(M), M, H, 3), exact(M, H), atol=1e-12)


def test_blocks_may_touch_unknowns_that_the_matrix_does_not_couple() -> None:
    rng = np.random.default_rng(0)
    M = sp.csr_array(sp.diags_array([-1.0, 2.5, -1.0], shape=(90, 90), offsets=[-1, 0, 1]))
    H = sp.random_array((60, 90), density=0.04, rng=rng, format="csr")
    assert np.allclose(delassus_diagonal(factorise(M), M, H, 3), exact(M, H), atol=1e-12)


def test_diagonal_blocks_by_solves_are_the_same(monkeypatch) -> None:
    M, H = plate(7)
    monkeypatch.setattr(delassus_module, "MEGABYTES", 0)
    monkeypatch.setattr(delassus_module, "_right_sides", lambda m: 10)  # several chunks, the last one shorter
    assert np.allclose(delassus_diagonal(factorise(M), M, H, 3), exact(M, H), atol=1e-12)


def test_a_chunk_of_right_sides_stays_within_its_memory() -> None:
    for m in (10, 1000, 10**6, 10**9):
        assert delassus_module._right_sides(m) >= 1
        assert m * delassus_module._right_sides(m) * 16 <= max(delassus_module.MEGABYTES * 2**20, 16 * m)


def test_estimated_traces_are_within_forty_percent_and_right_on_average() -> None:
    M, H = plate(24)
    wanted = np.einsum("iaa->i", delassus_diagonal(factorise(M), M, H, 3))
    error = delassus_trace(factorise(M), H, 3) / wanted - 1.0
    assert np.abs(error).max() < 0.4
    assert np.abs(error).mean() < 0.1
    assert abs(error.mean()) < 0.02


def test_the_spread_of_the_estimate_is_within_its_bound() -> None:
    M, H = plate(9)
    factor = factorise(M)
    blocks = delassus_diagonal(factor, M, H, 3)
    wanted = np.einsum("iaa->i", blocks)
    bound = np.sqrt(2.0) * np.linalg.norm(blocks, axis=(1, 2)) / wanted
    probes = 400
    error = (delassus_trace(factor, H, 3, probes) / wanted - 1.0) / (bound / np.sqrt(probes))
    # Deviations in units of the bound: their mean square is at most one, up to the noise of 324 dependent samples.
    assert 0.3 < (error**2).mean() < 1.2


def test_blocks_that_touch_nothing_have_no_trace() -> None:
    M, H = plate(7)
    empty = sp.csr_array(sp.vstack([H[:6], sp.csr_array((3, H.shape[1])), H[6:]]))
    trace = delassus_trace(factorise(M), empty, 3)
    assert trace[2] == 0.0 and (np.delete(trace, 2) > 0.0).all()


def problem(size: int) -> Problem:
    M, H = plate(size)
    return Problem(M=M, f=np.zeros(M.shape[0]), H=H, w=np.zeros(H.shape[0]), law=Coulomb(0.5), block_size=3)


def test_small_problems_take_exact_traces() -> None:
    small = problem(6)
    assert np.allclose(small.rho, 3.0 / np.einsum("iaa->i", exact(small.M, small.H)))


def test_large_problems_never_ask_for_diagonal_blocks(monkeypatch) -> None:
    reference = problem(8).rho
    monkeypatch.setattr(problem_module, "EXACT_ENTRIES", 1000)
    monkeypatch.setattr(problem_module, "delassus_diagonal", lambda *_: pytest.fail("one solve per row"))
    estimate = problem(8).rho
    assert np.abs(estimate / reference - 1.0).max() < 0.6
    assert not np.array_equal(estimate, reference)
    assert np.array_equal(estimate, problem(8).rho)


def test_the_unit_of_the_data_only_scales_the_estimate(monkeypatch) -> None:
    monkeypatch.setattr(problem_module, "EXACT_ENTRIES", 1000)
    M, H = plate(8)
    zero = {"f": np.zeros(M.shape[0]), "w": np.zeros(H.shape[0]), "law": Coulomb(0.5), "block_size": 3}
    ratio = Problem(M=4.0 * M, H=8.0 * H, **zero).rho / Problem(M=M, H=H, **zero).rho
    assert np.allclose(ratio, 1.0 / 16.0, rtol=1e-12)
