"""Meshes of the benchmarks of quasi-Newtonian flows: published counts, areas, nodes on the circles, cells that do not fold."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.spaces.meshes import annulus, dfg_channel
from barchan.spaces.quadratic import QuadraticSpace

INNER, OUTER = 0.019, 0.024
AREAS = {"channel": 2.2 * 0.41 - np.pi * 0.05**2, "ring": np.pi * (OUTER**2 - INNER**2)}
KINDS = {"quadrilateral": "P1d", "triangle": "P1"}

TABLE_5 = {
    1: (130, 156, 286, 1533),
    2: (520, 572, 1092, 5927),
    3: (2080, 2184, 4264, 23295),
    4: (8320, 8528, 16848, 92351),
    5: (33280, 33696, 66976, 367743),
}
TABLE_14 = {
    1: (32, 48, 80, 415),
    2: (128, 160, 288, 1535),
    3: (512, 576, 1088, 5887),
    4: (2048, 2176, 4224, 23039),
    5: (8192, 8448, 16640, 91135),
    6: (32768, 33280, 66048, 362495),
}


def make(name, level, kind="quadrilateral"):
    return dfg_channel(level, kind) if name == "channel" else annulus(level, INNER, OUTER, kind=kind)


@pytest.mark.parametrize(("name", "table"), [("channel", TABLE_5), ("ring", TABLE_14)])
def test_cells_vertices_sides_and_unknowns_are_those_published(name, table):
    for level, (cells, vertices, sides, unknowns) in table.items():
        mesh = make(name, level)
        skeleton = mesh.skeleton
        assert (skeleton.t.shape[1], skeleton.p.shape[1], skeleton.facets.shape[1]) == (
            cells,
            vertices,
            sides,
        )
        assert abs(2 * len(mesh.nodes) + 3 * cells - unknowns) <= 1


@pytest.mark.parametrize("name", AREAS)
@pytest.mark.parametrize("kind", KINDS)
def test_area_converges_to_the_exact_one_with_order_four(name, kind):
    errors = []
    for level in (1, 2, 3):
        weights = QuadraticSpace(make(name, level, kind), KINDS[kind]).weights
        assert weights.min() > 0.0
        errors.append(abs(weights.sum() / AREAS[name] - 1.0))
    assert errors[0] < 1e-3
    assert np.log2(errors[1] / errors[2]) > 3.8


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("level", [1, 3])
def test_nodes_of_curved_parts_lie_on_their_circles(kind, level):
    ring, channel = make("ring", level, kind), make("channel", level, kind)
    for mesh, part, centre, radius in (
        (ring, "inner", (0.0, 0.0), INNER),
        (ring, "outer", (0.0, 0.0), OUTER),
        (channel, "cylinder", (0.2, 0.2), 0.05),
    ):
        nodes = mesh.nodes[mesh.part_nodes(part)]
        assert len(nodes) == 32 * 2 ** (level - 1)
        assert np.allclose(np.linalg.norm(nodes - np.array(centre), axis=1), radius, rtol=1e-13)


@pytest.mark.parametrize("name", AREAS)
def test_named_parts_cover_the_boundary_once(name):
    skeleton = make(name, 2).skeleton
    named = np.sort(np.concatenate(list(skeleton.boundaries.values())))
    assert np.array_equal(named, np.sort(skeleton.boundary_facets()))


def test_the_cut_line_of_the_ring_runs_along_sides():
    mesh = make("ring", 3)
    on_line = np.abs(mesh.nodes[:, 1]) < 1e-15
    right = mesh.nodes[on_line & (mesh.nodes[:, 0] > 0.0), 0]
    assert np.allclose(np.sort(right), np.linspace(INNER, OUTER, 17), rtol=1e-12)


@pytest.mark.parametrize("name", AREAS)
def test_triangles_split_at_their_centres_fill_the_same_domain(name):
    whole = make(name, 2, "triangle")
    split = whole.split_at_centres()
    assert split.skeleton.t.shape[1] == 3 * whole.skeleton.t.shape[1]
    areas = [QuadraticSpace(mesh, "P1d").weights for mesh in (whole, split)]
    assert areas[1].min() > 0.0
    assert areas[1].sum() == pytest.approx(areas[0].sum(), rel=1e-13)
    for part, facets in whole.skeleton.boundaries.items():
        assert len(split.skeleton.boundaries[part]) == len(facets)


@pytest.mark.parametrize("name", AREAS)
def test_no_triangle_has_all_its_corners_on_the_boundary_at_a_corner_of_the_channel(name):
    skeleton = make(name, 1, "triangle").skeleton
    on_boundary = np.zeros(skeleton.p.shape[1], dtype=bool)
    on_boundary[skeleton.facets[:, skeleton.boundary_facets()]] = True
    assert not np.any(np.all(on_boundary[skeleton.t], axis=0))


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: dfg_channel(0), "mesh.level"),
        (lambda: dfg_channel(2.5), "mesh.level"),
        (lambda: dfg_channel(9), "mesh.level"),
        (lambda: dfg_channel(1, "hexagon"), "mesh.kind"),
        (lambda: annulus(1, 0.02, 0.019), "mesh.outer"),
        (lambda: annulus(1, -1.0, 0.019), "mesh.inner"),
        (lambda: annulus(1, 0.01, 0.019, around=5), "mesh.around"),
        (lambda: annulus(1, 0.01, 0.019, across=0), "mesh.across"),
    ],
)
def test_what_no_mesh_can_have_is_refused(call, field):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.field == field
