"""Steps of fibres in contact: weight is carried, friction holds or lets slide, solvers agree, states come back bit for bit."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from barchan import friction
from barchan.bodies.fibres.assembly import FibreAssembly
from barchan.bodies.fibres.helices import Helices, even_pieces
from barchan.bodies.fibres.rods import Damping, Rods, Section
from barchan.bodies.fibres.roots import StillRoots, frames_along
from barchan.bodies.fibres.state import FibreState
from barchan.bodies.moreau import AssemblyRecord, Options
from barchan.bodies.rigid import Body, Fixed, HalfSpace, Prescribed, Sphere
from barchan.errors import InputError

RADIUS = 2e-3
SECTION = Section.circular(RADIUS, density=1000.0, young=1e7)
FLOOR = Body(HalfSpace([0.0, 0.0, 1.0]), name="floor", motion=Fixed(), friction=0.5)
EXACT = Options(tolerance=1e-9)


def loose(lines: list[np.ndarray]) -> Rods:
    """Rods that nothing holds."""
    first = np.array([line[0] for line in lines])
    frames = frames_along([line[1] - line[0] for line in lines])
    damping = Damping(internal=0.01)
    return Rods(lines, SECTION, roots=StillRoots(first, frames, hold="free"), damping=damping)


def line(start: tuple[float, float, float], end: tuple[float, float, float], n: int = 6) -> np.ndarray:
    return np.linspace(start, end, n + 1)


def steps(assembly: FibreAssembly, count: int, dt: float) -> tuple[FibreState, list[AssemblyRecord]]:
    state, records = assembly.started(), []
    for _ in range(count):
        state, record = assembly.advance(state, dt)
        records.append(record)
    return state, records


def test_a_rod_on_the_floor_is_carried_by_its_weight() -> None:
    rods = loose([line((0.0, 0.0, RADIUS), (0.3, 0.0, RADIUS))])
    state, records = steps(FibreAssembly(rods, [FLOOR], options=EXACT), 3, 1e-3)
    weight = 9.81 * 1000.0 * np.pi * RADIUS**2 * 0.3
    assert np.sum(state.world_forces(), axis=0) == pytest.approx(
        [0.0, 0.0, weight], rel=1e-6, abs=1e-6 * weight
    )
    assert records[-1].max_speed < 1e-9 and all(record.converged for record in records)


@pytest.mark.parametrize(("slope", "mu"), [(0.3, 0.5), (0.6, 0.5), (0.3, 0.0)])
def test_a_rod_on_a_slope_sticks_or_slides_as_coulomb_says(slope: float, mu: float) -> None:
    rods = loose([line((0.0, 0.0, RADIUS), (0.02, 0.3, RADIUS))])
    gravity = 9.81 * np.array([math.sin(slope), 0.0, -math.cos(slope)])
    assembly = FibreAssembly(rods, [FLOOR], gravity, friction_bodies=mu, options=EXACT)
    state, _ = steps(assembly, 10, 1e-3)
    speed = np.mean(rods.node_velocities(state.shape), axis=0)[0]
    wanted = max(0.0, 9.81 * (math.sin(slope) - mu * math.cos(slope))) * 0.01
    assert speed == pytest.approx(wanted, abs=1e-6)
    assert np.all(state.sliding()) == (wanted > 0.0 and mu > 0.0) or mu == 0.0


def test_fibres_push_one_another_with_equal_and_opposite_forces() -> None:
    """Momentum is kept, and centre lines that would cross do not come closer than they touch."""
    lines = [line((-0.1, 0, 0), (0.1, 0, 0)), line((0, -0.1, 0.006), (0, 0.1, 0.006))]
    first = np.array([one[0] for one in lines])
    roots = StillRoots(first, frames_along([one[1] - one[0] for one in lines]), hold="free")
    velocities = np.repeat([[0.0, 0.0, 0.0], [0.3, 0.0, -1.0]], 7, axis=0)
    rods = Rods(lines, SECTION, velocities=velocities, roots=roots)
    assembly = FibreAssembly(rods, (), 0.0, 0.4, options=EXACT)
    state, record = assembly.advance(assembly.started(), 5e-3)
    assert record.contacts == 1
    weights = np.tile([0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5], 2)[:, None]
    start, end = (np.sum(weights * v, axis=0) for v in (velocities, rods.node_velocities(state.shape)))
    np.testing.assert_allclose(end, start, atol=1e-9)
    force = state.forces[0]
    assert np.linalg.norm(force[1:]) == pytest.approx(0.4 * force[0], rel=1e-6)
    assert np.min(assembly.contacts(state, 1e-9).gaps, initial=0.0) > -0.05 * RADIUS


def test_friction_between_fibres_holds_or_not() -> None:
    """A bar laid across two fixed ones slides off a slope unless friction holds it."""
    bars = [line((-0.05, -0.1, 0), (-0.05, 0.1, 0)), line((0.05, -0.1, 0), (0.05, 0.1, 0))]
    across = line((-0.1, 0.0, 2 * RADIUS), (0.1, 0.0, 2 * RADIUS), 8)
    gravity = 9.81 * np.array([0.0, math.sin(0.3), -math.cos(0.3)])
    speeds = []
    for mu in (0.4, 0.2):
        rods = loose([*bars, across])
        # the bars underneath lie on nodes of the floor
        floor = Body(HalfSpace([0.0, 0.0, 1.0], -RADIUS), motion=Fixed(), friction=5.0)
        assembly = FibreAssembly(rods, [floor], gravity, mu, options=EXACT)
        state, records = steps(assembly, 10, 1e-3)
        assert all(record.converged for record in records)
        speeds.append(float(rods.node_velocities(state.shape)[[16, 20], 1].mean()))  # where it is held up
    assert speeds[0] == pytest.approx(0.0, abs=1e-4)
    assert speeds[1] == pytest.approx(9.81 * (math.sin(0.3) - 0.2 * math.cos(0.3)) * 0.01, rel=0.05)


def test_a_belt_drags_a_rod_to_its_own_speed() -> None:
    belt = Body(
        HalfSpace([0.0, 0.0, 1.0]), motion=Prescribed(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [0.02, 0.01, 0]])),
        friction=0.6,
    )  # fmt: skip
    rods = loose([line((0.0, 0.0, RADIUS), (0.3, 0.0, RADIUS))])
    state, _ = steps(FibreAssembly(rods, [belt], options=EXACT), 20, 1e-3)
    np.testing.assert_allclose(
        rods.node_velocities(state.shape), np.tile([0.02, 0.01, 0.0], (7, 1)), atol=1e-7
    )


def cantilever_on_ball(**options: object) -> FibreAssembly:
    lengths, firsts = even_pieces([0.2], pieces=4)
    roots = StillRoots(np.array([[0.0, 0.005, 0.0]]), frames_along([[1.0, 0.0, 0.0]]))
    fibre = Helices(
        lengths,
        firsts,
        roots,
        radius=1e-3,
        density=1300.0,
        young=2e6,
        internal_damping=0.02,
        nodes_per_piece=2,
    )
    ball = Body(Sphere(0.04), position=[0.12, 0.0, -0.05], motion=Fixed(), friction=0.3)
    given = {"options": Options(tolerance=1e-10)} | options
    return FibreAssembly(fibre, [ball], bare=0.01, **given)  # type: ignore[arg-type]


def touching(assembly: FibreAssembly) -> FibreState:
    """The first state in which the fibre slides on its ball."""
    state = assembly.started()
    for _ in range(100):
        state, record = assembly.advance(state, 2e-3)
        if record.contacts >= 1 and state.sliding().any():
            return state
    raise AssertionError("no contact")


def test_every_method_gives_the_same_step() -> None:
    base = cantilever_on_ball()
    state = touching(base)
    wanted = base.advance(state, 2e-3)[0].shape.velocities
    for method in ("gauss_seidel", "newton_fischer_burmeister", "newton_alart_curnier", "aspg"):
        other = cantilever_on_ball(options=Options(tolerance=1e-10, method=method))
        new, record = other.advance(state, 2e-3)
        assert record.converged, method
        np.testing.assert_allclose(new.shape.velocities, wanted, rtol=1e-5, atol=1e-6, err_msg=method)
    for local in ("enumerative", "fischer-burmeister+enumerative"):
        other = cantilever_on_ball(
            options=Options(tolerance=1e-10, method="gauss_seidel"), solver_options={"local_solver": local}
        )
        new, record = other.advance(state, 2e-3)
        np.testing.assert_allclose(new.shape.velocities, wanted, rtol=1e-5, atol=1e-6, err_msg=local)


def test_the_pyramid_is_another_law() -> None:
    base = cantilever_on_ball()
    state = touching(base)
    new, record = cantilever_on_ball(law="faceted").advance(state, 2e-3)
    exact, _ = base.advance(state, 2e-3)
    assert record.converged
    assert np.max(np.abs(new.shape.velocities - exact.shape.velocities)) > 1e-4


def test_a_restored_state_goes_on_bit_for_bit() -> None:
    assembly = cantilever_on_ball()
    state = touching(assembly)
    again = assembly.restored(state.arrays())
    one, two = (assembly.advance(start, 2e-3)[0].arrays() for start in (state, again))
    assert one.keys() == two.keys() and all(np.array_equal(one[key], two[key]) for key in one)
    with pytest.raises(InputError, match=r"state\.forces"):
        assembly.restored({key: value for key, value in state.arrays().items() if key != "forces"})


def test_the_warm_start_is_the_answer_when_nothing_changes() -> None:
    rods = loose([line((0.0, 0.0, RADIUS), (0.3, 0.0, RADIUS))])
    assembly = FibreAssembly(rods, [FLOOR], options=Options(tolerance=1e-6, method="gauss_seidel"))
    _, records = steps(assembly, 4, 1e-3)
    assert records[0].sweeps > 0 and records[-1].sweeps == 0


def test_problems_are_written_and_read_back(tmp_path: Path) -> None:
    assembly = cantilever_on_ball()
    state = touching(assembly)
    path = tmp_path / "step.hdf5"
    assembly.write_problem(path, state, 2e-3)
    solution = friction.solve(friction.read(path), tol=1e-8)
    wanted = assembly.advance(state, 2e-3)[0].shape.velocities
    assert solution.converged
    np.testing.assert_allclose(solution.v, wanted, atol=1e-5 * np.max(np.abs(wanted)))


def test_what_makes_no_sense_is_refused() -> None:
    rods = loose([line((0.0, 0.0, 1.0), (0.3, 0.0, 1.0))])
    free = Body(Sphere(0.1), density=1.0, name="ball")
    for field, given in {
        "bodies": {"bodies": [free]}, "friction_fibres": {"friction_fibres": -0.1}, "bare": {"bare": math.nan},
        "law": {"law": "square"}, "gravity": {"gravity": [1.0, 2.0]}, "options.theta": {"options": Options(theta=0.5)},
        "options.restitution": {"options": Options(restitution=0.5)},
        "options.method": {"law": "faceted", "options": Options(method="gauss_seidel")},
    }.items():  # fmt: skip
        with pytest.raises(InputError) as caught:
            FibreAssembly(rods, **given)  # type: ignore[arg-type]
        assert caught.value.field == field
    with pytest.raises(InputError, match="dt"):
        FibreAssembly(rods).advance(FibreAssembly(rods).started(), 0.0)
