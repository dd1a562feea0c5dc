"""Stress spaces: virtual work, volumes and room, warm starts by name, and which pairs of spaces hold a bed at rest."""

from __future__ import annotations

from dataclasses import replace

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp

from barchan.cones import chi
from barchan.flows.mpm import Material, Options, State, Stepper, Walls, fill_box
from barchan.flows.mpm import _basis_kernels as kernels
from barchan.flows.mpm.advice import UNFIT_PAIRS, advice_on
from barchan.flows.mpm.assembly import compression_allowance, strain_operator
from barchan.flows.mpm.bases import VELOCITIES, VelocityBasis
from barchan.flows.mpm.frames import initial_frames
from barchan.flows.mpm.options import STRESSES
from barchan.flows.mpm.stencil import moment_tables
from barchan.flows.mpm.stresses import StressRows, stress_rows
from barchan.flows.mpm.transfer import GridMatter, particles_to_grid
from barchan.flows.mpm.velocity import VelocityField, velocity_field
from barchan.friction import Problem
from barchan.spaces import RegularGrid

DIMENSIONS = [2, 3]
MATERIAL = Material(1500.0, 0.5)
PAIRS = [(velocity, stress) for velocity in VELOCITIES for stress in STRESSES]
FIT = [pair for pair in PAIRS if pair not in UNFIT_PAIRS]


def discretised(
    random_state, d: int, velocity: str, stress: str
) -> tuple[GridMatter, VelocityField, StressRows, State]:
    grid, state = random_state(d)
    widths = np.repeat((state.volumes ** (1.0 / d))[:, None], d, axis=1)
    state = replace(state, frames=initial_frames(widths))
    matter = particles_to_grid(grid, state)
    field = velocity_field(matter, state, VelocityBasis(grid, velocity), 1.0, True)
    return matter, field, stress_rows(stress, matter, field, state), state


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize(("velocity", "stress"), PAIRS)
def test_the_strain_operator_gives_the_work_of_the_stresses_at_the_particles(
    random_state, velocity, stress, d
):
    _, field, rows, state = discretised(random_state, d, velocity, stress)
    rng = np.random.default_rng(3)
    v = rng.normal(size=(len(field.ids), d))
    r = rng.normal(size=(len(rows.ids), d * (d + 1) // 2))
    strain = strain_operator(rows, np.ones(v.shape, dtype=bool))
    _, slopes = field.to_particles(v)
    tensors = chi(rows.at_particles(r))
    work = np.einsum("p,pkl,pkl->", state.volumes, tensors, 0.5 * (slopes + slopes.swapaxes(1, 2)))
    assert r.ravel() @ (strain @ v.ravel()) == pytest.approx(work, rel=1e-7, abs=1e-7 * np.linalg.norm(r))
    assert not np.any(strain_operator(rows, np.zeros(v.shape, dtype=bool)).data)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("stress", STRESSES)
def test_volumes_add_up_to_the_matter_and_room_to_the_parts_of_cells_that_hold_it(random_state, stress, d):
    matter, _, rows, state = discretised(random_state, d, "Q1", stress)
    assert np.sum(rows.volumes) == pytest.approx(np.sum(state.volumes), rel=1e-12)
    assert np.all(rows.volumes > 0.0)
    assert np.all(rows.room > 0.0)
    if stress == "particles":
        np.testing.assert_allclose(rows.room, state.volumes, rtol=1e-12)
    else:
        occupied = matter.grid.cell_volume * np.count_nonzero(matter.halves) / 2**d
        assert np.sum(rows.room) == pytest.approx(occupied, rel=1e-9)
        bodies = np.random.default_rng(0).uniform(0.1, 1.0, matter.halves.shape)
        taken = replace(matter, free=bodies)
        field = velocity_field(taken, state, VelocityBasis(matter.grid, "B2"), 1.0, True)
        less = stress_rows(stress, taken, field, state)
        expected = matter.grid.cell_volume * np.sum(bodies[matter.halves]) / 2**d
        assert np.sum(less.room) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("velocity", VELOCITIES)
@pytest.mark.parametrize("stress", STRESSES)
@pytest.mark.parametrize(("height", "count"), [(3.0, 2), (3.0, 3), (2.55, 2), (2.6, 3)])
def test_a_bed_filled_by_boxes_is_packed_everywhere(velocity, stress, d, height, count):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.05), np.full(d, 4))
    top = np.append(grid.upper[:-1], height * 0.05)
    state = fill_box(grid, np.zeros(d), top, count, MATERIAL)
    matter = particles_to_grid(grid, state)
    field = velocity_field(matter, state, VelocityBasis(grid, velocity), 1500.0, False)
    rows = stress_rows(stress, matter, field, state)
    assert not np.any(compression_allowance(rows, 1.0, MATERIAL.packing_tolerance, 0.01))


@pytest.mark.parametrize("d", DIMENSIONS)
def test_cell_sums_from_moments_are_those_over_the_particles(random_state, d):
    matter, field, _, state = discretised(random_state, d, "Q1", "Q1d")
    shape = (len(matter.active.occupied), 2**d)
    fast, fast_sums = np.zeros((*shape, 2**d, d)), np.zeros(shape)
    tables = moment_tables(d)
    kernels.table_from_moments(
        matter.moments, tables.value, tables.gradient, matter.stencil.slopes, fast, fast_sums
    )
    slow, slow_sums = np.zeros_like(fast), np.zeros_like(fast_sums)
    shapes = field.shapes
    kernels.cell_table(
        matter.active.order, matter.active.starts, state.volumes, shapes.weights,
        np.zeros(len(shapes.cells), dtype=np.int64), shapes.gradients, slow, slow_sums,
    )  # fmt: skip
    np.testing.assert_allclose(fast_sums, slow_sums, rtol=1e-10)
    np.testing.assert_allclose(fast, slow, atol=1e-10 * np.max(np.abs(slow)))


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("stress", STRESSES)
def test_means_over_rows_are_the_adjoint_of_values_at_particles(random_state, stress, d):
    matter, _, rows, state = discretised(random_state, d, "P1", stress)
    rng = np.random.default_rng(8)
    ours, theirs = rng.normal(size=(len(rows.ids), 2)), rng.normal(size=(state.particle_count, 2))
    left = np.einsum("q,qe,qe->", rows.volumes, ours, rows.averages(state.volumes, theirs))
    right = np.einsum("p,pe,pe->", state.volumes, rows.at_particles(ours), theirs)
    assert left == pytest.approx(right, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(
        rows.averages(state.volumes, np.ones((state.particle_count, 1))), 1.0, rtol=1e-9
    )
    np.testing.assert_allclose(rows.at_particles(np.ones((len(rows.ids), 1))), 1.0, rtol=1e-9)
    np.testing.assert_allclose(rows.node_means(matter, np.full((len(rows.ids), 1), 7.0)), 7.0, rtol=1e-9)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("stress", STRESSES)
def test_names_of_stresses_last(random_state, stress, d):
    _, _, rows, _ = discretised(random_state, d, "Q1", stress)
    assert len(np.unique(rows.ids)) == len(rows.ids)
    _, _, again, _ = discretised(lambda d: random_state(d, seed=5), d, "B2", stress)
    if stress == "particles":
        np.testing.assert_array_equal(rows.ids, again.ids)
        return
    _, here, there = np.intersect1d(rows.ids, again.ids, return_indices=True)
    assert len(here) > 0.5 * len(rows.ids)
    np.testing.assert_array_equal(rows.places[here], again.places[there])


def unborne(problem: Problem) -> float:
    """Smallest share of the weight that admissible stresses of the packed rows leave unborne: min |f + H^T r| / |f|."""
    s, size = problem.s, len(problem.f)
    packed = problem.w.reshape(-1, s)[:, 0] == 0.0
    scale = float(np.linalg.norm(problem.f))
    forces = sp.csr_array(problem.H)[np.repeat(packed, s)].T * (1000.0 / scale)
    friction, count = problem.law.parameters(problem.n)[packed, 0], int(np.count_nonzero(packed))
    cone = sp.block_diag([np.diag(np.append(mu, np.ones(s - 1))) for mu in friction])
    rows = sp.block_diag([sp.csr_array([[-1.0]]), -forces], format="csr")
    rows = sp.vstack([rows, sp.hstack([sp.csr_array((count * s, 1)), -cone])])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    found = clarabel.DefaultSolver(
        sp.csc_matrix((1 + count * s, 1 + count * s)),
        np.append(1.0, np.zeros(count * s)),
        sp.csc_matrix(rows),
        np.concatenate([[0.0], problem.f / scale, np.zeros(count * s)]),
        [clarabel.SecondOrderConeT(size + 1)] + [clarabel.SecondOrderConeT(s)] * count,
        settings,
    ).solve()
    return float(found.obj_val)


def bed(velocity: str, stress: str, height: float) -> tuple[Stepper, State]:
    """A box of 6 x 6 cells filled up to `height` cells."""
    grid = RegularGrid(np.zeros(2), np.full(2, 0.05), np.full(2, 6))
    state = fill_box(grid, np.zeros(2), np.array([0.3, 0.05 * height]), 2, MATERIAL)
    options = Options(
        velocity=velocity,
        stress=stress,
        tolerance=1e-11,
        rest_tolerance=1e-11,
        max_sweeps=20000,
        multilevel=False,
    )
    return Stepper(grid, MATERIAL, Walls.cuve(2), options=options), state


@pytest.mark.parametrize("height", [4.0, 4.55])
@pytest.mark.parametrize(("velocity", "stress"), FIT)
def test_fit_pairs_have_stresses_that_bear_a_bed(velocity, stress, height):
    stepper, state = bed(velocity, stress, height)
    assert unborne(stepper.problem(state, 1 / 240)) < 1e-6


@pytest.mark.parametrize(("velocity", "stress"), sorted(UNFIT_PAIRS))
def test_unfit_pairs_leave_a_part_of_the_weight_unborne(velocity, stress):
    stepper, state = bed(velocity, stress, 4.55)
    assert unborne(stepper.problem(state, 1 / 240)) > 5e-3


def fastest(velocity: str, stress: str, height: float, steps: int) -> float:
    """Largest speed over sqrt(g L) in `steps` steps."""
    stepper, state = bed(velocity, stress, height)
    largest = 0.0
    for _ in range(steps):
        state, record = stepper.advance(state, 1 / 240)
        largest = max(largest, record.max_speed)
    return float(largest / np.sqrt(9.81 * 0.2))


@pytest.mark.parametrize("height", [4.0, 4.55])
@pytest.mark.parametrize(("velocity", "stress"), FIT)
def test_fit_pairs_hold_a_bed_at_rest(velocity, stress, height):
    assert fastest(velocity, stress, height, 20) < 1e-8


@pytest.mark.parametrize(("velocity", "stress"), sorted(UNFIT_PAIRS))
def test_a_bed_creeps_in_unfit_pairs(velocity, stress):
    assert fastest(velocity, stress, 4.55, 4) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("height", [4.0, 4.55])
@pytest.mark.parametrize(("velocity", "stress"), FIT)
def test_fit_pairs_hold_a_bed_for_a_thousand_steps(velocity, stress, height):
    assert fastest(velocity, stress, height, 1000) < 1e-8


def test_what_does_not_do_what_one_expects_is_said():
    cohesive = Material(1500.0, 0.5, cohesion=100.0)
    assert advice_on(MATERIAL, Options()) == []
    assert advice_on(cohesive, Options(stress="particles")) == []
    (one,) = advice_on([MATERIAL, cohesive], Options())
    assert "Cohesion" in one
    for velocity, stress in PAIRS:
        texts = advice_on(MATERIAL, Options(velocity=velocity, stress=stress))
        assert (len(texts) == 1) == ((velocity, stress) in UNFIT_PAIRS)
    assert "FLIP" in advice_on(MATERIAL, Options(transfer="flip"))[0]
