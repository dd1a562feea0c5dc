"""Meshes of cloth: areas and topology of those that are made, refusal of those that no cloth can have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from barchan.bodies.cloth import ClothMesh, conical_skirt, disc, rectangle
from barchan.bodies.cloth.hinges import dihedral_angles
from barchan.bodies.cloth.makers import PATTERNS
from barchan.errors import InputError

SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize("pattern", PATTERNS)
def test_rectangles_have_their_area_face_up_and_obey_eulers_formula(pattern: Any) -> None:
    mesh = rectangle(1.0, 0.7, 0.1, pattern)
    corner = mesh.vertices[mesh.triangles]
    assert mesh.areas.sum() == pytest.approx(0.7, rel=1e-12)
    assert mesh.vertex_areas.sum() == pytest.approx(0.7, rel=1e-12)
    assert np.all(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] > 0.0)
    assert len(mesh.vertices) - len(mesh.hinges.edges) + len(mesh.triangles) == 1
    on_border = np.isclose(np.abs(mesh.vertices[:, 0]), 0.5) | np.isclose(np.abs(mesh.vertices[:, 1]), 0.35)
    np.testing.assert_array_equal(mesh.boundary, np.flatnonzero(on_border))


def test_discs_and_skirts_have_the_area_of_their_outline() -> None:
    assert disc(0.5, 0.05).areas.sum() == pytest.approx(math.pi * 0.25, rel=5e-3)
    skirt = conical_skirt(0.1, 0.3, 0.5, 0.03)
    assert skirt.areas.sum() == pytest.approx(math.pi * 0.4 * 0.5, rel=5e-3)
    assert len(skirt.vertices) - len(skirt.hinges.edges) + len(skirt.triangles) == 0  # a band
    corner = skirt.vertices[skirt.triangles]
    outward = (
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) * corner.mean(axis=1) * (1, 1, 0)
    )
    assert np.all(outward.sum(axis=1) > 0.0)


def test_hinge_angles_are_those_between_the_triangles() -> None:
    for angle in (-2.0, -0.3, 0.0, 0.4, 3.0):
        bent = np.array(
            [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.5, 0.0], [math.cos(angle), 0.5, math.sin(angle)]]
        )
        mesh = ClothMesh(bent, np.array([[0, 1, 2], [1, 0, 3]]))
        assert abs(dihedral_angles(mesh.vertices, mesh.hinges.stencils)[0]) == pytest.approx(abs(angle))


def refused(vertices: Any, triangles: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ClothMesh(vertices, np.array(triangles))


def test_what_is_no_surface_is_refused_with_its_place() -> None:
    refused(SQUARE, [[0, 1, 2], [0, 3, 2]], "turn the same way")
    refused(SQUARE, [[0, 1, 2]], "this one has none")
    refused(SQUARE, [[0, 1, 1], [0, 2, 3]], "three different vertices")
    refused(np.vstack([SQUARE, SQUARE[:1]]), [[0, 1, 2], [4, 2, 3]], "apart")
    wing = np.vstack([SQUARE, [[0.5, 0.5, 1.0]]])
    refused(wing, [[0, 1, 2], [0, 2, 3], [2, 0, 4]], "two at most")
    bow = np.vstack([SQUARE[:3], [[2.0, 2.0, 0.0], [1.0, 2.0, 0.0]]])
    refused(bow, [[0, 1, 2], [2, 3, 4]], "one fan")
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    refused(flat, [[0, 1, 2]], "with an area")
    refused([[0.0, 0.0, np.nan]] * 3, [[0, 1, 2]], "finite")
    refused(SQUARE, [[0, 1, 9]], "of the 4 vertices")


def test_two_closed_fans_at_a_vertex_are_refused() -> None:
    ring = np.array([[math.cos(a), math.sin(a), 1.0] for a in (0.0, 2.1, 4.2)])
    points = np.vstack([[[0.0, 0.0, 0.0]], ring, -ring])
    up = [[0, 1, 2], [0, 2, 3], [0, 3, 1]]
    down = [[0, 4, 5], [0, 5, 6], [0, 6, 4]]
    refused(points, up + down, "one fan")


def test_inverted_triangles_and_surfaces_that_cut_themselves_are_refused() -> None:
    mesh = rectangle(1.0, 1.0, 0.25)
    inverted = np.array(mesh.vertices)
    inner = mesh.nearest((0.0, 0.0, 0.0))
    inverted[inner, 0] += 0.6
    with pytest.raises(InputError, match=r"folded back|cut itself"):
        mesh.with_vertices(inverted)
    crossing = np.concatenate([mesh.vertices, mesh.vertices[:, [0, 2, 1]] + np.array([0.013, 0.0, 0.021])])
    both = np.concatenate([mesh.triangles, mesh.triangles + len(mesh.vertices)])
    with pytest.raises(InputError, match="cut itself"):
        ClothMesh(crossing, both)
    apart = crossing + np.repeat([[0.0, 0.0, 0.0], [0.0, 0.0, 0.6]], len(mesh.vertices), axis=0)
    assert len(ClothMesh(apart, both).areas) == len(both)


def test_a_plane_surface_does_not_cut_itself_however_it_is_turned() -> None:
    mesh = rectangle(1.0, 1.0, 0.1, "unstructured")
    for seed in range(5):
        turn = Rotation.random(random_state=seed).as_matrix()
        assert len(mesh.with_vertices(mesh.vertices @ turn.T + 3.0).areas) == len(mesh.triangles)


def test_makers_refuse_lengths_that_do_not_fit() -> None:
    for make in (
        lambda: rectangle(1.0, 1.0, 2.0), lambda: rectangle(-1.0, 1.0, 0.1), lambda: disc(0.0, 0.1),
        lambda: conical_skirt(0.1, 0.9, 0.5, 0.02), lambda: rectangle(1.0, 1.0, 0.1, "hexagons"),  # type: ignore[arg-type]
    ):  # fmt: skip
        with pytest.raises(InputError):
            make()
