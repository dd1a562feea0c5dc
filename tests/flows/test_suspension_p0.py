"""The mesh-based two-phase model: laws of the whole step, and of each of its parts (seed B, chapter 8 and 8.3.4)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.flows.dry import Boundary as DryBoundary
from barchan.flows.dry import DryFlow
from barchan.flows.dry import Options as DryOptions
from barchan.flows.dry.cells import Cells
from barchan.flows.mpm.material import Material
from barchan.flows.suspension.drag import CarmanKozeny, Quadratic, RichardsonZaki
from barchan.flows.suspension.mixture import Mixture
from barchan.flows.suspension.p0 import Boundary, Options, SuspensionFlow, SuspensionRecord, SuspensionState
from barchan.flows.suspension.p0.boundaries import Sides
from barchan.flows.suspension.p0.fluxes import VolumeFluxes, carried_by
from barchan.flows.suspension.viscosity import Einstein
from barchan.friction import certify
from barchan.friction import solve as solve_friction
from barchan.spaces.meshes import box, rectangle

WATER = 1000.0
SAND = Material(2500.0, 0.5, max_volume_fraction=0.6)
FLOOR = {"bottom": Boundary("no_slip")}
G = 9.81


def mixture(diameter: float = 5e-4, material: Material = SAND, **given: Any) -> Mixture:
    """Sand in water."""
    return Mixture(
        material, **{"fluid_density": WATER, "fluid_viscosity": 1e-3, "grain_diameter": diameter, **given}
    )


def tank(
    made_of: Mixture, cells: tuple[int, int] = (20, 10), edge: float = 0.01, options: Options | None = None,
    gravity: Any = G, **walls: Boundary,
) -> SuspensionFlow:  # fmt: skip
    """A closed box of triangles, two in each square of the given edge."""
    mesh = rectangle((0.0, 0.0), (cells[0] * edge, cells[1] * edge), cells)
    return SuspensionFlow(mesh, made_of, {**FLOOR, **walls}, gravity, options)


def run(
    flow: SuspensionFlow, state: SuspensionState, steps: int, dt: float
) -> tuple[SuspensionState, list[SuspensionRecord]]:
    records = []
    for _ in range(steps):
        state, record = flow.advance(state, dt)
        records.append(record)
    return state, records


class TestCollapse:
    @pytest.mark.parametrize(
        ("viscosity", "options"),
        [
            (1e-3, Options()),
            (0.1, Options()),
            (1e-3, Options(model="darcy")),
            (1e-3, Options(inertia="explicit")),
        ],
        ids=["water", "viscous", "darcy", "explicit"],
    )
    def test_a_collapse_keeps_grains_bounds_and_volume_is_certified_and_loses_energy(
        self, viscosity: float, options: Options
    ) -> None:
        flow = tank(mixture(1e-3, fluid_viscosity=viscosity), (16, 8), options=options)
        start = flow.filled(lambda x: (x[:, 0] < 0.06) & (x[:, 1] < 0.06))
        volume = float(np.sum(start.fractions * flow.cells.volumes))
        state, records = run(flow, start, 40, 5e-3)
        assert all(record.converged and record.residual <= 1e-4 for record in records)
        assert max(record.divergence for record in records) < 1e-12
        assert max(record.bilateral_residual for record in records) < 1e-12
        assert max(abs(record.volume / volume - 1.0) for record in records) < 1e-12
        assert min(record.min_volume_fraction for record in records) >= 0.0
        assert max(record.max_volume_fraction for record in records) <= 0.6
        assert max(record.excess for record in records) < 1e-5 * volume
        energy = np.array([record.energy for record in records])
        assert np.max(np.diff(energy)) <= 0.0
        assert state.fractions @ flow.cells.centres[:, 0] > 1.05 * (
            start.fractions @ flow.cells.centres[:, 0]
        )

    def test_the_more_viscous_the_fluid_the_slower(self) -> None:
        fallen = []
        for viscosity in (1e-3, 0.1, 1.0):
            made_of = mixture(1e-3, fluid_viscosity=viscosity, effective_viscosity=Einstein())
            # What a tolerance of 1e-4 leaves over makes matter creep faster than such fluids let it.
            flow = tank(made_of, (12, 6), options=Options(tolerance=1e-6, max_sweeps=100_000))
            start = flow.filled(lambda x: (x[:, 0] < 0.05) & (x[:, 1] < 0.05))
            _, records = run(flow, start, 10, 8e-3)
            assert all(record.converged for record in records)
            fallen.append(records[0].potential_energy - records[-1].potential_energy)
        assert fallen[0] > 1.2 * fallen[1] > 1.2 * fallen[2] > 0.0

    def test_a_fluid_of_nearly_no_weight_leaves_the_dry_collapse(self) -> None:
        """alpha and St to infinity (seed B, 8.2.6): the model of `flows.dry` on the same mesh."""
        light = mixture(5e-3, fluid_density=1e-4, fluid_viscosity=0.0, drag=Quadratic())
        wet = tank(light, options=Options(tolerance=1e-5))
        dry = DryFlow(
            rectangle((0.0, 0.0), (0.2, 0.1), (20, 10)), SAND, {"bottom": DryBoundary("no_slip")}, G,
            DryOptions(tolerance=1e-5, inertia="conservative"),
        )  # fmt: skip
        inside = lambda x: (x[:, 0] < 0.08) & (x[:, 1] < 0.08)  # noqa: E731
        one, other = wet.filled(inside), dry.filled(inside)
        one, _ = run(wet, one, 20, 6e-3)
        for _ in range(20):
            other, _ = dry.advance(other, 6e-3)
        moved = np.sum(np.abs(other.fractions - dry.filled(inside).fractions))
        assert np.sum(np.abs(one.fractions - other.fractions)) < 0.01 * moved

    def test_the_certificate_is_that_of_the_problem_of_the_step(self) -> None:
        flow = tank(mixture(1e-3), (12, 6))
        state, _ = run(flow, flow.filled(lambda x: (x[:, 0] < 0.05) & (x[:, 1] < 0.04)), 3, 4e-3)
        problem = flow.problem(state, 4e-3)
        solution = solve_friction(problem, tol=1e-4)
        certificate = certify(problem, r=solution.r, v=solution.v)
        assert certificate.residual <= 1e-4
        assert certificate.bilateral < 1e-12

    def test_the_state_of_a_checkpoint_goes_on_with_the_same_bytes(self) -> None:
        flow = tank(mixture(1e-3), (12, 6))
        state, _ = run(flow, flow.filled(lambda x: x[:, 0] < 0.05), 4, 4e-3)
        one, _ = flow.advance(state, 4e-3)
        two, _ = flow.advance(SuspensionState.from_arrays(state.arrays()), 4e-3)
        assert all(np.array_equal(a, two.arrays()[name]) for name, a in one.arrays().items())

    def test_a_box_of_tetrahedra_obeys_the_same_laws(self) -> None:
        flow = SuspensionFlow(box((0.0, 0.0, 0.0), (0.04, 0.02, 0.02), (4, 2, 2)), mixture(1e-3), FLOOR)
        start = flow.filled(lambda x: x[:, 0] < 0.02)
        volume = float(np.sum(start.fractions * flow.cells.volumes))
        _, records = run(flow, start, 6, 5e-3)
        assert all(record.converged and record.divergence < 1e-12 for record in records)
        assert records[-1].volume == pytest.approx(volume, rel=1e-12)
        assert np.max(np.diff([record.energy for record in records])) < 0.0


class TestRest:
    def test_after_sedimentation_water_bears_itself_and_grains_their_buoyant_weight(self) -> None:
        flow = tank(mixture(2e-3), (10, 10), 0.02)
        state, records = run(flow, flow.filled(lambda x: x[:, 1] < 0.18, 0.3), 120, 0.01)
        cells, z = flow.cells, flow.cells.centres[:, 1]
        matter = state.fractions * cells.volumes
        assert records[-1].max_grain_speed < 1e-5
        assert np.max(state.fractions) == pytest.approx(
            0.6, rel=0.025
        )  # the packing tolerance of the material
        hydrostatic = WATER * G * (0.1 - cells.mesh.p[1])
        assert np.max(np.abs(state.pressure - hydrostatic)) < 1e-3 * WATER * G * 0.2
        floor = np.where(cells.parts >= 0, np.array(cells.names)[cells.parts] == "bottom", False)
        carried = (state.tractions[..., 0] * np.linalg.norm(cells.faces, axis=2) * state.fractions[:, None])[
            floor
        ]
        weight = 1500.0 * G * np.sum(matter)
        assert np.sum(carried) == pytest.approx(weight, rel=1e-3)
        vertical = state.fractions * (state.stresses[:, 0] - state.stresses[:, 1])  # chi
        for row in range(3):
            here = (z > 0.02 * row) & (z < 0.02 * (row + 1))
            above = np.sum(matter[z > 0.02 * (row + 1)]) + 0.5 * np.sum(matter[here])
            assert np.mean(vertical[here]) == pytest.approx(1500.0 * G * above / 0.2, abs=0.04 * weight / 0.2)

    @pytest.mark.parametrize(
        "drag", [RichardsonZaki(), CarmanKozeny(), Quadratic()], ids=lambda drag: type(drag).__name__
    )
    @pytest.mark.parametrize("phi", [0.02, 0.2])
    def test_a_dilute_layer_settles_at_the_velocity_of_its_closure(self, drag: Any, phi: float) -> None:
        """w_inf (1 - phi)^nu with Richardson and Zaki's drag (seed B, Eq. 8.1)."""
        made_of = mixture(1e-4, drag=drag)
        flow = tank(made_of, (4, 16), 0.02)
        state, _ = run(flow, flow.at_rest(np.full(flow.cells.count, phi)), 15, 5e-3)
        middle = np.abs(flow.cells.centres[:, 1] - 0.18) < 0.06
        expected = float(made_of.settling_velocity(np.array([phi]), G)[0])
        assert state.grains[middle, 1] == pytest.approx(-expected, rel=1e-2)
        if isinstance(drag, RichardsonZaki):
            assert expected == pytest.approx(made_of.terminal_velocity(G) * (1.0 - phi) ** drag.exponent)
        # Nothing flows through a level of a closed vessel.
        assert np.max(np.abs(state.volume_average[middle])) < 1e-2 * expected

    def test_light_grains_rise(self) -> None:
        flow = tank(mixture(2e-3, Material(400.0, 0.5, max_volume_fraction=0.6)), (6, 10))
        start = flow.filled(lambda x: x[:, 1] < 0.05, 0.3)
        state, records = run(flow, start, 80, 0.01)
        height = [s.fractions @ flow.cells.centres[:, 1] / np.sum(s.fractions) for s in (start, state)]
        assert height[1] > height[0] + 0.04
        assert records[-1].energy < records[0].energy


class TestFluid:
    def test_without_grains_the_fluid_is_alone_and_hydrostatic(self) -> None:
        flow = tank(mixture())
        state, records = run(flow, flow.at_rest(np.zeros(flow.cells.count)), 5, 0.01)
        assert records[-1].blocks == 0
        assert records[-1].max_fluid_speed < 1e-12
        assert state.pressure == pytest.approx(WATER * G * (0.05 - flow.cells.mesh.p[1]), abs=1e-8)

    def test_between_plates_the_flow_is_the_parabola_to_first_order(self) -> None:
        """Stokes flow driven by its weight: u = rho g y (H - y) / (2 eta), stress 2 eta D(u)."""
        errors = []
        for n in (6, 12, 24):
            made_of = mixture(1e-3, fluid_density=1.0, fluid_viscosity=1.0)
            ends = {name: Boundary("free") for name in ("left", "right")}
            plates = {name: Boundary("no_slip") for name in ("bottom", "top")}
            mesh = rectangle((0.0, 0.0), (1.5, 0.25), (6 * n, n), diagonals="same")
            flow = SuspensionFlow(mesh, made_of, {**plates, **ends}, (1e-2, 0.0))
            state, _ = run(flow, flow.at_rest(np.zeros(flow.cells.count)), 5, 10.0)
            x, y = flow.cells.centres.T
            middle = np.abs(x - 0.75) < 0.1
            exact = 0.5e-2 * y * (0.25 - y)
            errors.append(np.linalg.norm((state.fluid[:, 0] - exact)[middle]) / np.linalg.norm(exact[middle]))
        assert errors[1] < 0.65 * errors[0]
        assert errors[2] < 0.65 * errors[1]
        assert errors[2] < 0.04

    def test_a_moving_lid_drags_the_fluid_and_gives_it_all_its_energy(self) -> None:
        lid = Boundary("no_slip", velocity=(1.0, 0.0))
        walls = {name: Boundary("no_slip") for name in ("left", "right")}
        flow = tank(
            mixture(1e-3, fluid_density=1.0, fluid_viscosity=0.1),
            (12, 12),
            1 / 12,
            gravity=0.0,
            top=lid,
            **walls,
        )
        state, records = run(flow, flow.at_rest(np.zeros(flow.cells.count)), 60, 0.2)
        z = flow.cells.centres[:, 1]
        assert np.mean(state.fluid[z > 11 / 12, 0]) > 0.4
        assert np.mean(state.fluid[(z > 0.3) & (z < 0.7), 0]) < 0.0
        assert records[-1].fluid_kinetic_energy == pytest.approx(records[-2].fluid_kinetic_energy, rel=1e-4)

    def test_what_a_wall_lets_in_goes_out_where_the_box_is_open(self) -> None:
        parts = {
            "left": Boundary("slip", velocity=(0.3, 0.0)),
            "right": Boundary("free"),
            "bottom": Boundary(),
        }
        flow = tank(mixture(), gravity=0.0, **parts)
        state, records = run(flow, flow.at_rest(np.zeros(flow.cells.count)), 5, 0.05)
        assert state.fluid == pytest.approx(np.tile([0.3, 0.0], (flow.cells.count, 1)), abs=1e-9)
        assert records[-1].divergence < 1e-12

    def test_water_driven_through_a_bed_obeys_darcy(self) -> None:
        """Pressure drop = xi (phi, w) w / (1 - phi) for each length of a bed that walls hold."""
        parts = {
            "left": Boundary("slip", velocity=(1e-3, 0.0)),
            "right": Boundary("slip", velocity=(1e-3, 0.0)),
        }
        made_of = mixture(5e-4, drag=CarmanKozeny())
        flow = tank(made_of, (16, 4), gravity=0.0, options=Options(tolerance=1e-7), **parts)
        packed = 0.6 * (1.0 - SAND.packing_tolerance)
        _, records = run(flow, flow.at_rest(np.full(flow.cells.count, packed)), 6, 0.05)
        xi = float(made_of.drag.coefficient(np.array([packed]), np.zeros(1), made_of)[0])
        drop = xi * 1e-3 / (1.0 - packed) ** 2 * 0.16
        assert records[-1].max_grain_speed < 0.03 * 1e-3
        assert records[-1].pressure_range == pytest.approx(drop, rel=0.02)

    def test_grains_fall_out_through_an_open_floor_and_are_counted(self) -> None:
        opened = {"bottom": Boundary("free"), "top": Boundary("free")}
        flow = tank(mixture(2e-3), (6, 6), **opened)
        start = flow.filled(lambda x: x[:, 1] < 0.03)
        state, records = run(flow, start, 40, 0.01)
        volume = float(np.sum(start.fractions * flow.cells.volumes))
        assert records[-1].volume + state.left == pytest.approx(volume, rel=1e-12)
        assert state.left > 0.9 * volume


def some_fluid(seed: int) -> tuple[Cells, Sides, np.ndarray, np.ndarray, np.ndarray]:
    """A closed box with random fractions, volumes that cross the sides, and velocities."""
    cells = Cells.of(rectangle((0.0, 0.0), (1.0, 1.0), (4, 4)))
    sides = Sides.of(cells, tuple(Boundary() for _ in cells.names))
    random = np.random.default_rng(seed)
    before = random.uniform(0.1, 1.0, cells.count) * cells.volumes
    inner = cells.neighbours >= 0
    # Each side takes a share of the smaller neighbour, with the sign of a random order: nothing is overdrawn.
    order = random.permutation(cells.count)
    own = np.arange(cells.count)[:, None]
    size = 0.3 * np.minimum(before[:, None], before[cells.neighbours])
    crossing = np.where(inner, np.sign(order[own] - order[cells.neighbours]) * size, 0.0)
    return cells, sides, before, crossing, random.normal(size=(cells.count, 2))


class TestTransport:
    @given(seed=st.integers(0, 10_000))
    @settings(max_examples=25, deadline=None)
    def test_transport_keeps_the_momentum_of_the_fluid_and_never_adds_energy(self, seed: int) -> None:
        cells, sides, before, crossing, velocities = some_fluid(seed)
        after = before - np.sum(crossing, axis=1)
        found = carried_by(cells, sides, before, crossing, velocities)
        assert after @ found == pytest.approx(before @ velocities, rel=1e-10, abs=1e-12)
        assert after @ np.sum(found**2, axis=1) <= (1.0 + 1e-12) * (before @ np.sum(velocities**2, axis=1))
        assert np.max(found) <= np.max(velocities) + 1e-12

    @given(seed=st.integers(0, 10_000), opened=st.booleans())
    @settings(max_examples=25, deadline=None)
    def test_fluxes_balance_in_every_cell_and_are_opposite_on_both_sides(
        self, seed: int, opened: bool
    ) -> None:
        cells = Cells.of(rectangle((0.0, 0.0), (2.0, 1.0), (5, 4)))
        parts = tuple(Boundary("free" if opened and name == "top" else "slip") for name in cells.names)
        velocities = np.random.default_rng(seed).normal(size=(cells.count, 2))
        fluxes = VolumeFluxes.of(cells, Sides.of(cells, parts)).across(velocities)
        assert np.max(np.abs(np.sum(fluxes, axis=1))) < 1e-12
        inner = cells.neighbours >= 0
        total = np.zeros((cells.count,) * 2)
        np.add.at(total, (np.nonzero(inner)[0], cells.neighbours[inner]), fluxes[inner])
        assert np.array_equal(total, -total.T)

    def test_fluxes_of_a_uniform_flow_are_its_own(self) -> None:
        cells = Cells.of(rectangle((0.0, 0.0), (1.0, 1.0), (4, 3)))
        inlet, outlet = Boundary("slip", velocity=(2.0, 0.0)), Boundary("free")
        parts = tuple({"left": inlet, "right": outlet}.get(name, Boundary()) for name in cells.names)
        velocities = np.tile([2.0, 0.0], (cells.count, 1))
        fluxes = VolumeFluxes.of(cells, Sides.of(cells, parts)).across(velocities)
        assert fluxes == pytest.approx(np.einsum("d,ckd->ck", [2.0, 0.0], cells.faces), abs=1e-12)


class TestBadInput:
    @pytest.mark.parametrize(
        ("make", "word"),
        [
            (lambda: tank(mixture(), roof=Boundary()), "boundaries.roof"),
            (lambda: tank(mixture(), top=DryBoundary()), "boundaries.top"),  # type: ignore[arg-type]
            (lambda: tank(mixture(), top=Boundary(velocity=(0.0, 0.0, 1.0))), "boundaries.top.velocity"),
            (lambda: tank(mixture(), left=Boundary(velocity=(1.0, 0.0))), "closed box"),
            (lambda: Boundary("free", velocity=(1.0, 0.0)), "boundary.velocity"),
            (lambda: Boundary(velocity=(np.nan, 0.0)), "boundary.velocity"),
            (lambda: Boundary("sticky"), "boundary.kind"),  # type: ignore[arg-type]
            (lambda: tank(mixture(0.02)), "grain_diameter"),
            (lambda: tank(mixture(5e-4, Material(2500.0, 0.5, max_volume_fraction=0.6, cohesion=1.0))), "cohesion"),
            (lambda: Options(model="wet"), "options.model"),  # type: ignore[arg-type]
            (lambda: Options(tolerance=0.0), "options.tolerance"),
            (lambda: tank(mixture()).at_rest([0.1]), "fractions"),
            (lambda: tank(mixture()).filled(lambda x: x[:, 0] < 0.1, 0.7), "fractions"),
            (
                lambda: SuspensionFlow(rectangle((0, 0), (1, 1), (2, 2), "quadrilateral"), mixture(), {}),
                "triangles or tetrahedra",
            ),
            (lambda: SuspensionState.from_arrays({}), "state"),
        ],
    )  # fmt: skip
    def test_bad_input_is_named(self, make: Any, word: str) -> None:
        with pytest.raises(InputError, match=word):
            make()

    @pytest.mark.parametrize("dt", [0.0, -1.0, np.nan])
    def test_bad_steps_are_refused(self, dt: float) -> None:
        flow = tank(mixture(), (4, 4))
        with pytest.raises(InputError, match="dt"):
            flow.advance(flow.filled(lambda x: x[:, 0] < 0.02), dt)
