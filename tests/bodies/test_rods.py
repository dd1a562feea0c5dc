"""Discrete Elastic Rods: derivatives, invariances, and published shapes, loads and frequencies of rods."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_bvp

from barchan.bodies.fibres.rods import Damping, Natural, Rods, RodShape, Section, at_rest, laid_out
from barchan.bodies.fibres.roots import MovingRoots, StillRoots, frames_along
from barchan.bodies.rigid import rotations
from barchan.errors import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])
NONE = np.zeros(3)
SECTION = Section.elliptic(0.01, 0.006, density=1000.0, young=1e6, poisson=0.3)


def wild(seed: int, hold: str = "clamped") -> Rods:
    """Three rods of random shape, natural shape, twist, stretch and velocities."""
    rng = np.random.default_rng(seed)
    lines = [
        np.cumsum(0.1 * np.array([1.0, 0, 0]) + rng.uniform(-0.04, 0.04, size=(n, 3)), axis=0)
        for n in (6, 3, 8)
    ]
    natural = Natural(0.3 * rng.normal(size=(11, 2)), 0.5 * rng.normal(size=11))
    first = np.array([line[0] for line in lines])
    roots = StillRoots(first, frames_along([line[1] - line[0] for line in lines]), hold=hold)
    drawn = Rods(lines, SECTION, roots=roots)
    lengths = drawn.rest_lengths * (1.0 + 0.2 * rng.random(14))
    return Rods(
        lines, SECTION, roots=roots, natural=natural, angles=rng.normal(size=14), rest_lengths=lengths,
        velocities=rng.normal(size=(17, 3)),
    )  # fmt: skip


def straight(
    n: int, length: float, section: Section, along: tuple[float, float, float] = (1.0, 0.0, 0.0), **options
) -> Rods:
    """One straight rod from the origin."""
    return Rods(
        [np.linspace(0.0, length, n + 1)[:, None] * np.array(along)], section, natural="straight", **options
    )


# -- energy -------------------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_forces_and_hessian_are_derivatives_of_the_energy(seed: int) -> None:
    rods = wild(seed)
    shape = rods.started()
    direction = 0.01 * np.random.default_rng(seed).normal(size=rods.size)

    def energy(step: float) -> float:
        return float(rods.elastic_energies(rods.displaced(shape, step * direction)).sum())

    h = 0.005  # centred differences of order 8
    plus = np.array([energy(k * h) for k in (1, 2, 3, 4)])
    minus = np.array([energy(-k * h) for k in (1, 2, 3, 4)])
    slope = np.dot([4 / 5, -1 / 5, 4 / 105, -1 / 280], plus - minus) / h
    bend = (np.dot([8 / 5, -1 / 5, 8 / 315, -1 / 560], plus + minus) - 205 / 72 * energy(0.0)) / h**2
    size = np.linalg.norm(rods.elastic_forces(shape)) * np.linalg.norm(direction)
    assert -rods.elastic_forces(shape) @ direction == pytest.approx(slope, abs=1e-8 * size)
    hessian = rods.hessian(shape)
    assert direction @ (hessian @ direction) == pytest.approx(
        bend, rel=1e-6, abs=1e-7 * abs(hessian).sum() * 1e-6
    )


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rigid_motion_costs_nothing_and_forces_balance(seed: int) -> None:
    rods = wild(seed)
    shape = rods.started()
    rng = np.random.default_rng(seed)
    turn = rotations.matrix(rotations.exponential(rng.normal(size=3)))
    nodes, directors = shape.nodes @ turn.T + rng.normal(size=3), shape.directors @ turn.T
    moved = RodShape(0.0, nodes, directors, shape.curvatures, shape.twists, shape.motion, shape.velocities)
    moved = rods.displaced(moved, np.zeros(rods.size))  # measures curvatures and twists again
    energy = rods.elastic_energies(shape)
    assert rods.elastic_energies(moved) == pytest.approx(energy, rel=1e-10)
    forces, spin = rods.elastic_forces(shape), rng.normal(size=3)
    virtual = np.zeros(rods.size)
    for i, (p0, p1) in enumerate(zip(rods.node_offsets[:-1], rods.node_offsets[1:], strict=True)):
        for p in range(p0, p1):
            virtual[4 * p - i : 4 * p - i + 3] = np.cross(spin, shape.nodes[p])
            if p < p1 - 1:
                tangent = shape.nodes[p + 1] - shape.nodes[p]
                virtual[4 * p - i + 3] = rods.radii[i] * spin @ tangent / np.linalg.norm(tangent)
    size = np.abs(forces).sum()
    assert abs(forces @ virtual) < 1e-11 * size
    at_nodes = rods.elastic_forces(shape)[rods.is_node].reshape(-1, 3)
    assert np.abs(at_nodes.sum(axis=0)).max() < 1e-12 * size


def test_step_matrix_is_symmetric_positive_definite_even_of_a_crushed_rod() -> None:
    rods = straight(10, 1.0, SECTION, rest_lengths=np.full(10, 0.3))  # at a third of its length: unstable
    dt = 0.05
    full = rods.hessian(rods.started()).toarray()[7:, 7:] * dt + np.diag(rods.masses[7:]) / dt
    assert np.linalg.eigvalsh(full)[0] < 0.0
    system = rods.system(rods.started(), dt, GRAVITY)
    block = system.blocks.reshape(36, 36)
    assert np.array_equal(block, block.T)
    assert scipy.linalg.eigvalsh(block, np.diag(rods.masses[7:]) / dt)[0] > 1.0 - 1e-6


# -- statics ------------------------------------------------------------------------------------------------------------


def elastica(load: float) -> tuple[float, float]:
    """Tip of a heavy horizontal cantilever of unit length, load = rho g A L^3 / EI: EI theta'' = -rho g A (L - s) cos theta."""
    s, y = np.linspace(0.0, 1.0, 100), np.zeros((2, 100))
    for part in np.linspace(min(load, 1.0), load, 12):
        found = solve_bvp(
            lambda s, y, w=part: np.array([y[1], -w * (1.0 - s) * np.cos(y[0])]),
            lambda a, b: np.array([a[0], b[1]]),
            s, y, tol=1e-7, max_nodes=20000,
        )  # fmt: skip
        assert found.success
        s, y = found.x, found.y
    angle = found.sol(np.linspace(0.0, 1.0, 2001))[0]
    return float(np.trapezoid(np.cos(angle), dx=5e-4)), float(-np.trapezoid(np.sin(angle), dx=5e-4))


@pytest.mark.parametrize("load", [1.0, 5.0, 20.0, 100.0])
def test_heavy_cantilever_is_the_elastica(load: float) -> None:
    radius, young = 0.005, 1e6
    density = load * young * radius**2 / 4.0 / 9.81
    rods = straight(40, 1.0, Section.circular(radius, density=density, young=young))
    rest = at_rest(rods, rods.started(), GRAVITY)
    assert rest.converged
    tip, (x, z) = rest.shape.nodes[-1], elastica(load)
    assert np.hypot(tip[0] - x, tip[2] - z) < 0.01
    assert tip[2] == pytest.approx(z, rel=0.01) and abs(tip[1]) < 1e-9


def helix_nodes(curvature: float, torsion: float, arcs: np.ndarray) -> np.ndarray:
    """Points of a helix about the z axis at arc lengths."""
    turn = np.hypot(curvature, torsion)
    radius, angle = curvature / turn**2, turn * arcs
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), torsion / turn * arcs])


@settings(max_examples=30, deadline=None)
@given(st.floats(0.5, 20.0), st.floats(-15.0, 15.0), st.floats(0.0, 6.28))
def test_a_natural_coil_laid_out_is_the_exact_helix(curvature: float, torsion: float, phase: float) -> None:
    n, arc = 30, 0.05
    want = helix_nodes(curvature, torsion, arc * np.arange(n + 1))
    lengths = np.linalg.norm(np.diff(want, axis=0), axis=1)
    bends = curvature * np.array([np.cos(phase), np.sin(phase)])
    natural = Natural.of_curve(bends, torsion, lengths[1:])
    nodes, _ = laid_out(natural, lengths, [0, n + 1], np.zeros(3), np.eye(3))
    assert scipy.linalg.orthogonal_procrustes(nodes - nodes.mean(axis=0), want - want.mean(axis=0))[1] > 0.0
    moved, target = nodes - nodes.mean(axis=0), want - want.mean(axis=0)
    left, _, right = np.linalg.svd(moved.T @ target)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right  # a rotation: handedness counts
    assert np.abs(moved @ turn - target).max() < 1e-9


def test_a_straightened_curl_returns_to_its_natural_helix() -> None:
    n, length = 30, 0.3
    section = Section.circular(5e-5, density=1300.0, young=4e9, poisson=0.4)
    lengths = np.full(n, length / n)
    natural = Natural.of_curve([40.0, 0.0], 15.0, lengths[1:])
    rods = Rods(
        [np.linspace(0.0, length, n + 1)[:, None] * np.array([0.0, 0.0, -1.0])], section, natural=natural
    )
    rest = at_rest(rods, rods.started(), NONE)
    frames = rods.roots.at(0.0)[1]
    nodes, _ = laid_out(natural, lengths, [0, n + 1], np.zeros(3), frames)
    assert rest.converged
    assert np.abs(rest.shape.nodes - nodes).max() < 1e-4 * length
    assert np.linalg.norm(nodes[-1]) < 0.6 * length


def test_a_coil_spring_has_the_stiffness_of_textbooks() -> None:
    """k = G d^4 / (8 D^3 turns) of a close-coiled spring of wire diameter d, coil diameter D (Timoshenko)."""
    radius, coil, pitch, turns, n = 2e-4, 0.02, 0.002, 3.0, 150
    young, poisson = 1e9, 0.3
    section = Section.circular(radius, density=1000.0, young=young, poisson=poisson)
    angle = 2.0 * np.pi * turns
    length, height = np.hypot(coil * angle, pitch * turns), pitch * turns

    def strains(rise: float) -> tuple[float, float]:
        """Curvature and torsion of the helix of this height, of the same length and total angle."""
        return np.sqrt(length**2 - rise**2) * angle / length**2, rise * angle / length**2

    def spring(rise: float) -> Rods:
        """The helix of height `rise`, clamped at both ends, of the natural shape of that of height `height`."""
        bend, twist = strains(rise)
        chords = np.linalg.norm(
            np.diff(helix_nodes(bend, twist, np.linspace(0, length, n + 1)), axis=0), axis=1
        )
        loaded = Natural.of_curve([bend, 0.0], twist, chords[1:])
        nodes, directors = laid_out(loaded, chords, [0, n + 1], np.zeros(3), np.eye(3))
        edge = (nodes[-1] - nodes[-2]) / chords[-1]
        frame = np.column_stack([edge, directors[-1], np.cross(edge, directors[-1])])
        roots, tips = StillRoots(np.zeros((1, 3)), np.eye(3)), StillRoots(nodes[-1:], frame)
        bend, twist = strains(height)
        natural = Natural.of_curve([bend, 0.0], twist, chords[1:])
        carried = Rods([nodes], section, roots=roots).started().directors  # without the material twist
        tangents = np.diff(nodes, axis=0) / chords[:, None]
        sines = np.sum(np.cross(carried, directors) * tangents, axis=1)
        angles = np.arctan2(sines, np.sum(carried * directors, axis=1))
        return Rods([nodes], section, roots=roots, tips=tips, natural=natural, angles=angles)

    stretch = 1e-4
    energies = []
    for sign in (1.0, -1.0):
        rods = spring(height + sign * stretch)
        rest = at_rest(rods, rods.started(), NONE)
        assert (
            np.abs(rest.shape.nodes - rods.started().nodes).max() < 0.05 * stretch
        )  # the helix is the equilibrium
        energies.append(float(rods.elastic_energies(rest.shape)[0]))
    stiffness = sum(energies) / stretch**2
    shear = young / (2.0 * (1.0 + poisson))
    assert stiffness == pytest.approx(shear * (2 * radius) ** 4 / (8.0 * (2 * coil) ** 3 * turns), rel=0.01)


def least(matrix: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(matrix)[0])


def threshold(smallest, low: float, high: float) -> float:
    """Where `smallest` falls below zero."""
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if smallest(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def test_a_twisted_straight_rod_buckles_at_the_torque_of_greenhill() -> None:
    """Ends clamped in place: M L / EI = 8.987, twice the first root of tan x = x (Greenhill 1883; Love, art. 272)."""
    section = Section.circular(0.01, density=1000.0, young=1e6, poisson=0.3)
    n = 60
    nodes = np.linspace(0.0, 1.0, n + 1)[:, None] * np.array([1.0, 0.0, 0.0])
    # the first and last inner nodes stand for a length and a half: they take more of an even twist
    spread = np.concatenate([[0.0], np.cumsum(np.concatenate([[1.5], np.ones(n - 3), [1.5]]))]) / n

    ratio = float(section.twisting / section.bending[0, 0])
    turn = threshold(lambda turn: smallest_clamped(nodes, section, turn * spread), 5.0, 15.0)
    assert turn * ratio == pytest.approx(8.9868, rel=0.01)


def smallest_clamped(nodes: np.ndarray, section: Section, angles: np.ndarray) -> float:
    """Least eigenvalue of the Hessian of a twisted rod with both ends clamped."""
    frame = frames_along([nodes[-1] - nodes[-2]])[0]
    c, s = np.cos(angles[-1]), np.sin(angles[-1])
    turned = np.column_stack(
        [frame[:, 0], c * frame[:, 1] + s * frame[:, 2], -s * frame[:, 1] + c * frame[:, 2]]
    )
    tips = StillRoots(nodes[-1:], turned)
    rods = Rods([nodes], section, natural="straight", angles=angles, tips=tips)
    held = slice(7, rods.size - 7)
    return least(rods.hessian(rods.started()).toarray()[held, held])


def test_a_twisted_ring_buckles_at_the_twist_of_michell() -> None:
    """Total twist 2 pi sqrt(3) EI / GJ of a ring naturally straight (Michell 1889; Zajac 1962; Goriely 2006)."""
    n, section = 60, Section.circular(0.002, density=1000.0, young=1e6, poisson=0.3)
    around = 2.0 * np.pi * np.arange(n + 2) / n  # the last edge lies on the first: one ring of n edges
    nodes = np.column_stack([np.cos(around), np.sin(around), np.zeros(n + 2)])
    size = 4 * n
    join = np.zeros((4 * (n + 2) - 1, size))
    for k in range(4 * (n + 2) - 1):
        join[k, k % size] = 1.0
    roots = StillRoots(nodes[:1], frames_along(nodes[1:2] - nodes[:1]), hold="free")

    def negative(turn: float) -> float:
        rods = Rods([nodes], section, roots=roots, natural="straight", angles=turn * np.arange(n + 1) / n)
        values = np.linalg.eigvalsh(join.T @ rods.hessian(rods.started()).toarray() @ join)
        return -1.0 if values[0] < -1e-3 * values[8] else 1.0  # seven motions cost nothing

    ratio = float(section.twisting / section.bending[0, 0])
    assert threshold(negative, 5.0, 25.0) * ratio == pytest.approx(2.0 * np.pi * np.sqrt(3.0), rel=0.01)


# -- dynamics -----------------------------------------------------------------------------------------------------------


def run(rods: Rods, dt: float, steps: int, gravity: np.ndarray) -> list[RodShape]:
    """Steps without contacts."""
    shapes = [rods.started()]
    for _ in range(steps):
        system = rods.system(shapes[-1], dt, gravity)
        velocities = np.empty_like(system.forces)
        for i in range(len(rods.radii)):
            own = slice(rods.offsets[i], rods.offsets[i + 1])
            order = own.stop - own.start
            block = system.blocks[system.block_offsets[i] : system.block_offsets[i + 1]].reshape(order, order)
            velocities[own] = scipy.linalg.solve(block, system.forces[own], assume_a="pos")
        shapes.append(rods.moved(shapes[-1], velocities, dt))
    return shapes


def test_a_cantilever_vibrates_at_the_frequency_of_euler_and_bernoulli() -> None:
    radius, young, density, length = 0.005, 1e8, 1000.0, 1.0
    section = Section.circular(radius, density=density, young=young)
    rods = straight(20, length, section)
    want = 1.875104**2 * np.sqrt(young * radius**2 / 4.0 / density) / length**2
    hessian, masses = rods.hessian(rods.started()).toarray()[7:, 7:], np.diag(rods.masses[7:])
    assert np.sqrt(scipy.linalg.eigh(hessian, masses)[0][0]) == pytest.approx(want, rel=0.01)
    period = 2.0 * np.pi / want
    shares, found = (200, 400), []
    for share in shares:  # steps a period
        mode = scipy.linalg.eigh(hessian, masses)[1][:, 0]
        velocities = np.zeros(rods.size)
        velocities[7:] = 1e-3 * mode / np.abs(mode).max()
        kicked = straight(20, length, section, velocities=velocities[rods.is_node].reshape(-1, 3))
        height = np.array(
            [
                shape.nodes[-1] - [length, 0.0, 0.0]
                for shape in run(kicked, period / share, int(1.1 * share), NONE)
            ]
        )
        height = height @ (height[share // 4] / np.linalg.norm(height[share // 4]))
        ups = np.flatnonzero(height[1:] * height[:-1] < 0.0)
        cross = [k + height[k] / (height[k] - height[k + 1]) for k in ups[:2]]
        found.append(share / (2.0 * (cross[1] - cross[0])) * want)
    # implicit Euler lowers a frequency w by the factor atan(w dt) / (w dt): its errors fall as dt^2
    assert found[1] == pytest.approx(want, rel=0.01)
    assert abs(found[1] - found[0]) < 1e-3 * want


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_step_without_contact_is_implicit_euler(seed: int) -> None:
    rods, dt = wild(seed), 2e-3
    before = rods.started()
    after = run(rods, dt, 1, GRAVITY)[-1]
    weight = np.zeros(rods.size)
    weight[rods.is_node] = (rods.masses[rods.is_node].reshape(-1, 3) * GRAVITY).ravel()
    inertia = rods.masses * (after.motion - before.motion) / dt
    forces = rods.elastic_forces(after) + weight
    assert np.abs((inertia - forces)[rods.free]).max() < 1e-5 * np.abs(forces).max()


def turning_head(time: float) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(3), rotations.exponential(np.array([0.0, 0.0, 2.0 * np.sin(20.0 * time)]))


def test_a_curl_on_a_head_that_shakes_keeps_its_length() -> None:
    """Roots at up to 4 m/s, edges turning by up to half a radian in a step."""
    n, dt = 20, 2e-3
    section = Section.circular(4e-5, density=1300.0, young=4e9, poisson=0.4)
    lengths = np.full(n, 0.01)
    natural = Natural.of_curve([60.0, 0.0], 10.0, lengths[1:])
    frames = frames_along([1.0, 0.0, 0.0])
    nodes, _ = laid_out(natural, lengths, [0, n + 1], np.array([0.1, 0.0, 0.0]), frames)
    roots = MovingRoots(nodes[:1], frames, turning_head)
    rods = Rods([nodes], section, roots=roots, damping=Damping(air=1e-5))
    for shape in run(rods, dt, 100, GRAVITY)[1:]:
        stretch = np.linalg.norm(np.diff(shape.nodes, axis=0), axis=1) / rods.rest_lengths - 1.0
        assert np.abs(stretch).max() < 1e-3
        assert shape.nodes[0] == pytest.approx(roots.at(shape.time)[0][0], abs=1e-12)


@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.1])
def test_energy_of_a_swinging_curl_does_not_grow(dt: float) -> None:
    n = 15
    section = Section.circular(1e-4, density=1300.0, young=4e9, poisson=0.4)
    natural = Natural.of_curve([30.0, 0.0], 10.0, np.full(n - 1, 0.01))
    line = np.linspace(0.0, 0.15, n + 1)[:, None] * np.array([1.0, 0.0, 0.0])
    rods = Rods([line], section, natural=natural)
    shapes = run(rods, dt, 40, GRAVITY)
    energies = np.array([rods.kinetic_energy(s) + rods.potential_energy(s, GRAVITY) for s in shapes])
    assert np.all(np.diff(energies) <= 1e-6 * energies[0])
    assert energies[-1] < energies[0]


def test_free_rods_keep_momentum_and_fall() -> None:
    rods = wild(3, hold="free")
    masses = rods.masses[rods.is_node].reshape(-1, 3)
    before, after = rods.started(), run(rods, 1e-3, 20, GRAVITY)[-1]
    change = (masses * (rods.node_velocities(after) - rods.node_velocities(before))).sum(axis=0)
    assert change == pytest.approx(masses.sum(axis=0) * GRAVITY * 0.02, abs=1e-9 * masses.sum())


def test_damping_does_not_brake_rigid_motion_and_air_does() -> None:
    spin = np.array([0.0, 0.0, 3.0])
    nodes = np.linspace(0.0, 0.5, 6)[:, None] * np.array([1.0, 0.0, 0.0])
    roots = StillRoots(nodes[:1], frames_along(nodes[1:2]), hold="free")
    energies = []
    for damping in (Damping(), Damping(internal=0.1), Damping(air=0.05)):
        rods = Rods([nodes], SECTION, roots=roots, velocities=np.cross(spin, nodes), damping=damping)
        energies.append(rods.kinetic_energy(run(rods, 1e-4, 20, NONE)[-1]))
    assert energies[1] == pytest.approx(energies[0], rel=1e-4)
    assert energies[2] < 0.999 * energies[0]


# -- ends and rows ------------------------------------------------------------------------------------------------------


def turning(time: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.1 * np.sin(3.0 * time), 0.0, time]), rotations.exponential(
        np.array([time, 2.0 * time, 0.5])
    )


@pytest.mark.parametrize("hold", ["clamped", "ball", "free"])
def test_rows_say_how_points_move_and_ends_go_where_they_are_told(hold: str) -> None:
    rng = np.random.default_rng(5)
    lines = [np.cumsum(rng.normal(size=(n, 3)) * 0.02 + [0.1, 0.0, 0.0], axis=0) for n in (4, 7)]
    frames = frames_along([line[1] - line[0] for line in lines])
    roots = MovingRoots(np.array([line[0] for line in lines]), frames, turning, hold=hold)
    rods, dt = Rods(lines, SECTION, roots=roots), 0.01
    fibre, segment = np.array([0, 1, 1, 0, 1]), np.array([0, 0, 5, 2, 1])
    share = np.array([0.3, 1.0, 0.0, 0.5, 0.7])
    shape = rods.started()
    for _ in range(3):
        velocities = rng.normal(size=len(shape.velocities))
        rows = rods.rows(shape, dt, fibre, segment, share)
        after = rods.moved(shape, velocities, dt)
        for k, i in enumerate(fibre):
            order = rods.offsets[i + 1] - rods.offsets[i]
            block = rows.values[rows.starts[k] : rows.starts[k] + 3 * order].reshape(3, order)
            given_rate = block @ velocities[rods.offsets[i] : rods.offsets[i + 1]] + rows.drift[k]
            p = rods.node_offsets[i] + segment[k]
            step = (after.nodes - shape.nodes)[p : p + 2]
            assert given_rate == pytest.approx(((1 - share[k]) * step[0] + share[k] * step[1]) / dt, abs=1e-9)
        shape = after
    positions, frames = roots.at(shape.time)
    if hold != "free":
        assert shape.nodes[rods.node_offsets[:-1]] == pytest.approx(positions, abs=1e-12)
    if hold == "clamped":
        assert shape.directors[[0, 3]] == pytest.approx(frames[:, :, 1], abs=1e-12)


def test_a_state_comes_back_from_its_arrays() -> None:
    rods = wild(8)
    shape = run(rods, 1e-3, 3, GRAVITY)[-1]
    back = rods.restored(shape.arrays())
    assert all(np.array_equal(value, back.arrays()[name]) for name, value in shape.arrays().items())
    with pytest.raises(InputError, match="nodes"):
        rods.restored({**shape.arrays(), "nodes": shape.nodes[1:]})


def test_roots_turn_with_their_motion() -> None:
    roots = MovingRoots(np.eye(3), frames_along(np.eye(3)), turning)
    linear, spins = roots.velocities(0.2, 0.05)
    before, after = roots.at(0.2), roots.at(0.25)
    assert before[0] + 0.05 * linear == pytest.approx(after[0], abs=1e-12)
    turn = rotations.matrix(rotations.exponential(0.05 * spins[0]))
    assert turn @ before[1] == pytest.approx(after[1], abs=1e-12)


LINE = np.linspace(0.0, 0.4, 5)[:, None] * np.array([1.0, 0.0, 0.0])
BAD = {
    "zero length": (lambda: Rods([np.vstack([LINE, LINE[-1]])], SECTION), "positive length"),
    "thick": (lambda: Rods([0.01 * LINE], SECTION), "radius"),
    "folded": (lambda: Rods([np.vstack([LINE, LINE[-2]])], SECTION), "folded"),
    "not finite": (lambda: Rods([np.where(LINE == 0.4, np.nan, LINE)], SECTION), "finite"),
    "two nodes": (lambda: Rods([LINE[:2]], SECTION), "three nodes"),
    "root elsewhere": (lambda: Rods([LINE], SECTION, roots=StillRoots([[0, 0, 1]], frames_along([1, 0, 0]))), "roots.pos"),
    "root across": (lambda: Rods([LINE], SECTION, roots=StillRoots([[0, 0, 0]], frames_along([0, 1, 0]))), "roots.fra"),
    "frame": (lambda: StillRoots([[0, 0, 0]], 2.0 * np.eye(3)), "rotation matrix"),
    "roots short": (lambda: Rods([LINE, LINE], SECTION, roots=StillRoots([[0, 0, 0]], np.eye(3))), "each of the 2"),
    "tip turned": (lambda: Rods([LINE], SECTION, tips=StillRoots(LINE[-1:], frames_along([1, 0, 0], [1, 2, 3]))), "tips"),
    "held twice": (lambda: Rods([LINE[:3]], SECTION, tips=StillRoots(LINE[2:3], frames_along([1, 0, 0]))), "hold the same"),
    "young": (lambda: Section.circular(0.01, density=1.0, young=-1.0), "young"),
    "poisson": (lambda: Section.circular(0.01, density=1.0, young=1.0, poisson=0.6), "poisson"),
    "bending": (lambda: Section(0.01, 1, 1, [[1, 2], [2, 1]], 1, 1), "positive definite"),
    "natural": (lambda: Rods([LINE], SECTION, natural=Natural(np.zeros((2, 2)), np.zeros(3))), "natural"),
    "coil": (lambda: Natural.of_curve([100.0, 0.0], 0.0, [0.1]), "curvatures"),
    "damping": (lambda: Damping(internal=-1.0), "damping"),
    "dt": (lambda: Rods([LINE], SECTION).system(Rods([LINE], SECTION).started(), 0.0, GRAVITY), "dt"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_rods_that_make_no_sense_are_refused(name: str) -> None:
    build, said = BAD[name]
    with pytest.raises(InputError, match=said):
        build()
