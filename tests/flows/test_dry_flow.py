"""Steps of the mesh-based model: beds at rest, falling blocks, certificates, energy, walls, three dimensions (seed B, 7.2)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.dry import Boundary, DryFlow, DryRecord, DryState, Material, Options
from barchan.friction import certify
from barchan.friction import solve as solve_friction
from barchan.spaces.meshes import box, rectangle

SAND = Material(1.0, 0.5, packing_tolerance=0.0)
FLOOR = {"bottom": Boundary("no_slip")}


def column(
    kind: str, material: Material = SAND, options: Options | None = None, **walls: Boundary
) -> DryFlow:
    """A box 2 x 1 of 20 x 10 cells."""
    return DryFlow(
        rectangle((0.0, 0.0), (2.0, 1.0), (20, 10), kind), material, {**FLOOR, **walls}, 1.0, options
    )


def run(flow: DryFlow, state: DryState, steps: int, dt: float) -> tuple[DryState, list[DryRecord]]:
    records = []
    for _ in range(steps):
        state, record = flow.advance(state, dt)
        records.append(record)
    return state, records


class TestRest:
    @pytest.mark.parametrize("fill", [0.6, 0.63])
    def test_a_bed_stays_at_rest_whether_its_surface_fills_a_row_or_not(self, fill: float) -> None:
        """The compatibility criterion of 7.2.1 for the pair P0-P0, with a partly filled row on top."""
        flow = column("quadrilateral", options=Options(tolerance=1e-10))
        start = flow.filled(lambda x: x[:, 1] < fill)
        state, records = run(flow, start, 60, 0.02)
        there = state.fractions > 0.01
        assert np.max(np.abs(state.velocities[there])) < 1e-8
        assert np.max(np.abs(state.fractions - start.fractions)) < 1e-7
        assert all(record.converged for record in records)

    def test_a_bed_of_triangles_rests_to_the_tolerance(self) -> None:
        flow = column("triangle", options=Options(tolerance=1e-6))
        state, _ = run(flow, flow.filled(lambda x: x[:, 1] < 0.6), 20, 0.02)
        assert np.max(np.abs(state.velocities[state.fractions > 0.01])) < 1e-5

    def test_walls_bear_the_weight_and_stresses_are_the_overburden(self) -> None:
        flow = column("quadrilateral", options=Options(tolerance=1e-9))
        state, _ = run(flow, flow.filled(lambda x: x[:, 1] < 0.6), 5, 0.02)
        bottom = np.array(flow.cells.names)[flow.cells.parts] == "bottom"
        bottom &= flow.cells.parts >= 0
        areas = np.linalg.norm(flow.cells.faces, axis=2)
        assert np.sum((state.tractions[..., 0] * areas)[bottom]) == pytest.approx(0.6 * 2.0, rel=1e-6)
        # Cells two apart differ by the weight of two rows, whatever the rows between bear.
        z = flow.cells.centres[:, 1]
        vertical = state.stresses[:, 0] - state.stresses[:, 1]  # chi
        rows = [np.mean(vertical[np.isclose(z, (i + 0.5) / 10.0)]) for i in range(6)]
        assert np.array(rows[:-2]) - rows[2:] == pytest.approx(0.2, abs=1e-6)


class TestSteps:
    def test_a_falling_block_falls_freely_and_bears_no_stress(self) -> None:
        flow = column("quadrilateral")
        state = flow.filled(lambda x: (x[:, 1] > 0.5) & (x[:, 1] < 0.8) & (x[:, 0] > 0.5) & (x[:, 0] < 1.5))
        state, _ = run(flow, state, 20, 0.02)
        matter = state.fractions * flow.cells.volumes
        mean = matter @ state.velocities / np.sum(matter)
        assert mean == pytest.approx([0.0, -0.4], abs=1e-3)
        assert np.max(np.abs(state.stresses)) < 1e-6

    @pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
    @pytest.mark.parametrize("inertia", ["explicit", "conservative"])
    def test_a_collapse_keeps_bounds_and_mass_and_loses_energy(self, kind: str, inertia: Any) -> None:
        flow = column(kind, options=Options(inertia=inertia))
        start = flow.filled(lambda x: x[:, 0] < 0.83)
        volume = float(np.sum(start.fractions * flow.cells.volumes))
        state, records = run(flow, start, 80, 0.02)
        assert all(record.converged and record.residual <= 1e-4 for record in records)
        assert min(record.min_volume_fraction for record in records) >= 0.0
        assert max(record.max_volume_fraction for record in records) <= 1.0
        assert max(abs(record.volume / volume - 1.0) for record in records) < 1e-12
        energy = np.array([record.kinetic_energy + record.potential_energy for record in records])
        assert (
            np.max(np.diff(energy)) < 2e-3 * energy[0]
        )  # transport may lift matter by barycentres, see docs
        assert energy[-1] < 0.8 * energy[0]
        assert state.fractions @ flow.cells.volumes == pytest.approx(volume, rel=1e-12)

    def test_the_certificate_is_that_of_the_problem_of_the_step(self) -> None:
        flow = column("quadrilateral")
        state, _ = run(flow, flow.filled(lambda x: x[:, 0] < 0.8), 5, 0.02)
        problem = flow.problem(state, 0.02)
        solution = solve_friction(problem, tol=1e-4)
        assert certify(problem, r=solution.r, v=solution.v).residual <= 1e-4
        assert problem.n > np.count_nonzero(state.fractions > 1e-12)

    def test_the_limiter_moves_less_the_tighter_the_solver(self) -> None:
        """phi <= phi_max is a theorem for exact solutions: the excess is that of the tolerance."""
        moved = []
        for tolerance in (1e-3, 1e-5):
            flow = column("quadrilateral", options=Options(tolerance=tolerance))
            _, records = run(flow, flow.filled(lambda x: x[:, 0] < 0.83), 30, 0.02)
            moved.append(sum(record.excess for record in records))
        assert moved[1] < 0.05 * moved[0]

    def test_less_than_packed_matter_compacts_to_the_maximum_and_no_further(self) -> None:
        flow = column("quadrilateral", Material(1.0, 0.5, packing_tolerance=0.0, max_volume_fraction=0.6))
        start = flow.at_rest(np.where(flow.cells.centres[:, 1] < 0.8, 0.4, 0.0))
        state, records = run(flow, start, 150, 0.02)
        low = flow.cells.centres[:, 1] < 0.3
        assert state.fractions[low] == pytest.approx(0.6, abs=0.02)
        assert max(record.max_volume_fraction for record in records) <= 0.6

    def test_friction_grows_with_the_inertial_number(self) -> None:
        rapid = Material(1.0, 0.3, 0.4, 0.3, 0.05, packing_tolerance=0.0)
        flow = column("quadrilateral", rapid)
        state, _ = run(flow, flow.filled(lambda x: x[:, 0] < 0.8), 30, 0.02)
        there = state.fractions > 0.5
        assert np.min(state.frictions[there]) >= 0.3
        assert 0.35 < np.max(state.frictions[there]) <= 0.7

    def test_viscosity_slows_the_collapse(self) -> None:
        energies = []
        for viscosity in (0.0, 1e-2, 1.0):
            flow = column("quadrilateral", Material(1.0, 0.0, viscosity=viscosity, packing_tolerance=0.0))
            _, records = run(flow, flow.filled(lambda x: x[:, 0] < 0.8), 25, 0.02)
            energies.append(records[-1].kinetic_energy)
        assert energies[0] > energies[1] > 2.0 * energies[2]

    def test_the_state_of_a_checkpoint_goes_on_with_the_same_bytes(self) -> None:
        flow = column("triangle")
        state, _ = run(flow, flow.filled(lambda x: x[:, 0] < 0.8), 5, 0.02)
        one, _ = flow.advance(state, 0.02)
        two, _ = flow.advance(DryState.from_arrays(state.arrays()), 0.02)
        assert all(np.array_equal(a, two.arrays()[name]) for name, a in one.arrays().items())


class TestWalls:
    def test_matter_on_a_slope_of_gravity_slides_on_slip_and_sticks_to_friction(self) -> None:
        """Gravity inclined by 20 degrees: tan 20 = 0.36, below a wall friction of 0.5 and above one of 0.2."""
        tilt = math.radians(20.0)
        speeds = []
        for friction in (0.2, 0.5):
            mesh = rectangle((0.0, 0.0), (4.0, 0.5), (40, 5), "quadrilateral")
            flow = DryFlow(
                mesh, Material(1.0, 0.6, packing_tolerance=0.0), {"bottom": Boundary("friction", friction)},
                (math.sin(tilt), -math.cos(tilt)),
            )  # fmt: skip
            state = flow.filled(lambda x: (x[:, 0] > 0.5) & (x[:, 0] < 2.5) & (x[:, 1] < 0.2))
            state, _ = run(flow, state, 25, 0.02)
            matter = state.fractions * flow.cells.volumes
            speeds.append(float(matter @ state.velocities[:, 0] / np.sum(matter)))
        slide = 0.5 * (math.sin(tilt) - 0.2 * math.cos(tilt))
        assert speeds[0] == pytest.approx(slide, rel=0.1)  # the heap's edges spread
        assert abs(speeds[1]) < 0.1 * slide

    def test_what_leaves_through_a_free_floor_is_counted(self) -> None:
        flow = column("quadrilateral", bottom=Boundary("free"))
        start = flow.filled(lambda x: x[:, 1] < 0.5)
        state, records = run(flow, start, 80, 0.02)
        assert records[-1].volume + state.left == pytest.approx(1.0, rel=1e-12)
        assert state.left > 0.9

    def test_a_box_of_tetrahedra_keeps_its_bounds_too(self) -> None:
        flow = DryFlow(
            box((0.0, 0.0, 0.0), (1.0, 0.5, 0.5), (6, 3, 3)),
            SAND,
            FLOOR,
            1.0,
        )
        start = flow.filled(lambda x: x[:, 0] < 0.5)
        volume = float(np.sum(start.fractions * flow.cells.volumes))
        state, records = run(flow, start, 12, 0.03)
        assert all(record.converged for record in records)
        assert 0.0 <= np.min(state.fractions) <= np.max(state.fractions) <= 1.0
        assert records[-1].volume == pytest.approx(volume, rel=1e-13)
        assert records[-1].potential_energy < 0.98 * records[0].potential_energy


class TestBadInput:
    @pytest.mark.parametrize(
        ("make", "word"),
        [
            (lambda: column("triangle", roof=Boundary()), "boundaries.roof"),
            (lambda: Boundary("sticky"), "boundary.kind"),  # type: ignore[arg-type]
            (lambda: Boundary("friction", -1.0), "boundary.friction"),
            (lambda: Options(inertia="implicit"), "options.inertia"),  # type: ignore[arg-type]
            (lambda: Options(tolerance=0.0), "options.tolerance"),
            (lambda: Options(max_sweeps=0), "options.max_sweeps"),
            (lambda: Options(method="magic"), "options.method"),
            (lambda: DryFlow(rectangle((0, 0), (1, 1), (2, 2)), SAND, {}, (0.0, 0.0, -1.0)), "gravity"),
            (lambda: DryFlow(rectangle((0, 0), (1, 1), (2, 2)), SAND, {}, -1.0), "gravity"),
            (lambda: DryFlow("box.msh", SAND, {}), "mesh"),
            (lambda: column("triangle", Material(1.0, 0.5, cohesion=1.0)), "material.cohesion"),
            (lambda: column("triangle", Material(1.0, 0.5, dilatancy=0.1)), "material.dilatancy"),
            (lambda: column("triangle").at_rest([0.5]), "fractions"),
            (lambda: column("triangle").at_rest(np.full(400, 1.5)), "fractions"),
            (lambda: column("triangle").filled(lambda x: x[:, 0] > 5.0), "fractions"),
            (lambda: column("triangle").advance(column("quadrilateral").filled(lambda x: x[:, 0] < 1.0), 0.1), "state"),
            (lambda: column("triangle").advance(column("triangle").filled(lambda x: x[:, 0] < 1.0), 0.0), "dt"),
            (lambda: DryState.from_arrays({"time": np.zeros(())}), "state"),
        ],
    )  # fmt: skip
    def test_it_is_refused_by_name(self, make: Any, word: str) -> None:
        with pytest.raises(InputError, match=word):
            make()
