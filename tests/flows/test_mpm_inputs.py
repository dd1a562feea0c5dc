"""Materials, walls, options, states and initial boxes refuse what cannot be, naming the field; fill_box is exact."""

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.mpm import Material, Options, State, Stepper, Wall, Walls, fill_box
from barchan.flows.mpm.transfer import particles_to_grid
from barchan.flows.mpm.walls import free_components
from barchan.spaces import RegularGrid

GOOD = {"density": 1500.0, "friction": 0.5}


@pytest.mark.parametrize("name", ["density", "friction", "friction_increment", "grain_diameter", "viscosity"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "much"])
def test_negative_or_undefined_material_parameters_are_refused(name, value):
    with pytest.raises(InputError) as error:
        Material(**(GOOD | {name: value}))
    assert error.value.field == f"material.{name}"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("density", 0.0),
        ("inertial_reference", 0.0),
        ("max_volume_fraction", 0.0),
        ("max_volume_fraction", 1.2),
    ],
)
def test_parameters_that_must_be_positive_or_bounded(name, value):
    with pytest.raises(InputError) as error:
        Material(**(GOOD | {name: value}))
    assert error.value.field == f"material.{name}"


def test_friction_grows_from_its_static_to_its_dynamic_value_with_the_inertial_number():
    material = Material(1500.0, 0.3, friction_increment=0.4, inertial_reference=0.4, grain_diameter=0.001)
    pressure = np.full(200, 1500.0)
    shear_rate = np.append(0.0, np.geomspace(1e-3, 1e7, 199))
    mu = material.friction_at(shear_rate, pressure)
    assert mu[0] == 0.3
    assert np.all(np.diff(mu) > 0.0)
    assert mu[-1] == pytest.approx(0.7, rel=1e-3)
    half = 0.4 * 1.0 / 0.001  # I = I_0 where shear_rate d = I_0 sqrt(p / rho)
    assert material.friction_at(np.array([half]), np.array([1500.0]))[0] == pytest.approx(0.5, rel=1e-12)


def test_friction_of_sheared_matter_without_pressure_is_the_dynamic_one_and_never_undefined():
    material = Material(1500.0, 0.3, friction_increment=0.4, grain_diameter=0.001)
    mu = material.friction_at(np.array([0.0, 1.0, 1.0, 0.0]), np.array([0.0, 0.0, -1.0, 1e-300]))
    np.testing.assert_allclose(mu, [0.3, 0.7, 0.7, 0.3])


@pytest.mark.parametrize(
    ("kind", "friction"), [("sticky", 0.0), ("friction", -0.1), ("friction", float("nan"))]
)
def test_walls_that_cannot_be_are_refused(kind, friction):
    with pytest.raises(InputError, match="wall"):
        Wall(kind, friction)


def test_unknown_faces_are_refused():
    with pytest.raises(InputError, match="top"):
        Walls({"top": Wall()})
    with pytest.raises(InputError, match="y_min"):
        Stepper(RegularGrid([0, 0], [1, 1], [2, 2]), Material(**GOOD), Walls({"y_min": Wall()}))


def test_the_tank_sticks_at_the_floor_and_slips_elsewhere():
    grid = RegularGrid(np.zeros(3), np.ones(3), [3, 3, 3])
    free = free_components(grid, Walls.cuve(3), np.arange(grid.node_count)).reshape(4, 4, 4, 3)
    assert not np.any(free[:, :, 0])
    assert np.all(free[1:-1, 1:-1, 1:-1])
    np.testing.assert_array_equal(free[0, 1, 1], [False, True, True])
    np.testing.assert_array_equal(free[1, 3, 3], [True, False, False])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tolerance", 0.0), ("tolerance", float("nan")), ("cfl", -1.0), ("max_sweeps", 0), ("min_sweeps", -1),
        ("transfer", "flop"), ("stress", "P2"), ("velocity", "Q2"), ("flip_share", 1.5), ("warm_start", "no"),
        ("method", "magic"), ("volume_correction", 1.5), ("viscous_tolerance", 0.0),
    ],
)  # fmt: skip
def test_options_out_of_range_are_refused(name, value):
    with pytest.raises(InputError) as error:
        Options(**{name: value})
    assert error.value.field == f"options.{name}"


@pytest.mark.parametrize("gravity", [-9.81, float("nan"), "down"])
def test_gravity_must_be_a_number_pointing_down(gravity):
    with pytest.raises(InputError, match="gravity"):
        Stepper(RegularGrid([0, 0], [1, 1], [2, 2]), Material(**GOOD), Walls(), gravity=gravity)


@pytest.mark.parametrize("dt", [0.0, -0.1, float("nan")])
def test_a_time_step_must_be_positive(dt):
    grid = RegularGrid([0, 0], [1, 1], [2, 2])
    state = fill_box(grid, [0, 0], [1, 1], 2, Material(**GOOD))
    with pytest.raises(InputError, match="dt"):
        Stepper(grid, Material(**GOOD), Walls()).advance(state, dt)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("per_axis", [1, 2, 3])
def test_a_filled_box_is_packed_exactly_wherever_it_begins(d, per_axis):
    grid = RegularGrid(np.zeros(d), np.full(d, 0.1), np.full(d, 8))
    material = Material(1500.0, 0.5, max_volume_fraction=0.6)
    lower, upper = np.full(d, 0.137), np.full(d, 0.681)
    state = fill_box(grid, lower, upper, per_axis, material)
    assert np.isclose(np.sum(state.volumes), 0.6 * np.prod(upper - lower), rtol=1e-13)
    assert np.all((state.positions > lower) & (state.positions < upper))
    matter = particles_to_grid(grid, state)
    nodes = grid.node_positions(matter.active.nodes)
    inside = np.all((nodes - 0.1 > lower) & (nodes + 0.1 < upper), axis=1)
    np.testing.assert_allclose(matter.volume_fractions[inside], 0.6, rtol=1e-8)


def test_a_box_in_the_middle_of_the_grid_gives_a_symmetric_lattice():
    grid = RegularGrid([0, 0], [0.1, 0.1], [10, 4])
    state = fill_box(grid, [0.23, 0.0], [0.77, 0.35], 3, Material(**GOOD))
    mirrored = np.column_stack([1.0 - state.positions[:, 0], state.positions[:, 1]])
    one = state.positions[np.lexsort(np.round(state.positions, 9).T)]
    np.testing.assert_allclose(mirrored[np.lexsort(np.round(mirrored, 9).T)], one, atol=1e-14)


@pytest.mark.parametrize(
    ("lower", "upper", "count"),
    [
        ([0, 0], [0.5, 2.0], 2),
        ([0.5, 0], [0.5, 0.5], 2),
        ([0, 0], [0.5, np.nan], 2),
        ([0], [0.5], 2),
        ([0, 0], [1, 1], 0),
    ],
)
def test_a_column_that_does_not_fit_is_refused(lower, upper, count):
    with pytest.raises(InputError):
        fill_box(RegularGrid([0, 0], [0.1, 0.1], [10, 10]), lower, upper, count, Material(**GOOD))


def test_states_check_shapes_values_and_missing_fields():
    grid = RegularGrid([0, 0], [1, 1], [2, 2])
    arrays = fill_box(grid, [0, 0], [1, 1], 2, Material(**GOOD)).arrays()
    volumes = arrays["volumes"]
    for name, value in [
        ("volumes", volumes[:-1]), ("volumes", -volumes), ("velocities", arrays["velocities"] * np.nan),
        ("affine", arrays["velocities"]), ("time", np.zeros(3)), ("node_stresses", np.zeros((4, 3))),
    ]:  # fmt: skip
        with pytest.raises(InputError, match=f"state.{name}"):
            State.from_arrays(arrays | {name: value})
    del arrays["affine"]
    with pytest.raises(InputError, match="affine"):
        State.from_arrays(arrays)
