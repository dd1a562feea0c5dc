"""Shapes: their distances are distances, their boundaries close, their moments are those of the solids they describe."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.bodies.rigid import (
    Box,
    Capsule,
    Complement,
    ConvexHull,
    Cylinder,
    Extruded,
    HalfSpace,
    Intersection,
    Moved,
    Polygon,
    Repeated,
    Revolved,
    Shape,
    Sphere,
    Torus,
    Union,
    funnel,
    hourglass,
    hourglass_of_revolution,
    plate_with_hole,
    wheel,
)
from barchan.errors import InputError

L_SHAPE = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0)]
HULL = np.array(
    [(0, 0, 0.6), (0.5, 0.1, 0.2), (-0.2, 0.5, 0.3), (-0.4, -0.4, 0.1), (0.3, -0.5, -0.3), (0.0, 0.3, -0.6)]
)
TURN = np.array([np.cos(0.4), 0.0, np.sin(0.4) * 0.6, np.sin(0.4) * 0.8])

EXACT: dict[str, Callable[[], Shape]] = {
    "ball": lambda: Sphere(0.7),
    "disk": lambda: Sphere(0.7, dimension=2),
    "box": lambda: Box([0.5, 0.3, 0.4]),
    "rectangle": lambda: Box([0.5, 0.3]),
    "capsule": lambda: Capsule(0.3, 0.4, axis=[2.0, -1.0, 2.0]),
    "plane capsule": lambda: Capsule(0.3, 0.4, axis=[1.0, 0.5], dimension=2),
    "convex hull": lambda: ConvexHull(HULL),
    "cylinder": lambda: Cylinder(0.4, 0.6, axis=1),
    "slanted cylinder": lambda: Cylinder(0.4, 0.6, axis=[1.0, 2.0, 2.0]),
    "torus": lambda: Torus(0.6, 0.25, axis=0),
    "polygon": lambda: Polygon(L_SHAPE),
    "extruded": lambda: Extruded(Polygon(L_SHAPE), 0.3),
    "ring of revolution": lambda: hourglass_of_revolution(0.6, 1.2, 0.2, 0.15, 0.1),
    "cone on the axis": lambda: Revolved(Polygon([(0.0, -0.4), (0.6, -0.4), (0.2, 0.5), (0.0, 0.5)])),
    "moved": lambda: Moved(Box([0.5, 0.3, 0.4]), [0.2, -0.1, 0.3], TURN),
    "half space": lambda: HalfSpace([1.0, 2.0, -2.0], 0.1),
}
COMBINED: dict[str, Callable[[], Shape]] = {
    "union": lambda: Union(Sphere(0.5), Moved(Box([0.3, 0.3, 0.3]), [0.5, 0.1, 0.0], TURN)),
    "intersection": lambda: Intersection(Sphere(0.6), HalfSpace([0.0, 0.0, 1.0], 0.2)),
    "plate with a hole": lambda: plate_with_hole([0.6, 0.5, 0.1], 0.25),
    "wheel": lambda: wheel(0.5, 0.2, 8, 0.08),
    "spokes": lambda: Repeated(Moved(Box([0.3, 0.1, 0.1]), [0.6, 0.0, 0.0]), 5),
    "plane union": lambda: Union(Sphere(0.4, 2), Moved(Box([0.4, 0.2]), [0.5, 0.0], 0.3)),
}
CLOSED = {name: make for name, make in (EXACT | COMBINED).items() if name != "half space"}


def cloud(shape: Shape, count: int = 4000, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.3, 1.3, (count, shape.dimension))


def brute_distance(shape: Shape, points: np.ndarray) -> np.ndarray:
    """Distance to the nearest point of a fine boundary."""
    box = np.full(shape.dimension, 4.0)
    surface = shape.surface(0.03, -box, box)
    return np.array([np.min(np.linalg.norm(surface.points - p, axis=1)) for p in points])


@pytest.mark.parametrize("name", EXACT)
def test_the_distance_is_that_to_the_nearest_boundary_point(name: str) -> None:
    shape = EXACT[name]()
    points = cloud(shape, 60)
    np.testing.assert_allclose(
        np.abs(shape.signed_distance(points)), brute_distance(shape, points), atol=0.02
    )


@pytest.mark.parametrize("name", EXACT | COMBINED)
def test_a_distance_never_grows_faster_than_the_way_walked(name: str) -> None:
    shape = (EXACT | COMBINED)[name]()
    a, b = cloud(shape, seed=2), cloud(shape, seed=3)
    b[::2] = a[::2] + 1e-3 * b[::2]
    slope = np.abs(shape.signed_distance(a) - shape.signed_distance(b)) / np.linalg.norm(a - b, axis=1)
    assert np.max(slope) <= 1.0 + 1e-9


@pytest.mark.parametrize("name", EXACT | COMBINED)
def test_normals_are_the_unit_gradient_of_the_distance(name: str) -> None:
    shape = (EXACT | COMBINED)[name]()
    points, step = cloud(shape), 1e-6
    gradient = np.stack(
        [
            (shape.signed_distance(points + step * e) - shape.signed_distance(points - step * e)) / (2 * step)
            for e in np.eye(shape.dimension)
        ],
        axis=1,
    )
    normals = shape.normals(points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1.0) < 1e-6  # away from edges and medial surfaces
    assert np.mean(smooth) > 0.98
    agree = np.linalg.norm(normals - gradient, axis=1) < 1e-4
    assert np.mean(agree[smooth]) > 0.999


@pytest.mark.parametrize("name", EXACT | COMBINED)
def test_a_distance_along_the_normal_leads_to_the_boundary(name: str) -> None:
    shape = EXACT[name]() if name in EXACT else COMBINED[name]()
    points = cloud(shape)
    distance = shape.signed_distance(points)
    near = np.abs(distance) < 0.05
    feet = points[near] - distance[near, None] * shape.normals(points[near])
    assert np.mean(np.abs(shape.signed_distance(feet)) < 1e-9) > (0.99 if name in EXACT else 0.85)


@pytest.mark.parametrize("name", CLOSED)
def test_the_boundary_lies_on_the_zero_of_the_distance_and_faces_out(name: str) -> None:
    shape = CLOSED[name]()
    spacing = 0.04
    surface = shape.surface(spacing)
    assert np.max(np.abs(shape.signed_distance(surface.points))) < 0.5 * spacing**2 / 0.08
    inner = shape.signed_distance(surface.points - 0.01 * surface.normals) < 0.0
    outer = shape.signed_distance(surface.points + 0.01 * surface.normals) > 0.0
    area = np.sum(surface.areas)  # a step can cross the other side of a sharp edge, but only very near it
    assert surface.areas @ inner > 0.98 * area and surface.areas @ outer > 0.98 * area
    lower, upper = shape.bounds()
    slack = 0.02 * spacing
    assert np.all(surface.points >= lower - slack) and np.all(surface.points <= upper + slack)


@pytest.mark.parametrize("name", CLOSED)
def test_a_constant_pressure_leaves_neither_force_nor_torque(name: str) -> None:
    surface = CLOSED[name]().surface(0.07)
    area = float(np.sum(surface.areas))
    assert np.linalg.norm(surface.areas @ surface.normals) < 1e-12 * area
    vectors = surface.areas[:, None] * surface.normals
    if surface.points.shape[1] == 3:
        torque = np.sum(np.cross(surface.points, vectors), axis=0)
    else:
        torque = np.sum(surface.points[:, 0] * vectors[:, 1] - surface.points[:, 1] * vectors[:, 0])
    assert np.linalg.norm(torque) < 1e-11 * area


AREAS = {
    "ball": 4 * np.pi * 0.49,
    "disk": 2 * np.pi * 0.7,
    "box": 8 * (0.15 + 0.2 + 0.12),
    "rectangle": 3.2,
    "capsule": 4 * np.pi * 0.3 * (0.3 + 0.4),
    "plane capsule": 2 * np.pi * 0.3 + 1.6,
    "cylinder": 2 * np.pi * 0.4 * (0.4 + 1.2),
    "torus": 4 * np.pi**2 * 0.6 * 0.25,
    "polygon": 4.0,
    "extruded": 4.0 * 0.6 + 2 * 0.64,
    "intersection": 2 * np.pi * 0.6 * 0.8 + np.pi * 0.32,
    "plate with a hole": 8 * (0.3 + 0.06 + 0.05) - 2 * np.pi * 0.0625 + 2 * np.pi * 0.25 * 0.2,
}


@pytest.mark.parametrize("name", AREAS)
def test_areas_converge(name: str) -> None:
    errors = [
        abs(float(np.sum(CLOSED[name]().surface(spacing).areas)) / AREAS[name] - 1.0)
        for spacing in (0.1, 0.025)
    ]
    assert errors[0] < 0.02
    assert errors[1] < max(errors[0] / 6.0, 1e-11)


@pytest.mark.parametrize("name", CLOSED)
def test_volume_centre_and_inertia_are_those_of_random_points_inside(name: str) -> None:
    shape = CLOSED[name]()
    volume, centre, inertia = shape.volume_properties()
    lower, upper = shape.bounds()
    points = np.random.default_rng(5).uniform(lower, upper, (400_000, shape.dimension))
    inside = points[shape.signed_distance(points) < 0.0]
    box = float(np.prod(upper - lower))
    assert volume == pytest.approx(box * len(inside) / 400_000, rel=0.01)
    np.testing.assert_allclose(centre, np.mean(inside, axis=0), atol=0.005)
    arms = inside - np.mean(inside, axis=0)
    second = volume * arms.T @ arms / len(arms)
    trace = np.trace(second)
    expected = np.array([[trace]]) if shape.dimension == 2 else trace * np.eye(3) - second
    np.testing.assert_allclose(inertia, expected, atol=0.015 * np.max(expected))


@pytest.mark.parametrize(
    "name",
    [
        "ball",
        "box",
        "capsule",
        "plane capsule",
        "slanted cylinder",
        "torus",
        "cone on the axis",
        "extruded",
        "moved",
    ],
)
def test_closed_forms_agree_with_the_moments_of_the_boundary(name: str) -> None:
    shape = EXACT[name]()
    exact, boundary = shape.volume_properties(), Shape.volume_properties(shape)
    assert exact[0] == pytest.approx(boundary[0], rel=2e-3)
    np.testing.assert_allclose(exact[1], boundary[1], atol=1e-3)
    np.testing.assert_allclose(exact[2], boundary[2], atol=3e-3 * np.max(exact[2]))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.2, 1.0), min_size=5, max_size=12))
def test_a_star_polygon_is_triangulated_whole(radii: list[float]) -> None:
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    corners = np.array(radii)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    polygon = Polygon(corners)
    prism = Extruded(polygon, 0.5)
    low, high = prism.bounds()
    caps = prism.facets(10.0, low, high)
    flat = np.all(np.abs(caps[:, :, 1] - 0.5) < 1e-12, axis=1)
    area = 0.5 * np.sum(
        np.linalg.norm(np.cross(caps[flat, 1] - caps[flat, 0], caps[flat, 2] - caps[flat, 0]), axis=1)
    )
    assert area == pytest.approx(polygon.volume_properties()[0], rel=1e-12)


def test_an_unbounded_surface_covers_the_box_and_nothing_else() -> None:
    plane = HalfSpace([0.0, 0.0, 1.0], 0.25)
    surface = plane.surface(0.1, [0.0, 0.0, 0.0], [2.0, 1.0, 1.0])
    assert float(np.sum(surface.areas)) == pytest.approx(2.0, rel=1e-12)
    assert np.all(surface.normals == [0.0, 0.0, 1.0])
    assert len(plane.surface(0.1, [0.0, 0.0, 0.5], [2.0, 1.0, 1.0])) == 0
    slanted = HalfSpace([1.0, 0.0, 1.0], np.sqrt(0.5))
    assert float(np.sum(slanted.surface(0.1, [0.0] * 3, [1.0] * 3).areas)) == pytest.approx(np.sqrt(2.0))


def test_touching_boxes_have_no_boundary_between_them() -> None:
    left, right = Moved(Box([0.5, 0.5, 0.5]), [-0.5, 0.0, 0.0]), Moved(Box([0.5, 0.5, 0.5]), [0.5, 0.0, 0.0])
    assert float(np.sum(Union(left, right).surface(0.2).areas)) == pytest.approx(10.0, rel=1e-12)
    overlapping = Union(Box([0.5, 0.5, 0.5]), Moved(Box([0.5, 0.5, 0.5]), [0.5, 0.0, 0.0]))
    assert float(np.sum(overlapping.surface(0.25).areas)) == pytest.approx(8.0, rel=1e-9)


def test_assemblies_are_what_their_names_say() -> None:
    glass = hourglass(1.0, 2.0, 0.2)
    middle = np.array([[0.0, 0.0], [0.05, 0.0], [0.2, 0.0], [0.0, 0.9], [0.45, 0.9], [0.3, 0.1]])
    np.testing.assert_array_equal(
        glass.signed_distance(middle) < 0.0, [False, False, True, False, False, True]
    )
    solid = hourglass(1.0, 2.0, 0.2, half_depth=0.1, neck_length=0.2)
    assert solid.dimension == 3 and solid.signed_distance(np.array([[0.12, 0.0, 0.09]]))[0] < 0.0
    cone = funnel(0.5, 0.1, 0.8, 0.05, spout=0.2)
    inside = cone.signed_distance(
        np.array([[0.0, 0.0, 0.4], [0.32, 0.0, 0.4], [0.12, 0.0, -0.1], [0.0, 0.6, 0.4]])
    )
    np.testing.assert_array_equal(inside < 0.0, [False, True, True, False])
    gap = plate_with_hole([0.5, 0.1], 0.2)
    assert gap.signed_distance(np.array([[0.0, 0.0]]))[0] == pytest.approx(0.2)
    bar = wheel(0.5, 0.2, 6, 0.1)
    assert bar.signed_distance(np.array([[0.0, 0.0, 0.55]]))[0] < 0.0  # the first bar stands up along z


BAD: dict[str, tuple[str, Callable[[], object]]] = {
    "negative radius": ("radius", lambda: Sphere(-1.0)),
    "radius that is no number": ("radius", lambda: Sphere("big")),  # type: ignore[arg-type]
    "dimension": ("dimension", lambda: Sphere(1.0, dimension=4)),
    "flat box": ("half_extents", lambda: Box([1.0, 0.0, 1.0])),
    "box of one number": ("half_extents", lambda: Box([1.0])),
    "axis number": ("axis", lambda: Cylinder(1.0, 1.0, axis=3)),
    "axis zero": ("axis", lambda: Cylinder(1.0, 1.0, axis=[0.0, 0.0, 0.0])),
    "torus without a hole": ("minor", lambda: Torus(0.3, 0.4)),
    "normal zero": ("normal", lambda: HalfSpace([0.0, 0.0])),
    "two vertices": ("vertices", lambda: Polygon([(0.0, 0.0), (1.0, 0.0)])),
    "flat polygon": ("vertices", lambda: Polygon([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])),
    "crossed polygon": ("vertices", lambda: Polygon([(0, 0), (1, 1), (1, 0), (0, 1.5)])),
    "repeated vertex": ("vertices", lambda: Polygon([(0, 0), (1, 0), (1, 0), (0, 1)])),
    "profile beyond the axis": ("profile", lambda: Revolved(Polygon([(-1, 0), (1, 0), (0, 1)]))),
    "mixed dimensions": ("parts", lambda: Union(Sphere(1.0), Sphere(1.0, 2))),
    "no parts": ("parts", lambda: Union()),
    "part that is no shape": ("shape", lambda: Complement("ball")),  # type: ignore[arg-type]
    "long quaternion": ("rotation", lambda: Moved(Sphere(1.0), [0, 0, 0], [1.0, 1.0, 0.0, 0.0])),
    "mirror": ("rotation", lambda: Moved(Sphere(1.0), [0, 0, 0], np.diag([1.0, 1.0, -1.0]))),
    "offset": ("offset", lambda: Moved(Sphere(1.0), [0.0, 0.0])),
    "spacing": ("spacing", lambda: Sphere(1.0).surface(0.0)),
    "too fine a spacing": ("spacing", lambda: Box([1.0, 1.0, 1.0]).surface(1e-5)),
    "unbounded surface": ("shape", lambda: HalfSpace([0.0, 1.0]).surface(0.1)),
    "unbounded volume": ("shape", lambda: Complement(Sphere(1.0)).volume_properties()),
    "points of the wrong dimension": ("points", lambda: Sphere(1.0).signed_distance(np.zeros((3, 2)))),
    "crowded treads": ("treads", lambda: wheel(0.1, 0.1, 40, 0.05)),
    "hole too wide": ("hole_radius", lambda: plate_with_hole([1.0, 0.2, 0.1], 0.3)),
    "neck too wide": ("neck", lambda: hourglass(1.0, 1.0, 1.0)),
    "outlet too wide": ("outlet", lambda: funnel(0.1, 0.2, 1.0, 0.01)),
}


def test_a_corner_inside_a_convex_hull_is_refused_with_its_depth() -> None:
    corners = [[-1, -1, -1], [1, -1, -1], [0, 1, -1], [0, 0, 1]]
    with pytest.raises(InputError, match=r"vertex 4, 0\.25 m inside"):
        ConvexHull([*corners, [0.0, 0.0, -0.75]])
    for flat in (np.c_[np.eye(4, 2), np.zeros(4)], np.eye(4, 3) * [1.0, 1.0, 1e-13]):
        with pytest.raises(InputError, match="vertices"):
            ConvexHull(flat)
    # a point on a face is neither inside nor a corner
    cube = ConvexHull([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)] + [[0.5, 0.5, 1.0]])
    assert len(cube.vertices) == 8 and len(cube.edges) == 12
    assert [len(face) for face in cube.faces] == [4] * 6


@pytest.mark.parametrize("name", BAD)
def test_bad_shapes_are_refused_by_name(name: str) -> None:
    field, make = BAD[name]
    with pytest.raises(InputError) as raised:
        make()
    assert raised.value.field == field
