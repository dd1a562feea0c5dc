"""Super-Helices (Bertails et al. 2006) move, weigh and swing as inextensible Kirchhoff rods do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from barchan.bodies.fibres.helices import Helices, HelixShape, even_pieces
from barchan.bodies.fibres.model import FibreSystem
from barchan.bodies.fibres.rods import Natural, Rods, Section, at_rest, laid_out
from barchan.bodies.fibres.roots import MovingRoots, StillRoots, frames_along
from barchan.errors import InputError

Vector = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.81])
DOWN, ALONG = [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]


def one_fibre(pieces: int, tangent: list[float], length: float = 0.3, **choices: object) -> Helices:
    """A fibre held at the origin, 1 mm thick, soft enough to bend under its weight."""
    lengths, firsts = even_pieces([length], pieces)
    roots = StillRoots(np.zeros((1, 3)), frames_along([tangent], [0.0, 1.0, 0.0]))
    given = {"radius": 5e-4, "density": 1200.0, "young": 2e7} | choices
    return Helices(lengths, firsts, roots, **given)  # type: ignore[arg-type]


def two_fibres(seed: int, curl: float = 15.0, **choices: object) -> Helices:
    """Fibres of 4 and 3 unequal pieces, of random shapes with a straight piece and an almost straight one."""
    rng = np.random.default_rng(seed)
    lengths, firsts = even_pieces([0.3, 0.2], [4, 3])
    start = curl * rng.normal(size=(7, 3))
    start[1], start[5] = 0.0, 1e-7 * start[5]
    roots = StillRoots(rng.normal(size=(2, 3)), frames_along(rng.normal(size=(2, 3))))
    given = {"natural": 0.4 * start, "curvatures": start} | choices
    return Helices(lengths * rng.uniform(0.7, 1.3, 7), firsts, roots, 1e-3, 1000.0, 1e6, **given)  # type: ignore[arg-type]


def block(system: FibreSystem, fibre: int) -> Vector:
    """One of the dense blocks."""
    values = system.blocks[system.block_offsets[fibre] : system.block_offsets[fibre + 1]]
    order = round(np.sqrt(len(values)))
    return values.reshape(order, order)


def step(model: Helices, shape: HelixShape, dt: float, gravity: Vector = GRAVITY) -> HelixShape:
    """A step without contact."""
    system = model.system(shape, dt, gravity)
    parts = [
        np.linalg.solve(block(system, i), system.forces[model.offsets[i] : model.offsets[i + 1]])
        for i in range(model.pieces.fibres)
    ]
    return model.moved(shape, np.concatenate(parts), dt)


def settled(model: Helices, gravity: Vector = GRAVITY, ramp: int = 10) -> HelixShape:
    """At rest under gravity, which grows in a few steps so long that each is one of Newton's for the equilibrium."""
    shape = model.started()
    for k in range(200):
        shape = step(model, shape, 1e3, min(1.0, (k + 1) / ramp) * gravity)
        forces = model.weight_forces(shape, gravity)
        left = forces - (model.stiffness * (shape.curvatures - model.natural_curvatures)).reshape(-1)
        if k >= ramp and np.max(np.abs(left)) <= 1e-9 * np.max(np.abs(forces)):
            return shape
    raise AssertionError("not at rest")


def differences(function: object, q: Vector, h: float) -> Vector:
    """Derivatives of a function of (m,) by centred differences: the last axis is that of q."""
    columns = []
    for k in range(q.size):
        d = np.zeros(q.size)
        d[k] = h
        columns.append((function(q + d) - function(q - d)) / (2.0 * h))  # type: ignore[operator]
    return np.stack(columns, axis=-1)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.01, 3.0, 20.0, 60.0]))
def test_forces_and_stiffness_are_derivatives_of_the_energy(seed: int, curl: float) -> None:
    model = two_fibres(seed, curl)
    shape, gravity = model.started(), np.array([1.0, -2.0, -9.0])

    def shaped(q: Vector) -> HelixShape:
        return replace(shape, curvatures=q.reshape(-1, 3))

    q = shape.curvatures.reshape(-1)
    exact = model.weight_forces(shape, gravity)
    elastic = model.stiffness * (shape.curvatures - model.natural_curvatures)
    slope = differences(lambda x: model.potential_energy(shaped(x), gravity), q, 1e-2)
    total = exact - elastic.reshape(-1)
    np.testing.assert_allclose(-slope, total, atol=1e-6 * np.max(np.abs(exact)))
    system = model.system(shape, 1e-3, gravity)
    np.testing.assert_allclose(system.forces, total, atol=1e-12 * np.max(np.abs(exact)))

    stiff = differences(lambda x: -model.weight_forces(shaped(x), gravity), q, 1e-2)
    blocks = model.weight_stiffness(shape, gravity)
    for i, low in enumerate((0, 144)):
        part = slice(model.offsets[i], model.offsets[i + 1])
        order = part.stop - part.start
        mine = blocks[low : low + order**2].reshape(order, order)
        np.testing.assert_allclose(mine, stiff[part, part], atol=1e-6 * np.max(np.abs(mine)))


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_rows_are_the_motion_of_points_of_the_polyline(seed: int) -> None:
    model = two_fibres(seed, nodes_per_piece=3)
    shape = model.started()
    fibre, segment, share = np.array([0, 1, 1, 0]), np.array([11, 0, 4, 5]), np.array([1.0, 0.2, 0.5, 0.0])

    def points(q: Vector) -> Vector:
        nodes = model.centre_line(replace(shape, curvatures=q.reshape(-1, 3)))
        first = model.node_offsets[fibre] + segment
        return (1.0 - share)[:, None] * nodes[first] + share[:, None] * nodes[first + 1]

    moves = differences(points, shape.curvatures.reshape(-1), 1e-3)
    rows = model.rows(shape, 1e-3, fibre, segment, share)
    for k in range(4):
        part = slice(model.offsets[fibre[k]], model.offsets[fibre[k] + 1])
        order = part.stop - part.start
        mine = rows.values[rows.starts[k] : rows.starts[k] + 3 * order].reshape(3, order)
        np.testing.assert_allclose(mine, moves[k][:, part], atol=1e-6 * np.max(np.abs(mine)))
    np.testing.assert_allclose(rows.drift, 0.0, atol=1e-12)


def test_a_piece_is_a_helix_of_its_curvature_and_torsion() -> None:
    """Exactly, whatever the length: radius k / (k^2 + t^2), pitch 2 pi t / (k^2 + t^2)."""
    curvature, torsion, length = 40.0, 12.0, 0.7
    model = one_fibre(
        1, ALONG, length, natural=[[torsion, 0.6 * curvature, 0.8 * curvature]], nodes_per_piece=50
    )
    nodes = model.centre_line(model.started())
    total = curvature**2 + torsion**2
    frame = model.roots.at(0.0)[1][0]
    axis = frame @ np.array([torsion, 0.6 * curvature, 0.8 * curvature]) / np.sqrt(total)
    along = nodes @ axis
    np.testing.assert_allclose(along, np.linspace(0.0, length, 51) * torsion / np.sqrt(total), atol=1e-12)
    across = nodes - along[:, None] * axis
    angle = np.sqrt(total) * length / 50
    chords = np.linalg.norm(np.diff(across, axis=0), axis=1)
    np.testing.assert_allclose(chords, 2.0 * curvature / total * np.sin(0.5 * angle), rtol=1e-12)


@pytest.mark.parametrize("load", [1.0, 8.0, 40.0])
def test_a_cantilever_under_its_weight_is_the_heavy_elastica(load: float) -> None:
    """EI angle'' = w (L - s) cos(angle), the angle below the horizontal; load = w L^3 / EI."""
    length, radius = 0.3, 5e-4
    weight = 1200.0 * np.pi * radius**2 * 9.81
    young = weight * length**3 / load / (0.25 * np.pi * radius**4)
    model = one_fibre(12, ALONG, length, young=young)
    nodes = model.centre_line(settled(model, ramp=4))

    def slopes(s: Vector, y: Vector) -> Vector:
        return np.stack([y[1], -load * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a: Vector, b: Vector) -> Vector:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, 1.0, 200)
    guess = np.stack([1.2 * (1.0 - (1.0 - s) ** 3), 3.6 * (1.0 - s) ** 2, s, s])
    solution = solve_bvp(slopes, ends, s, guess, tol=1e-8, max_nodes=20_000)
    assert solution.success
    tip = length * solution.y[2:, -1] * np.array([1.0, -np.sign(solution.y[3, -1])])
    reached = np.linalg.norm(nodes[-1, [0, 2]] - tip) / length
    assert reached < 5e-3


def test_a_close_coil_is_a_spring() -> None:
    """Force over extension, loaded along its axis, is G d^4 / (8 D^3 n)."""
    mean, turns, radius, young, poisson, pieces = 0.02, 6.0, 5e-4, 2e8, 0.3, 36
    curvature = 2.0 / mean
    lengths, firsts = even_pieces([np.pi * mean * turns], pieces)
    roots = StillRoots(np.zeros((1, 3)), np.eye(3))
    coil = np.tile([0.0, 0.0, curvature], (pieces, 1))
    model = Helices(lengths, firsts, roots, radius, 1200.0, young, poisson, natural=coil)
    shape, last = model.started(), model.node_offsets[-1] - 1
    rows = model.rows(shape, 1.0, np.array([0]), np.array([last - 1]), np.array([1.0]))
    # The coil is in the plane of the first two axes, its centre half a diameter aside; the load is there, on a rigid arm.
    spins = np.concatenate(model.placed(shape.curvatures, 0.0).psi, axis=1)
    arm = np.array([0.0, 0.5 * mean, 0.0]) - model.centre_line(shape)[-1]
    moves = rows.values.reshape(3, -1)[2] + np.cross(spins.T, arm)[:, 2]
    flexibility = np.sum(moves**2 / model.stiffness.reshape(-1))
    shear = young / (2.0 * (1.0 + poisson))
    assert 1.0 / flexibility == pytest.approx(shear * (2.0 * radius) ** 4 / (8.0 * mean**3 * turns), rel=1e-6)


@pytest.mark.parametrize("mode", [1, 2])
def test_a_cantilever_vibrates_at_its_frequencies(mode: int) -> None:
    """beta^2 sqrt(EI / (w L^4)), by the vibrations of the step's own inertia and stiffness about the straight fibre."""
    model = one_fibre(16, ALONG)
    shape, dt = model.started(), 1e3
    stiff = np.diag(model.stiffness.reshape(-1))
    # A = M / dt + dt K: at a large dt and a small one
    mass = (block(model.system(shape, 1.0 / dt, np.zeros(3)), 0) - stiff / dt) / dt
    bending = np.arange(2, 48, 3)
    rates = np.linalg.eigvals(
        np.linalg.solve(stiff[np.ix_(bending, bending)], mass[np.ix_(bending, bending)])
    )
    found = 1.0 / np.sqrt(np.sort(rates.real)[::-1][mode - 1])
    bend = 0.25 * np.pi * 5e-4**4 * 2e7
    beta = {1: 1.8751040687, 2: 4.6940911330}[mode]
    assert found == pytest.approx(beta**2 * np.sqrt(bend / (model.line_densities[0] * 0.3**4)), rel=0.01)


def test_the_time_between_swings_is_that_of_the_first_mode() -> None:
    """Released from a small bend, first order in dt."""
    model = one_fibre(6, ALONG)
    bend = 0.25 * np.pi * 5e-4**4 * 2e7
    period = 2.0 * np.pi / (1.8751040687**2 * np.sqrt(bend / (model.line_densities[0] * 0.3**4)))
    shape = settled(model, 1e-3 * GRAVITY, ramp=1)
    shape = replace(
        shape, time=0.0, velocities=0.0 * shape.velocities, point_velocities=0.0 * shape.point_velocities
    )
    steps, heights = 300, []
    for _ in range(2 * steps + 10):
        shape = step(model, shape, period / steps, np.zeros(3))
        heights.append(model.centre_line(shape)[-1, 2])
    signs = np.flatnonzero(np.diff(np.sign(heights)))
    # zeros at a quarter, three quarters, five quarters of the period
    assert (signs[2] - signs[0]) / steps == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("young", [1e5, 1e6, 1e8])
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_energy_never_grows(young: float, dt: float) -> None:
    """However soft the fibre; a fibre of 100 kPa bends under a thousandth of its weight."""
    model = replace(two_fibres(0), young=young)
    for gravity in (np.zeros(3), GRAVITY):
        shape = model.started()
        energies = [model.potential_energy(shape, gravity)]
        for _ in range(60):
            shape = step(model, shape, dt, gravity)
            energies.append(model.kinetic_energy(shape) + model.potential_energy(shape, gravity))
        assert energies[-1] < energies[0]
        assert np.max(np.diff(energies)) <= 1e-6 * (energies[0] - energies[-1])


@pytest.mark.parametrize("curl", [(0.0, 0.0, 12.0), (6.0, 20.0, 5.0)])
def test_a_curly_fibre_hangs_as_a_discrete_elastic_rod_does(curl: tuple[float, float, float]) -> None:
    """Same material, natural twist and curvatures: nodes within 1 % of the length."""
    pieces, edges, length, radius = 10, 40, 0.25, 5e-4
    lengths, firsts = even_pieces([length], pieces)
    roots = StillRoots(np.zeros((1, 3)), frames_along([[1.0, 0.0, 0.3]]))
    model = Helices(
        lengths, firsts, roots, radius, 1200.0, 1e8, natural=np.tile(curl, (pieces, 1)), nodes_per_piece=4
    )
    ours = model.centre_line(settled(model))
    section = Section.circular(radius, density=1200.0, young=1e8, poisson=0.3)
    spans = np.full(edges, length / edges)
    natural = Natural.of_curve([curl[2], -curl[1]], curl[0], spans[1:])
    # the first edge is a chord: its frame is that half-way along
    place, frame = roots.at(0.0)
    held = StillRoots(place, frame @ Rotation.from_rotvec(0.5 * spans[0] * np.array(curl)).as_matrix())
    nodes, _ = laid_out(natural, spans, [0, edges + 1], *held.at(0.0))
    rods = Rods([nodes], section, roots=held, natural=natural)
    rest = at_rest(rods, rods.started(), GRAVITY)
    assert rest.converged
    theirs = rods.centre_line(rest.shape)
    assert np.max(np.linalg.norm(ours - theirs, axis=1)) < 0.01 * length
    assert np.max(np.linalg.norm(ours - model.centre_line(model.started()), axis=1)) > 0.05 * length


def test_a_turning_root_carries_a_stiff_fibre_as_a_rigid_body() -> None:
    def turn(time: float) -> tuple[Vector, Vector]:
        angle = 5.0 * time
        return np.array([0.1 * time, 0.0, 0.0]), np.array(
            [np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]
        )

    lengths, firsts = even_pieces([0.1], 3)
    roots = MovingRoots(np.zeros((1, 3)), frames_along([ALONG]), turn)
    model = Helices(lengths, firsts, roots, 2e-3, 1000.0, 1e12, natural=np.full((3, 3), 5.0))
    start = model.centre_line(model.started())
    shape = model.started()
    for _ in range(20):
        rows = model.rows(shape, 1e-2, np.array([0]), np.array([11]), np.array([1.0]))
        before = model.centre_line(shape)[-1]
        shape = step(model, shape, 1e-2)
        moved = before + 1e-2 * (rows.values.reshape(3, -1) @ shape.velocities + rows.drift[0])
        np.testing.assert_allclose(moved, model.centre_line(shape)[-1], atol=1e-8)
    c, s = np.cos(1.0), np.sin(1.0)
    turned = start @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T + [0.02, 0.0, 0.0]
    np.testing.assert_allclose(model.centre_line(shape), turned, atol=2e-5)
    expected = np.cross([0.0, 0.0, 5.0], turned - [0.02, 0.0, 0.0])
    expected[:, 0] += 0.1
    np.testing.assert_allclose(model.node_velocities(shape), expected, atol=2e-3)


def test_drag_slows_a_falling_end_to_the_speed_where_it_bears_the_weight() -> None:
    """A fibre that hardly resists falls at first at w g / drag, where the drag is large."""
    model = one_fibre(4, ALONG, air_friction=10.0, young=1e-2)
    shape = step(model, model.started(), 0.1)
    expected = -9.81 * model.line_densities[0] / 10.0
    assert model.node_velocities(shape)[-1, 2] == pytest.approx(expected, rel=0.2)


def test_shapes_are_written_and_read() -> None:
    model = two_fibres(3)
    shape = step(model, model.started(), 1e-2)
    again = model.restored(shape.arrays())
    for name, array in shape.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    np.testing.assert_array_equal(step(model, again, 1e-2).curvatures, step(model, shape, 1e-2).curvatures)


@pytest.mark.parametrize(
    ("field", "choices"),
    [
        ("radius", {"radius": 0.2}),
        ("radius", {"radius": -1.0}),
        ("young", {"young": 0.0}),
        ("poisson", {"poisson": 0.7}),
        ("natural", {"natural": np.zeros((2, 3))}),
        ("curvatures", {"curvatures": np.full((3, 3), np.nan)}),
        ("nodes_per_piece", {"nodes_per_piece": 0}),
        ("roots", {"roots": StillRoots(np.zeros((2, 3)), np.eye(3))}),
        ("roots.hold", {"roots": StillRoots(np.zeros((1, 3)), np.eye(3), "free")}),
        ("lengths", {"lengths": np.array([0.1, 0.0, 0.1])}),
        ("firsts", {"firsts": np.array([0, 2])}),
    ],
)
def test_bad_input_is_named(field: str, choices: dict[str, object]) -> None:
    lengths, firsts = even_pieces([0.3], 3)
    given = {
        "lengths": lengths, "firsts": firsts, "roots": StillRoots(np.zeros((1, 3)), np.eye(3)), "radius": 1e-3,
        "density": 1000.0, "young": 1e6,
    } | choices  # fmt: skip
    with pytest.raises(InputError) as caught:
        Helices(**given)  # type: ignore[arg-type]
    assert caught.value.field == field
