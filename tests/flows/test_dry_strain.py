"""The weak strain rate on cells: consistency, rigid motions, forces, the limit of empty neighbours (seed B, Eq. 7.13)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.cones import chi
from barchan.errors import InputError
from barchan.flows.dry import Cells
from barchan.flows.dry.strain import strain_operator
from barchan.spaces.meshes import box, rectangle

MESHES = {
    "triangle": rectangle((0.0, 0.0), (1.0, 1.2), (6, 7), "triangle"),
    "quadrilateral": rectangle((0.0, 0.0), (1.0, 1.2), (6, 7), "quadrilateral", grading=2.0),
    "tetrahedron": box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3, 3, 3)),
}
CELLS = {name: Cells.of(mesh) for name, mesh in MESHES.items()}
NAMES = pytest.mark.parametrize("name", list(CELLS))


def rates(cells: Cells, fractions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """(n, d, d) weak strain rates of the filled cells."""
    filled = fractions > 0.0
    strain = strain_operator(cells, fractions, filled)
    integral = (strain @ velocities[filled].ravel()).reshape(np.count_nonzero(filled), -1)
    return chi(integral / (2.0 * fractions * cells.volumes)[filled][:, None])


class TestCells:
    @NAMES
    def test_sides_close_every_cell_and_are_opposite_for_neighbours(self, name: str) -> None:
        cells = CELLS[name]
        assert np.sum(cells.faces, axis=1) == pytest.approx(0.0, abs=1e-14)
        for cell, side in np.argwhere(cells.neighbours >= 0):
            other = cells.neighbours[cell, side]
            back = np.flatnonzero(cells.neighbours[other] == cell)
            assert len(back) == 1
            assert np.array_equal(cells.faces[other, back[0]], -cells.faces[cell, side])

    @NAMES
    def test_volumes_fill_the_box_and_sides_point_outwards(self, name: str) -> None:
        cells = CELLS[name]
        assert np.sum(cells.volumes) == pytest.approx(1.2 if cells.dimension == 2 else 1.0)
        for cell, side in np.argwhere(cells.neighbours >= 0):
            towards = cells.centres[cells.neighbours[cell, side]] - cells.centres[cell]
            assert towards @ cells.faces[cell, side] > 0.0

    def test_what_is_no_mesh_is_refused(self) -> None:
        with pytest.raises(InputError, match="mesh"):
            Cells.of(np.zeros((3, 3)))

    def test_a_mesh_without_named_parts_is_refused(self) -> None:
        mesh = MESHES["triangle"]
        with pytest.raises(InputError, match="boundary"):
            Cells.of(type(mesh)(mesh.p, mesh.t))


class TestStrain:
    @NAMES
    def test_translations_do_not_strain(self, name: str) -> None:
        cells = CELLS[name]
        fractions = np.random.default_rng(0).random(cells.count) + 0.01
        fractions[::5] = 0.0
        velocities = np.tile(np.arange(1.0, cells.dimension + 1.0), (cells.count, 1))
        assert rates(cells, fractions, velocities) == pytest.approx(0.0, abs=1e-12)

    def test_linear_velocities_give_their_strain_inside_an_even_mesh(self) -> None:
        cells = Cells.of(rectangle((0.0, 0.0), (1.0, 1.2), (6, 7), "quadrilateral"))
        gradient = np.array([[0.3, -1.0], [0.4, 0.7]])
        found = rates(cells, np.ones(cells.count), cells.centres @ gradient.T)
        inside = np.all(cells.neighbours >= 0, axis=1)
        assert found[inside] == pytest.approx(
            np.broadcast_to(0.5 * (gradient + gradient.T), found[inside].shape), abs=1e-12
        )

    @NAMES
    @settings(max_examples=10, deadline=None)
    @given(seed=st.integers(0, 2**32 - 1))
    def test_internal_forces_of_free_matter_add_up_to_nothing(self, name: str, seed: int) -> None:
        cells = CELLS[name]
        rng = np.random.default_rng(seed)
        fractions = np.where(rng.random(cells.count) < 0.3, 0.0, rng.random(cells.count))
        fractions[0] = 1.0
        strain = strain_operator(cells, fractions, fractions > 0.0)
        forces = (strain.T @ rng.normal(size=strain.shape[0])).reshape(-1, cells.dimension)
        assert np.sum(forces, axis=0) == pytest.approx(0.0, abs=1e-11)

    def test_a_nearly_empty_neighbour_is_as_good_as_none_and_feels_a_bounded_acceleration(self) -> None:
        cells = CELLS["quadrilateral"]
        bed = cells.centres[:, 1] < 0.6
        alone = strain_operator(cells, bed.astype(float), bed).toarray()
        for trace in (1e-4, 1e-8, 1e-11):
            fractions = np.where(bed, 1.0, trace)
            whole = strain_operator(cells, fractions, np.ones(cells.count, dtype=bool)).toarray()
            rows, columns = np.repeat(bed, 3), np.repeat(bed, 2)
            assert whole[np.ix_(rows, columns)] == pytest.approx(alone, abs=2.0 * trace)
            push = np.abs(whole[np.ix_(rows, ~columns)].T).sum(axis=1)
            masses = np.repeat(trace * cells.volumes[~bed], 2)
            assert np.max(push / masses) < 50.0

    def test_at_walls_of_no_slip_the_tangential_jump_is_shear(self) -> None:
        cells = Cells.of(rectangle((0.0, 0.0), (1.0, 1.0), (1, 1), "quadrilateral"))
        sticky = (cells.parts >= 0) & (np.array(cells.names)[cells.parts] == "bottom")
        strain = strain_operator(cells, np.ones(1), np.ones(1, dtype=bool), sticky)
        rate = chi((strain @ np.array([1.0, 0.0])) / 2.0)
        assert rate == pytest.approx(np.array([[0.0, 0.5], [0.5, 0.0]]), abs=1e-14)
