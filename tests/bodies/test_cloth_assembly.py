"""Cloth in motion: laws of mechanics, elastica and catenary, friction with obstacles, pins, contact with itself."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from barchan.bodies.cloth import (
    Cloth,
    ClothAssembly,
    ClothMaterial,
    ClothMesh,
    ClothOptions,
    ClothState,
    Pins,
    carried_by,
    conical_skirt,
    rectangle,
)
from barchan.bodies.cloth._crossings import crossing_pair
from barchan.bodies.rigid import Body, Fixed, Free, HalfSpace, Prescribed, Sphere
from barchan.errors import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])


def weave(**changes: Any) -> ClothMaterial:
    given = {
        "young_modulus": 2e4,
        "thickness": 4e-3,
        "area_density": 0.3,
        "bending_stiffness": 1e-4,
        "friction": 0.5,
    }
    return ClothMaterial(**{**given, **changes})


def lifted(mesh: ClothMesh, *way: float) -> Any:
    """Its vertices, moved."""
    return mesh.vertices + np.array(way)


def advanced(
    assembly: ClothAssembly, state: ClothState, dt: float, steps: int
) -> tuple[ClothState, list[Any]]:
    records = []
    for _ in range(steps):
        state, record = assembly.advance(state, dt)
        records.append(record)
    return state, records


def equilibrium(cloth: Cloth, gravity: Any, steps: int = 250) -> Any:
    """Positions (n, 3) at rest, by steps with the convex part of the Hessian, shortened until the energy falls."""
    x, weight = np.array(cloth.positions), cloth.masses[:, None] * gravity
    free = np.repeat(~cloth.pinned.mask, 3)
    for _ in range(steps):
        force = (weight - cloth.energy.gradient(x)).ravel()[free]
        way = np.zeros(x.size)
        way[free] = spla.spsolve(cloth.energy.hessian(x, convex=True).tocsr()[free][:, free].tocsc(), force)
        if np.max(np.abs(way)) < 1e-5:
            break
        value, length = cloth.potential_energy(x, gravity), 1.0
        while length > 1e-3 and cloth.potential_energy(x + length * way.reshape(-1, 3), gravity) > value:
            length *= 0.5
        x = x + length * way.reshape(-1, 3)
    return x


def elastica(gamma: float, length: float) -> tuple[float, float]:
    """Tip of a horizontal cantilever under its weight: theta'' = -gamma (L - s) cos theta, gamma = weight per length / D."""
    start = np.zeros((2, 200))
    start[0] = np.linspace(0.0, 1.0, 200)
    found = solve_bvp(
        lambda s, y: np.array([y[1], -gamma * (length - s) * np.cos(y[0])]), lambda a, b: np.array([a[0], b[1]]),
        np.linspace(0.0, length, 200), start, tol=1e-8, max_nodes=100_000,
    )  # fmt: skip
    assert found.status == 0
    s = np.linspace(0.0, length, 4001)
    theta = found.sol(s)[0]
    return float(np.trapezoid(np.cos(theta), s)), -float(np.trapezoid(np.sin(theta), s))


def test_a_cantilevered_sheet_hangs_as_the_elastica() -> None:
    rows = 24
    mesh = rectangle(0.5, 1.0, 1.0 / rows / math.sqrt(0.75))
    y = mesh.vertices[:, 1]
    row = 1.0 / rows
    # wide and stiff in its plane: bent to a cylinder, without anticlastic curvature
    material = ClothMaterial(1e8, 0.0, 1e-3, area_density=0.1, bending_stiffness=1e-2)
    cloth = Cloth(mesh, material, pins=[Pins(np.flatnonzero(y < y.min() + 1.5 * row))])
    x = equilibrium(cloth, 0.1 * GRAVITY)
    # bending begins half a row beyond the first pinned row
    tip = x[y > y.max() - 1e-9].mean(axis=0) - (0.0, y.min() + 0.5 * row, 0.0)
    along, down = elastica(0.1 * 0.981 / 1e-2, 1.0 - 0.5 * row)
    assert tip[1] == pytest.approx(along, abs=0.01 * 1.0)
    assert tip[2] == pytest.approx(down, abs=0.01 * 1.0)


def test_a_strip_between_two_walls_hangs_as_the_catenary() -> None:
    mesh = rectangle(1.0, 0.1, 0.025)
    x = mesh.vertices[:, 0]
    ends = np.flatnonzero(np.abs(x) > 0.5 - 1e-9)
    # started as a parabola between walls 0.8 apart
    start = np.stack([0.8 * x, mesh.vertices[:, 1], -0.27 * (1.0 - (2.0 * x) ** 2)], axis=1)
    material = ClothMaterial(1e7, 0.3, 1e-3, area_density=0.2, bending_stiffness=1e-8, stiffness_damping=0.01)
    cloth = Cloth(mesh, material, start=start, pins=[Pins(ends)])
    assembly = ClothAssembly(cloth)
    state = assembly.started()
    for _ in range(60):
        state, record = assembly.advance(state, 0.1)
        state = replace(state, velocities=np.zeros_like(state.velocities))
        if record.max_speed < 1e-6:
            break
    c = brentq(lambda c: 2.0 * c * math.sinh(0.4 / c) - 1.0, 0.1, 2.0)
    sag = c * (math.cosh(0.4 / c) - 1.0)
    assert -state.positions[:, 2].min() == pytest.approx(sag, rel=0.01)


def test_a_free_cloth_falls_as_a_body_and_keeps_its_momenta() -> None:
    mesh = rectangle(0.4, 0.3, 0.1, "unstructured")
    start = mesh.vertices * (1.05, 0.97, 1.0) + 0.01 * np.sin(7.0 * mesh.vertices[:, ::-1])
    cloth = Cloth(mesh, weave(), start=start)
    assembly = ClothAssembly(cloth, gravity=GRAVITY)
    state, _ = advanced(assembly, assembly.started(), 0.01, 10)
    momentum = cloth.masses @ state.velocities
    np.testing.assert_allclose(momentum, cloth.masses.sum() * GRAVITY * 0.1, rtol=1e-10, atol=1e-12)


def test_energy_does_not_grow_without_forcing() -> None:
    for membrane in ("stvk", "springs"):
        mesh = rectangle(0.4, 0.4, 0.08, "unstructured")
        rng = np.random.default_rng(0)
        start = mesh.vertices + 0.008 * rng.normal(size=mesh.vertices.shape)
        cloth = Cloth(mesh, weave(membrane=membrane), start=start)
        assembly = ClothAssembly(cloth, gravity=0.0)
        state, records = advanced(assembly, assembly.started(), 0.01, 40)
        first = cloth.potential_energy(cloth.positions, 0.0 * GRAVITY)
        energy = np.array([first, *(record.kinetic_energy + record.potential_energy for record in records)])
        assert np.all(np.diff(energy) <= 1e-12 * first)
        assert np.linalg.norm(cloth.masses @ state.velocities) < 1e-9


def test_more_linearisations_solve_the_implicit_step() -> None:
    mesh = rectangle(0.4, 0.2, 0.1)
    x = mesh.vertices[:, 0]
    cloth = Cloth(mesh, weave(), pins=[Pins(np.flatnonzero(x < -0.19))])
    residuals = []
    for iterations in (1, 4, 12):
        assembly = ClothAssembly(cloth, options=ClothOptions(iterations=iterations))
        begun, _ = advanced(assembly, assembly.started(), 0.02, 4)
        ended, _ = assembly.advance(begun, 0.02)
        force = cloth.masses[:, None] * (GRAVITY - (ended.velocities - begun.velocities) / 0.02)
        unbalanced = (force - cloth.energy.gradient(ended.positions))[~cloth.pinned.mask]
        residuals.append(np.max(np.abs(unbalanced)) / np.max(cloth.masses * 9.81))
    assert residuals[2] < 1e-6 and residuals[1] < 0.1 * residuals[0]


@pytest.mark.parametrize(("angle", "mu"), [(0.3, 0.32), (0.3, 0.29), (0.6, 0.2), (0.5, 0.6)])
def test_cloth_on_a_slope_sticks_or_slides_as_coulomb_says(angle: float, mu: float) -> None:
    mesh = rectangle(0.3, 0.2, 0.1)
    ground = Body(HalfSpace((0.0, 0.0, 1.0)), name="slope", friction=mu, motion=Fixed())
    cloth = Cloth(mesh, weave(friction=mu), start=lifted(mesh, 0.0, 0.0, 2e-3))
    pull = 9.81 * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    assembly = ClothAssembly(cloth, [ground], pull, ClothOptions(tolerance=1e-10))
    state, records = advanced(assembly, assembly.started(), 0.01, 10)
    exact = max(0.0, 9.81 * (math.sin(angle) - mu * math.cos(angle))) * 0.1
    np.testing.assert_allclose(state.velocities[:, 0], exact, atol=1e-7)
    assert all(record.converged for record in records)
    weight = cloth.masses.sum() * 9.81 * math.cos(angle)
    assert state.forces[:, 2].sum() == pytest.approx(weight, rel=1e-7)


def test_a_belt_carries_the_cloth_and_a_turntable_turns_it() -> None:
    mesh = rectangle(0.3, 0.2, 0.1)
    times = np.linspace(0.0, 1.0, 41)
    turns = np.stack([np.cos(times / 2), 0 * times, 0 * times, np.sin(times / 2)], axis=1)
    cases = (
        (Prescribed(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])), lambda x: (0.4, 0.0, 0.0)),
        (Prescribed(times, np.zeros((41, 3)), turns), lambda x: np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1)),
    )  # fmt: skip
    for motion, expected in cases:
        belt = Body(HalfSpace((0.0, 0.0, 1.0)), friction=0.8, motion=motion)
        cloth = Cloth(mesh, weave(friction=0.8), start=lifted(mesh, 0.0, 0.0, 2e-3))
        assembly = ClothAssembly(cloth, [belt], options=ClothOptions(tolerance=1e-8))
        state, _ = advanced(assembly, assembly.started(), 0.01, 30)
        exact = np.broadcast_to(expected(state.positions), state.positions.shape)
        np.testing.assert_allclose(state.velocities, exact, atol=0.01)


def test_a_symmetric_drape_stays_symmetric_and_out_of_the_ball() -> None:
    mesh = rectangle(0.6, 0.6, 0.1, "crossed")
    ball = Body(Sphere(0.2), friction=0.4, motion=Fixed())
    cloth = Cloth(mesh, weave(stiffness_damping=2e-3), start=lifted(mesh, 0.0, 0.0, 0.21))
    assembly = ClothAssembly(cloth, [ball], options=ClothOptions(tolerance=1e-9))
    state, records = advanced(assembly, assembly.started(), 0.01, 25)
    assert all(record.converged for record in records) and records[-1].contacts > 4
    place = {tuple(np.round(p[:2], 6) + 0.0): k for k, p in enumerate(mesh.vertices)}
    mirrored = np.array([place[tuple(np.round((-p[0], p[1]), 6) + 0.0)] for p in mesh.vertices])
    np.testing.assert_allclose(state.positions[mirrored] * (-1, 1, 1), state.positions, atol=1e-6)
    assert np.min(np.linalg.norm(state.positions, axis=1)) > 0.2 + 0.9 * 2e-3


def test_pinned_vertices_follow_a_turning_body_and_carry_the_skirt_round() -> None:
    mesh = conical_skirt(0.1, 0.15, 0.1, 0.05)
    times = np.linspace(0.0, 1.0, 33)
    turns = np.stack([np.cos(times), 0 * times, 0 * times, np.sin(times)], axis=1)
    hips = Body(Sphere(0.05), motion=Prescribed(times, np.zeros((33, 3)), turns))
    waist = np.flatnonzero(mesh.vertices[:, 2] > -1e-9)
    cloth = Cloth(
        mesh, weave(stiffness_damping=0.01), pins=[Pins(waist, carried_by(hips, mesh.vertices[waist]))]
    )
    assembly = ClothAssembly(cloth, [hips])
    state, _ = advanced(assembly, assembly.started(), 0.01, 50)
    angle = np.arctan2(state.positions[waist, 1], state.positions[waist, 0])
    turned = angle - np.arctan2(mesh.vertices[waist, 1], mesh.vertices[waist, 0])
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j), atol=1e-6)
    below = state.positions[:, 2] < -0.05
    spin = (
        state.positions[below, 0] * state.velocities[below, 1]
        - state.positions[below, 1] * state.velocities[below, 0]
    )
    assert np.all(spin > 0.0)


def two_layers(height: float, speed: float, pinned: bool = True) -> tuple[ClothAssembly, int]:
    """A small cloth at some height above a larger one, pinned or not; far apart at rest."""
    large, small = rectangle(0.4, 0.4, 0.1), rectangle(0.2, 0.2, 0.07, "unstructured")
    n = len(large.vertices)
    above = lifted(small, 0.013, 0.007, 1.0)
    mesh = ClothMesh(
        np.concatenate([large.vertices, above]), np.concatenate([large.triangles, small.triangles + n])
    )
    start, velocity = np.array(mesh.vertices), np.zeros_like(mesh.vertices)
    start[n:, 2] = height
    velocity[n:, 2] = -speed
    cloth = Cloth(mesh, weave(), start=start, velocity=velocity, pins=[Pins(np.arange(n))] if pinned else [])
    return ClothAssembly(cloth, options=ClothOptions(self_contact=True, tolerance=1e-8)), n


def test_one_layer_falls_on_another_and_stays_a_thickness_above() -> None:
    assembly, n = two_layers(0.02, 3.0)
    state, records = advanced(assembly, assembly.started(), 0.005, 20)
    assert all(record.converged for record in records)
    # 3 m/s cross four thicknesses in a step
    heights = state.positions[n:, 2]
    assert np.min(heights) > 0.95 * 4e-3 and np.max(heights) < 1.5 * 4e-3
    kinds = state.contact_keys % 2
    assert np.count_nonzero(kinds == 0) and np.count_nonzero(kinds == 1)
    # normals point from the second side to the first: here up or down
    upward = np.abs(state.forces[:, 2]).sum()
    assert upward == pytest.approx(9.81 * assembly.cloth.masses[n:].sum(), rel=1e-4)


def test_layers_keep_their_sides_when_one_is_found_through_the_other() -> None:
    assembly, n = two_layers(0.0045, 0.0)
    state, _ = advanced(assembly, assembly.started(), 0.005, 4)
    for depth, kept in ((3e-3, True), (6e-3, False)):  # within a thickness of the other layer, or beyond
        pushed = np.array(state.positions)
        pushed[n:, 2] = 4e-3 - 4e-3 - depth
        after, _ = advanced(assembly, replace(state, positions=pushed), 0.005, 20)
        above = np.min(after.positions[n:, 2]) > 0.9 * 4e-3
        assert bool(above) == kept


def test_forces_of_self_contact_are_opposite_on_both_layers() -> None:
    assembly, _ = two_layers(0.0041, 0.5, pinned=False)
    masses, begun = assembly.cloth.masses, assembly.started()
    state, record = assembly.advance(begun, 0.005)
    assert record.contacts > 4
    momentum = masses @ (state.velocities - begun.velocities)
    np.testing.assert_allclose(momentum, masses.sum() * GRAVITY * 0.005, atol=1e-9)


def test_a_sheet_dropped_on_its_edge_folds_without_cutting_itself() -> None:
    mesh = rectangle(0.4, 0.5, 0.05, "unstructured")
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    start = np.stack([x, 0.02 * np.sin(9.0 * y + 3.0 * x), y + 0.26], axis=1)
    ground = Body(HalfSpace((0.0, 0.0, 1.0)), friction=0.3, motion=Fixed())
    cloth = Cloth(
        mesh,
        weave(young_modulus=1e5, bending_stiffness=2e-5, stiffness_damping=1e-3, friction=0.3),
        start=start,
    )
    assembly = ClothAssembly(cloth, [ground], options=ClothOptions(self_contact=True, tolerance=1e-5))
    state, folded = assembly.started(), 0
    for step in range(120):
        state, record = assembly.advance(state, 0.005)
        folded = max(folded, int(np.count_nonzero(state.pressing & (state.contact_bodies == -1))))
        assert record.converged
        assert step % 20 or crossing_pair(state.positions, mesh.triangles) is None
    assert folded > 3 and state.positions[:, 2].max() < 0.2
    assert crossing_pair(state.positions, mesh.triangles) is None


def test_states_go_through_arrays_and_runs_are_the_same_bytes() -> None:
    assembly, _ = two_layers(0.0045, 0.1)
    state, _ = advanced(assembly, assembly.started(), 0.005, 5)
    again = ClothState.from_arrays(state.arrays())
    one, two = assembly.advance(state, 0.005)[0], assembly.advance(again, 0.005)[0]
    for name, array in one.arrays().items():
        assert array.tobytes() == two.arrays()[name].tobytes(), name


def test_rows_of_obstacle_contacts_are_one_rotation_a_vertex() -> None:
    mesh = rectangle(0.3, 0.2, 0.1)
    ball = Body(Sphere(0.2), motion=Fixed())
    cloth = Cloth(mesh, weave(), start=lifted(mesh, 0.0, 0.0, 0.202), pins=[Pins([0])])
    problem = ClothAssembly(cloth, [ball]).problem(ClothAssembly(cloth, [ball]).started(), 0.02)
    assert problem.H.format == "bsr" and problem.H.blocksize == (3, 3)
    np.testing.assert_array_equal(np.diff(problem.H.indptr), 1)
    assert len(np.unique(problem.H.indices)) == problem.n > 0 and 0 not in problem.H.indices
    np.testing.assert_allclose(
        problem.H.data @ problem.H.data.transpose(0, 2, 1), np.tile(np.eye(3), (problem.n, 1, 1)), atol=1e-12
    )


def test_bad_input_is_refused() -> None:
    mesh = rectangle(0.3, 0.2, 0.1)
    with pytest.raises(InputError, match="one pin only"):
        Cloth(mesh, weave(), pins=[Pins([0, 1]), Pins([1])])
    with pytest.raises(InputError, match="from 0 to"):
        Cloth(mesh, weave(), pins=[Pins([99])])
    with pytest.raises(InputError, match="at time 0"):
        Cloth(mesh, weave(), pins=[Pins([0], lambda time: np.array([[1.0, 1.0, 1.0]]))])
    with pytest.raises(InputError, match="start"):
        Cloth(mesh, weave(), start=mesh.vertices[:-1])
    with pytest.raises(InputError, match="fixed or prescribed"):
        ClothAssembly(Cloth(mesh, weave()), [Body(Sphere(0.1), density=1.0, motion=Free())])
    with pytest.raises(InputError, match="dt"):
        ClothAssembly(Cloth(mesh, weave())).advance(ClothAssembly(Cloth(mesh, weave())).started(), 0.0)
    with pytest.raises(InputError, match="method"):
        ClothOptions(method="magic")
    with pytest.raises(InputError, match="gravity"):
        ClothAssembly(Cloth(mesh, weave()), gravity=(0.0, math.nan, 0.0))
