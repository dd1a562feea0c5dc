"""Point location, evaluation of fields and characteristics: exactness, boundaries, first order in the time step."""

from types import SimpleNamespace

import numpy as np
import pytest
from skfem import (
    CellBasis,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    ElementTriP3,
    ElementTriP4,
    ElementTriRT0,
    ElementVector,
    MeshTri2,
)

from barchan.errors import InputError
from barchan.spaces.characteristics import feet
from barchan.spaces.location import Locator, evaluate
from barchan.spaces.meshes import box, channel_with_cylinder, rectangle, silo

MESHES = {
    "channel": channel_with_cylinder(0.3, 1.0, 0.8, 1.2, 500),
    "silo": silo(1.0, 8.0, 8.0, 500, below=0.6),
    "quadrilaterals": rectangle([0, -1], [2, 1], [9, 7], kind="quadrilateral", grading=3.0),
    "box": box([0, 0, 0], [1, 2, 1], [4, 5, 3], grading=2.0),
}
CASES = [
    ("channel", ElementTriP1, 1),
    ("channel", ElementTriP2, 2),
    ("silo", ElementTriP3, 3),
    ("channel", ElementTriP4, 4),
    ("quadrilaterals", ElementQuad1, 1),
    ("quadrilaterals", ElementQuad2, 2),
    ("box", ElementTetP1, 1),
    ("box", ElementTetP2, 2),
]


def skewed(mesh, amount=0.15):
    """The mesh with its vertices moved smoothly: quadrilaterals are then no parallelograms."""
    x, y = mesh.p
    return type(mesh)(np.stack([x + amount * x * y, y + amount * np.sin(x)]), mesh.t)


def quadrature(mesh, element, order=4):
    basis = CellBasis(mesh, ElementVector(element()), intorder=order)
    places = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    points = places.reshape(-1, mesh.p.shape[0])
    return basis, points, np.repeat(np.arange(mesh.t.shape[1]), places.shape[1])


def project(basis, function):
    """Coefficients of the field that takes the values of `function` (n, d) -> (n, d) at the nodes."""
    nodes = function(basis.doflocs.T)
    component = np.empty(basis.N, dtype=int)
    components = basis.elem.dim
    for local in range(len(basis.element_dofs)):
        component[basis.element_dofs[local]] = local % components
    return nodes[np.arange(basis.N), component]


@pytest.mark.parametrize(("name", "element", "degree"), CASES)
def test_every_quadrature_point_lies_in_its_own_cell(name, element, degree):
    mesh = MESHES[name]
    _, points, cells = quadrature(mesh, element)
    locator = Locator(mesh)
    far = np.random.default_rng(0).permutation(cells)
    for start in (None, cells, far):
        found, reference, inside = locator.find(points, start)
        np.testing.assert_array_equal(found, cells)
        assert np.all(inside)
        np.testing.assert_allclose(locator.position(found, reference), points, atol=1e-12)


@pytest.mark.parametrize(("name", "element", "degree"), CASES)
def test_values_agree_with_those_of_scikit_fem(name, element, degree):
    mesh = MESHES[name]
    basis, points, cells = quadrature(mesh, element)
    values = np.random.default_rng(1).normal(size=basis.N)
    expected = np.moveaxis(np.asarray(basis.interpolate(values)), 0, -1).reshape(points.shape)
    found = evaluate(basis, values, cells, Locator(mesh).reference(points, cells))
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize(("name", "element", "degree"), CASES)
def test_polynomials_of_the_degree_of_the_element_are_exact_anywhere(name, element, degree):
    mesh = MESHES[name]
    dimension = mesh.p.shape[0]
    basis, points, _ = quadrature(mesh, element)

    def field(x):
        ramp = x @ np.arange(1.0, dimension + 1.0) + 0.3
        return np.stack([ramp**degree, *(x.T[1:] - 2.0 * ramp)], axis=1)

    locator = Locator(mesh)
    places = points + 1e-3 * np.random.default_rng(2).normal(size=points.shape)
    cells, reference, inside = locator.find(places)
    found = evaluate(basis, project(basis, field), cells, reference)
    np.testing.assert_allclose(found[inside], field(places)[inside], rtol=1e-9, atol=1e-9)


def test_bilinear_cells_of_any_convex_shape():
    mesh = skewed(MESHES["quadrilaterals"])
    _, points, cells = quadrature(mesh, ElementQuad2)
    locator = Locator(mesh)
    found, reference, inside = locator.find(points)
    np.testing.assert_array_equal(found, cells)
    assert np.all(inside)
    np.testing.assert_allclose(locator.position(found, reference), points, atol=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_vertices_are_inside_and_points_outside_move_to_the_nearest_boundary_point(name):
    mesh = MESHES[name]
    locator = Locator(mesh)
    assert np.all(locator.find(mesh.p.T)[2])
    lower, upper = np.min(mesh.p, axis=1), np.max(mesh.p, axis=1)
    outside = upper + np.abs(np.random.default_rng(3).normal(size=(40, len(upper))))
    cells, reference, inside = locator.find(outside)
    assert not np.any(inside)
    np.testing.assert_allclose(
        locator.position(cells, reference), np.broadcast_to(upper, outside.shape), atol=1e-12
    )
    beside = outside.copy()
    beside[:, 1] = 0.5 * (lower[1] + upper[1])
    cells, reference, _ = locator.find(beside[:, :2] if len(upper) == 2 else beside)
    np.testing.assert_allclose(locator.position(cells, reference)[:, 0], upper[0], atol=1e-12)


def test_points_in_the_cylinder_move_to_its_rim():
    locator = Locator(MESHES["channel"])
    points = 0.1 * np.random.default_rng(4).uniform(-1.0, 1.0, size=(50, 2))
    cells, reference, inside = locator.find(points)
    assert not np.any(inside)
    radius = np.linalg.norm(locator.position(cells, reference), axis=1)
    assert np.all(radius < 0.15 + 1e-12) and np.all(radius > 0.14)


def test_a_path_stops_where_it_leaves_the_domain():
    mesh = MESHES["silo"]
    locator = Locator(mesh)
    origins = np.array([[3.0, 1.0], [0.4, -0.3], [0.2, 0.5], [2.0, 2.0]])
    targets = np.array([[5.0, 1.0], [0.8, -0.3], [0.2, 9.5], [2.5, 2.5]])
    ends = np.array([[4.0, 1.0], [0.5, -0.3], [0.2, 8.0], [2.5, 2.5]])
    cells, reference, inside = locator.follow(origins, targets, np.full(4, -1))
    np.testing.assert_allclose(locator.position(cells, reference), ends, atol=1e-12)
    np.testing.assert_array_equal(inside, [False, False, False, True])


def test_a_path_does_not_jump_over_a_corner():
    # From the chute of the silo, through its side, to a place that lies in the silo again.
    locator = Locator(MESHES["silo"])
    cells, reference, inside = locator.follow([[0.25, -0.5]], [[1.25, 0.5]], [-1])
    assert not inside[0]
    np.testing.assert_allclose(locator.position(cells, reference), [[0.5, -0.25]], atol=1e-12)


@pytest.mark.parametrize("name", ["quadrilaterals", "box"])
def test_in_a_convex_domain_every_target_inside_is_reached_from_every_vertex(name):
    mesh = MESHES[name]
    locator = Locator(mesh)
    origins = np.repeat(mesh.p.T, 6, axis=0)
    targets = origins + 0.4 * np.random.default_rng(5).normal(size=origins.shape)
    reached, reference, inside = locator.follow(origins, targets, np.full(len(origins), -1))
    np.testing.assert_array_equal(inside, locator.find(targets)[2])
    np.testing.assert_allclose(locator.position(reached, reference)[inside], targets[inside], atol=1e-12)
    # The others stop on their path, in the domain.
    ends = locator.position(reached, reference)
    across = np.linalg.norm(np.cross(*(np.pad(x, ((0, 0), (0, 3 - x.shape[1]))) for x in
                                       (ends - origins, targets - origins))), axis=-1)  # fmt: skip
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    assert np.all(locator.find(ends)[2])


def test_walls_can_be_followed_from_corner_to_corner():
    locator = Locator(rectangle([0, 0], [1, 1], [7, 5]))
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cells, reference, inside = locator.follow(corners, np.roll(corners, 1, axis=0), np.full(4, -1))
    assert np.all(inside)
    np.testing.assert_allclose(locator.position(cells, reference), np.roll(corners, 1, axis=0), atol=1e-12)


@pytest.mark.parametrize("element", [ElementTriP2, ElementTriP4])
def test_a_rotation_is_carried_at_first_order_in_the_time_step(element):
    mesh = rectangle([-1, -1], [1, 1], [8, 8])
    basis, points, cells = quadrature(mesh, element)
    rotation = project(basis, lambda x: np.stack([-x[:, 1], x[:, 0]], axis=1))
    near = np.linalg.norm(points, axis=1) < 0.6
    points, cells = points[near], cells[near]
    locator, space = Locator(mesh), SimpleNamespace(basis=basis)

    def turned(angle):
        x, y = points.T
        back = np.stack([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)])
        return np.stack([-back[1], back[0]], axis=1)

    # One step carries with an error of second order, the steps of a given time together with one of first order.
    steps = np.array([0.2, 0.1, 0.05, 0.025])
    errors = [
        np.max(np.abs(feet(space, locator, rotation, dt, points, cells) - turned(dt))) / dt for dt in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.05)


def test_feet_of_a_uniform_flow_are_exact_and_a_still_field_stays():
    mesh = MESHES["silo"]
    basis, points, cells = quadrature(mesh, ElementTriP2)
    locator, space = Locator(mesh), SimpleNamespace(basis=basis)
    shear = project(basis, lambda x: np.stack([np.zeros(len(x)), -(x[:, 0] ** 2)], axis=1))
    # Straight lines along the flow keep their velocity; above the domain they stop at its top, with the same one.
    expected = np.stack([np.zeros(len(points)), -(points[:, 0] ** 2)], axis=1)
    for dt in (0.0, 0.1, 3.0):
        np.testing.assert_allclose(feet(space, locator, shear, dt, points, cells), expected, atol=1e-11)
        np.testing.assert_allclose(
            feet(space, locator, shear, dt, points, np.full(len(cells), -1)), expected, atol=1e-11
        )


def test_bad_input_is_refused():
    mesh = MESHES["silo"]
    locator = Locator(mesh)
    basis, points, cells = quadrature(mesh, ElementTriP2)
    space = SimpleNamespace(basis=basis)
    velocity = np.zeros(basis.N)
    with pytest.raises(InputError, match="finite"):
        locator.find([[0.0, np.nan]])
    with pytest.raises(InputError, match="shape"):
        locator.find([[0.0, 1.0, 2.0]])
    with pytest.raises(InputError, match="number of cells"):
        locator.find([[0.0, 1.0]], [10**6])
    with pytest.raises(InputError, match="dt"):
        feet(space, locator, velocity, -1.0, points, cells)
    with pytest.raises(InputError, match="finite"):
        feet(space, locator, velocity + np.nan, 0.1, points, cells)
    with pytest.raises(InputError, match="shape"):
        evaluate(basis, velocity[1:], cells, points)
    rough = CellBasis(mesh, ElementTriRT0())
    with pytest.raises(InputError, match="a Lagrange element"):
        evaluate(rough, np.zeros(rough.N), cells[:1], points[:1])
    with pytest.raises(InputError, match="mesh"):
        Locator(MeshTri2())
