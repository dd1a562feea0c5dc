"""Pictures and files of finite-element fields: drawn as given, every digit kept in files, bad input refused."""

import meshio
import numpy as np
import pytest
from matplotlib.image import imread

from barchan.errors import InputError
from barchan.results.field_views import make_view, stream_grid
from barchan.results.fields import (
    DIMENSIONLESS,
    Panel,
    draw_field,
    draw_flow_fields,
    draw_panels,
    write_series,
    write_vtu,
)
from barchan.spaces.meshes import box, channel_with_cylinder, rectangle, silo

SILO = silo(1.0, 8.0, 8.0, 300, below=0.5)
QUADRILATERALS = rectangle([0, 0], [2, 1], [8, 4], kind="quadrilateral")


def colours_in(path):
    """Number of distinct colours of a picture, and its size."""
    pixels = (imread(path)[:, :, :3] * 255).astype(int)
    return len(np.unique(pixels @ [1, 256, 65536])), pixels.shape[:2]


def test_a_field_with_contrast_has_many_colours_and_one_without_few(tmp_path):
    draw_field(tmp_path / "ramp.png", SILO, SILO.p[1], "height (m)", title="ramp")
    draw_field(tmp_path / "flat.png", SILO, np.ones(SILO.p.shape[1]), "one (m)", limits=(0.0, 2.0))
    ramp, size = colours_in(tmp_path / "ramp.png")
    flat, _ = colours_in(tmp_path / "flat.png")
    assert ramp > 200 and min(size) > 300
    # The flat field shows one colour; the rest of the colours belong to the bar and the letters.
    pixels = imread(tmp_path / "flat.png")[:, :, :3]
    middle = pixels[pixels.shape[0] // 2, pixels.shape[1] // 4]
    assert np.mean(np.all(np.abs(pixels - middle) < 0.01, axis=2)) > 0.2
    assert ramp != flat


def test_all_fields_of_a_flow_in_one_picture_half_or_whole(tmp_path):
    x, y = SILO.p
    velocity = np.stack([-x, -1.0 - y], axis=1)
    rigid = np.mean(SILO.p[1][SILO.t], axis=0) > 5.0
    for mirror in (False, True):
        path = tmp_path / f"flow_{mirror}.png"
        draw_flow_fields(
            path, SILO, velocity, np.hypot(x, y), y, np.exp(-y), rigid, title="flow", mirror=mirror, units=DIMENSIONLESS
        )  # fmt: skip
        assert colours_in(path)[0] > 500
    assert imread(tmp_path / "flow_True.png").shape != imread(tmp_path / "flow_False.png").shape


def test_hatches_are_drawn_where_the_matter_is_rigid(tmp_path):
    values = np.zeros(QUADRILATERALS.t.shape[1])
    draw_field(tmp_path / "plain.png", QUADRILATERALS, values, "rate (1/s)")
    draw_field(tmp_path / "rigid.png", QUADRILATERALS, values, "rate (1/s)", rigid=values == 0.0)
    assert not np.array_equal(imread(tmp_path / "plain.png"), imread(tmp_path / "rigid.png"))


def test_the_mirror_image_keeps_scalars_and_turns_the_normal_component():
    half = channel_with_cylinder(0.25, 1.0, 1.0, 1.5, 300, half=True)
    view = make_view(half, mirror=True)
    even, at_points = view.scalars("x", half.p[0], odd=False)
    odd, _ = view.scalars("y", half.p[1], odd=True)
    assert at_points
    np.testing.assert_allclose(even, view.points[:, 0])
    np.testing.assert_allclose(odd, view.points[:, 1])
    # A linear velocity with the symmetry of the channel is found exactly on both sides.
    x, y, u, w = stream_grid(view, np.stack([1.0 + half.p[0], -half.p[1]], axis=1))
    grid_x, grid_y = np.meshgrid(x, y)
    known = ~np.ma.getmaskarray(u)
    np.testing.assert_allclose(u[known], (1.0 + grid_x)[known], atol=1e-12)
    np.testing.assert_allclose(w[known], -grid_y[known], atol=1e-12)
    assert np.all(~known[np.hypot(grid_x, grid_y) < 0.1])
    assert np.count_nonzero(known) > 0.9 * known.size


def test_areas_of_a_view_add_up_to_the_domain():
    for mesh, mirror, area in ((SILO, True, 2 * 32.25), (QUADRILATERALS, False, 2.0)):
        view = make_view(mesh, mirror)
        assert np.sum(view.weights(True)) == pytest.approx(area)
        assert np.sum(view.weights(False)) == pytest.approx(area)


def test_cells_marked_by_their_vertices():
    view = make_view(QUADRILATERALS, mirror=False)
    left = QUADRILATERALS.p[0] < 1.01
    middles = np.mean(view.points[view.triangles], axis=1)
    np.testing.assert_array_equal(view.marked(left), middles[:, 0] < 1.0)


def test_vtu_files_hold_every_digit(tmp_path):
    x, y = SILO.p
    cells = np.random.default_rng(0).normal(size=SILO.t.shape[1])
    write_vtu(
        tmp_path / "flow.vtu",
        SILO,
        {"velocity": np.stack([x, y], axis=1)},
        {"p": cells, "rigid": cells > 0.0},
    )
    found = meshio.read(tmp_path / "flow.vtu")
    np.testing.assert_array_equal(found.points[:, :2].T, SILO.p)
    np.testing.assert_array_equal(found.point_data["velocity"], np.stack([x, y, 0 * x], axis=1))
    np.testing.assert_array_equal(found.cell_data["p"][0], cells)
    np.testing.assert_array_equal(found.cell_data["rigid"][0], cells > 0.0)
    assert [file.name for file in tmp_path.iterdir()] == ["flow.vtu"]


def test_a_series_holds_every_time(tmp_path):
    mesh = box([0, 0, 0], [1, 1, 1], [2, 2, 2])
    instants = [(t, {"speed": mesh.p[0] * t}, {"cell": np.full(mesh.t.shape[1], t)}) for t in (0.0, 0.1, 0.3)]
    write_series(tmp_path / "run.xdmf", mesh, instants)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "run.xdmf") as reader:
        points, cells = reader.read_points_cells()
        np.testing.assert_array_equal(points.T, mesh.p)
        assert reader.num_steps == 3 and len(cells[0].data) == mesh.t.shape[1]
        for k, (time, at_points, in_cells) in enumerate(instants):
            found_time, found_points, found_cells = reader.read_data(k)
            assert found_time == time
            np.testing.assert_allclose(found_points["speed"], at_points["speed"], rtol=1e-15)
            np.testing.assert_allclose(found_cells["cell"][0], in_cells["cell"], rtol=1e-15)
    assert [file.name for file in tmp_path.iterdir()] == ["run.xdmf"]


def test_fields_that_fit_nothing_are_refused(tmp_path):
    path = tmp_path / "no.png"
    with pytest.raises(InputError, match="field 'p'"):
        draw_field(path, SILO, np.ones(7), "p")
    with pytest.raises(InputError, match="velocity"):
        draw_field(path, SILO, SILO.p[0], "x", velocity=np.ones(7))
    with pytest.raises(InputError, match="mirror"):
        draw_field(path, QUADRILATERALS, QUADRILATERALS.p[0], "x", mirror=True)
    with pytest.raises(InputError, match="to be drawn"):
        draw_field(path, box([0, 0, 0], [1, 1, 1], [1, 1, 1]), np.ones(8), "x")
    with pytest.raises(InputError, match="at least one field"):
        draw_panels(path, SILO, [])
    with pytest.raises(InputError, match="no such folder"):
        draw_panels(tmp_path / "nowhere" / "a.png", SILO, [Panel(SILO.p[0], "x")])
    with pytest.raises(InputError, match="field 'u'"):
        write_vtu(path, SILO, {"u": np.ones(7)})
    assert list(tmp_path.iterdir()) == []


def test_values_that_are_not_known_are_left_blank(tmp_path):
    holes = SILO.p[1].copy()
    holes[SILO.p[0] > 2.0] = np.nan
    draw_field(tmp_path / "holes.png", SILO, holes, "height (m)", lines=4)
    draw_field(tmp_path / "full.png", SILO, SILO.p[1], "height (m)", lines=4)
    blank = [
        np.mean(np.all(imread(tmp_path / f"{name}.png")[:, :, :3] > 0.99, axis=2))
        for name in ("holes", "full")
    ]
    assert blank[0] > blank[1] + 0.1
