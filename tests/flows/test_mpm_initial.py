"""Shapes filled with matter: volumes converge, nothing lies outside; states put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barchan.bodies.rigid import Box, Difference, HalfSpace, Moved, Sphere
from barchan.errors import InputError
from barchan.flows.mpm import Material, State, fill_box, fill_shape, joined
from barchan.flows.mpm.frames import frame_volumes
from barchan.flows.mpm.orientation import aligned
from barchan.spaces import RegularGrid

MATERIAL = Material(1500.0, 0.5, max_volume_fraction=0.6)


def box(d: int, cells: int) -> RegularGrid:
    return RegularGrid(np.zeros(d), np.full(d, 1.0 / cells), np.full(d, cells))


def sphere(d: int, radius: float):
    return Moved(Sphere(radius, dimension=2) if d == 2 else Sphere(radius), np.full(d, 0.5) + 0.013)


@pytest.mark.parametrize("d", [2, 3])
def test_the_volume_of_a_ball_converges_to_second_order_at_least(d):
    exact = 0.6 * (np.pi * 0.3**2 if d == 2 else 4 / 3 * np.pi * 0.3**3)
    errors = []
    for cells in (6, 12, 24):
        state = fill_shape(box(d, cells), sphere(d, 0.3), 2, MATERIAL)
        errors.append(abs(np.sum(state.volumes) / exact - 1.0))
        np.testing.assert_allclose(0.6 * frame_volumes(state.frames), state.volumes, rtol=1e-12)
        assert np.all(sphere(d, 0.3).signed_distance(state.positions) < 0.0)
    assert errors[0] < 0.03
    assert errors[-1] < 0.003
    assert max(errors[1:]) < max(errors[0], 0.005)


@pytest.mark.parametrize("d", [2, 3])
def test_a_box_as_a_shape_is_the_box(d):
    grid = box(d, 7)
    low, high = np.full(d, 0.21), np.full(d, 0.77)
    shape = Moved(Box(0.5 * (high - low)), 0.5 * (low + high))
    one, other = fill_box(grid, low, high, 2, MATERIAL), fill_shape(grid, shape, 2, MATERIAL)
    np.testing.assert_allclose(np.sum(other.volumes), np.sum(one.volumes), rtol=1e-9)
    np.testing.assert_allclose(other.positions, one.positions, atol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_what_lies_in_other_shapes_or_beside_the_grid_is_left_out(d):
    grid, hole = box(d, 16 if d == 2 else 10), sphere(d, 0.25)
    bed = HalfSpace(np.eye(d)[-1], 0.6)
    state = fill_shape(grid, bed, 2, MATERIAL, outside=[hole])
    whole = fill_shape(grid, bed, 2, MATERIAL)
    assert np.sum(whole.volumes) == pytest.approx(0.6 * 0.6, rel=1e-6)
    assert np.all(hole.signed_distance(state.positions) > 0.0)
    cut = fill_shape(
        grid,
        Difference(
            Moved(Box(np.append(np.full(d - 1, 0.5), 0.3)), np.append(np.full(d - 1, 0.5), 0.3)), hole
        ),
        2,
        MATERIAL,
    )
    assert np.sum(cut.volumes) == pytest.approx(np.sum(state.volumes), rel=1e-6)
    with pytest.raises(InputError, match="shape"):
        fill_shape(grid, sphere(d, 0.2), 2, MATERIAL, outside=[sphere(d, 0.4)])


def test_states_are_put_together_with_all_they_have():
    grid = box(2, 8)
    one, other = (
        fill_box(grid, [0, 0], [0.5, 0.25], 2, MATERIAL),
        fill_shape(grid, sphere(2, 0.2), 2, MATERIAL),
    )
    both = joined([one, other])
    count = one.particle_count
    np.testing.assert_array_equal(both.positions[:count], one.positions)
    np.testing.assert_array_equal(both.frames[count:], other.frames)
    np.testing.assert_array_equal(both.volumes, np.concatenate([one.volumes, other.volumes]))
    np.testing.assert_array_equal(both.materials, np.repeat([0, 1], [count, other.particle_count]))
    again = joined([both, one])
    np.testing.assert_array_equal(again.materials[:count], 0)
    flat = [replace(s, orientations=aligned([0.0, 1.0], s.particle_count)) for s in (one, other)]
    np.testing.assert_array_equal(joined(flat).orientations, aligned([0.0, 1.0], both.particle_count))
    with pytest.raises(InputError, match="orientations"):
        joined([flat[0], other])
    with pytest.raises(InputError, match="states"):
        joined([one, State.at_start(np.full((1, 3), 0.5), np.ones(1))])
    with pytest.raises(InputError, match="states"):
        joined([])
