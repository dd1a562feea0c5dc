"""Tables of quadratic velocities and linear pressures on curved cells: calculus, refinement, what the spaces contain."""

from __future__ import annotations

import numpy as np
import pytest
import skfem

from barchan.errors import InputError
from barchan.spaces.meshes import annulus, dfg_channel, rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

KINDS = ("quadrilateral", "triangle")
PAIRS = [("quadrilateral", "P1d"), ("quadrilateral", "P1d_mapped"), ("triangle", "P1d"), ("triangle", "P1")]
# Nodes of a cell on its side j: its ends, then its middle.
SIDES = {9: ((0, 1, 4), (1, 2, 5), (2, 3, 6), (0, 3, 7)), 6: ((0, 1, 3), (1, 2, 4), (0, 2, 5))}


def ring(kind: str = "quadrilateral", level: int = 1) -> QuadraticMesh:
    return annulus(level, 1.0, 2.0, around=8, kind=kind)


def bent(kind: str) -> QuadraticMesh:
    """The unit square with inner vertices moved about; straight sides, no cell a parallelogram."""
    mesh = rectangle((0.0, 0.0), (1.0, 1.0), (3, 3), kind)
    inside, points = mesh.interior_nodes(), mesh.p.copy()
    points[:, inside] += 0.06 * np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(inside)))
    return QuadraticMesh.of(type(mesh)(points, mesh.t, _boundaries=mesh.boundaries))


def mesh_of(name: str, kind: str) -> QuadraticMesh:
    return {"ring": ring, "square": bent, "channel": lambda kind: dfg_channel(1, kind)}[name](kind)


def quadratic(x: np.ndarray) -> np.ndarray:
    return (
        1.0
        + x[..., 0]
        - 2.0 * x[..., 1]
        + 3.0 * x[..., 0] ** 2
        - x[..., 0] * x[..., 1]
        + 0.5 * x[..., 1] ** 2
    )


def slopes(x: np.ndarray) -> np.ndarray:
    return np.stack([1.0 + 6.0 * x[..., 0] - x[..., 1], -2.0 - x[..., 0] + x[..., 1]], axis=-1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["ring", "square", "channel"])
def test_shapes_sum_to_one_and_carry_linear_functions(name, kind):
    """The patch test: linear fields and their gradients are exact on every cell, curved ones too."""
    space = QuadraticSpace(mesh_of(name, kind))
    assert np.allclose(space.values.sum(axis=1), 1.0, atol=1e-13)
    scale = np.abs(space.gradients).max()
    assert np.allclose(space.gradients.sum(axis=2), 0.0, atol=1e-12 * scale)
    nodal = 2.0 - space.mesh.nodes @ [3.0, -1.0]
    assert np.allclose(
        np.einsum("qk,ck->cq", space.values, nodal[space.cell_nodes]), 2.0 - space.points @ [3.0, -1.0]
    )
    found = np.einsum("cqka,ck->cqa", space.gradients, nodal[space.cell_nodes])
    assert np.allclose(found, [-3.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_straight_cells_carry_quadratic_functions_whatever_their_shape(kind):
    space = QuadraticSpace(bent(kind))
    nodal = quadratic(space.mesh.nodes)[space.cell_nodes]
    assert np.allclose(np.einsum("qk,ck->cq", space.values, nodal), quadratic(space.points), atol=1e-13)
    assert np.allclose(np.einsum("cqka,ck->cqa", space.gradients, nodal), slopes(space.points), atol=1e-11)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["ring", "square", "channel"])
def test_theorem_of_gauss(name, kind):
    """Sides close (integral of n = 0) and enclose the area (integral of x . n = 2 area); each field obeys div = flux."""
    space = QuadraticSpace(mesh_of(name, kind))
    closing, enclosed, flux = np.zeros(2), 0.0, 0.0
    nodal = np.random.default_rng(1).standard_normal((space.N, 2))
    for part in space.mesh.boundaries:
        side = space.boundary(part)
        assert np.allclose(np.linalg.norm(side.normals, axis=2), 1.0)
        closing += np.einsum("fq,fqa->a", side.weights, side.normals)
        enclosed += np.einsum("fq,fqa,fqa->", side.weights, side.points, side.normals)
        values = np.einsum("fqk,fka->fqa", side.values, nodal[space.cell_nodes[side.cells]])
        flux += np.einsum("fq,fqa,fqa->", side.weights, values, side.normals)
    assert np.allclose(closing, 0.0, atol=1e-12)
    assert enclosed == pytest.approx(2.0 * space.area, rel=1e-12)
    divergence = np.einsum("cqka,cka->cq", space.gradients, nodal[space.cell_nodes])
    assert np.sum(space.weights * divergence) == pytest.approx(flux, abs=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_normals_of_a_ring_point_out_of_it(kind):
    space = QuadraticSpace(ring(kind, 2))
    for part, sign in (("inner", -1.0), ("outer", 1.0)):
        side = space.boundary(part)
        radial = side.points / np.linalg.norm(side.points, axis=2, keepdims=True)
        assert np.allclose(np.sum(side.normals * radial, axis=2), sign, atol=1e-2)
        assert side.weights.sum() == pytest.approx(2.0 * np.pi * (1.0 if sign < 0 else 2.0), rel=1e-3)


def test_boundary_quadrature_integrates_polynomials_exactly():
    space = QuadraticSpace(bent("quadrilateral"))
    for points in (1, 2, 3, 4):
        side = space.boundary("right", points)
        degree = 2 * points - 1
        assert np.sum(side.weights * side.points[..., 1] ** degree) == pytest.approx(1.0 / (degree + 1.0))


# -- numbering and pressures ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "pressure"), PAIRS)
def test_unknowns_are_numbered_as_documented(kind, pressure):
    space = QuadraticSpace(ring(kind), pressure)
    k = space.cell_nodes.shape[1]
    assert (space.size, space.cells) == (2 * space.N + space.P, len(space.cell_nodes))
    assert np.array_equal(space.cell_unknowns[:, 0 : 2 * k : 2], 2 * space.cell_nodes)
    assert np.array_equal(space.cell_unknowns[:, 1 : 2 * k : 2], 2 * space.cell_nodes + 1)
    assert np.array_equal(space.cell_unknowns[:, 2 * k :], 2 * space.N + space.cell_pressures)
    assert np.array_equal(np.unique(space.cell_unknowns), np.arange(space.size))
    vertices = space.mesh.skeleton.p.shape[1]
    assert (vertices if pressure == "P1" else 3 * space.cells) == space.P


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["ring", "channel"])
def test_middle_nodes_belong_to_the_sides_of_the_skeleton(name, kind):
    mesh = mesh_of(name, kind)
    vertices, facets = mesh.skeleton.p.shape[1], mesh.skeleton.facets
    for first, second, middle in SIDES[mesh.cell_nodes.shape[1]]:
        ends = np.sort(mesh.cell_nodes[:, [first, second]], axis=1)
        assert np.array_equal(np.sort(facets[:, mesh.cell_nodes[:, middle] - vertices], axis=0).T, ends)


@pytest.mark.parametrize(("kind", "pressure"), PAIRS)
def test_pressures_have_their_constant_and_their_integrals(kind, pressure):
    space = QuadraticSpace(ring(kind), pressure)
    one = np.einsum("cqm,cm->cq", space.pressure_values, space.unit_pressure[space.cell_pressures])
    assert np.allclose(one, 1.0, atol=1e-14)
    assert space.pressure_weights @ space.unit_pressure == pytest.approx(space.area, rel=1e-13)
    p = np.random.default_rng(2).standard_normal(space.P)
    at_points = np.einsum("cqm,cm->cq", space.pressure_values, p[space.cell_pressures])
    assert space.pressure_weights @ p == pytest.approx(np.sum(space.weights * at_points), abs=1e-12)


@pytest.mark.parametrize(("kind", "pressure"), PAIRS)
def test_linear_pressures_are_contained_on_curved_cells_by_physical_coordinates_only(kind, pressure):
    """What makes the non-parametric P1 of seed C 4.2 the better one: mapped functions bend with the cell."""
    space = QuadraticSpace(ring(kind), pressure)
    wanted = 1.0 + space.points @ [2.0, -3.0]
    errors = []
    for values, w, p in zip(space.pressure_values, np.sqrt(space.weights), wanted, strict=True):
        coefficients = np.linalg.lstsq(w[:, None] * values, w * p, rcond=None)[0]
        errors.append(np.abs(values @ coefficients - p).max())
    assert (max(errors) < 1e-12) == (pressure == "P1d")


def test_pressures_of_a_few_cells_are_those_of_all():
    for kind, pressure in PAIRS:
        space = QuadraticSpace(ring(kind), pressure)
        some = np.array([3, 1])
        found = space.pressure_at(space.reference_points, space.points[some], some)
        assert np.array_equal(found, space.pressure_values[some])


# -- refinement ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["ring", "square", "channel"])
def test_nodes_of_a_mesh_are_the_vertices_of_its_refinement(name, kind):
    coarse = mesh_of(name, kind)
    fine = coarse.refined()
    assert np.allclose(fine.skeleton.p.T, coarse.nodes, atol=1e-15)
    assert len(fine.cell_nodes) == 4 * len(coarse.cell_nodes)
    for part, facets in coarse.boundaries.items():
        assert len(fine.boundaries[part]) == 2 * len(facets)
        assert set(coarse.part_nodes(part)) <= set(fine.part_nodes(part))


@pytest.mark.parametrize("kind", KINDS)
def test_four_children_fill_their_parent(kind):
    """Cells 4 K + j together have the area of cell K: exactly with straight sides, nearly where sides bend anew."""
    for mesh, slack in ((bent(kind), 1e-13), (ring(kind, 2), 1e-3)):
        parents = QuadraticSpace(mesh).weights.sum(axis=1)
        children = QuadraticSpace(mesh.refined()).weights.sum(axis=1).reshape(-1, 4).sum(axis=1)
        assert np.allclose(children, parents, rtol=slack)


def test_children_of_quadrilaterals_stand_in_the_quarters_of_their_parent():
    """Child 0 at corner 0 of the parent, and so on around; each with the orientation of the parent."""
    mesh = bent("quadrilateral")
    nodes, fine = mesh.cell_nodes, mesh.refined()
    corners = fine.cell_nodes[:, :4].reshape(-1, 4, 4)
    m = [nodes[:, 4 + j] for j in range(4)]
    c, cc = [nodes[:, j] for j in range(4)], nodes[:, 8]
    wanted = [(c[0], m[0], cc, m[3]), (m[0], c[1], m[1], cc), (cc, m[1], c[2], m[2]), (m[3], cc, m[2], c[3])]
    for j, child in enumerate(wanted):
        assert np.array_equal(corners[:, j], np.stack(child, axis=1))


@pytest.mark.parametrize("kind", KINDS)
def test_refined_nodes_lie_on_the_curved_cells_of_their_parents(kind):
    """Inside, every node is the image of its reference place; on named curves it is put on the curve."""
    mesh = ring(kind)
    fine = mesh.refined()
    free = QuadraticMesh(mesh.skeleton, mesh.nodes).refined()
    on = np.zeros(len(fine.nodes), dtype=bool)
    for part in ("inner", "outer"):
        on[fine.part_nodes(part)] = True
    assert np.allclose(fine.nodes[~on], free.nodes[~on], atol=1e-15)
    assert np.abs(fine.nodes[on] - free.nodes[on]).max() > 1e-4
    radius = np.linalg.norm(fine.nodes[on], axis=1)
    assert np.allclose(np.minimum(np.abs(radius - 1.0), np.abs(radius - 2.0)), 0.0, atol=1e-14)


def test_a_split_keeps_the_curved_sides_and_the_area():
    mesh = ring("triangle")
    split = mesh.split_at_centres()
    assert len(split.cell_nodes) == 3 * len(mesh.cell_nodes)
    assert QuadraticSpace(split).area == pytest.approx(QuadraticSpace(mesh).area, rel=1e-13)
    for part in mesh.boundaries:
        positions = {tuple(row) for row in np.round(mesh.nodes[mesh.part_nodes(part)], 12)}
        assert positions == {tuple(row) for row in np.round(split.nodes[split.part_nodes(part)], 12)}


# -- bad input -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: QuadraticSpace(ring(), "P0"), "pressure"),
        (lambda: QuadraticSpace(ring(), "P1"), "pressure"),
        (lambda: QuadraticSpace(ring("triangle"), "P1d_mapped"), "pressure"),
        (lambda: QuadraticSpace(ring()).boundary("lid"), "boundary"),
        (lambda: ring().part_nodes("lid"), "boundary"),
        (lambda: ring().split_at_centres(), "mesh"),
        (lambda: QuadraticMesh.of(skfem.MeshTet()), "mesh"),
        (lambda: QuadraticMesh.of(skfem.MeshQuad(), {"lid": lambda x: x}), "curves"),
    ],
)
def test_what_does_not_exist_is_refused_by_name(call, field):
    with pytest.raises(InputError, match=f"^{field} "):
        call()


def test_a_cell_folded_over_is_refused_with_its_place():
    mesh = rectangle((0.0, 0.0), (1.0, 1.0), (2, 2), "quadrilateral")
    nodes = QuadraticMesh.of(mesh).nodes.copy()
    centre = np.flatnonzero(np.all(np.isclose(nodes, 0.5), axis=1))
    nodes[centre] = 0.95
    with pytest.raises(InputError, match="folded over"):
        QuadraticSpace(QuadraticMesh.of(mesh, nodes=nodes))
