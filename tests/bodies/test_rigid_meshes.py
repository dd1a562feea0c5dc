"""Triangle meshes are solids: a mesh of a ball behaves as the ball, and what encloses nothing is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from barchan.bodies.rigid import Body, Box, Sphere, TriangleMesh, Union, sample_mesh
from barchan.bodies.rigid.surfaces import facet_vectors
from barchan.bodies.rigid.tessellation import geodesic_sphere
from barchan.errors import InputError


def mesh_of(facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (F, 3, 3) as a soup of vertices and faces, as STL files hold them."""
    return facets.reshape(-1, 3), np.arange(3 * len(facets)).reshape(-1, 3)


def cube(centre: tuple[float, float, float] = (0.0, 0.0, 0.0), half: float = 0.5) -> np.ndarray:
    sides = np.full(3, half)
    return Box(sides).facets(10.0, -sides, sides) + np.array(centre)


@pytest.fixture(scope="module")
def ball() -> TriangleMesh:
    return TriangleMesh(*mesh_of(np.round(geodesic_sphere(0.5, 0.05), 12)))


def test_a_mesh_of_a_ball_is_the_ball(ball: TriangleMesh) -> None:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20_000, 3))
    exact = Sphere(0.5).signed_distance(points)
    off_centre = np.linalg.norm(points, axis=1) > 0.1
    assert np.max(np.abs(ball.signed_distance(points) - exact)[off_centre]) < 2e-3
    near = np.abs(exact) < 0.05
    assert np.max(np.linalg.norm(ball.normals(points) - Sphere(0.5).normals(points), axis=1)[near]) < 0.08
    volume, centre, inertia = ball.volume_properties()
    assert volume == pytest.approx(np.pi / 6.0, rel=5e-3)
    np.testing.assert_allclose(centre, 0.0, atol=1e-12)
    np.testing.assert_allclose(inertia, 0.1 * volume * np.eye(3), atol=1e-3 * volume)


def test_beyond_its_table_a_mesh_gives_a_continuous_lower_bound(ball: TriangleMesh) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-3.0, 3.0, (20_000, 3))
    exact, given = Sphere(0.5).signed_distance(points), ball.signed_distance(points)
    assert np.all(given <= exact + 2e-3)
    assert np.all(given >= np.max(np.abs(points), axis=1) - 0.5 - 0.04)
    neighbours = points + 1e-4 * rng.normal(size=points.shape)
    slope = np.abs(ball.signed_distance(neighbours) - given) / np.linalg.norm(neighbours - points, axis=1)
    assert np.max(slope) < 1.1
    far = np.linalg.norm(points, axis=1) > 1.2
    step = 1e-6
    slopes = [
        (ball.signed_distance(points[far] + step * e) - ball.signed_distance(points[far] - step * e))
        / (2 * step)
        for e in np.eye(3)
    ]
    gradient = np.stack(slopes, axis=1)
    unit = gradient / np.linalg.norm(gradient, axis=1)[:, None]
    assert np.mean(np.linalg.norm(ball.normals(points[far]) - unit, axis=1) < 1e-4) > 0.99


def test_volume_and_inertia_of_a_mesh_are_exact() -> None:
    box = Box([0.5, 0.5, 0.5])
    volume, centre, inertia = TriangleMesh(*mesh_of(cube((1.0, 2.0, 3.0)))).volume_properties()
    assert volume == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(centre, [1.0, 2.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(inertia, box.volume_properties()[2], atol=1e-14)


@pytest.mark.parametrize("spacing", [0.02, 0.25])
def test_the_quadrature_of_a_mesh_closes_finer_and_coarser_than_its_triangles(
    ball: TriangleMesh, spacing: float
) -> None:
    surface = ball.surface(spacing)
    area = float(np.sum(surface.areas))
    assert area == pytest.approx(np.pi, rel=0.03)
    assert np.linalg.norm(surface.areas @ surface.normals) < 1e-12 * area
    torque = np.sum(np.cross(surface.points, surface.areas[:, None] * surface.normals), axis=0)
    assert np.linalg.norm(torque) < 1e-12 * area
    if spacing > 0.1:
        assert len(surface) < 0.7 * len(ball.faces)


def test_a_mesh_turned_inside_out_is_turned_back() -> None:
    vertices, faces = mesh_of(cube())
    assert TriangleMesh(vertices, faces[:, ::-1]).volume_properties()[0] == pytest.approx(1.0)
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    mesh = TriangleMesh(vertices, mixed)
    assert mesh.volume_properties()[0] == pytest.approx(1.0)
    assert np.all(
        np.einsum("fi,fi->f", facet_vectors(mesh.vertices[mesh.faces]), mesh.vertices[mesh.faces].mean(1)) > 0
    )


def test_a_hollow_mesh_has_its_cavity() -> None:
    hollow = np.concatenate([cube(), cube(half=0.3)[:, ::-1]])
    mesh = TriangleMesh(*mesh_of(hollow))
    assert mesh.volume_properties()[0] == pytest.approx(1.0 - 0.6**3)
    np.testing.assert_array_equal(
        mesh.signed_distance(np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.6, 0.0, 0.0]])) < 0.0,
        [False, True, False],
    )


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_files_keep_the_mesh(tmp_path: Path, suffix: str) -> None:
    animal = sample_mesh(0.3, 20)
    animal.write(tmp_path / f"animal{suffix}")
    again = TriangleMesh.from_file(tmp_path / f"animal{suffix}", scale=2.0)
    assert again.volume_properties()[0] == pytest.approx(8.0 * animal.volume_properties()[0], rel=1e-5)


def test_the_sample_mesh_is_one_solid_that_lies_on_the_ground() -> None:
    animal = sample_mesh(0.5, 32)
    lower, upper = animal.bounds()
    assert np.max(upper - lower) == pytest.approx(0.5) and lower[2] == 0.0
    volume, centre, _ = animal.volume_properties()
    assert 0.05 < volume / np.prod(upper - lower) < 0.9
    assert animal.signed_distance(centre[None])[0] < 0.1
    points = np.random.default_rng(2).uniform(lower, upper, (40_000, 3))
    assert np.mean(animal.signed_distance(points) < 0.0) * np.prod(upper - lower) == pytest.approx(
        volume, rel=0.03
    )
    assert Body(animal, density=500.0).mass == pytest.approx(500.0 * volume)
    count = len(animal.vertices) - 3 * len(animal.faces) // 2 + len(animal.faces)
    assert count in (2, 0)  # Euler: one piece, a ball or a ring


def test_meshes_combine_with_other_shapes(ball: TriangleMesh) -> None:
    both = Union(ball, Sphere(0.3))
    assert both.volume_properties()[0] == pytest.approx(ball.volume_properties()[0], rel=1e-2)


def test_an_open_mesh_is_refused() -> None:
    vertices, faces = mesh_of(cube())
    with pytest.raises(InputError, match=r"open.*closed"):
        TriangleMesh(vertices, faces[1:])


def test_a_mesh_that_overlaps_itself_is_refused() -> None:
    twice = np.concatenate([cube(), cube((0.4, 0.3, 0.2))])
    with pytest.raises(InputError, match="overlap itself"):
        TriangleMesh(*mesh_of(twice)).signed_distance(np.zeros((1, 3)))


def test_other_bad_meshes_are_refused(tmp_path: Path) -> None:
    vertices, faces = mesh_of(cube())
    with pytest.raises(InputError, match="faces"):
        TriangleMesh(vertices, faces + 1000)
    with pytest.raises(InputError, match="faces"):
        TriangleMesh(vertices, faces[:, :2])
    with pytest.raises(InputError, match="vertices"):
        TriangleMesh(vertices[:, :2], faces)
    with pytest.raises(InputError, match="resolution"):
        TriangleMesh(vertices, faces, resolution=1e-6)
    thin = TriangleMesh(*mesh_of(cube() * np.array([1.0, 1.0, 1e-3])), resolution=0.3)
    with pytest.raises(InputError, match="resolution"):
        thin.signed_distance(np.zeros((1, 3)))
    with pytest.raises(InputError, match="exists"):
        TriangleMesh.from_file(tmp_path / "none.stl")
    with pytest.raises(InputError, match="ends in"):
        TriangleMesh.from_file(tmp_path / "none.doc")
    (tmp_path / "bad.obj").write_text("nothing here\n")
    with pytest.raises(InputError, match="mesh"):
        TriangleMesh.from_file(tmp_path / "bad.obj")
    (tmp_path / "bad.stl").write_bytes(b"solid x\n")
    with pytest.raises(InputError, match="mesh"):
        TriangleMesh.from_file(tmp_path / "bad.stl")
    with pytest.raises(InputError, match="cells"):
        sample_mesh(1.0, 3)
