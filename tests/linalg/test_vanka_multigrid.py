"""Vanka sweeps, cycles and flexible GMRES on small chains: what each must do by definition, on any number of threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.linalg import vanka
from barchan.linalg.cell_pattern import CellPattern
from barchan.linalg.fgmres import flexible_gmres
from barchan.linalg.multigrid import Border, CycleOptions, Level, Multigrid
from barchan.linalg.vanka import VankaSmoother, multiply


def chain(cells: int, seed: int = 0, n: int = 3) -> tuple[CellPattern, np.ndarray]:
    """Pattern and data of a diagonally dominant, unsymmetric matrix on a chain of cells that share one unknown."""
    rng = np.random.default_rng(seed)
    unknowns = (n - 1) * np.arange(cells)[:, None] + np.arange(n)
    pattern = CellPattern(unknowns, (n - 1) * cells + 1)
    return pattern, pattern.assemble(rng.standard_normal((cells, n, n)) + 3.0 * np.eye(n))


def smoother_of(pattern: CellPattern, **options) -> VankaSmoother:
    return VankaSmoother(pattern.indptr, pattern.indices, pattern.cell_unknowns, pattern.positions, **options)


def sweep_by_definition(
    matrix: np.ndarray, patches: np.ndarray, x: np.ndarray, b: np.ndarray, damping: float
):
    for patch in patches:
        block = matrix[np.ix_(patch, patch)]
        x[patch] += damping * np.linalg.solve(block, (b - matrix @ x)[patch])


def test_one_patch_over_everything_is_a_direct_solver():
    rng = np.random.default_rng(1)
    size = 21
    pattern = CellPattern(rng.permutation(size)[None], size)
    data = pattern.assemble(rng.standard_normal((1, size, size)))
    # Equations and unknowns of very different units, as viscosities and cell sizes bring them.
    rows, columns = 10.0 ** rng.uniform(-10, 3, size), 10.0 ** rng.uniform(-4, 4, size)
    matrix = sp.csr_array(sp.diags_array(rows) @ pattern.matrix(data) @ sp.diags_array(columns))
    smoother = smoother_of(pattern)
    smoother.update(matrix.data)
    wanted, x = rng.standard_normal(size) / columns, np.zeros(size)
    smoother.sweep(x, matrix @ wanted)
    assert np.allclose(x * columns, wanted * columns, atol=1e-8)


@pytest.mark.parametrize("damping", [1.0, 0.7])
def test_sweep_in_order_is_gauss_seidel_over_patches(damping):
    pattern, data = chain(7)
    smoother = smoother_of(pattern)
    smoother.update(data)
    rng = np.random.default_rng(2)
    b, x = rng.standard_normal(pattern.size), rng.standard_normal(pattern.size)
    wanted, back = x.copy(), x.copy()
    sweep_by_definition(pattern.matrix(data).toarray(), pattern.cell_unknowns, wanted, b, damping)
    smoother.sweep(x, b, damping=damping)
    assert np.allclose(x, wanted, atol=1e-12)
    wanted = back.copy()
    sweep_by_definition(pattern.matrix(data).toarray(), pattern.cell_unknowns[::-1], wanted, b, damping)
    smoother.sweep(back, b, backward=True, damping=damping)
    assert np.allclose(back, wanted, atol=1e-12)


def test_coloured_sweep_is_gauss_seidel_in_another_order(monkeypatch):
    monkeypatch.setattr(vanka, "LARGEST_SERIAL", 10)
    pattern, data = chain(50)
    smoother = smoother_of(pattern, block=4)
    smoother.update(data)
    schedule = smoother._schedule
    order = np.concatenate([np.arange(4 * block, min(4 * block + 4, 50)) for block in schedule.order])
    b = np.random.default_rng(3).standard_normal(pattern.size)
    wanted, x = np.zeros(pattern.size), np.zeros(pattern.size)
    for _ in range(2):
        sweep_by_definition(pattern.matrix(data).toarray(), pattern.cell_unknowns[order], wanted, b, 1.0)
    smoother.sweep(x, b, 2)
    assert np.allclose(x, wanted, atol=1e-12)


def test_blocks_of_one_colour_neither_write_nor_read_what_another_writes(monkeypatch):
    monkeypatch.setattr(vanka, "LARGEST_SERIAL", 10)
    pattern, data = chain(200)
    schedule = smoother_of(pattern, block=8)._schedule
    matrix = pattern.matrix(np.ones_like(data))
    for first, last in zip(schedule.colour_ptr, schedule.colour_ptr[1:], strict=False):
        written = [np.unique(pattern.cell_unknowns[8 * b : 8 * b + 8]) for b in schedule.order[first:last]]
        read = [np.unique(matrix[rows].indices) for rows in written]
        for i in range(len(written)):
            for j in range(len(written)):
                assert i == j or not np.intersect1d(written[i], read[j]).size


@pytest.mark.parametrize("precision", ["double", "single"])
def test_bytes_do_not_depend_on_the_threads(precision, monkeypatch):
    monkeypatch.setattr(vanka, "LARGEST_SERIAL", 10)
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    pattern, data = chain(3000)
    b = np.random.default_rng(4).standard_normal(pattern.size)
    found = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            smoother = smoother_of(pattern, precision=precision)
            smoother.update(data)
            x = np.zeros(pattern.size)
            smoother.sweep(x, b, 3)
            smoother.sweep(x, b, 3, backward=True)
            found.append(x.tobytes())
    finally:
        numba.set_num_threads(before)
    assert found[0] == found[1]


def test_a_patch_without_an_inverse_is_survived():
    # Two velocities cannot carry the three pressures of a cell with walls all around: the patch is singular, the sweep is not.
    pattern = CellPattern(np.arange(5)[None], 5)
    element = np.zeros((1, 5, 5))
    element[0, :2, :2] = np.eye(2)
    element[0, :2, 2:] = [[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]
    element[0, 2:, :2] = element[0, :2, 2:].T
    data = pattern.assemble(element)
    smoother = smoother_of(pattern)
    smoother.update(data)
    x, b = np.zeros(5), element[0] @ np.ones(5)
    smoother.sweep(x, b)
    assert np.isfinite(x).all()
    assert np.allclose(element[0] @ x, b)


def test_wrong_arrays_are_refused():
    pattern, data = chain(3)
    with pytest.raises(InputError, match="precision"):
        smoother_of(pattern, precision="half")
    with pytest.raises(InputError, match="positions"):
        VankaSmoother(pattern.indptr, pattern.indices, pattern.cell_unknowns, pattern.positions[:, :2])
    with pytest.raises(InputError, match="data"):
        smoother_of(pattern).update(data[:-1])


def test_multiply_is_the_product():
    pattern, data = chain(20)
    x = np.random.default_rng(5).standard_normal(pattern.size)
    assert np.allclose(multiply(pattern.indptr, pattern.indices, data, x), pattern.matrix(data) @ x)


# -- flexible GMRES ----------------------------------------------------------------------------------------------------


def test_flexible_gmres_solves_with_a_preconditioner_that_changes():
    rng = np.random.default_rng(6)
    A = rng.standard_normal((40, 40)) + 12.0 * np.eye(40)
    b, calls = rng.standard_normal(40), []

    def precondition(v):
        calls.append(len(calls))
        return v / (A.diagonal() + rng.standard_normal(40))

    found = flexible_gmres(A.__matmul__, precondition, b, 1e-10, 200, restart=15)
    assert found.iterations == len(calls)
    assert found.residual <= 1e-10
    assert np.linalg.norm(b - A @ found.x) <= 1.01e-10 * np.linalg.norm(b)


def test_the_weighted_norm_is_the_one_that_is_measured():
    rng = np.random.default_rng(7)
    weights = 10.0 ** rng.uniform(-3, 3, 30)
    A, b = rng.standard_normal((30, 30)) + 8.0 * np.eye(30), rng.standard_normal(30)
    found = flexible_gmres(A.__matmul__, lambda v: v / A.diagonal(), b, 0.1, 12, weights=weights)
    true = np.linalg.norm(weights * (b - A @ found.x)) / np.linalg.norm(weights * b)
    assert true == pytest.approx(found.residual, rel=1e-10)


def test_exact_preconditioner_needs_one_step_and_zero_needs_none():
    A = np.diag(np.arange(1.0, 9.0))
    b = np.ones(8)
    found = flexible_gmres(A.__matmul__, lambda v: v / A.diagonal(), b, 1e-12, 10)
    assert found.iterations == 1 and np.allclose(A @ found.x, b)
    assert flexible_gmres(A.__matmul__, lambda v: v, np.zeros(8), 1e-12, 10).iterations == 0


def test_a_preconditioner_that_overflows_ends_the_iteration_with_the_best_so_far():
    A, b = np.diag(np.arange(1.0, 9.0)), np.ones(8)
    answers = iter([b, np.full(8, np.inf)])
    found = flexible_gmres(A.__matmul__, lambda v: next(answers), b, 1e-12, 10)
    assert found.iterations == 1
    assert np.isfinite(found.x).all() and found.residual < 1.0


# -- cycles ------------------------------------------------------------------------------------------------------------


def laplacian(
    levels: int, closed: bool, options: CycleOptions | None = None
) -> tuple[Multigrid, CellPattern, np.ndarray]:
    """Multigrid for -u'' on [0, 1] with linear elements, patches of one element; `closed` leaves both ends free."""
    grids, pattern, data, coarsest = [], None, None, None
    for k in range(levels):
        cells = 4 * 2**k
        pattern = CellPattern(np.arange(cells)[:, None] + np.arange(2), cells + 1)
        elements = np.tile(cells * np.array([[1.0, -1.0], [-1.0, 1.0]]), (cells, 1, 1))
        fixed = np.zeros(cells + 1, bool)
        fixed[[0, -1]] = not closed
        data = pattern.assemble(elements, fixed)
        smoother = smoother_of(pattern)
        smoother.update(data)
        transfer = None
        if k:
            matrix = sp.lil_array((cells + 1, cells // 2 + 1))
            for i in range(cells // 2 + 1):
                matrix[2 * i, i] = 1.0
                for j in (2 * i - 1, 2 * i + 1):
                    if 0 <= j <= cells:
                        matrix[j, i] = 0.5
            transfer = sp.csr_array(matrix)
            if not closed:
                transfer = sp.csr_array(sp.diags_array((~fixed).astype(float)) @ transfer)
                inner = np.ones(cells // 2 + 1)
                inner[[0, -1]] = 0.0
                transfer = sp.csr_array(transfer @ sp.diags_array(inner))
        border = None
        if closed:
            weights = np.full(cells + 1, 1.0 / cells)
            weights[[0, -1]] *= 0.5
            border = Border(weights, np.ones(cells + 1))
        grids.append(Level(smoother, transfer, border))
        coarsest = pattern.matrix(data) if k == 0 else coarsest
    multigrid = Multigrid(grids, options)
    multigrid.update(coarsest)
    return multigrid, pattern, data


@pytest.mark.parametrize("shape", ["V", "W", "F"])
def test_cycles_contract_by_a_factor_that_does_not_depend_on_the_level(shape):
    rates = []
    for levels in (3, 6, 9):
        multigrid, pattern, _ = laplacian(levels, False, CycleOptions(shape, 1, 1, damping=1.0))
        b = np.random.default_rng(8).standard_normal(pattern.size)
        b[[0, -1]] = 0.0
        found = multigrid.solve(b, 1e-8, 12, krylov=False)
        rates.append(found.residual ** (1.0 / found.iterations))
    assert max(rates) < 0.3


@pytest.mark.parametrize("krylov", [True, False])
def test_a_free_constant_is_fixed_by_its_mean(krylov):
    multigrid, pattern, data = laplacian(6, True, CycleOptions("V", 2, 2))
    x = np.linspace(0.0, 1.0, pattern.size)
    b = np.cos(np.pi * x)
    b[[0, -1]] *= 0.5
    found = multigrid.solve(b - b.mean(), 1e-10, 40, krylov=krylov)
    trapezium = np.full(pattern.size, 1.0)
    trapezium[[0, -1]] = 0.5
    assert found.residual <= 1e-10
    assert np.allclose(pattern.matrix(data) @ found.x, b - b.mean(), atol=1e-8)
    assert abs(trapezium @ found.x) < 1e-8 * np.abs(found.x).max() * pattern.size


def test_wrong_levels_and_options_are_refused():
    with pytest.raises(InputError, match="shape"):
        CycleOptions("X")
    with pytest.raises(InputError, match="pre"):
        CycleOptions("V", 0, 0)
    with pytest.raises(InputError, match="damping"):
        CycleOptions("V", damping=0.0)
    with pytest.raises(InputError, match="levels"):
        Multigrid([])
    pattern, _ = chain(3)
    level = Level(smoother_of(pattern))
    with pytest.raises(InputError, match="prolongation"):
        Multigrid([level, level])
