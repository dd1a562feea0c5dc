"""What matter is made of: several materials, cohesion and its decay, yield stresses, dilatancy, plates, viscosity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stepping import DT, grid_of, run

from barchan.cones import chi
from barchan.flows.mpm import Material, Options, Stepper, Wall, Walls, fill_box, joined
from barchan.flows.mpm.orientation import aligned, isotropic


@pytest.mark.parametrize("stress", ["Q1", "Q1d", "particles"])
def test_two_materials_weigh_what_they_weigh(stress):
    grid, light, heavy = grid_of((6, 8)), Material(1000.0, 0.4), Material(3000.0, 0.8)
    state = joined(
        [fill_box(grid, [0, 0], [0.3, 0.1], 2, light), fill_box(grid, [0, 0.1], [0.3, 0.2], 2, heavy)]
    )
    options = Options(stress=stress, tolerance=1e-8, rest_tolerance=1e-8, max_sweeps=20000)
    stepper = Stepper(grid, [light, heavy], Walls(), options=options)
    assert np.sum(stepper.setting.masses(state)) == pytest.approx(0.3 * 0.1 * (1000 + 3000), rel=1e-12)
    after, records = run(stepper, state, 2)
    assert records[-1].max_speed < 1e-6
    step = stepper._build(after, DT)
    assert np.sum(step.velocity.masses) == pytest.approx(0.3 * 0.1 * 4000, rel=1e-12)
    tensors = chi(step.rows.averages(after.volumes, step.rows.at_particles(step.start[: len(step.rows.ids)])))
    bottom = step.rows.places[:, 1] < 0.04
    mean = np.average(tensors[bottom, 1, 1], weights=step.rows.volumes[bottom])
    assert 0.7 * 0.4e3 * 9.81 < mean < 1.1 * 0.4e3 * 9.81
    # Friction coefficients are means over the matter around each row; far from the interface those of one material.
    mu, height = step.rheology.friction, step.rows.places[:, 1]
    assert np.all((mu > 0.4 - 1e-12) & (mu < 0.8 + 1e-12))
    np.testing.assert_allclose(mu[height < 0.04], 0.4, rtol=1e-12)
    np.testing.assert_allclose(mu[height > 0.16], 0.8, rtol=1e-12)
    if stress == "Q1":
        np.testing.assert_allclose(mu[np.isclose(height, 0.1)], 0.6, rtol=1e-9)


def test_a_heavy_block_hits_a_light_one_and_momentum_stays():
    grid, light, heavy = grid_of((12, 12)), Material(1000.0, 0.4), Material(3000.0, 0.6)
    state = joined(
        [fill_box(grid, [0.1, 0.1], [0.4, 0.3], 2, light), fill_box(grid, [0.2, 0.35], [0.4, 0.5], 2, heavy)]
    )
    moving = replace(state, velocities=np.where(state.materials[:, None] == 1, [0.3, -2.0], [0.0, 0.0]))
    stepper = Stepper(grid, [light, heavy], Walls(), gravity=0.0)
    before = stepper.setting.masses(moving) @ moving.velocities
    after, _ = run(stepper, moving, 12)
    momentum = stepper.setting.masses(after) @ after.velocities
    np.testing.assert_allclose(momentum, before, rtol=1e-9)
    lower = after.materials == 0
    assert np.mean(after.velocities[lower, 1]) < -0.1
    energy = [np.sum(stepper.setting.masses(s) * np.sum(s.velocities**2, axis=1)) for s in (moving, after)]
    assert energy[1] < energy[0]


def column(material: Material, stress: str, steps: int = 40, height: int = 4):
    """Drop of the highest particle, and the state, of a free standing column 3 cells wide, on a floor that it sticks to."""
    grid = grid_of((9, 6))
    state = fill_box(grid, [0.15, 0.0], [0.3, 0.05 * height], 3, material)
    stepper = Stepper(grid, material, Walls.cuve(2), options=Options(stress=stress, tolerance=1e-5))
    after, records = run(stepper, state, steps)
    return float(np.max(state.positions[:, 1]) - np.max(after.positions[:, 1])), after, records


def test_a_column_stands_by_cohesion_and_collapses_without():
    # Plane strain: a vertical face of height H stands if rho g H <= 4 k, k = mu c being the strength in pure shear.
    weight = 1500 * 9.81 * 0.2
    fallen, _, _ = column(Material(1500.0, 0.5), "particles")
    stood, after, records = column(Material(1500.0, 0.5, cohesion=2.0 * weight), "particles")
    assert fallen > 0.03
    assert stood < 0.002
    assert records[-1].max_speed < 0.02
    assert len(after.cohesions) == 0


def test_a_block_below_its_critical_height_stands_by_its_yield_stress_alone():
    weight = 1500 * 9.81 * 0.2
    stood, _, _ = column(
        Material(1500.0, 0.0, shear_yield=1.0 * weight, tensile_yield=0.2 * weight), "particles"
    )
    fallen, _, _ = column(Material(1500.0, 0.0, shear_yield=0.05 * weight), "particles")
    assert stood < 0.002
    assert fallen > 0.03


def test_cohesive_matter_hangs_from_a_ceiling_it_sticks_to():
    grid, weight = grid_of((6, 6)), 1500 * 9.81 * 0.1
    drops = {}
    for cohesion in (0.0, 3.0 * weight):
        material = Material(1500.0, 0.6, cohesion=cohesion)
        state = fill_box(grid, [0.1, 0.2], [0.2, 0.3], 3, material)
        walls = Walls({"z_max": Wall("stick")})
        after, _ = run(Stepper(grid, material, walls, options=Options(stress="particles")), state, 24)
        drops[cohesion] = float(np.max(state.positions[:, 1] - after.positions[:, 1]))
    assert drops[0.0] > 0.03
    assert drops[3.0 * weight] < 0.002


def test_cohesion_decays_where_matter_deforms_as_its_law_says():
    weight, material = 1500 * 9.81 * 0.2, Material(1500.0, 0.3, cohesion=20.0, cohesion_decay=3.0)
    grid = grid_of((9, 6))
    state = fill_box(grid, [0.15, 0.0], [0.3, 0.2], 3, material)
    stepper = Stepper(grid, material, Walls.cuve(2), options=Options(stress="Q1d"))
    state = stepper.started(state)
    expected = np.ones(state.particle_count)
    np.testing.assert_array_equal(state.cohesions, expected)
    for _ in range(10):
        state, _ = stepper.advance(state, DT)
        rates = 0.5 * (state.affine + state.affine.swapaxes(1, 2))
        expected *= np.exp(-3.0 * DT * np.sqrt(0.5 * np.sum(rates**2, axis=(1, 2))))
    np.testing.assert_allclose(state.cohesions, expected, rtol=1e-10)
    assert np.min(state.cohesions) < 0.9
    assert weight > 20.0


@pytest.mark.parametrize(("stress", "share"), [("Q1", 0.3), ("Q1d", 0.3), ("particles", 0.75)])
def test_broken_contacts_do_not_attract(stress, share):
    """A loose cloud flies as it does without cohesion, and its energy does not grow (seed B, Remark 7.1).

    Stresses of the grid see whether half-cells are full: one particle in the corner of its half may look packed.
    """
    grid = grid_of((12, 12))
    ends = []
    for cohesion in (0.0, 1e4):
        material = Material(1500.0, 0.5, cohesion=cohesion)
        state = fill_box(grid, [0.2, 0.2], [0.35, 0.4], 2, material)
        # Matter at a share of its density, flying apart.
        loose = replace(
            state,
            volumes=share * state.volumes,
            velocities=2.0 * (state.positions - [0.275, 0.3]) + [0.0, 0.5],
        )
        stepper = Stepper(
            grid, material, Walls(), gravity=0.0, options=Options(stress=stress, volume_correction=0.0)
        )
        after, records = run(stepper, loose, 6)
        ends.append(after)
        energy = np.array([record.kinetic_energy for record in records])
        assert np.all(np.diff(energy) <= 1e-9 * energy[0])
        assert records[-1].total_volume == pytest.approx(np.sum(loose.volumes), rel=1e-14)
    np.testing.assert_allclose(ends[1].positions, ends[0].positions, atol=1e-12)
    np.testing.assert_allclose(ends[1].velocities, ends[0].velocities, atol=1e-10)


@pytest.mark.parametrize("stress", ["Q1d", "particles"])
def test_cohesive_matter_torn_apart_loses_energy(stress):
    grid, material = grid_of((12, 12)), Material(1500.0, 0.5, cohesion=200.0)
    state = fill_box(grid, [0.15, 0.2], [0.4, 0.35], 2, material)
    torn = replace(state, velocities=3.0 * (state.positions - state.positions.mean(axis=0)) * [1.0, 0.2])
    stepper = Stepper(grid, material, Walls(), gravity=0.0, options=Options(stress=stress, transfer="pic"))
    _, records = run(stepper, torn, 15)
    energy = np.array([record.kinetic_energy for record in records])
    assert np.all(np.diff(energy) <= 1e-9 * energy[0])
    free = Stepper(
        grid, Material(1500.0, 0.5), Walls(), gravity=0.0, options=Options(stress=stress, transfer="pic")
    )
    _, without = run(free, torn, 15)
    assert energy[0] < without[0].kinetic_energy


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("dilatancy", [0.0, 0.2, 0.5])
def test_yielding_matter_grows_by_its_dilatancy(d, dilatancy):
    """Where matter is loaded and sheared Tr D = 2 zeta |Dev D|, |Dev D|^2 = Dev D:Dev D / 2."""
    grid = grid_of((8, 6)) if d == 2 else grid_of((8, 3, 4))
    material = Material(1500.0, 0.5, dilatancy=dilatancy)
    state = fill_box(grid, np.zeros(d), np.append([0.4, 0.15][: d - 1], 0.15), 2, material)
    state = replace(state, velocities=np.outer(4.0 * state.positions[:, -1], np.eye(d)[0]))
    options = Options(stress="particles", tolerance=1e-10, max_sweeps=40000, multilevel=False)
    stepper = Stepper(grid, material, Walls({"z_min": Wall("stick")}), options=options)
    step = stepper._build(stepper.started(state), DT)
    solution = stepper._solve(stepper.started(state), step)
    v = solution.v.reshape(-1, d)
    _, slopes = step.velocity.to_particles(v)
    rates = 0.5 * (slopes + slopes.swapaxes(1, 2))
    trace = np.trace(rates, axis1=1, axis2=2)
    deviators = rates - trace[:, None, None] * np.eye(d) / d
    norm = np.sqrt(0.5 * np.sum(deviators**2, axis=(1, 2)))
    pressure = np.sqrt(2.0 / d) * solution.r.reshape(len(step.start), -1)[: len(step.rows.ids), 0]
    yielding = (pressure > 0.05 * np.max(pressure)) & (norm > 0.05 * np.max(norm))
    assert np.count_nonzero(yielding) > 10
    np.testing.assert_allclose(trace[yielding], 2.0 * dilatancy * norm[yielding], atol=2e-3 * np.max(norm))
    assert np.all(trace >= 2.0 * dilatancy * norm - 1e-3 * np.max(norm))


def sheared(material: Material, orientations: np.ndarray | None, steps: int = 40) -> float:
    """How far a collapsing column has spread."""
    grid = grid_of((16, 6), 0.04)
    state = fill_box(grid, [0.0, 0.0], [0.2, 0.2], 2, material)
    if orientations is not None:
        state = replace(state, orientations=orientations[: state.particle_count])
    stepper = Stepper(grid, material, Walls.cuve(2), options=Options(tolerance=1e-7, max_sweeps=20000))
    after, _ = run(stepper, state, steps)
    return float(np.mean(after.positions[:, 0]))


def test_grains_without_direction_flow_as_if_friction_had_none_and_aligned_ones_slide_further():
    plain = sheared(Material(1500.0, 0.6), None)
    still = Material(1500.0, 0.6, anisotropy=0.6, elongation=0.0)
    count = 4 * 25
    assert sheared(still, isotropic(count, 2), 6) == pytest.approx(
        sheared(Material(1500.0, 0.6), None, 6), abs=1e-6
    )
    flat = sheared(Material(1500.0, 0.6, anisotropy=0.6), aligned([0.0, 1.0], count))
    assert flat > plain + 0.005


def test_viscosity_slows_shear_and_does_not_slow_a_rigid_motion():
    grid = grid_of((12, 12))
    for velocity in ("Q1", "B2"):
        speeds = {}
        for eta in (0.0, 200.0):
            material = Material(1000.0, 0.0, viscosity=eta)
            state = fill_box(grid, [0.2, 0.2], [0.4, 0.4], 2, material)
            arms = state.positions - 0.3
            turning = replace(
                state, velocities=2.0 * arms @ np.array([[0.0, 1.0], [-1.0, 0.0]]),
                affine=np.tile(2.0 * np.array([[0.0, -1.0], [1.0, 0.0]]), (state.particle_count, 1, 1)),
            )  # fmt: skip
            stepper = Stepper(
                grid,
                material,
                Walls(),
                gravity=0.0,
                options=Options(velocity=velocity, volume_correction=0.0),
            )
            after, _ = run(stepper, turning, 4, 1e-3)
            speeds[eta] = float(np.sum(after.velocities**2))
        assert speeds[200.0] == pytest.approx(speeds[0.0], rel=1e-3)
        fast = {}
        for eta in (0.0, 200.0):
            material = Material(1000.0, 0.0, viscosity=eta)
            state = fill_box(grid, [0.2, 0.2], [0.4, 0.4], 2, material)
            slopes = np.tile(np.array([[0.0, 2.0], [0.0, 0.0]]), (state.particle_count, 1, 1))
            shear = replace(
                state, velocities=np.outer(2.0 * (state.positions[:, 1] - 0.3), [1.0, 0.0]), affine=slopes
            )
            stepper = Stepper(grid, material, Walls(), gravity=0.0, options=Options(velocity=velocity))
            after, _ = run(stepper, shear, 10, 1e-3)
            fast[eta] = float(np.sum(after.velocities**2))
        assert fast[200.0] < 0.8 * fast[0.0]
