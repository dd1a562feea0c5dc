"""Two bodies: gaps are signed distances, contacts lie on both boundaries, and neither order nor place of the pair matters."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull as QuickHull

from barchan.bodies.contact import ContactGeometry, ContactSet
from barchan.bodies.rigid import (
    Body,
    BodyStates,
    Box,
    Capsule,
    Complement,
    ConvexHull,
    Cylinder,
    Extruded,
    Fixed,
    HalfSpace,
    Intersection,
    Moved,
    Polygon,
    Shape,
    Sphere,
    Torus,
    Union,
    body_distance,
    plate_with_hole,
)
from barchan.bodies.rigid.rotations import matrix, product

HULL = [
    (0, 0, 0.6),
    (0.5, 0.1, 0.2),
    (-0.2, 0.5, 0.3),
    (-0.4, -0.4, 0.1),
    (0.3, -0.5, -0.3),
    (0.0, 0.3, -0.6),
]
PRISM = Polygon([(-0.4, -0.3), (0.5, -0.3), (0.3, 0.4)])
L_SHAPE = Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0)])
REACH = 0.4

CONVEX: dict[int, dict[str, Shape]] = {
    3: {
        "ball": Sphere(0.45),
        "capsule": Capsule(0.2, 0.5, [1.0, 2.0, -1.0]),
        "box": Box([0.5, 0.3, 0.4]),
        "slab": Box([0.7, 0.6, 0.05]),
        "hull": ConvexHull(HULL),
        "prism": Extruded(PRISM, 0.3),
        "moved box": Moved(Box([0.3, 0.2, 0.4]), [0.1, -0.2, 0.1], [0.8, 0.0, 0.6, 0.0]),
    },
    2: {
        "disk": Sphere(0.45, 2),
        "capsule": Capsule(0.2, 0.5, [1.0, 2.0], 2),
        "rectangle": Box([0.5, 0.3]),
        "triangle": PRISM,
        "pentagon": Polygon([(np.cos(a), 0.6 * np.sin(a)) for a in 0.4 * np.pi * np.arange(5)]),
    },
}
ANY: dict[int, dict[str, Shape]] = {
    3: CONVEX[3]
    | {
        "half space": HalfSpace([1.0, -2.0, 0.5], 0.3),
        "cylinder": Cylinder(0.4, 0.3, 1),
        "torus": Torus(0.6, 0.2, [1.0, 1.0, 0.0]),
        "cavity": Complement(Sphere(2.0)),
        "plate with a hole": plate_with_hole([0.7, 0.6, 0.1], 0.3),
        "lens": Intersection(Sphere(0.8), Moved(Sphere(0.8), [0.6, 0.0, 0.0])),
    },
    2: CONVEX[2]
    | {"half space": HalfSpace([1.0, -2.0], 0.3), "L": L_SHAPE, "cavity": Complement(Sphere(2.0, 2))},
}
PAIRS = [(d, a, b) for d in (2, 3) for a in CONVEX[d] for b in CONVEX[d] if a <= b]
BALL_PAIRS = [(d, name) for d in (2, 3) for name in ANY[d]]

numbers = st.integers(0, 2**32 - 1)


def turn(rng: np.random.Generator, d: int) -> np.ndarray:
    if d == 2:
        return rng.uniform(-np.pi, np.pi, 1)
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def contacts_of(first: Body, second: Body, reach: float = REACH) -> ContactSet:
    d = first.dimension
    return ContactGeometry.of([first, second], d).detect(BodyStates.at_start([first, second]), reach)


def free(shape: Shape, position: np.ndarray | None = None, rotation: np.ndarray | None = None) -> Body:
    if not shape.bounded or isinstance(shape, Complement):
        return Body(shape, motion=Fixed(), position=position, rotation=rotation)
    return Body(shape, density=1.0, position=position, rotation=rotation)


def random_pair(seed: int, d: int, a: Shape, b: Shape) -> tuple[Body, Body]:
    """Two bodies turned at random - every third pair alike - and so near that many overlap."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=d)
    way *= rng.uniform(0.1, 1.6) / np.linalg.norm(way)
    first = turn(rng, d)
    second = first if seed % 3 == 0 else turn(rng, d)
    origin = rng.normal(size=d)
    return free(a, origin, first), free(b, origin + way, second)


def core_of(body: Body) -> tuple[np.ndarray, float]:
    """Corners of the body in the world and the radius that rounds them, taken from the definition of its shape."""
    shape, place, move = body.shape, body.position, matrix(body.rotation)
    if isinstance(shape, Moved):
        move, place, shape = move @ matrix(shape.rotation), place + move @ shape.offset, shape.shape
    d, radius = shape.dimension, 0.0
    if isinstance(shape, Sphere):
        corners, radius = np.zeros((1, d)), shape.radius
    elif isinstance(shape, Capsule):
        corners, radius = shape.ends, shape.radius
    elif isinstance(shape, Box):
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * d)).reshape(d, -1).T * shape.half_extents
    elif isinstance(shape, Extruded):
        corners = np.array([(x, y, z) for x, z in shape.polygon.vertices for y in (-0.3, 0.3)])
    else:
        corners = shape.vertices  # type: ignore[attr-defined]
    return corners @ move.T + place, radius


def minkowski_distance(first: Body, second: Body) -> float:
    """Signed distance of the origin from the set of differences of points of the two bodies."""
    (a, ra), (b, rb) = core_of(first), core_of(second)
    differences = (b[None] - a[:, None]).reshape(-1, a.shape[1])
    d = differences.shape[1]
    if np.linalg.matrix_rank(differences - differences[0], tol=1e-6) < d:  # of points and segments
        flat = np.concatenate([differences, np.zeros((len(differences), 3 - d))], axis=1)
        corners = itertools.combinations_with_replacement(range(len(flat)), 3)
        return min(distance_to_triangle(flat[list(three)]) for three in corners) - ra - rb
    hull = QuickHull(differences)
    inside = float(np.max(hull.equations[:, -1]))
    if inside > 0.0:
        corners = differences[hull.vertices]
        if d == 2:
            return float(Polygon(corners).signed_distance(np.zeros((1, 2)))[0]) - ra - rb
        facets = differences[hull.simplices]
        return min(distance_to_triangle(facet) for facet in facets) - ra - rb
    return inside - ra - rb


def distance_to_triangle(corners: np.ndarray) -> float:
    """Distance of the origin, by the least of its plane where the foot is inside and of its three sides."""
    best = np.inf
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way = q - p
        share = np.clip(-(p @ way) / max(way @ way, 1e-300), 0.0, 1.0)
        best = min(best, float(np.linalg.norm(p + share * way)))
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if np.linalg.norm(normal) < 1e-14:
        return best
    normal /= np.linalg.norm(normal)
    foot = (corners[0] @ normal) * normal
    sides = [
        np.cross(q - p, foot - p) @ normal for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return min(best, float(np.linalg.norm(foot))) if min(sides) >= 0.0 else best


@pytest.mark.parametrize(("d", "name"), BALL_PAIRS)
@settings(max_examples=10)
@given(seed=numbers, radius=st.floats(0.05, 0.5))
def test_the_gap_of_a_ball_is_the_signed_distance_of_its_middle_less_its_radius(
    d: int, name: str, seed: int, radius: float
) -> None:
    other, ball = random_pair(seed, d, ANY[d][name], Sphere(radius, d))
    distance = float(body_distance(other, BodyStates.at_start([other]).row(0), ball.position[None])[0])
    assume(name != "plate with a hole" or abs(distance) > 1e-3)
    found = contacts_of(ball, other)
    if distance - radius > REACH:
        assert len(found) == 0
        return
    assert float(np.min(found.gaps)) == pytest.approx(distance - radius, abs=1e-9)
    if abs(distance) > 1e-6 and d == 3 and name not in ("box", "moved box", "prism", "hull", "slab"):
        step = 1e-6  # the ball goes away along the normal: the distance grows at unit rate
        moved = ball.position + step * found.normals[int(np.argmin(found.gaps))]
        further = float(body_distance(other, BodyStates.at_start([other]).row(0), moved[None])[0])
        assert further - distance == pytest.approx(step, rel=1e-3) or name in (
            "lens",
            "plate with a hole",
            "cylinder",
        )


@pytest.mark.parametrize(("d", "a", "b"), PAIRS)
@settings(max_examples=10)
@given(seed=numbers)
def test_the_least_gap_of_convex_bodies_is_their_signed_distance(d: int, a: str, b: str, seed: int) -> None:
    first, second = random_pair(seed, d, CONVEX[d][a], CONVEX[d][b])
    distance = minkowski_distance(first, second)
    found = contacts_of(first, second)
    assert abs(distance - REACH) < 1e-6 or (len(found) > 0) == (distance < REACH)
    if len(found):
        # faces within about a degree of each other are taken for parallel: second order in that angle
        assert float(np.min(found.gaps)) == pytest.approx(distance, rel=1e-3, abs=2e-5)


@pytest.mark.parametrize(("d", "a", "b"), PAIRS)
@settings(max_examples=8)
@given(seed=numbers)
def test_contacts_lie_on_both_boundaries(d: int, a: str, b: str, seed: int) -> None:
    first, second = random_pair(seed, d, CONVEX[d][a], CONVEX[d][b])
    found, states = contacts_of(first, second), BodyStates.at_start([first, second])
    if len(found) == 0:
        return
    shift, least = 0.5 * found.gaps[:, None] * found.normals, int(np.argmin(found.gaps))
    places = found.points + shift, found.points - shift
    for body, row, points in zip((first, second), (states.row(0), states.row(1)), places, strict=True):
        # faces and segments that are nearly parallel share a normal: they are off by the square of the angle
        distance = body_distance(body, row, points)
        assert abs(distance[least]) < 1e-3
        assert np.max(distance) < 1e-3  # a contact at the far end of a capsule lies on a ball in it
        assert isinstance(body.shape, Capsule) or np.min(distance) > -1e-3


UNLIKE = [
    (d, a, b) for d, a, b in PAIRS if a != b
]  # of two equal faces that of the first body is the reference


@pytest.mark.parametrize(("d", "a", "b"), [*UNLIKE, (3, "half space", "box"), (2, "half space", "triangle")])
@settings(max_examples=8)
@given(seed=numbers)
def test_exchanging_two_bodies_turns_the_normals_round(d: int, a: str, b: str, seed: int) -> None:
    first, second = random_pair(seed, d, ANY[d][a], ANY[d][b])
    one, other = contacts_of(first, second), contacts_of(second, first)
    assert len(one) == len(other)
    order_one, order_other = np.lexsort(np.round(one.points, 7).T), np.lexsort(np.round(other.points, 7).T)
    if len(np.unique(np.round(one.points, 6), axis=0)) == len(one):
        np.testing.assert_allclose(one.normals[order_one], -other.normals[order_other], atol=0.03)
    assert np.min(one.gaps, initial=9.0) == pytest.approx(np.min(other.gaps, initial=9.0), abs=1e-4)


@pytest.mark.parametrize(("d", "a", "b"), PAIRS)
@settings(max_examples=8)
@given(seed=numbers)
def test_moving_and_turning_both_bodies_moves_and_turns_the_contacts(
    d: int, a: str, b: str, seed: int
) -> None:
    assume(seed % 3 != 0)  # where faces are parallel, rounding chooses among equal corners
    first, second = random_pair(seed, d, CONVEX[d][a], CONVEX[d][b])
    rng = np.random.default_rng(seed + 1)
    by, shift = turn(rng, d), rng.normal(size=d)
    move = matrix(by)
    found = contacts_of(first, second)
    moved = [free(x.shape, move @ x.position + shift, product(by, x.rotation)) for x in (first, second)]
    again = contacts_of(*moved)
    np.testing.assert_array_equal(again.keys, found.keys)
    np.testing.assert_allclose(again.gaps, found.gaps, atol=1e-9)
    np.testing.assert_allclose(again.normals, found.normals @ move.T, atol=1e-6)
    np.testing.assert_allclose(again.points, found.points @ move.T + shift, atol=1e-6)


def hull_area(points: np.ndarray) -> float:
    return float(QuickHull(points).volume) if len(points) > 2 else 0.0


@settings(max_examples=20)
@given(
    shift=st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)),
    angle=st.floats(0.0, 3.0),
    gap=st.floats(-0.01, 0.05),
)
def test_a_box_on_a_box_rests_on_contacts_that_span_their_overlap(
    shift: tuple[float, float], angle: float, gap: float
) -> None:
    lower, upper = Box([0.6, 0.5, 0.3]), Box([0.5, 0.4, 0.2])
    half = np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    found = contacts_of(free(lower), free(upper, np.array([*shift, 0.5 + gap]), half), 0.1)
    np.testing.assert_allclose(found.gaps, gap, atol=1e-12)
    np.testing.assert_allclose(found.normals, np.tile([0.0, 0.0, -1.0], (len(found), 1)), atol=1e-9)
    steps = np.linspace(-0.6, 0.6, 241)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    c, s = np.cos(angle), np.sin(angle)
    local = (grid - shift) @ np.array([[c, -s], [s, c]])
    inside = np.all(np.abs(local) <= [0.5, 0.4], axis=1) & np.all(np.abs(grid) <= [0.6, 0.5], axis=1)
    overlap = float(np.sum(inside)) * (steps[1] - steps[0]) ** 2
    assert len(found) <= 4
    assert 0.6 * overlap - 0.01 <= hull_area(found.points[:, :2]) <= overlap * 1.02 + 0.01
    if angle == 0.0:
        assert hull_area(found.points[:, :2]) == pytest.approx(overlap, abs=0.01)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("gap", [-0.01, 0.0, 0.05])
def test_a_box_above_a_plane_has_a_contact_at_each_lower_corner(d: int, gap: float) -> None:
    floor = Body(HalfSpace(np.eye(d)[-1]), motion=Fixed())
    box = free(Box(np.full(d, 0.5)), (0.5 + gap) * np.eye(d)[-1])
    found = contacts_of(box, floor, 0.1)
    assert len(found) == 2 ** (d - 1)
    np.testing.assert_allclose(found.gaps, gap, atol=1e-15)
    np.testing.assert_allclose(found.points[:, -1], 0.5 * gap, atol=1e-15)
    np.testing.assert_allclose(np.abs(found.points[:, :-1]), 0.5, atol=1e-15)
    np.testing.assert_allclose(found.normals, np.tile(np.eye(d)[-1], (len(found), 1)))


def test_parallel_capsules_touch_at_two_points_and_crossed_ones_at_one() -> None:
    lying, above = Capsule(0.1, 0.5, 0), np.array([0.3, 0.0, 0.25])
    side_by_side = contacts_of(free(lying), free(lying, above), 0.1)
    np.testing.assert_allclose(side_by_side.gaps, 0.05)
    np.testing.assert_allclose(np.sort(side_by_side.points[:, 0]), [-0.2, 0.5])
    crossed = contacts_of(free(lying), free(Capsule(0.1, 0.5, 1), above), 0.1)
    np.testing.assert_allclose(crossed.points, [[0.3, 0.0, 0.125]])


def test_a_capsule_lies_on_a_box_and_on_a_plane_with_two_contacts() -> None:
    capsule = free(Capsule(0.1, 0.5, 0), np.array([0.4, 0.0, 0.35]))
    on_box = contacts_of(capsule, free(Box([0.6, 0.5, 0.25])))
    np.testing.assert_allclose(np.sort(on_box.points[:, 0]), [-0.1, 0.6], atol=1e-9)
    on_plane = contacts_of(capsule, Body(HalfSpace([0.0, 0.0, 1.0], 0.25), motion=Fixed()))
    np.testing.assert_allclose(np.sort(on_plane.points[:, 0]), [-0.1, 0.9], atol=1e-9)


def test_two_boxes_edge_on_edge_touch_along_their_common_part() -> None:
    diamond = np.array([np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0])  # an edge along y on top
    tall = 0.5 * np.sqrt(2.0)
    lower, upper = free(Box([0.5, 1.0, 0.5]), rotation=diamond), np.array([0.0, 0.3, 2.0 * tall + 0.01])
    found = contacts_of(lower, free(Box([0.5, 1.0, 0.5]), upper, diamond), 0.1)
    np.testing.assert_allclose(np.sort(found.points[:, 1]), [-0.7, 1.0], atol=1e-9)
    np.testing.assert_allclose(found.gaps, 0.01, atol=1e-9)


@settings(max_examples=20)
@given(seed=numbers)
def test_names_of_contacts_last_while_bodies_jitter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = [free(Box([0.5, 0.5, 0.5]), np.array([0.0, 0.0, 1.0 * k])) for k in range(3)]
    geometry, start = ContactGeometry.of(boxes, 3), BodyStates.at_start(boxes)
    keys = geometry.detect(start, 0.01).keys
    assert len(keys) == 8 and len(np.unique(keys)) == 8
    positions = start.positions + 1e-7 * rng.normal(size=(3, 3))
    turns = start.rotations + 1e-7 * rng.normal(size=(3, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    after = BodyStates(positions, turns, start.velocities, start.spins)
    np.testing.assert_array_equal(geometry.detect(after, 0.01).keys, keys)


def test_names_last_while_a_block_slides_off_a_table() -> None:
    bodies = [free(Box([1.0, 1.0, 0.5])), free(Box([0.3, 0.2, 0.1]), np.array([0.0, 0.1, 0.6]))]
    geometry, start = ContactGeometry.of(bodies, 3), BodyStates.at_start(bodies)
    changes, before = 0, None
    for x in np.arange(0.0, 1.2, 0.003):
        places = start.positions + np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0]])
        keys = geometry.detect(BodyStates(places, start.rotations, start.velocities, start.spins), 1e-3).keys
        assert len(keys) == 4
        changes += before is not None and not np.array_equal(keys, before)
        before = keys
    assert changes == 1  # when its leading edge leaves the table


def test_a_union_touches_with_each_of_its_parts() -> None:
    dumbbell = Union(Moved(Sphere(0.3), [-0.5, 0.0, 0.0]), Moved(Sphere(0.3), [0.5, 0.0, 0.0]))
    found = contacts_of(
        free(dumbbell, np.array([0.0, 0.0, 0.3])), Body(HalfSpace([0.0, 0.0, 1.0]), motion=Fixed())
    )
    np.testing.assert_allclose(np.sort(found.points[:, 0]), [-0.5, 0.5])
    assert len(np.unique(found.keys)) == 2


def test_boxes_that_meet_in_one_edge_have_two_contacts_not_four() -> None:
    found = contacts_of(free(Box([0.5, 0.5, 0.5])), free(Box([0.3, 0.5, 0.5]), np.array([0.8, 0.0, 1.0])))
    assert len(found) == 2
    np.testing.assert_allclose(np.sort(found.points[:, 1]), [-0.5, 0.5])
