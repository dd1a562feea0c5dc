"""Soft spheres obey the laws of mechanics: sliding, rolling, energy, momentum, periodic images, restart."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.rigid import Body, Box, Fixed, Free, HalfSpace, Sphere
from barchan.bodies.soft import (
    Cell,
    Hertzian,
    Hookean,
    Piston,
    SoftSpheres,
    SoftState,
    Wall,
    from_bodies,
    lattice_packing,
)
from barchan.bodies.soft import workspace as workspaces
from barchan.bodies.soft.cell import CellState, cell_rows, wrap
from barchan.bodies.soft.neighbours import find_neighbours
from barchan.errors import InputError

LAW = Hookean.of_restitution(1e5, 0.5)


def poured(dimension: int, law=LAW, count: int = 60, **more) -> tuple[SoftSpheres, SoftState]:  # type: ignore[no-untyped-def]
    """Grains thrown into a box without lid."""
    rng = np.random.default_rng(1)
    radii = rng.uniform(0.04, 0.06, count)
    upper = np.full(dimension, 0.5)
    upper[-1] = 2.2 if dimension == 2 else 1.0
    sides = [
        Wall(s * np.eye(dimension)[k], 0.0 if s > 0 else -0.5) for k in range(dimension - 1) for s in (1, -1)
    ]
    gravity = -9.81 * np.eye(dimension)[-1]
    spheres = SoftSpheres(radii, 1000.0, law, 0.5, [*sides, Wall(np.eye(dimension)[-1])], gravity, **more)
    places = lattice_packing(radii, np.zeros(dimension), upper, 1)
    return spheres, spheres.start(places, rng.normal(0.0, 0.3, places.shape))


@pytest.mark.parametrize(("dimension", "rolls_at"), [(2, 2.0 / 3.0), (3, 5.0 / 7.0)])
@pytest.mark.parametrize("law", [Hookean.of_restitution(1e6, 0.3), Hertzian.of_restitution(1e8, 0.3)])
def test_a_grain_thrown_along_a_wall_slides_and_then_rolls(
    dimension: int, rolls_at: float, law: Hookean | Hertzian
) -> None:
    """Friction mu g slows it down until it rolls at 2/3 (disc) or 5/7 (ball) of its first speed."""
    up, along = np.eye(dimension)[-1], np.eye(dimension)[0]
    spheres = SoftSpheres([0.1], 1000.0, law, 0.3, [Wall(up, friction=0.3)], -9.81 * up)
    resting = spheres.advance(spheres.start([0.1 * up]), 2e-5, 20000)
    sinks = 0.1 - resting.bodies.positions[0, -1]
    assert 0.0 < sinks < 1e-3
    state = spheres.start(resting.bodies.positions, [along])
    state = spheres.advance(state, 2e-5, 2500)
    assert state.bodies.velocities[0, 0] == pytest.approx(1.0 - 0.3 * 9.81 * 0.05, rel=2e-3)
    state = spheres.advance(state, 2e-5, 12500)
    speed = float(state.bodies.velocities[0, 0])
    assert speed == pytest.approx(rolls_at, rel=5e-3)
    spin = state.bodies.spins[0]
    turning = -spin[0] if dimension == 2 else spin[1]
    assert turning * (0.1 - 0.5 * sinks) == pytest.approx(speed, rel=5e-3)


def test_rolling_friction_stops_a_rolling_ball_within_its_law() -> None:
    """A rolling ball slows down by 5/7 mu_r g (the quasi-force acts at R* = R)."""
    up = np.array([0.0, 0.0, 1.0])
    spheres = SoftSpheres(
        [0.1], 1000.0, Hookean.of_restitution(1e6, 0.3), 0.5, [Wall(up)], -9.81 * up, rolling_friction=0.05
    )
    rest = spheres.advance(spheres.start([0.1 * up]), 2e-5, 20000)
    state = spheres.start(rest.bodies.positions, [[1.0, 0.0, 0.0]], [[0.0, 10.0, 0.0]])
    state = spheres.advance(state, 2e-5, 15000)
    assert state.bodies.velocities[0, 0] == pytest.approx(1.0 - 5.0 / 7.0 * 0.05 * 9.81 * 0.3, rel=5e-3)
    state = spheres.advance(state, 2e-5, 250000)
    assert abs(state.bodies.velocities[0, 0]) < 1e-6


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("rolling", [0.0, 0.1])
def test_the_books_of_energy_close_as_the_step_goes_to_zero(dimension: int, rolling: float) -> None:
    errors = []
    for share in (1.0 / 50.0, 1.0 / 200.0):
        spheres, state = poured(dimension, count=30, rolling_friction=rolling)
        before, dt = spheres.energy(state), spheres.time_step(share=share)
        state = spheres.advance(state, dt, round(0.4 / dt))
        after = spheres.energy(state)
        errors.append(abs(after.total - before.total) / after.dissipated)
    assert after.dissipated > 0.5 * before.translation
    assert errors[1] < 0.5 * errors[0] and errors[1] < 0.01


def test_grains_in_a_periodic_box_keep_their_momentum_to_rounding() -> None:
    rng = np.random.default_rng(3)
    radii = rng.uniform(0.04, 0.05, 300)
    spheres = SoftSpheres(
        radii, 1.0, Hookean.of_restitution(1e3, 0.8), 0.5, gravity=np.zeros(3), cell=Cell((0.8, 0.8, 0.8))
    )
    places = lattice_packing(radii, np.zeros(3), (0.8, 0.8, 0.8), 5)
    state = spheres.start(places, rng.normal(0.0, 1.0, places.shape))
    momentum = spheres.masses @ state.bodies.velocities
    after = spheres.advance(state, spheres.time_step(), 4000)
    assert after.dissipated > 0.2 * spheres.energy(state).total
    np.testing.assert_allclose(spheres.masses @ after.bodies.velocities, momentum, atol=1e-14)


def brute_pairs(x, radii, skin, rows):  # type: ignore[no-untyped-def]
    found = {}
    for a in range(-2, 3):
        for b in range(-2, 3):
            for c in range(-2, 3):
                shift = np.array([a, b, c]) @ rows[:, :3]
                apart = np.linalg.norm(x[:, None] - x[None] - shift, axis=2)
                for i, j in np.argwhere(apart < radii[:, None] + radii[None] + skin):
                    if i < j:
                        found.setdefault((int(i), int(j)), shift)
    return found


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([2, 3]),
    st.floats(-3.0, 3.0),
    st.integers(0, 1000),
    st.lists(st.booleans(), min_size=3, max_size=3),
)
def test_the_neighbour_list_is_that_of_all_pairs_and_images(
    dimension: int, offset: float, seed: int, periodic: list[bool]
) -> None:
    rng = np.random.default_rng(seed)
    axes = periodic[:dimension]
    sheared = bool(axes[0] and axes[-1])
    cell = Cell(np.full(dimension, 1.0), axes, 1.0 if sheared else 0.0)
    rows = cell_rows(cell, CellState(1.0, 0.0, offset if sheared else 0.0), dimension)
    x = np.zeros((60, 3))
    x[:, :dimension] = rng.uniform(-2.0, 2.0, (60, dimension))
    v = np.zeros_like(x)
    wrap(x, v, rows)
    radii = rng.uniform(0.03, 0.1, 60)
    grains = np.stack([radii, np.ones(60), np.ones(60), np.zeros(60)], axis=1)
    near = find_neighbours(x, grains, 0.05, rows, dimension)
    expected = brute_pairs(x, radii, 0.05, rows)
    assert [tuple(pair) for pair in near.pairs.tolist()] == sorted(expected)
    for (i, j), shift in zip(near.pairs, near.shifts, strict=True):
        np.testing.assert_allclose(shift @ rows[:, :3], expected[i, j], atol=1e-12)


def test_a_grain_that_leaves_a_sheared_cell_comes_back_with_the_velocity_of_its_image() -> None:
    rows = cell_rows(Cell((2.0, 1.0), None, 3.0), CellState(1.0, 0.25, 0.6), 2)
    x, v = np.array([[0.5, 1.2, 0.0], [1.9, -0.1, 0.0]]), np.ones((2, 3))
    wrap(x, v, rows)
    np.testing.assert_allclose(x[:, 1], [0.2, 0.9])
    np.testing.assert_allclose(
        np.exp(1j * np.pi * x[:, 0]), np.exp(1j * np.pi * np.array([0.5 - 0.6, 1.9 + 0.6]))
    )
    place = x[:, 0] - 0.6 * x[:, 1]
    assert np.all((place >= 0.0) & (place < 2.0))
    np.testing.assert_allclose(v[:, 0], [1.0 - 3.0, 1.0 + 3.0])
    np.testing.assert_allclose(v[:, 1], [0.75, 1.25])


def test_uniform_shear_of_a_lattice_is_carried_across_the_cell_without_a_seam() -> None:
    """Grains that move with the flow and never touch keep doing so, however long, and their energy is that of the flow."""
    grid = np.stack(np.meshgrid(np.arange(6) + 0.5, np.arange(6) + 0.5), axis=-1).reshape(-1, 2)
    velocities = np.stack([0.7 * (grid[:, 1] - 3.0), np.zeros(36)], axis=1)
    spheres = SoftSpheres(
        np.full(36, 0.4), 1.0, LAW, 0.5, gravity=np.zeros(2), cell=Cell((6.0, 6.0), None, 0.7)
    )
    state = spheres.advance(spheres.start(grid, velocities), 1e-3, 20000)
    flow = 0.7 * (state.bodies.positions[:, 1] - 3.0)
    np.testing.assert_allclose(state.bodies.velocities[:, 0], flow, atol=1e-9)
    assert state.dissipated == 0.0


def test_a_piston_brings_the_grains_to_its_pressure() -> None:
    rng = np.random.default_rng(0)
    radii = rng.uniform(0.4, 0.6, 80)
    cell = Cell((10.0, 14.0), None, 0.0, Piston(2.0, 5.0, 2.0))
    spheres = SoftSpheres(radii, 1.0, Hookean.of_restitution(2e3, 0.3), 0.3, gravity=np.zeros(2), cell=cell)
    state = spheres.start(lattice_packing(radii, (0.0, 0.0), (10.0, 14.0)))
    state = spheres.advance(state, spheres.time_step(share=0.05), 40000)
    grains, forces = spheres.grains(state)
    stress = forces.forces.T @ forces.branches / (10.0 * state.cell.height)
    assert stress[1, 1] == pytest.approx(2.0, rel=0.01)
    assert state.cell.stress == pytest.approx(stress[1, 1], rel=0.01)
    assert len(grains) == 80


def test_steps_taken_in_parts_and_from_a_stored_state_give_the_same_bytes() -> None:
    spheres, state = poured(3, Hertzian.of_restitution(1e7, 0.6), rolling_friction=0.1)
    dt = spheres.time_step(3.0)
    state = spheres.advance(state, dt, 12000)
    whole = spheres.advance(state, dt, 500)
    middle = spheres.advance(state, dt, 123)
    parts = spheres.advance(SoftState.from_arrays(middle.arrays()), dt, 377)
    for name, value in whole.arrays().items():
        if name == "dissipated":  # a sum, which rounds otherwise in parts
            assert value == pytest.approx(parts.dissipated, rel=1e-12)
        else:
            assert np.array_equal(value, parts.arrays()[name]), name
    assert len(whole.pairs) > 20


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two threads")
def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspaces, "PARALLEL_GRAINS", 0)
    spheres, state = poured(3)
    before, ends = numba.get_num_threads(), []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            ends.append(spheres.advance(state, spheres.time_step(), 3000).arrays())
    finally:
        numba.set_num_threads(before)
    for name, value in ends[0].items():
        assert np.array_equal(value, ends[1][name]), name


def test_the_state_given_is_left_alone_and_reading_forces_changes_nothing() -> None:
    spheres, state = poured(2)
    state = spheres.advance(state, spheres.time_step(), 4000)
    kept = {name: value.copy() for name, value in state.arrays().items()}
    forces = spheres.contacts(state)
    spheres.energy(state)
    spheres.advance(state, spheres.time_step(), 50)
    assert len(forces) > 10
    assert all(np.array_equal(value, kept[name]) for name, value in state.arrays().items())


def test_held_grains_drag_others_along_and_keep_their_motion() -> None:
    """A glued row that moves carries a ball lying on it."""
    row = np.stack([np.arange(-2.0, 12.0), np.zeros(14)], axis=1)
    x = np.concatenate([row, [[2.5, math.sqrt(0.75)]]])
    held = np.arange(15) < 14
    spheres = SoftSpheres(
        np.full(15, 0.5), 1.0, Hookean.of_restitution(1e4, 0.3), 0.8, gravity=(0.0, -1.0), held=held
    )
    v = np.zeros((15, 2))
    v[:14, 0] = 0.1
    v[14, 0] = 0.1
    state = spheres.advance(spheres.start(x, v), spheres.time_step(), 20000)
    np.testing.assert_allclose(state.bodies.velocities[:14], v[:14], atol=0.0)
    assert state.bodies.velocities[14, 0] == pytest.approx(0.1, abs=1e-5)
    grains, forces = spheres.grains(state)
    assert len(grains) == 1 and set(forces.second.tolist()) == {-1}
    np.testing.assert_allclose(forces.forces.sum(axis=0), [0.0, grains.masses[0]], atol=1e-4)


def test_a_wall_that_moves_along_itself_drags_and_one_that_moves_across_pushes() -> None:
    walls = [Wall((0.0, 1.0), 0.0, 0.5, (0.3, 0.0)), Wall((1.0, 0.0), -2.0, 0.0, (0.5, 0.0))]
    spheres = SoftSpheres([0.5], 1.0, Hookean.of_restitution(1e4, 0.3), 0.5, walls[:1], (0.0, -1.0))
    state = spheres.advance(spheres.start([[0.0, 0.5]]), spheres.time_step(), 3000)
    assert state.bodies.velocities[0, 0] > 0.05
    spheres = SoftSpheres([0.5], 1.0, Hookean.of_restitution(1e4, 1.0), 0.5, walls[1:], (0.0, 0.0))
    dt = spheres.time_step()
    state = spheres.advance(spheres.start([[0.0, 0.5]]), dt, math.ceil(3.5 / dt))
    assert state.bodies.velocities[0, 0] == pytest.approx(1.0, rel=0.01)


def test_the_same_bodies_serve_as_soft_spheres() -> None:
    bodies = [
        Body(Sphere(0.1), "ball", 0.4, density=1000.0, position=(0.0, 0.0, 1.0), velocity=(1.0, 0.0, 0.0)),
        Body(HalfSpace((0.0, 0.0, 1.0), 0.2), "floor", 0.3, position=(0.0, 0.0, -0.5), motion=Fixed()),
        Body(Sphere(0.2), "post", 0.2, motion=Fixed(), position=(3.0, 0.0, 0.0)),
    ]  # fmt: skip
    spheres, state = from_bodies(bodies, LAW, (0.0, 0.0, -9.81))
    assert spheres.masses[0] == pytest.approx(bodies[0].mass)
    assert spheres.moments[0] == pytest.approx(bodies[0].principal_moments[0])
    assert spheres.held.tolist() == [False, True]
    assert spheres.walls[0].offset == pytest.approx(-0.3) and spheres.walls[0].friction == 0.3
    np.testing.assert_allclose(state.bodies.velocities[0], [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="Sphere"):
        from_bodies([Body(Box((1.0, 1.0, 1.0)), density=1.0)], LAW, (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="held"):
        from_bodies([Body(Sphere(1.0), density=1.0, motion=Free(held=("x",)))], LAW, (0.0, 0.0, 0.0))


def test_grains_that_start_inside_one_another_are_named() -> None:
    spheres = SoftSpheres(np.full(3, 0.5), 1.0, LAW, gravity=(0.0, -1.0), walls=[Wall((0.0, 1.0))])
    with pytest.raises(InputError, match=r"grains 0 and 2 overlap by 0\.6"):
        spheres.start([[0.0, 1.0], [2.0, 1.0], [0.4, 1.0]])
    with pytest.raises(InputError, match=r"grain 1 is 0\.7 m deep in wall 0"):
        spheres.start([[0.0, 1.0], [2.0, -0.2], [4.0, 1.0]])


def test_a_step_too_long_for_the_contacts_is_refused_with_the_pair() -> None:
    spheres = SoftSpheres(np.full(2, 0.5), 1.0, Hookean(1e2), gravity=(0.0, 0.0))
    state = spheres.start([[0.0, 0.0], [1.1, 0.0]], [[9.0, 0.0], [-9.0, 0.0]])
    with pytest.raises(InputError, match=r"dt = .* grains 0 and 1"):
        spheres.advance(state, 0.01, 6)


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ({"radii": [0.0, 1.0]}, "radii"),
        ({"densities": -1.0}, "radii"),
        ({"friction": -0.1}, "friction"),
        ({"contact": 3.0}, "contact"),
        ({"gravity": (1.0,)}, "gravity"),
        ({"held": [True]}, "held"),
        ({"rolling_friction": -1.0}, "rolling_friction"),
        ({"walls": [Wall((0.0, 0.0, 1.0))]}, "walls"),
        ({"cell": Cell((1.0, 1.0, 1.0))}, "cell"),
    ],
)
def test_bad_input_is_named(more: dict[str, object], field: str) -> None:
    given_ = {"radii": [1.0, 1.0], "densities": 1.0, "contact": LAW, "gravity": (0.0, -1.0)} | more
    with pytest.raises(InputError) as caught:
        SoftSpheres(**given_)  # type: ignore[arg-type]
    assert caught.value.field == field


def test_bad_cells_and_steps_are_named() -> None:
    for make, field in (
        (lambda: Cell((1.0, -1.0)), "cell.lengths"),
        (lambda: Cell((1.0, 1.0), (False, True), 1.0), "cell.shear_rate"),
        (lambda: Cell((1.0, 1.0), (False, True), 0.0, Piston(1.0, 1.0, 1.0)), "cell.piston"),
        (lambda: Piston(0.0, 1.0, 1.0), "cell.piston.pressure"),
        (lambda: Wall((0.0, 0.0)), "wall.normal"),
        (lambda: lattice_packing([1.0, 1.0], (0.0, 0.0), (2.0, 2.0)), "upper"),
    ):
        with pytest.raises(InputError) as caught:
            make()
        assert caught.value.field == field
    small = SoftSpheres([0.5, 0.5], 1.0, LAW, gravity=(0.0, 0.0), cell=Cell((2.0, 20.0)))
    with pytest.raises(InputError, match=r"cell.lengths = 2.0"):
        small.start([[0.5, 0.5], [1.5, 3.0]])
    spheres, state = poured(2)
    for dt, steps in ((0.0, 1), (1e-5, -1), (1e-5, 1.5)):
        with pytest.raises(InputError):
            spheres.advance(state, dt, steps)  # type: ignore[arg-type]
