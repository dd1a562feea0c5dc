"""Laws of the two-phase step: rest, settling, energy, mass, incompressibility, its limits, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows import mpm
from barchan.flows.mpm import Material, fill_box
from barchan.flows.suspension import (
    Mixture,
    Options,
    Quadratic,
    RichardsonZaki,
    Side,
    Sides,
    Suspension,
    SuspensionState,
)
from barchan.spaces import RegularGrid

STICK = Side("stick")
TANK = Sides({"z_min": STICK})
GRAVITY = 9.81


def _sand(**given: float) -> Material:
    return Material(**{"density": 2500.0, "friction": 0.5, "max_volume_fraction": 0.6, **given})


def _mixture(
    diameter: float = 5e-4, density: float = 1000.0, viscosity: float = 1e-3, **given: float
) -> Mixture:
    return Mixture(_sand(**given), density, viscosity, diameter)


def _column(
    grid: RegularGrid, mixture: Mixture, upper: tuple[float, ...], share: float = 1.0, per_cell: int = 3
) -> mpm.State:
    grains = fill_box(grid, (0.0,) * grid.dimension, upper, per_cell, mixture.grains)
    return replace(grains, volumes=share * grains.volumes)


def _run(flow: Suspension, state: SuspensionState, steps: int, dt: float) -> tuple[SuspensionState, list]:
    records = []
    for _ in range(steps):
        state, record = flow.advance(state, dt)
        records.append(record)
    return state, records


def test_a_packed_bed_rests_under_its_buoyant_weight_and_a_hydrostatic_pressure() -> None:
    grid = RegularGrid.from_box((0.5, 1.0), (4, 8))
    flow = Suspension(grid, _mixture(), TANK, GRAVITY, Options(grains=mpm.Options(tolerance=1e-7)))
    state, records = _run(flow, flow.at_rest(_column(grid, flow.mixture, (0.5, 0.5))), 10, 0.01)
    assert all(record.converged for record in records)
    # The first step presses the bed together up to the packing tolerance: velocities die out with the tolerance.
    assert records[-1].max_speed < 1e-6 * np.sqrt(GRAVITY * 1.0)
    pressure = state.pressures.reshape(5, 9)
    slope = np.diff(pressure, axis=1) / 0.125
    assert np.allclose(slope, -1000.0 * GRAVITY, rtol=1e-5)
    # Everything that the fluid does not carry goes into the floor: the lowest cells carry the weight above their nodes.
    rows = flow._build(state, 0.01).grains
    stress = rows.rows.at_particles(state.grains.node_stresses)
    vertical = np.einsum("ps,sij->pij", stress, _tensors())[:, 1, 1]
    lowest = state.grains.positions[:, 1] < 0.125
    carried = np.sum((state.grains.volumes * vertical)[lowest]) / 0.125
    above = 1500.0 * GRAVITY * 0.6 * 0.5 * (0.5 - 0.5 * 0.125)
    assert carried == pytest.approx(above, rel=1e-3)


def _tensors() -> np.ndarray:
    from barchan.cones import chi

    return np.array([chi(row) for row in np.eye(3)])


@pytest.mark.parametrize("drag", [RichardsonZaki(), Quadratic()])
def test_a_dilute_layer_settles_at_the_speed_of_its_drag(drag: RichardsonZaki | Quadratic) -> None:
    grid = RegularGrid.from_box((0.05, 0.2), (4, 16))
    mixture = replace(_mixture(diameter=1e-4), drag=drag)
    flow = Suspension(grid, mixture, Sides(), GRAVITY)
    grains = fill_box(grid, (0.0, 0.1), (0.05, 0.15), 3, mixture.grains)
    phi = 0.05
    grains = replace(grains, volumes=phi / 0.6 * grains.volumes)
    state, _ = _run(flow, flow.at_rest(grains), 10, 0.02)
    inside = np.abs(state.grains.positions[:, 1] - np.mean(state.grains.positions[:, 1])) < 0.01
    speed = -np.mean(state.grains.velocities[inside, 1])
    expected = float(mixture.settling_velocity(phi, GRAVITY))
    assert speed == pytest.approx(expected, rel=0.02)
    if isinstance(drag, RichardsonZaki):
        assert expected == pytest.approx(
            mixture.terminal_velocity(GRAVITY) * (1 - phi) ** drag.exponent, rel=1e-12
        )


@pytest.mark.parametrize("model", ["two_phase", "darcy"])
def test_energy_falls_mass_stays_and_the_volume_average_has_no_divergence(model: str) -> None:
    grid = RegularGrid.from_box((0.4, 0.2), (16, 8))
    flow = Suspension(grid, _mixture(), TANK, GRAVITY, Options(model=model))  # type: ignore[arg-type]
    start = flow.at_rest(_column(grid, flow.mixture, (0.1, 0.15)))
    state, records = _run(flow, start, 40, 0.005)
    energy = np.array([r.kinetic_grains + r.kinetic_fluid + r.potential_energy for r in records])
    if model == "darcy":
        energy = np.array([r.potential_energy for r in records])
    assert np.all(np.diff(energy) <= 1e-9 * energy[0])
    assert all(record.converged and record.residual <= 1e-4 for record in records)
    assert max(record.divergence for record in records) < 1e-6
    assert np.sum(state.grains.volumes) == pytest.approx(np.sum(start.grains.volumes), rel=1e-12)
    assert np.mean(state.grains.positions[:, 0]) > np.mean(start.grains.positions[:, 0])


def test_a_symmetric_heap_spreads_symmetrically() -> None:
    grid = RegularGrid.from_box((0.4, 0.2), (16, 8))
    flow = Suspension(grid, _mixture(), TANK, GRAVITY, Options(grains=mpm.Options(tolerance=1e-10)))
    grains = fill_box(grid, (0.15, 0.0), (0.25, 0.15), 3, flow.mixture.grains)
    state, _ = _run(flow, flow.at_rest(grains), 5, 0.005)
    u = state.fluid_velocities.reshape(17, 9, 2)
    scale = np.max(np.abs(u))
    assert np.allclose(u[::-1, :, 0], -u[:, :, 0], atol=1e-5 * scale)
    assert np.allclose(u[::-1, :, 1], u[:, :, 1], atol=1e-5 * scale)


def test_the_splitting_error_falls_with_the_step() -> None:
    grid = RegularGrid.from_box((0.2, 0.1), (8, 4))
    mixture = _mixture(diameter=2e-3, viscosity=1.0)
    grains = mpm.Options(tolerance=1e-6, max_sweeps=100_000)
    gaps = []
    for steps in (2, 4):
        found = []
        for solution in ("two_step", "coupled"):
            flow = Suspension(grid, mixture, TANK, GRAVITY, Options(grains=grains, solution=solution))  # type: ignore[arg-type]
            state, records = _run(flow, flow.at_rest(_column(grid, mixture, (0.1, 0.1))), steps, 0.04 / steps)
            assert all(record.converged for record in records)
            found.append(state.grains.positions)
        gaps.append(float(np.max(np.abs(found[0] - found[1]))))
    moved = float(np.max(np.abs(found[0] - _column(grid, mixture, (0.1, 0.1)).positions)))
    assert gaps[1] < 0.7 * gaps[0] < 0.35 * moved


def test_a_penalised_pressure_tends_to_the_incompressible_one() -> None:
    grid = RegularGrid.from_box((0.4, 0.2), (16, 8))
    reached = []
    for penalty in (1e-6, 1e-8):
        options = Options(pressure="penalised", penalty=penalty)
        flow = Suspension(grid, _mixture(), TANK, GRAVITY, options)
        _, records = _run(flow, flow.at_rest(_column(grid, flow.mixture, (0.1, 0.15))), 5, 0.005)
        assert all(record.converged for record in records)
        reached.append(records[-1].divergence)
    assert reached[1] < 0.05 * reached[0]


def test_a_thin_fluid_leaves_the_dry_column_alone() -> None:
    grid = RegularGrid.from_box((0.6, 0.2), (24, 8))
    sand = _sand(friction=0.4)
    mixture = Mixture(sand, 1e-3, 1e-9, 5e-3)  # alpha and St both beyond 1e6
    grains = fill_box(grid, (0.0, 0.0), (0.1, 0.15), 3, sand)
    flow = Suspension(grid, mixture, Sides({"z_min": STICK, "z_max": Side("open")}), GRAVITY)
    state, _ = _run(flow, flow.at_rest(grains), 80, 0.004)
    walls = mpm.Walls({"z_min": mpm.Wall("stick")})
    stepper = mpm.Stepper(grid, sand, walls, GRAVITY, mpm.Options())
    dry = grains
    for _ in range(80):
        dry, _ = stepper.advance(dry, 0.004)
    fronts = [float(np.quantile(s.positions[:, 0], 0.995)) - 0.1 for s in (state.grains, dry)]
    assert fronts[0] == pytest.approx(fronts[1], rel=0.03)


def test_a_trace_of_grains_does_not_change_the_fluid() -> None:
    grid = RegularGrid.from_box((1.0, 1.0), (16, 16))
    sides = Sides(
        {"x_min": STICK, "x_max": STICK, "z_min": STICK, "z_max": Side("stick", velocity=(1.0, 0.0))}
    )
    found = []
    for share in (1e-4, 1e-9):
        mixture = _mixture(diameter=1e-3, viscosity=10.0)
        flow = Suspension(grid, mixture, sides, 0.0)
        state, records = _run(flow, flow.at_rest(_column(grid, mixture, (1.0, 1.0), share, 1)), 20, 0.05)
        assert max(record.divergence for record in records) < 1e-6
        found.append(state.fluid_velocities)
    assert np.max(np.abs(found[1])) == pytest.approx(1.0)
    assert np.max(np.abs(found[0] - found[1])) < 1e-3


def test_a_state_written_and_read_again_continues_with_the_same_bytes() -> None:
    grid = RegularGrid.from_box((0.4, 0.2), (16, 8))
    flow = Suspension(grid, _mixture(), TANK, GRAVITY)
    state, _ = _run(flow, flow.at_rest(_column(grid, flow.mixture, (0.1, 0.15))), 3, 0.005)
    again = SuspensionState.from_arrays(state.arrays())
    for one, two in zip(
        flow.advance(state, 0.005)[0].arrays().values(),
        flow.advance(again, 0.005)[0].arrays().values(),
        strict=True,
    ):
        assert np.array_equal(one, two)


def test_grains_leave_a_frictional_wall_and_fluid_takes_their_place() -> None:
    grid = RegularGrid.from_box((0.4, 0.2), (16, 8))
    sides = Sides({"z_min": STICK, "x_min": Side("friction", friction=0.3)})
    flow = Suspension(grid, _mixture(), sides, GRAVITY)
    state, records = _run(flow, flow.at_rest(_column(grid, flow.mixture, (0.1, 0.15))), 30, 0.005)
    assert all(record.converged for record in records)
    wall = np.flatnonzero(grid.on_face(np.arange(grid.node_count), 0, False))
    grains = np.zeros((grid.node_count, 2))
    grains[state.grains.node_ids] = state.grains.node_velocities
    assert np.max(grains[wall, 0]) > 1e-3
    assert np.min(grains[wall, 0]) > -1e-4
    assert np.min(state.fluid_velocities[wall, 0]) < -1e-3


def _in_a_tank(
    mixture: Mixture, sides: dict[str, Side] | None = None, cells: tuple[int, int] = (4, 4)
) -> Suspension:
    return Suspension(RegularGrid.from_box((1.0, 1.0), cells), mixture, sides or {})


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("max_volume_fraction", lambda: _mixture(max_volume_fraction=1.0)),
        ("fluid_viscosity", lambda: _mixture(viscosity=-1.0)),
        ("grain_diameter", lambda: _in_a_tank(_mixture(diameter=0.3))),
        ("sides", lambda: _in_a_tank(_mixture(), {"x_min": Side(velocity=(1.0, 0.0))})),
        ("grid.cells", lambda: _in_a_tank(_mixture(), cells=(5, 4))),
        ("options.grains.velocity", lambda: Options(grains=mpm.Options(velocity="B2"))),
        ("options.model", lambda: Options(model="porous")),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_bad_input_is_named(field: str, make) -> None:
    with pytest.raises(InputError, match=field.replace(".", r"\.")):
        make()


def test_rising_grains_are_announced_and_rise() -> None:
    grid = RegularGrid.from_box((0.2, 0.2), (8, 8))
    flow = Suspension(grid, _mixture(density=3000.0), TANK, GRAVITY)
    assert any("rise" in note for note in flow.notes)
    grains = _column(grid, flow.mixture, (0.2, 0.1), 0.5)
    state, records = _run(flow, flow.at_rest(grains), 5, 0.01)
    assert np.mean(state.grains.positions[:, 1]) > np.mean(grains.positions[:, 1])
    assert all(record.converged for record in records)


def test_three_dimensions_step_with_a_certificate() -> None:
    grid = RegularGrid.from_box((0.2, 0.1, 0.1), (8, 4, 4))
    flow = Suspension(grid, _mixture(), TANK, GRAVITY)
    state, records = _run(flow, flow.at_rest(_column(grid, flow.mixture, (0.1, 0.1, 0.075), 1.0, 2)), 5, 0.01)
    assert all(record.converged and record.divergence < 1e-6 for record in records)
    energy = [r.kinetic_grains + r.kinetic_fluid + r.potential_energy for r in records]
    assert np.all(np.diff(energy) < 0.0)
    assert np.mean(state.grains.velocities[:, 0]) > 0.0
