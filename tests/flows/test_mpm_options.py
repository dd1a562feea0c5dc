"""Options: FLIP, stresses carried by particles, resampling, open walls, gravity askew, and resuming with everything on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stepping import DT, grid_of, run

from barchan.bodies.rigid import Body, Box, Fixed, Sphere
from barchan.flows.mpm import Material, Options, Resampling, State, Stepper, Wall, Walls, fill_box, joined
from barchan.flows.mpm.bases import VELOCITIES
from barchan.flows.mpm.options import STRESSES
from barchan.flows.mpm.orientation import aligned
from barchan.spaces import RegularGrid

MATERIAL = Material(1500.0, 0.5)


def two_lumps(d: int) -> tuple[RegularGrid, State]:
    """One lump flying into another, away from walls."""
    grid = grid_of((12, 12) if d == 2 else (10, 6, 8))
    one = fill_box(grid, np.full(d, 0.1), np.append([0.25, 0.2][: d - 1], 0.2), 2, MATERIAL)
    other = fill_box(
        grid, np.append([0.3, 0.1][: d - 1], 0.1), np.append([0.4, 0.2][: d - 1], 0.25), 2, MATERIAL
    )
    state = joined([one, other])
    velocities = np.zeros_like(state.velocities)
    velocities[state.materials == 0] = np.append([3.0, 0.2][: d - 1], 0.5)
    return grid, replace(state, velocities=velocities)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("velocity", VELOCITIES)
@pytest.mark.parametrize("transfer", ["apic", "pic", "flip"])
def test_every_transfer_in_every_basis_conserves_momentum(transfer, velocity, d):
    grid, state = two_lumps(d)
    options = Options(transfer=transfer, velocity=velocity, flip_share=0.9)
    after, _ = run(Stepper(grid, MATERIAL, Walls(), gravity=0.0, options=options), state, 8)
    np.testing.assert_allclose(
        after.volumes @ after.velocities, state.volumes @ state.velocities, rtol=1e-9, atol=1e-12
    )
    assert np.mean(after.velocities[state.materials == 1, 0]) > 0.1


def test_flip_keeps_what_pic_loses():
    grid, state = two_lumps(2)
    # A lump alone, whose particles jitter: FLIP keeps the jitter, PIC averages it away.
    rng = np.random.default_rng(0)
    jittered = replace(state, velocities=rng.normal(size=state.velocities.shape), volumes=0.2 * state.volumes)
    energies = {}
    for transfer, share in (("pic", 1.0), ("flip", 1.0), ("flip", 0.5), ("flip", 0.0)):
        options = Options(transfer=transfer, flip_share=share, volume_correction=0.0)
        after, _ = run(Stepper(grid, MATERIAL, Walls(), gravity=0.0, options=options), jittered, 3, 1e-4)
        energies[transfer, share] = float(np.sum(after.velocities**2))
    assert energies["flip", 0.0] == pytest.approx(energies["pic", 1.0], rel=1e-12)
    assert energies["pic", 1.0] < energies["flip", 0.5] < energies["flip", 1.0]


def test_steps_that_begin_nearly_at_rest_are_pic_steps_with_flip_too():
    grid = grid_of((6, 8))
    state = fill_box(grid, [0.0, 0.0], [0.3, 0.3], 2, MATERIAL)
    stepper = Stepper(grid, MATERIAL, Walls.cuve(2), options=Options(transfer="pic"))
    state, _ = run(stepper, state, 2)
    for size, same in ((1e-3, True), (0.5, False)):
        jitter = replace(
            state, velocities=size * np.random.default_rng(1).normal(size=state.velocities.shape)
        )
        ends = [
            run(Stepper(grid, MATERIAL, Walls.cuve(2), options=Options(transfer=transfer)), jitter, 1)[0]
            for transfer in ("pic", "flip")
        ]
        assert np.array_equal(ends[0].velocities, ends[1].velocities) == same


@pytest.mark.parametrize("stress", STRESSES)
def test_stresses_carried_by_particles_reach_the_same_certificate(stress):
    grid = grid_of((12, 6))
    state = fill_box(grid, [0.0, 0.0], [0.25, 0.2], 2, MATERIAL)
    for warm_start in ("grid", "particles"):
        options = Options(stress=stress, warm_start=warm_start, max_sweeps=20000)
        after, records = run(Stepper(grid, MATERIAL, Walls.cuve(2), options=options), state, 10)
        assert all(record.converged for record in records)
        kept = after.particle_stresses
        if warm_start == "particles" or stress == "particles":
            assert kept.shape == (state.particle_count, 3)
            assert np.mean(kept[:, 0]) > 0.1 * 1500 * 9.81 * 0.1
        else:
            assert kept.shape == (0, 3)


def test_stresses_carried_by_particles_save_sweeps_at_rest():
    grid = grid_of((6, 8))
    state = fill_box(grid, [0.0, 0.0], [0.3, 0.3], 2, MATERIAL)
    options = Options(stress="particles", multilevel=False)
    _, records = run(Stepper(grid, MATERIAL, Walls.cuve(2), options=options), state, 4)
    assert records[-1].sweeps < 0.2 * records[0].sweeps


@pytest.mark.parametrize("stress", ["Q1", "particles"])
def test_resampling_keeps_mass_momentum_and_particles_that_fit_their_cells(stress):
    grid, state = two_lumps(2)
    # `two_lumps` numbers its parts as materials; merges stay within one.
    options = Options(
        stress=stress,
        resampling=Resampling(split_ratio=1.7, merge_ratio=1.4, fewest_per_cell=2, most_per_cell=6),
        transfer="pic",
    )
    stepper = Stepper(grid, MATERIAL, Walls(), gravity=0.0, options=options)
    before, counts = state.volumes @ state.velocities, []
    for _ in range(25):
        state, record = stepper.advance(state, DT)
        counts.append(record.particles)
        assert record.total_volume == pytest.approx(np.sum(two_lumps(2)[1].volumes), rel=1e-12)
    np.testing.assert_allclose(state.volumes @ state.velocities, before, rtol=1e-9)
    assert len(set(counts)) > 1
    for name, array in state.particle_fields().items():
        assert len(array) == state.particle_count, name


@pytest.mark.parametrize("stress", ["Q1", "particles"])
def test_an_open_wall_lets_particles_out_and_changes_nothing_else(stress):
    grid = grid_of((8, 8))
    block = fill_box(grid, [0.1, 0.1], [0.25, 0.25], 2, MATERIAL)
    thrown = replace(block, velocities=np.tile([3.0, 0.0], (block.particle_count, 1)))
    stepper = Stepper(
        grid,
        MATERIAL,
        Walls({"x_max": Wall("open")}),
        gravity=0.0,
        options=Options(stress=stress, warm_start="particles", volume_correction=0.0),
    )
    state, counts = thrown, []
    for _ in range(16):
        before = state
        state, record = stepper.advance(state, DT)
        counts.append(record.particles)
        stays = before.positions[:, 0] + 3.0 * DT < 0.4 - 1e-6 * 0.05
        assert record.particles == np.count_nonzero(stays)
        np.testing.assert_allclose(state.positions, before.positions[stays] + [3.0 * DT, 0.0], atol=1e-9)
        np.testing.assert_array_equal(state.volumes, before.volumes[stays])
    assert counts[0] == block.particle_count
    assert 0 < counts[-1] < block.particle_count


@pytest.mark.parametrize(("slope", "slides"), [(0.3, False), (0.45, True)])
def test_a_slab_slides_when_gravity_is_steeper_than_its_friction(slope, slides):
    grid, wall = grid_of((24, 4)), 0.37
    state = fill_box(grid, [0.2, 0.0], [0.8, 0.05], 2, Material(1500.0, 2.0))
    gravity = 9.81 * np.array([slope, -1.0]) / np.hypot(slope, 1.0)
    options = Options(tolerance=1e-7, max_sweeps=20000)
    stepper = Stepper(
        grid,
        Material(1500.0, 2.0),
        Walls({"z_min": Wall("friction", wall)}),
        gravity=gravity,
        options=options,
    )
    after, _ = run(stepper, state, 24)
    mean = float(after.volumes @ after.velocities[:, 0] / np.sum(after.volumes))
    expected = max(0.0, (slope - wall) * 9.81 / np.hypot(slope, 1.0)) * 24 * DT
    assert mean == pytest.approx(expected, abs=0.01)
    assert (mean > 0.03) == slides


def test_gravity_along_any_axis_gives_the_same_fall():
    grid = grid_of((10, 10))
    falls = []
    for direction in ([0.0, -1.0], [-1.0, 0.0], [0.6, 0.8]):
        state = fill_box(grid, [0.2, 0.2], [0.3, 0.3], 2, MATERIAL)
        after, _ = run(Stepper(grid, MATERIAL, Walls(), gravity=9.81 * np.array(direction)), state, 8)
        falls.append((after.positions - state.positions) @ direction)
    np.testing.assert_allclose(np.array(falls), 9.81 * DT**2 * 36, rtol=1e-6)


def everything(warm_start: str, stress: str, velocity: str, transfer: str) -> tuple[Stepper, State]:
    grid = grid_of((12, 8))
    materials = [
        Material(
            1500.0, 0.5, cohesion=20.0, cohesion_decay=2.0, anisotropy=0.4, viscosity=0.5, dilatancy=0.1
        ),
        Material(2500.0, 0.3, friction_increment=0.3, grain_diameter=1e-3, anisotropy=0.4, shear_yield=5.0),
    ]
    parts = [
        fill_box(grid, [0.0, 0.0], [0.2, 0.1], 2, materials[0]),
        fill_box(grid, [0.0, 0.1], [0.2, 0.25], 2, materials[1]),
    ]
    state = joined([replace(part, orientations=aligned([0.0, 1.0], part.particle_count)) for part in parts])
    options = Options(
        stress=stress, velocity=velocity, warm_start=warm_start, transfer=transfer,
        resampling=Resampling(split_ratio=1.8, merge_ratio=1.4),
    )  # fmt: skip
    bodies = [
        Body(
            Sphere(0.06, dimension=2), density=2000.0, position=[0.12, 0.31], velocity=[0.2, -1.0], spin=3.0
        ),
        Body(Box([0.04, 0.05]), motion=Fixed(), position=[0.4, 0.03], friction=0.4),
    ]
    walls = Walls({"z_min": Wall("friction", 0.4), "x_max": Wall("open")})
    return Stepper(grid, materials, walls, options=options, bodies=bodies), state


@pytest.mark.parametrize(
    ("warm_start", "stress", "velocity", "transfer"),
    [
        ("grid", "Q1", "Q1", "apic"),
        ("particles", "Q1d", "B2", "apic"),
        ("grid", "particles", "Q1", "flip"),
        ("grid", "P1d", "P1", "pic"),
    ],
)
def test_a_run_with_everything_on_resumes_with_the_same_bytes(warm_start, stress, velocity, transfer):
    stepper, start = everything(warm_start, stress, velocity, transfer)
    straight, records = run(stepper, start, 10)
    half, _ = run(stepper, start, 5)
    copied = {name: array.copy() for name, array in half.arrays().items()}
    resumed, _ = run(everything(warm_start, stress, velocity, transfer)[0], State.from_arrays(copied), 5)
    for name, array in straight.arrays().items():
        assert array.tobytes() == resumed.arrays()[name].tobytes(), name
    assert (
        len(straight.cohesions)
        == len(straight.orientations)
        == len(straight.frames)
        == straight.particle_count
    )
    assert len(straight.bodies) == 2
    assert all(np.isfinite(record.kinetic_energy) for record in records)
    traces = np.trace(straight.orientations, axis1=1, axis2=2)
    np.testing.assert_allclose(traces, 1.0, rtol=1e-9)


def test_a_run_with_everything_on_gives_the_same_bytes_on_one_and_two_threads(bytes_by_threads):
    stepper, start = everything("particles", "Q1d", "B2", "apic")
    one, two = bytes_by_threads(lambda: run(stepper, start, 4)[0].arrays().values())
    assert one == two
