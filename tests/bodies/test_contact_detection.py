"""Many bodies: the grid finds what testing all pairs finds; meshes are the solids they enclose; steps too long are noticed."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.contact import ContactGeometry, crossing, deepest
from barchan.bodies.contact.contact_set import merged
from barchan.bodies.contact.narrow import contacts_of
from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Box,
    Capsule,
    ConvexHull,
    Cylinder,
    Extruded,
    Fixed,
    HalfSpace,
    Polygon,
    Prescribed,
    Shape,
    Sphere,
    Torus,
    TriangleMesh,
    sample_mesh,
)
from barchan.errors import InputError

numbers = st.integers(0, 2**32 - 1)
SIDES = np.array([2.0, 1.5, 1.0])


def quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def mesh_of(facets: np.ndarray) -> TriangleMesh:
    return TriangleMesh(facets.reshape(-1, 3), np.arange(3 * len(facets)).reshape(-1, 3))


def at(states: BodyStates, positions: np.ndarray) -> BodyStates:
    return BodyStates(positions, states.rotations, states.velocities, states.spins)


def random_crowd(seed: int, d: int, count: int) -> list[Body]:
    """Bodies of all kinds whose sizes spread over two decades, some that cannot move, and a floor."""
    rng = np.random.default_rng(seed)
    hull = rng.normal(size=(8, 3))
    hull = ConvexHull(hull / np.linalg.norm(hull, axis=1)[:, None]).vertices
    angles = np.sort(rng.uniform(0, 2 * np.pi, 3)) + np.array([0.0, 0.1, 0.2])
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    bodies = [Body(HalfSpace(np.eye(d)[-1], -1.0), motion=Fixed())]
    for _ in range(count):
        size = float(10.0 ** rng.uniform(-1.7, 0.3))
        makers: list[Shape] = [
            Sphere(size, d),
            Capsule(0.5 * size, size, None, d),
            Box(size * rng.uniform(0.3, 1.0, d)),
        ]
        makers += [ConvexHull(size * hull)] if d == 3 else [Polygon(size * corners)]
        shape = makers[rng.integers(len(makers))]
        place = rng.uniform(-2.0, 2.0, d)
        rotation = quaternion(rng) if d == 3 else rng.uniform(0.0, 6.0)
        if rng.uniform() < 0.2:
            bodies.append(Body(shape, position=place, rotation=rotation, motion=Fixed()))
        else:
            bodies.append(
                Body(shape, density=1.0, position=place, rotation=rotation, velocity=rng.normal(size=d))
            )
    return bodies


@pytest.mark.parametrize("d", [2, 3])
@settings(max_examples=12)
@given(seed=numbers, reach=st.sampled_from([0.0, 0.05, 0.5]))
def test_the_grid_finds_what_testing_all_pairs_finds(d: int, seed: int, reach: float) -> None:
    bodies = random_crowd(seed, d, 60)
    states, geometry = BodyStates.at_start(bodies), ContactGeometry.of(bodies, d)
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(bodies)), 2)
        if not (bodies[i].driven and bodies[j].driven)
    ]
    all_pairs = np.array(pairs, dtype=np.int64)
    raw = contacts_of(geometry, geometry.placed(states), all_pairs, np.full(len(pairs), reach))
    expected, found = merged(raw, geometry.body, d), geometry.detect(states, reach)
    np.testing.assert_array_equal(found.keys, expected.keys)
    np.testing.assert_array_equal(found.gaps, expected.gaps)
    assert np.all(np.diff(found.keys) > 0) and np.all(found.first < found.second)
    assert found.first.dtype == np.int32 and found.keys.dtype == np.int64


def test_a_level_wider_than_its_table_loses_and_doubles_nothing() -> None:
    rng = np.random.default_rng(3)
    line = np.zeros((300, 3))
    line[:, 0] = np.cumsum(rng.choice([1.9, 2.1, 50.0, 1e7], 300))
    ball = Body(Sphere(1.0), density=1.0)
    states = BodyStates(line, np.tile([1.0, 0.0, 0.0, 0.0], (300, 1)), np.zeros((300, 3)), np.zeros((300, 3)))
    found = ContactGeometry.of([ball] * 300, 3).detect(states, 0.0)
    expected = [(k, k + 1) for k in range(299) if line[k + 1, 0] - line[k, 0] < 2.0]
    assert list(zip(found.first.tolist(), found.second.tolist(), strict=True)) == expected


def test_threads_do_not_change_a_bit() -> None:
    bodies = random_crowd(5, 3, 200)
    states, geometry = BodyStates.at_start(bodies), ContactGeometry.of(bodies, 3)
    before = numba.get_num_threads()
    results = []
    for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
        numba.set_num_threads(threads)
        results.append(geometry.detect(states, 0.1))
    numba.set_num_threads(before)
    for name in ("keys", "gaps", "points", "normals"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[-1], name))


def test_bodies_that_cannot_move_never_touch_one_another_nor_ignored_pairs() -> None:
    fixed = Body(Sphere(1.0), motion=Fixed())
    driven = Body(Box([1.0, 1.0, 1.0]), motion=Prescribed(np.array([0.0]), np.zeros((1, 3))))
    free = Body(Sphere(1.0), density=1.0, position=[0.5, 0.0, 0.0])
    bodies = [fixed, driven, free]
    states = BodyStates.at_start(bodies)
    found = ContactGeometry.of(bodies, 3).detect(states, 0.1)
    assert sorted(zip(found.first, found.second, strict=True)) == [(0, 2), (1, 2)]
    fewer = ContactGeometry.of(bodies, 3, ignored=[(2, 0)]).detect(states, 0.1)
    assert fewer.first.tolist() == [1]
    assert len(ContactGeometry.of([], 3).detect(BodyStates.none(3), 0.1)) == 0


def test_velocities_bring_contacts_of_the_coming_step_and_no_others() -> None:
    floor = Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed())
    falling = Body(Sphere(0.1), density=1.0, position=[0.0, 0.0, 1.0], velocity=[0.0, 0.0, -10.0])
    rising = Body(Sphere(0.1), density=1.0, position=[1.0, 0.0, 0.3], velocity=[0.0, 0.0, 10.0])
    spinning = Body(Capsule(0.1, 1.0, 0), density=1.0, position=[5.0, 0.0, 0.7], spin=[0.0, 10.0, 0.0])
    bodies = [floor, falling, rising, spinning]
    states, geometry = BodyStates.at_start(bodies), ContactGeometry.of(bodies, 3)
    assert len(geometry.detect(states, 0.0)) == 0
    soon = geometry.detect(states, 0.0, velocities_dt=0.1)
    assert soon.second.tolist() == [1, 3]
    np.testing.assert_allclose(soon.gaps, [0.9, 0.6])
    assert geometry.detect(states, 0.0, velocities_dt=0.05).second.tolist() == []


def test_the_deepest_pair_is_named() -> None:
    bodies = [Body(Sphere(1.0), density=1.0, position=[x, 0.0, 0.0]) for x in (0.0, 1.9, 3.5, 9.0)]
    geometry, states = ContactGeometry.of(bodies, 3), BodyStates.at_start(bodies)
    pair, depth = deepest(geometry.detect(states, 0.0))
    assert pair == (1, 2) and depth == pytest.approx(0.4)
    assert deepest(geometry.detect(at(states, 10.0 * states.positions), 0.0)) == (None, -np.inf)


def test_values_are_carried_over_by_name() -> None:
    bodies = [Body(Sphere(1.0), density=1.0, position=[x, 0.0, 0.0]) for x in (0.0, 1.9, 3.8)]
    geometry, states = ContactGeometry.of(bodies, 3), BodyStates.at_start(bodies)
    before = geometry.detect(states, 0.0)
    apart = geometry.detect(at(states, states.positions - [[1.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3]), 0.0)
    forces = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(apart.carried(before.keys, forces), forces[1:])
    np.testing.assert_array_equal(before.carried(apart.keys, forces[1:]), [[0.0, 0.0, 0.0], [4.0, 5.0, 6.0]])


@pytest.mark.parametrize("thickness", [0.01, 1.0])
def test_a_step_in_which_a_ball_crosses_a_wall_is_noticed(thickness: float) -> None:
    wall = Body(Box([0.5 * thickness, 1.0, 1.0]), motion=Fixed())
    bodies = [wall, *(Body(Sphere(0.1), density=1.0, position=[-1.0, y, 0.0]) for y in (0.0, 0.5, 3.0))]
    velocities = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [-20.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    geometry, states = ContactGeometry.of(bodies, 3), BodyStates.at_start(bodies)
    found = crossing(geometry, states, velocities, 0.1)
    assert found.pairs == [(0, 1)] and found.ways[0] == pytest.approx(2.0)
    assert found.allowed[0] == pytest.approx(0.1 + 0.5 * thickness)
    assert len(crossing(geometry, states, velocities, 0.1 * float(found.allowed[0]) / 2.01)) == 0


def test_a_ball_that_falls_into_a_floor_by_more_than_its_radius_is_noticed() -> None:
    bodies = [
        Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed()),
        Body(Sphere(0.1), density=1.0, position=[0.0, 0.0, 0.2]),
        Body(Sphere(0.1), density=1.0, position=[1.0, 0.0, 0.2]),
    ]
    states = BodyStates.at_start(bodies)
    velocities = np.array([[0.0] * 3, [0.0, 0.0, -3.0], [0.0, 0.0, 3.0]])
    assert crossing(ContactGeometry.of(bodies, 3), states, velocities, 0.1).pairs == [(0, 1)]
    with pytest.raises(InputError, match="dt"):
        crossing(ContactGeometry.of(bodies, 3), states, None, 0.0)


BAD = {
    "cylinder.*box|box.*cylinder": lambda: [
        Body(Cylinder(0.5, 0.5), name="cylinder", density=1.0),
        Body(Box([1.0, 1.0, 1.0]), name="box", motion=Fixed()),
    ],
    "Torus": lambda: [Body(Torus(0.5, 0.1), density=1.0), Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed())],
    "TriangleMesh": lambda: [
        Body(sample_mesh(), density=1.0),
        Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed()),
    ],
    "dimension": lambda: [Body(Sphere(1.0, 2), density=1.0)],
}


@pytest.mark.parametrize("name", BAD)
def test_pairs_without_a_test_are_refused_by_name(name: str) -> None:
    with pytest.raises(InputError, match=name):
        ContactGeometry.of(BAD[name](), 3)


def test_a_polygon_that_is_not_convex_meets_disks_alone() -> None:
    notch = Body(Polygon([(0, 0), (2, 0), (2, 2), (1, 1), (0, 2)]), motion=Fixed())
    disk = Body(Sphere(0.2, 2), density=1.0, position=[1.0, 1.1])
    assert len(ContactGeometry.of([notch, disk], 2).detect(BodyStates.at_start([notch, disk]), 0.0)) == 1
    with pytest.raises(InputError, match="not convex"):
        ContactGeometry.of([notch, Body(Box([0.1, 0.1]), density=1.0)], 2)


def test_bad_calls_are_refused_by_name() -> None:
    bodies = [Body(Sphere(1.0), density=1.0)]
    geometry, states = ContactGeometry.of(bodies, 3), BodyStates.at_start(bodies)
    for name, call in {
        "reach": lambda: geometry.detect(states, -1.0),
        "velocities_dt": lambda: geometry.detect(states, 0.1, 0.0),
        "states": lambda: geometry.detect(BodyStates.none(3), 0.1),
        "ignored": lambda: ContactGeometry.of(bodies, 3, ignored=[(0, 1)]),
        "velocities": lambda: crossing(geometry, states, np.zeros((2, 3)), 0.1),
    }.items():
        with pytest.raises(InputError, match=name):
            call()


GRAINS: dict[str, Shape] = {
    "ball": Sphere(0.4),
    "capsule": Capsule(0.2, 0.4, [1.0, 1.0, 0.3]),
    "box": Box([0.5, 0.3, 0.4]),
    "hull": ConvexHull(
        [(0, 0, 0.6), (0.5, 0.1, 0.2), (-0.2, 0.5, 0.3), (-0.4, -0.4, 0.1), (0.3, -0.5, -0.3), (0, 0.3, -0.6)]
    ),
}
BLOCKS = {spacing: mesh_of(Box(SIDES).facets(spacing, -SIDES, SIDES)) for spacing in (10.0, 0.7)}


@pytest.mark.parametrize("spacing", BLOCKS)
@pytest.mark.parametrize("grain", GRAINS)
@settings(max_examples=20)
@given(seed=numbers, gap=st.floats(-0.04, 0.2))
def test_a_mesh_of_a_box_is_the_box(grain: str, spacing: float, seed: int, gap: float) -> None:
    rng = np.random.default_rng(seed)
    turned, place = quaternion(rng), rng.normal(size=3)
    pose = {"rotation": turned, "position": place, "motion": Fixed()}
    way = rng.normal(size=3)
    free = Body(GRAINS[grain], density=1.0, rotation=turned if seed % 3 == 0 else quaternion(rng))
    box, mesh = ([Body(shape, **pose), free] for shape in (Box(SIDES), BLOCKS[spacing]))
    states = BodyStates.at_start(box)
    # set the grain down on the box from some side: twice, as the normal may change on the way
    position = place + 4.0 * way / np.linalg.norm(way)
    of_box, of_mesh = ContactGeometry.of(box, 3), ContactGeometry.of(mesh, 3)
    for _ in range(4):
        near = of_box.detect(at(states, np.stack([place, position])), 5.0)
        least = int(np.argmin(near.gaps))
        position = position + (near.gaps[least] - gap) * near.normals[least]
    placed = at(states, np.stack([place, position]))
    exact, found = of_box.detect(placed, 0.3), of_mesh.detect(placed, 0.3)
    # of an edge that goes in, triangles away from it know little: within the depth that counts as none
    assert float(np.min(found.gaps)) == pytest.approx(float(np.min(exact.gaps)), abs=2e-3)
    if gap > 0.01:  # apart, there is one shortest way
        assert exact.normals[np.argmin(exact.gaps)] @ found.normals[np.argmin(found.gaps)] > 0.999


@pytest.mark.parametrize("gap", [-0.01, 0.0, 0.05])
def test_a_box_on_a_plane_part_of_many_triangles_rests_on_its_corners(gap: float) -> None:
    table = Body(BLOCKS[0.7], motion=Fixed())
    box = Body(Box([0.6, 0.5, 0.2]), density=1.0, position=[0.2, 0.1, 1.2 + gap])
    found = ContactGeometry.of([table, box], 3).detect(BodyStates.at_start([table, box]), 0.1)
    corners = [[0.2 + x, 0.1 + y, 1.0 + 0.5 * gap] for x in (-0.6, 0.6) for y in (-0.5, 0.5)]
    np.testing.assert_allclose(found.points[np.lexsort(found.points.T[::-1])], corners, atol=1e-9)
    np.testing.assert_allclose(found.normals, np.tile([0.0, 0.0, -1.0], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(found.gaps, gap, atol=1e-12)


def test_a_ball_rolls_over_the_triangles_of_a_plane_part_without_a_new_name() -> None:
    table, ball = Body(BLOCKS[0.7], motion=Fixed()), Body(Sphere(0.2), density=1.0)
    geometry, start = ContactGeometry.of([table, ball], 3), BodyStates.at_start([table, ball])
    keys = set()
    for x in np.linspace(-1.5, 1.5, 101):
        found = geometry.detect(at(start, np.array([[0.0, 0.0, 0.0], [x, 0.3 * x, 1.199]])), 0.01)
        np.testing.assert_allclose(found.normals, [[0.0, 0.0, -1.0]], atol=1e-12)
        keys.add(int(found.keys[0]))
    assert len(keys) == 1


def groove() -> TriangleMesh:
    """A block with a right-angled groove along y."""
    profile = [(-2.0, -1.0), (2.0, -1.0), (2.0, 2.0), (0.0, 0.0), (-2.0, 2.0)]
    solid = Extruded(Polygon(profile), 2.0)
    facets = solid.facets(10.0, *solid.bounds())
    return mesh_of(facets)


def test_a_ball_in_a_groove_touches_both_sides() -> None:
    bodies = [
        Body(groove(), motion=Fixed()),
        Body(Sphere(0.5), density=1.0, position=[0.0, 0.1, 0.5 * np.sqrt(2.0)]),
    ]
    found = ContactGeometry.of(bodies, 3).detect(BodyStates.at_start(bodies), 0.01)
    np.testing.assert_allclose(found.gaps, 0.0, atol=1e-12)
    tilted = np.sqrt(0.5)
    normals = found.normals[np.argsort(found.normals[:, 0])]
    np.testing.assert_allclose(normals, [[-tilted, 0.0, -tilted], [tilted, 0.0, -tilted]], atol=1e-12)


def test_a_box_in_a_groove_lies_on_both_sides() -> None:
    turned = [np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0]
    box = Body(Box([0.3, 0.5, 0.3]), density=1.0, position=[0.0, 0.1, 0.3 * np.sqrt(2.0)], rotation=turned)
    bodies = [Body(groove(), motion=Fixed()), box]
    found = ContactGeometry.of(bodies, 3).detect(BodyStates.at_start(bodies), 0.01)
    np.testing.assert_allclose(found.gaps, 0.0, atol=1e-9)
    assert np.sum(found.normals[:, 0] > 0.5) == 4 and np.sum(found.normals[:, 0] < -0.5) == 4


def test_a_ball_inside_a_mesh_is_pushed_out_the_shortest_way() -> None:
    bodies = [Body(BLOCKS[0.7], motion=Fixed()), Body(Sphere(0.1), density=1.0, position=[0.3, 0.2, 0.4])]
    found = ContactGeometry.of(bodies, 3).detect(BodyStates.at_start(bodies), 0.0)
    np.testing.assert_allclose(found.gaps, [-0.7])
    np.testing.assert_allclose(found.normals, [[0.0, 0.0, -1.0]], atol=1e-12)


def test_the_example_of_the_page_runs() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "contact_detection.md"
    (example,) = re.findall(
        r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    names: dict[str, object] = {}
    exec(compile(example, str(page), "exec"), names)
    assert len(names["contacts"]) == 12  # type: ignore[arg-type]
    assert names["depth"] == 0.0 and names["too_fast"] == []
