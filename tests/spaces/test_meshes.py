"""Meshes: sizes, named parts that cover the boundary once, symmetry, quality, files there and back, bad meshes refused."""

import meshio
import numpy as np
import pytest
from skfem import MeshQuad, MeshTet, MeshTri

from barchan.errors import InputError
from barchan.spaces.meshes import (
    box,
    channel_with_cylinder,
    check_mesh,
    read_mesh,
    rectangle,
    silo,
    silo_3d,
    split_at_centres,
    tensor_rectangle,
    write_mesh,
)
from barchan.spaces.meshes.checking import signed_sizes

MESHES = {
    "rectangle": (rectangle([-1, 0], [2, 2], [5, 4]), 6.0, "left right bottom top"),
    "graded": (rectangle([-1, 0], [2, 2], [5, 4], grading=(3.0, 0.5)), 6.0, "left right bottom top"),
    "crossed": (rectangle([-1, 0], [2, 2], [5, 4], diagonals="crossed"), 6.0, "left right bottom top"),
    "quadrilaterals": (
        rectangle([-1, 0], [2, 2], [5, 4], kind="quadrilateral"),
        6.0,
        "left right bottom top",
    ),
    "centres": (split_at_centres(rectangle([-1, 0], [2, 2], [5, 4])), 6.0, "left right bottom top"),
    "silo": (silo(1.0, 8.0, 8.0, 400), 32.0, "axis wall top outlet bottom"),
    "even silo": (silo(1.0, 8.0, 8.0, 400, grading=False), 32.0, "axis wall top outlet bottom"),
    "chute": (silo(1.5, 8.0, 6.0, 400, below=0.8), 24.6, "axis wall top outlet bottom chute"),
    "box": (box([0, 0, 0], [1, 2, 3], [2, 3, 4], grading=2.0), 6.0, "left right front back bottom top"),
    "silo in space": (silo_3d(1.0, 4.0, 3.0, (4, 5)), 12.0, "axis_x axis_y top outlet bottom wall"),
}


def sizes(mesh):
    return np.abs(signed_sizes(mesh.p.T, mesh.t.T))


def facet_sizes(mesh, name):
    corners = mesh.p.T[mesh.facets[:, mesh.boundaries[name]].T]
    if mesh.p.shape[0] == 2:
        return np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    return 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )


def smallest_angle(mesh):
    corners = mesh.p.T[mesh.t.T]
    a, b, c = (np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(3))
    cosines = [(y**2 + z**2 - x**2) / (2 * y * z) for x, y, z in ((a, b, c), (b, c, a), (c, a, b))]
    return np.degrees(np.arccos(np.max(cosines)))


@pytest.mark.parametrize("name", MESHES)
def test_cells_fill_the_domain_and_names_cover_its_boundary_once(name):
    mesh, area, parts = MESHES[name]
    check_mesh(mesh)
    measured = sizes(mesh)
    total = np.sum(measured) / (2.0 if isinstance(mesh, MeshQuad) else 1.0)
    assert total == pytest.approx(area, rel=1e-12)
    assert set(mesh.boundaries) == set(parts.split())
    assert sorted(np.concatenate(list(mesh.boundaries.values()))) == sorted(mesh.boundary_facets())


@pytest.mark.parametrize("name", ["quadrilaterals", "box", "silo in space"])
def test_cells_are_listed_with_positive_sizes(name):
    # scikit-fem sorts the vertices of its triangles, so that only the other kinds keep an orientation.
    mesh = MESHES[name][0]
    assert np.all(signed_sizes(mesh.p.T, mesh.t.T) > 0.0)


def test_lengths_of_the_parts_of_a_silo():
    mesh = silo(1.5, 8.0, 6.0, 900, below=0.8)
    expected = {"axis": 6.8, "wall": 6.0, "top": 4.0, "outlet": 0.75, "bottom": 3.25, "chute": 0.8}
    for name, length in expected.items():
        assert np.sum(facet_sizes(mesh, name)) == pytest.approx(length, rel=1e-12)
    assert np.min(np.linalg.norm(mesh.p.T - [0.75, 0.0], axis=1)) == 0.0


def test_a_silo_in_space_has_the_square_outlet_asked_for():
    mesh = silo_3d(1.0, 4.0, 3.0, (4, 5))
    expected = {"axis_x": 6.0, "axis_y": 6.0, "top": 4.0, "outlet": 0.25, "bottom": 3.75, "wall": 12.0}
    for name, area in expected.items():
        assert np.sum(facet_sizes(mesh, name)) == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("vertices", [670, 2703, 10403])
@pytest.mark.parametrize("grading", [True, False])
def test_silos_have_the_vertices_asked_for_and_fair_angles(vertices, grading):
    mesh = silo(1.0, 8.0, 8.0, vertices, grading=grading)
    assert mesh.p.shape[1] == pytest.approx(vertices, rel=0.05)
    assert smallest_angle(mesh) > 20.0


@pytest.mark.slow
def test_the_largest_silo_of_table_2():
    mesh = silo(1.0, 8.0, 8.0, 41509)
    assert mesh.p.shape[1] == pytest.approx(41509, rel=0.05)
    check_mesh(mesh)


def test_a_graded_silo_has_its_smallest_cells_at_the_edge_of_the_outlet():
    mesh = silo(1.0, 8.0, 8.0, 2000)
    areas, middles = sizes(mesh)[:, 0], np.mean(mesh.p[:, mesh.t], axis=1).T
    distance = np.linalg.norm(middles - [0.5, 0.0], axis=1)
    assert np.max(areas[distance < 0.1]) < 0.1 * np.min(areas[distance > 5.0])


def test_even_silos_stand_on_rows_and_columns():
    mesh = silo(1.0, 8.0, 8.0, 670, grading=False)
    columns, rows = (len(np.unique(np.round(x, 9))) for x in mesh.p)
    assert columns * rows == mesh.p.shape[1]
    areas = sizes(mesh)
    assert np.max(areas) < 1.5 * np.min(areas)


@pytest.mark.parametrize(
    "name", ["rectangle", "crossed", "silo", "even silo", "chute", "silo in space", "box"]
)
def test_no_cell_has_all_but_one_of_its_sides_on_walls(name):
    mesh = MESHES[name][0]
    outer = np.isin(mesh.t2f, mesh.boundary_facets()).sum(axis=0)
    chute_end = np.zeros(mesh.t.shape[1], dtype=bool)
    if name == "chute":  # the corners of its end are open: one of their sides is not a wall
        chute_end = np.min(mesh.p[1, mesh.t], axis=0) < 0.0
    assert np.max(outer[~chute_end]) <= mesh.p.shape[0] - 1


def mirror_is_itself(mesh, axis):
    image = mesh.p.copy()
    image[axis] *= -1.0
    order, other = np.lexsort(np.round(mesh.p, 9)), np.lexsort(np.round(image, 9))
    np.testing.assert_allclose(mesh.p[:, order], image[:, other], atol=1e-12)
    twin = np.empty(mesh.p.shape[1], dtype=int)
    twin[order] = other
    cells = {tuple(sorted(cell)) for cell in mesh.t.T}
    return cells == {tuple(sorted(cell)) for cell in twin[mesh.t].T}


def test_symmetric_meshes_are_symmetric():
    assert mirror_is_itself(rectangle([-1, -2], [1, 2], [6, 8], grading=2.0), 0)
    assert mirror_is_itself(rectangle([-1, -2], [1, 2], [6, 8]), 1)
    assert mirror_is_itself(channel_with_cylinder(0.3, 1.0, 1.0, 1.5, 900), 1)


@pytest.mark.parametrize("diameter", [0.05, 0.25, 0.5, 0.8])
@pytest.mark.parametrize("half", [True, False])
def test_channels_keep_good_angles_at_any_diameter(diameter, half):
    mesh = channel_with_cylinder(diameter, 1.0, 1.5, 2.0, 1500, half=half)
    check_mesh(mesh)
    assert smallest_angle(mesh) > 20.0
    assert mesh.p.shape[1] == pytest.approx(1500, rel=0.05)
    assert set(mesh.boundaries) == {"inflow", "outflow", "sides", "cylinder"} | ({"axis"} if half else set())
    rim = mesh.p[:, np.unique(mesh.facets[:, mesh.boundaries["cylinder"]])]
    np.testing.assert_allclose(np.linalg.norm(rim, axis=0), diameter / 2, rtol=1e-12)
    # The cells fill the channel without the polygon inscribed in the cylinder.
    sides = len(mesh.boundaries["cylinder"]) * (2 if half else 1)
    polygon = sides / 2 * np.sin(2 * np.pi / sides) * (diameter / 2) ** 2
    assert np.sum(sizes(mesh)) == pytest.approx((3.5 - polygon) * (0.5 if half else 1.0), rel=1e-12)
    near, far = facet_sizes(mesh, "cylinder").max(), facet_sizes(mesh, "outflow").min()
    assert near < far


def test_a_channel_may_end_right_behind_the_cylinder():
    mesh = channel_with_cylinder(0.25, 1.0, 0.3, 0.5, 600)
    check_mesh(mesh)
    assert np.min(mesh.p[0]) == pytest.approx(-0.3) and np.max(mesh.p[0]) == pytest.approx(0.5)


@pytest.mark.parametrize("ending", ["msh", "vtu", "xdmf"])
@pytest.mark.parametrize("name", ["rectangle", "quadrilaterals", "chute", "box"])
def test_files_give_the_mesh_back(tmp_path, ending, name):
    mesh = MESHES[name][0]
    path = tmp_path / f"mesh.{ending}"
    write_mesh(path, mesh)
    again = read_mesh(path)
    np.testing.assert_allclose(again.p, mesh.p, atol=1e-14)
    np.testing.assert_array_equal(np.sort(again.t, axis=0), np.sort(mesh.t, axis=0))
    assert set(again.boundaries) == set(mesh.boundaries)
    for part, facets in mesh.boundaries.items():
        np.testing.assert_array_equal(again.boundaries[part], np.sort(facets))


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_gmsh_physical_groups_name_the_parts(tmp_path, version):
    gmsh = pytest.importorskip("gmsh")
    path = tmp_path / "disc.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        plate = gmsh.model.occ.addRectangle(0, 0, 0, 2, 1)
        hole = gmsh.model.occ.addDisk(1, 0.5, 0, 0.2, 0.2)
        (surface,), _ = gmsh.model.occ.cut([(2, plate)], [(2, hole)])
        gmsh.model.occ.synchronize()
        rims = [tag for _, tag in gmsh.model.getBoundary([surface], oriented=False)]
        circle = [tag for tag in rims if gmsh.model.getType(1, tag) != "Line"]
        gmsh.model.addPhysicalGroup(2, [surface[1]], name="matter")
        gmsh.model.addPhysicalGroup(1, circle, name="hole")
        gmsh.model.addPhysicalGroup(1, [tag for tag in rims if tag not in circle], name="walls")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    mesh = read_mesh(path)
    assert set(mesh.boundaries) == {"hole", "walls"}
    assert np.sum(facet_sizes(mesh, "walls")) == pytest.approx(6.0, rel=1e-12)
    assert np.sum(facet_sizes(mesh, "hole")) == pytest.approx(0.4 * np.pi, rel=0.05)


def test_tags_without_names_become_parts(tmp_path):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    lines = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    path = tmp_path / "square.vtu"
    content = meshio.Mesh(
        square,
        [("triangle", np.array([[0, 1, 2], [0, 2, 3]])), ("line", lines)],
        cell_data={"facet_tags": [np.zeros(2, dtype=int), np.array([7, 7, 8, 8])]},
    )
    meshio.write(path, content)
    mesh = read_mesh(path)
    assert {name: len(facets) for name, facets in mesh.boundaries.items()} == {"tag_7": 2, "tag_8": 2}


# Two triangles of the unit square with all four sides named, to be spoiled in one way at a time.
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
SIDES = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


def write_square(path, points=SQUARE, cells=HALVES, sides=SIDES, kind="triangle", more=()):
    spatial = np.column_stack([points, np.zeros(len(points))]) if np.shape(points)[1] == 2 else points
    blocks = [(kind, np.asarray(cells)), *more, ("line", np.asarray(sides).reshape(-1, 2))]
    tags = [np.full(len(data), 2 if name == "line" else 1) for name, data in blocks]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    names = {"rim": np.array([2, 1]), "matter": np.array([1, 2])}
    meshio.write(path, meshio.Mesh(spatial, blocks, cell_data=data, field_data=names), file_format="gmsh22")


BAD_FILES = {
    "inverted cell 1": {"cells": [[0, 1, 2], [0, 3, 2]]},
    "inverted cell 0 at .* and 1 more": {"cells": [[0, 2, 1], [0, 3, 2]]},
    "flat cell 1": {"points": [[0, 0], [1, 0], [1, 1], [0.5, 0.5]]},
    "1 vertices used by no cell": {"points": [*SQUARE, [3, 3]]},
    "1 boundary facets without a name": {"sides": SIDES[:3]},
    "no named boundary": {"sides": np.empty((0, 2), dtype=int)},
    "1 facets of 'rim' inside the domain": {"sides": [*SIDES, [0, 2]]},
    "part 'rim' has 1 facets that belong to no cell": {"sides": [*SIDES, [1, 3]]},
    "mixed cells: quad, triangle": {"more": [("quad", np.array([[0, 1, 2, 3]]))]},
    "triangle6": {"points": [*SQUARE, [0.5, 0]], "cells": [[0, 1, 2, 4, 4, 4]], "kind": "triangle6"},
    "a surface in space": {"points": [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]},
    "no triangles, quadrilaterals": {"cells": SIDES[:1], "kind": "line"},
    "concave or crossed cell 0": {"cells": [[0, 1, 3, 2]], "kind": "quad"},
    "2 pairs of vertices at the same place": {
        "points": [*SQUARE, SQUARE[0], SQUARE[2]],
        "cells": [[0, 1, 2], [4, 5, 3]],
        "sides": [[0, 1], [1, 2], [2, 0], [4, 5], [5, 3], [3, 4]],
    },
    "vertex 4 at .0.5, 0.5. in the middle of a cell's side": {
        "points": [*SQUARE, [0.5, 0.5]],
        "cells": [[0, 1, 2], [0, 4, 3], [4, 2, 3]],
        "sides": [*SIDES, [0, 2], [0, 4], [4, 2]],
    },
    "shared by more than two cells": {
        "points": [*SQUARE, [-0.5, 0.8]],
        "cells": [[0, 1, 2], [0, 2, 3], [0, 2, 4]],
    },
}


@pytest.mark.parametrize("message", BAD_FILES)
def test_bad_files_are_refused_with_their_fault(tmp_path, message):
    path = tmp_path / "bad.msh"
    write_square(path, **BAD_FILES[message])
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(path)
    assert "bad.msh" in str(caught.value) and "\n" not in str(caught.value)


def test_the_square_itself_is_good(tmp_path):
    write_square(tmp_path / "good.msh")
    assert set(read_mesh(tmp_path / "good.msh").boundaries) == {"rim"}


@pytest.mark.parametrize("name", ["text.msh", "text.vtu", "text.xdmf", "text.unknown"])
def test_files_that_are_no_meshes_are_refused(tmp_path, capsys, name):
    (tmp_path / name).write_text("no mesh\n")
    with pytest.raises(InputError, match="unreadable"):
        read_mesh(tmp_path / name)
    assert capsys.readouterr().out == ""


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere.msh = missing: must be a mesh file that exists"):
        read_mesh(tmp_path / "nowhere.msh")


def test_an_overlap_is_found_whatever_the_order_of_the_vertices():
    # The vertex 3 pulled across the diagonal folds the second triangle onto the first.
    points = SQUARE.copy()
    points[3] = [0.7, 0.4]
    with pytest.raises(InputError, match="inverted cell"):
        check_mesh(MeshTri(points.T, HALVES.T))


def test_a_facet_has_one_name_and_no_part_is_empty():
    mesh = rectangle([0, 0], [1, 1], [2, 2])
    twice = dict(mesh.boundaries, lid=mesh.boundaries["top"][:1])
    with pytest.raises(InputError, match="1 facets in both 'top' and 'lid'"):
        check_mesh(MeshTri(mesh.p, mesh.t, _boundaries=twice))
    with pytest.raises(InputError, match="part 'lid' is empty"):
        check_mesh(MeshTri(mesh.p, mesh.t, _boundaries=dict(mesh.boundaries, lid=np.empty(0, dtype=int))))


def test_a_tetrahedron_turned_inside_out_is_refused():
    mesh = box([0, 0, 0], [1, 1, 1], [2, 2, 2])
    points = mesh.p.copy()
    middle = int(np.argmin(np.linalg.norm(points.T - 0.5, axis=1)))
    points[:, middle] = [0.5, 0.5, 1.3]
    with pytest.raises(InputError, match="inverted cell"):
        check_mesh(MeshTet(points, mesh.t, _boundaries=mesh.boundaries))


def test_coordinates_that_are_not_finite_are_refused():
    points = SQUARE.copy()
    points[2, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        check_mesh(MeshTri(points.T, HALVES.T, validate=False))


@pytest.mark.parametrize(
    "build",
    [
        lambda: rectangle([0, 0], [0, 1], [2, 2]),
        lambda: rectangle([0, 0], [1, 1], [2, 0]),
        lambda: rectangle([0, 0], [1, 1], [2]),
        lambda: rectangle([0, 0], [1, 1], [2, 2.5]),
        lambda: rectangle([0, 0], [1, 1], [2, 2], kind="hexagon"),
        lambda: rectangle([0, 0], [1, 1], [2, 2], diagonals="none"),
        lambda: rectangle([0, 0], [1, 1], [2, 2], grading=-1.0),
        lambda: rectangle([0, 0], [1, float("nan")], [2, 2]),
        lambda: tensor_rectangle(np.array([0.0, 1.0]), np.array([0.0, 1.0]), kind="hexagon"),
        lambda: box([0, 0, 0], [1, 1], [2, 2, 2]),
        lambda: silo(8.0, 8.0, 8.0, 500),
        lambda: silo(1.0, 8.0, 0.0, 500),
        lambda: silo(1.0, 8.0, 8.0, 5),
        lambda: silo(1.0, 8.0, 8.0, 500, below=-1.0),
        lambda: silo_3d(1.0, 8.0, 8.0, (1, 3)),
        lambda: silo_3d(1.0, 8.0, 8.0, 4),
        lambda: channel_with_cylinder(0.95, 1.0, 2.0, 2.0, 500),
        lambda: channel_with_cylinder(0.5, 1.0, 0.2, 2.0, 500),
        lambda: channel_with_cylinder(0.5, 1.0, 2.0, 2.0, 10),
        lambda: write_mesh("mesh.stl", rectangle([0, 0], [1, 1], [2, 2])),
    ],
)
def test_builders_refuse_bad_input(build):
    with pytest.raises(InputError):
        build()
