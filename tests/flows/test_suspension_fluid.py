"""The fluid on the grid: faces, matrices, Stokes-like steps, characteristics, and the lid-driven cavity (seed B, 8.3)."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.errors import InputError
from barchan.flows.suspension.characteristics import advected
from barchan.flows.suspension.fluid_grid import FluidGrid, penalty_for
from barchan.flows.suspension.phases import CLOSED, FLUID_HELD, FREE, HELD
from barchan.flows.suspension.sides import Side, Sides
from barchan.flows.suspension.stokes import StokesSolver
from barchan.spaces import RegularGrid, interpolate

FACES = {2: ("x_min", "x_max", "z_min", "z_max"), 3: ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")}
STABLE = ("layers", "coarse")


def box(dimension: int, cells: int = 4) -> RegularGrid:
    """A box of oblong cells away from the origin."""
    counts = [cells, cells + 2] if dimension == 2 else [cells, cells, cells + 2]
    spacing = [0.3, 0.2] if dimension == 2 else [0.3, 0.5, 0.2]
    return RegularGrid([0.1, -0.3, 0.7][:dimension], spacing, counts)


def everywhere(kind: str, dimension: int) -> Sides:
    return Sides({name: Side(kind) for name in FACES[dimension]})


def places(grid: RegularGrid) -> np.ndarray:
    return grid.node_positions(np.arange(grid.node_count))


def norm(fluid: FluidGrid, values: np.ndarray) -> float:
    return math.sqrt(fluid.volumes @ np.sum(values.reshape(len(fluid.volumes), -1) ** 2, axis=1))


def solver(fluid: FluidGrid) -> StokesSolver:
    return StokesSolver(fluid.divergence, None if fluid.slack_masses is None else 1.0 / fluid.slack_masses)


# -- faces ------------------------------------------------------------------------------------------------------------------


def test_static_walls_win_at_the_corners_of_a_lid_driven_cavity():
    grid = RegularGrid.from_box([1.0, 1.0], [4, 4])
    sides = Sides(dict(everywhere("stick", 2).faces) | {"z_max": Side("stick", velocity=(1.0, 0.0))})
    free, values = sides.fixed(grid, np.arange(grid.node_count))
    lid = places(grid)[:, 1] == 1.0
    inner = lid & (places(grid)[:, 0] > 0.0) & (places(grid)[:, 0] < 1.0)
    np.testing.assert_array_equal(values[inner], np.tile([1.0, 0.0], (3, 1)))
    np.testing.assert_array_equal(values[~inner], 0.0)
    assert np.count_nonzero(free.all(axis=1)) == 9


def test_frictional_walls_close_their_normal_and_hold_the_fluid_along_them():
    grid = box(3)
    sides = Sides({"z_min": Side("friction", 0.4), "x_min": Side("stick"), "y_max": Side("open")})
    kinds, _ = sides.boundary(grid)
    index = grid.node_indices(np.arange(grid.node_count))
    floor, wall = index[:, 2] == 0, index[:, 0] == 0
    inside = floor & (index[:, 0] > 0) & (index[:, 0] < 4) & (index[:, 1] > 0)
    np.testing.assert_array_equal(kinds[inside], np.tile([FLUID_HELD, FLUID_HELD, CLOSED], (inside.sum(), 1)))
    np.testing.assert_array_equal(kinds[wall], HELD)
    slipping = floor & (index[:, 0] == 4) & (index[:, 1] > 0)
    np.testing.assert_array_equal(kinds[slipping], np.tile([HELD, FLUID_HELD, CLOSED], (slipping.sum(), 1)))
    np.testing.assert_array_equal(np.flatnonzero(kinds[:, 2] == CLOSED), np.flatnonzero(floor & ~wall))
    assert not np.any(kinds[:, :2] == CLOSED)
    np.testing.assert_array_equal(sides.fixed(grid, np.flatnonzero(floor))[0], kinds[floor] != HELD)


def test_two_frictional_walls_keep_both_their_normals_closed_on_their_edge():
    sides = Sides({"z_min": Side("friction"), "x_min": Side("friction")})
    kinds, _ = sides.boundary(box(3))
    np.testing.assert_array_equal(kinds[box(3).cells[2] + 1], [CLOSED, FLUID_HELD, CLOSED])


def test_grains_see_walls_of_the_same_kinds():
    sides = Sides({"z_min": Side("friction", 0.4), "x_min": Side("open")})
    walls = sides.walls().on(2)
    assert [wall.kind for wall in walls] == ["open", "slip", "friction", "slip"]
    assert walls[2].friction == 0.4


@settings(max_examples=25)
@given(
    dimension=st.sampled_from([2, 3]),
    kinds=st.lists(st.sampled_from(["slip", "stick", "friction"]), min_size=6, max_size=6),
    speeds=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
)
def test_discrete_fluxes_are_those_of_the_faces(dimension, kinds, speeds):
    """Integral of div u_h = sum of (normal velocity) (area), whatever corners do: balanced faces balance on the grid."""
    grid = box(dimension)
    lengths, faces, net = grid.upper - grid.origin, {}, 0.0
    for face, name in enumerate(FACES[dimension]):
        axis, upper = divmod(face, 2)
        velocity = np.zeros(dimension)
        velocity[axis] = speeds[face]
        faces[name] = Side(kinds[face], velocity=tuple(velocity))
        net += (2 * upper - 1) * speeds[face] * np.prod(np.delete(lengths, axis))
    kinds_found, held = Sides(faces).boundary(grid)
    # The same boxes with one open face, which needs no balance.
    fluid = FluidGrid(grid, Sides({"z_max": Side("open")}), "penalised", 1.0)
    inside = np.random.default_rng(0).normal(size=held.shape)
    normal_given = np.where(kinds_found == FREE, inside, held)
    assert (fluid.divergence @ normal_given.reshape(-1)).sum() == pytest.approx(net, abs=1e-10)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Side("sticky"), "side.kind"),
        (lambda: Side("friction", -0.1), "side.friction"),
        (lambda: Side("friction", math.nan), "side.friction"),
        (lambda: Side("stick", velocity=(1.0, math.inf)), "side.velocity"),
        (lambda: Side("stick", velocity=(1.0,)), "side.velocity"),
        (lambda: Side("stick", velocity=3.0), "side.velocity"),
        (lambda: Side("open", velocity=(1.0, 0.0)), "side.velocity"),
        (lambda: Sides({"top": Side()}), "sides"),
        (lambda: Sides({"z_min": "stick"}), "sides.z_min"),
        (lambda: Sides({"y_min": Side()}).on(2), "sides"),
        (lambda: Sides({"z_min": Side("stick", velocity=(0.0, 0.0, 0.0))}).on(2), "sides.z_min.velocity"),
        (lambda: Sides({"z_min": Side("slip", velocity=(1.0, 0.0))}).on(2), "sides.z_min.velocity"),
        (lambda: FluidGrid(box(2), Sides(), "Q2"), "pressure"),
        (lambda: FluidGrid(box(2), Sides(), "penalised"), "penalty"),
        (lambda: FluidGrid(box(2), Sides(), "penalised", -1.0), "penalty"),
        (lambda: FluidGrid(box(2), Sides(), "layers", 1.0), "penalty"),
        (lambda: FluidGrid(box(2, 5), Sides(), "layers"), "grid.cells"),
        (lambda: FluidGrid(box(2, 5), Sides(), "coarse"), "grid.cells"),
        (
            lambda: FluidGrid(RegularGrid.from_box([1, 1], [2, 2]), everywhere("stick", 2), "layers"),
            "grid.cells",
        ),
        (lambda: FluidGrid(box(2), Sides()).stiffness(-1.0), "viscosity"),
        (lambda: FluidGrid(box(2), Sides()).stiffness(np.ones(3)), "viscosity"),
        (lambda: penalty_for(0.0, 9.81, 1.0), "density"),
        (lambda: advected(box(2), np.zeros((35, 2)), -1.0), "dt"),
        (lambda: advected(box(2), np.zeros((3, 2)), 1.0), "velocities"),
        (lambda: advected(box(2), np.zeros((35, 2)), 1.0, np.zeros(35)), "carried"),
        (lambda: advected(box(2), np.full((35, 2), np.nan), 1.0), "velocities"),
        (lambda: advected(box(2), np.full((35, 2), 1e9), 1.0), "dt"),
        (lambda: StokesSolver(np.eye(2), np.array([1.0, 0.0])), "compliance"),
        (lambda: StokesSolver(np.eye(2)).solve(np.zeros(2), None, np.ones(2)), "mass"),
        (lambda: StokesSolver(np.eye(2)).solve(np.ones(2), None, np.ones(3)), "load"),
        (lambda: StokesSolver(np.ones((2, 3))).solve(np.ones(3), None, np.ones(3)), "constraints"),
    ],
)
def test_bad_input_is_named(make, field):
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.field == field


def test_a_closed_box_with_inconsistent_fluxes_is_refused_with_its_faces():
    grid = RegularGrid.from_box([2.0, 1.0], [4, 4])
    inflow = {"x_min": Side("slip", velocity=(0.5, 0.0))}
    with pytest.raises(InputError, match=r"net flux.*|x_min") as caught:
        FluidGrid(grid, Sides(inflow))
    assert "x_min -0.5" in str(caught.value) and "inconsistent fluxes" in str(caught.value)
    FluidGrid(grid, Sides(inflow | {"z_max": Side("slip", velocity=(0.0, 0.25))}))
    FluidGrid(grid, Sides(inflow | {"z_max": Side("open")}))


# -- matrices ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("pressure", [*STABLE, "penalised"])
def test_divergence_of_linear_and_shearing_fields(dimension, pressure):
    grid = box(dimension)
    fluid = FluidGrid(
        grid, Sides({"z_max": Side("open")}), pressure, 1.0 if pressure == "penalised" else None
    )
    slope = np.random.default_rng(dimension).normal(size=(dimension, dimension))
    linear = places(grid) @ slope.T
    expected = np.trace(slope) * fluid.pressure_volumes
    np.testing.assert_allclose(fluid.divergence @ linear.reshape(-1), expected, rtol=1e-11)
    assert fluid.pressure_volumes.sum() == pytest.approx(np.prod(grid.upper - grid.origin), rel=1e-12)
    # Forces of a linear pressure are minus its gradient times the nodal volumes, away from the faces.
    inner = np.all((grid.node_indices(np.arange(grid.node_count)) % grid.cells) != 0, axis=1)
    gradient = np.array([3.0, -2.0, 5.0])[:dimension]
    nodal = np.array(list(product(*_pressure_places(grid, pressure))))
    forces = (fluid.divergence.T @ (nodal @ gradient)).reshape(-1, dimension)
    np.testing.assert_allclose(forces[inner], -fluid.volumes[inner, None] * gradient, rtol=1e-10)
    np.testing.assert_allclose(
        fluid.pressure_field(nodal @ gradient), places(grid) @ gradient, rtol=1e-10, atol=1e-10
    )


def _pressure_places(grid: RegularGrid, pressure: str) -> list[np.ndarray]:
    found = []
    for axis in range(grid.dimension):
        start, h, count = grid.origin[axis], grid.spacing[axis], int(grid.cells[axis])
        if pressure == "layers" and axis == grid.dimension - 1:
            found.append(start + h * (np.arange(count) + 0.5))
        else:
            step = 1 if pressure == "penalised" else 2
            found.append(start + h * np.arange(0, count + 1, step))
    return found


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("cells", [2, 3, 4])
def test_stiffness_is_twice_the_square_of_the_strain_rate(dimension, cells):
    grid, rng = box(dimension, cells), np.random.default_rng(0)
    fluid = FluidGrid(grid, Sides(), "penalised", 1.0)
    slope = rng.normal(size=(dimension, dimension))
    strain = 0.5 * (slope + slope.T)
    eta = rng.uniform(0.5, 2.0, grid.cell_count)
    K, linear = fluid.stiffness(eta), (places(grid) @ slope.T).reshape(-1)
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()
    work = 2.0 * np.sum(strain**2) * grid.cell_volume * eta.sum()
    assert linear @ (K @ linear) == pytest.approx(work, rel=1e-12)
    rigid = (places(grid) @ (slope - slope.T).T + 1.0).reshape(-1)
    np.testing.assert_allclose(K @ rigid, 0.0, atol=1e-12 * abs(K).max() * abs(rigid).max())
    corners = rng.uniform(0.5, 2.0, grid.node_count).reshape(tuple(grid.nodes))
    mean = np.mean(
        [corners[tuple(slice(k, k + n) for k, n in zip(c, grid.cells, strict=True))]
         for c in product((0, 1), repeat=dimension)], axis=0,
    )  # fmt: skip
    assert abs(fluid.stiffness(corners.reshape(-1)) - fluid.stiffness(mean.reshape(-1))).max() < 1e-12
    assert np.linalg.eigvalsh(fluid.stiffness(1.0).toarray())[0] > -1e-12 * abs(K).max()


@pytest.mark.parametrize(("kind", "layers", "coarse"), [("stick", 0.2, 0.12), ("slip", 0.35, 0.21)])
def test_inf_sup_constants_do_not_fade(kind, layers, coarse):
    for pressure, least in (("layers", layers), ("coarse", coarse)):
        for cells in (4, 8, 12):
            assert _inf_sup(RegularGrid.from_box([1.0, 1.0], [cells] * 2), kind, pressure) > least
    assert _inf_sup(RegularGrid.from_box([1.0] * 3, [4] * 3), "slip", "layers") > 0.2


def _inf_sup(grid: RegularGrid, kind: str, pressure: str) -> float:
    sides = everywhere(kind, grid.dimension)
    fluid = FluidGrid(grid, sides, pressure)
    free = sides.fixed(grid, np.arange(grid.node_count))[0].reshape(-1)
    K = fluid.stiffness(1.0).toarray()[np.ix_(free, free)] + 1e-9 * np.eye(free.sum())
    B, volumes = fluid.divergence.toarray()[:, free], fluid.pressure_volumes
    # Lumped mass of pressures modulo constants: the one left out is zero.
    mass = np.diag(volumes) - np.outer(volumes, volumes)
    root = np.linalg.inv(np.linalg.cholesky(mass))
    return math.sqrt(np.linalg.eigvalsh(root @ B @ np.linalg.solve(K, B.T) @ root.T)[0])


# -- steps ------------------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(
    seed=st.integers(0, 1000),
    viscosity=st.sampled_from([0.0, 1e-3, 1.0, 1e3]),
    pressure=st.sampled_from([*STABLE, "penalised"]),
    kind=st.sampled_from(["slip", "stick", "friction", "open"]),
)
def test_a_step_is_the_solution_of_the_saddle_point(seed, viscosity, pressure, kind):
    rng, grid = np.random.default_rng(seed), box(2)
    sides = Sides({"z_min": Side("stick"), "x_max": Side(kind), "z_max": Side("stick", velocity=(0.7, 0.0))})
    penalty = 0.3 if pressure == "penalised" else None
    fluid = FluidGrid(grid, sides, pressure, penalty)
    kinds, held = sides.boundary(grid)
    free, values = (kinds == FREE).reshape(-1), held.reshape(-1)
    mass = np.repeat(rng.uniform(0.1, 3.0, grid.node_count) * fluid.volumes, 2)
    K = fluid.stiffness(viscosity * rng.uniform(1.0, 2.0, grid.node_count)) if viscosity else None
    load, k = rng.normal(size=free.size), np.zeros(len(fluid.kept))
    found = solver(fluid).solve(mass, K, load, k, free, values, tolerance=1e-11)
    B = fluid.divergence.toarray()
    A = np.diag(mass) + (0.0 if K is None else K.toarray())
    D = np.zeros(len(B)) if fluid.slack_masses is None else 1.0 / fluid.slack_masses
    saddle = np.block([[A[np.ix_(free, free)], -B[:, free].T], [B[:, free], np.diag(D)]])
    right = np.concatenate([(load - A @ values)[free], -B @ values])
    exact = np.linalg.solve(saddle, right)
    count = free.sum()
    scale = np.abs(exact[:count]).max() + 0.7
    assert found.converged and found.missed < 1e-12 * scale
    np.testing.assert_allclose(found.u[free], exact[:count], atol=1e-8 * scale)
    np.testing.assert_array_equal(found.u[~free], values[~free])
    np.testing.assert_allclose(found.p, exact[count:], atol=1e-6 * np.abs(exact[count:]).max())


def test_a_solver_kept_from_step_to_step_repeats_its_bytes():
    grid, sides = box(3), everywhere("slip", 3)
    fluid = FluidGrid(grid, sides)
    free = sides.fixed(grid, np.arange(grid.node_count))[0].reshape(-1)
    kept, load = solver(fluid), np.random.default_rng(1).normal(size=free.size)
    masses = [np.repeat(density * fluid.volumes, 3) for density in (1.0, 5.0, 1.0)]
    found = [kept.solve(mass, fluid.stiffness(0.1), load, free=free) for mass in masses]
    np.testing.assert_array_equal(found[0].u, found[2].u)
    np.testing.assert_array_equal(found[0].p, found[2].p)
    assert not np.array_equal(found[0].u, found[1].u)


def test_friction_walls_may_be_rows_of_constraints():
    """The normals of frictional walls as rows below B give the velocities of walls that hold these components."""
    grid, sides = box(2), Sides({"z_min": Side("friction")})
    fluid, d = FluidGrid(grid, sides), 2
    nodes, axes = np.nonzero(sides.boundary(grid)[0] == CLOSED)
    picked = np.zeros((len(nodes), fluid.divergence.shape[1]))
    picked[np.arange(len(nodes)), nodes * d + axes] = fluid.volumes[nodes]
    rows = np.vstack([fluid.divergence.toarray(), picked])
    free, _ = sides.fixed(grid, np.arange(grid.node_count))
    mass, load = np.repeat(fluid.volumes, d), np.random.default_rng(2).normal(size=free.size)
    K = fluid.stiffness(0.01)
    by_rows = StokesSolver(rows).solve(mass, K, load, None, free.reshape(-1), tolerance=1e-12)
    held = free.copy()
    held[nodes, axes] = False
    by_columns = solver(fluid).solve(mass, K, load, None, held.reshape(-1), tolerance=1e-12)
    np.testing.assert_allclose(by_rows.u, by_columns.u, atol=1e-9 * np.abs(by_columns.u).max())


@pytest.mark.parametrize("dimension", [2, 3])
def test_layers_hold_any_stratified_fluid_at_rest(dimension):
    """Exact for densities of the height alone, jumps included; "coarse" pressures let a jump drive velocities."""
    grid = box(dimension)
    sides = Sides({"z_min": Side("stick"), "x_max": Side("stick")})
    every, dt = np.arange(grid.node_count), 1e-2
    free = sides.fixed(grid, every)[0].reshape(-1)
    height = places(grid)[:, -1]
    for jump, pressure in product((0.0, 900.0), STABLE):
        density = 1000.0 + jump * (height < grid.origin[-1] + 2.5 * grid.spacing[-1])
        fluid = FluidGrid(grid, sides, pressure)
        gravity = np.tile(np.append(np.zeros(dimension - 1), -9.81), grid.node_count)
        mass = np.repeat(density * fluid.volumes / dt, dimension)
        found = solver(fluid).solve(
            mass, fluid.stiffness(1e-3), mass * gravity * dt, free=free, tolerance=1e-12
        )
        fastest = np.abs(found.u).max()
        if pressure == "layers" or jump == 0.0:
            assert fastest < 1e-13 * 9.81
        else:
            assert fastest > 0.01 * 9.81 * dt
        if jump == 0.0:
            hydrostatic = -1000.0 * 9.81 * (height - fluid.volumes @ height / fluid.volumes.sum())
            np.testing.assert_allclose(
                fluid.pressure_field(found.p), hydrostatic, atol=1e-9 * np.ptp(hydrostatic)
            )


def test_a_penalty_compresses_as_advised():
    grid, sides = RegularGrid.from_box([1.0, 1.0], [8, 8]), Sides()
    penalty = penalty_for(1000.0, 9.81, 1.0, share=1e-3)
    fluid, dt = FluidGrid(grid, sides, "penalised", penalty), 0.5
    free = sides.fixed(grid, np.arange(grid.node_count))[0].reshape(-1)
    mass = np.repeat(1000.0 * fluid.volumes / dt, 2)
    found = solver(fluid).solve(mass, None, mass * np.tile([0.0, -9.81 * dt], grid.node_count), free=free)
    assert found.missed < 1e-12
    assert 0.0 < fluid.largest_divergence(found.u) < 2e-3 * math.sqrt(9.81)


def _vortex(grid: RegularGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity curl(sin^2 pi x sin^2 pi z), pressure cos(pi x) cos(2 pi z), and the force on a fluid of viscosity one."""
    x, z = (math.pi * coordinate for coordinate in places(grid).T)
    pi, sx, sz = math.pi, np.sin(x) ** 2, np.sin(z) ** 2
    velocity = pi * np.stack([sx * np.sin(2 * z), -np.sin(2 * x) * sz], axis=1)
    laplacian = 2 * pi**3 * np.stack(
        [np.sin(2 * z) * (np.cos(2 * x) - 2 * sx), -np.sin(2 * x) * (np.cos(2 * z) - 2 * sz)], axis=1
    )  # fmt: skip
    slope = -pi * np.stack([np.sin(x) * np.cos(2 * z), 2 * np.cos(x) * np.sin(2 * z)], axis=1)
    return velocity, np.cos(x) * np.cos(2 * z), slope - laplacian


@pytest.mark.parametrize("pressure", STABLE)
def test_stokes_flow_converges_at_the_order_of_its_spaces(pressure):
    errors = []
    for cells in (8, 16, 32):
        grid, sides = RegularGrid.from_box([1.0, 1.0], [cells] * 2), everywhere("stick", 2)
        fluid = FluidGrid(grid, sides, pressure)
        velocity, p, force = _vortex(grid)
        free = sides.fixed(grid, np.arange(grid.node_count))[0].reshape(-1)
        load = (fluid.volumes[:, None] * force).reshape(-1)
        mass = np.repeat(1e-9 * fluid.volumes, 2)
        found = solver(fluid).solve(mass, fluid.stiffness(1.0), load, free=free, tolerance=1e-10)
        mean = fluid.volumes @ p / fluid.volumes.sum()
        missed = fluid.pressure_field(found.p) - (p - mean)
        errors.append((norm(fluid, found.u - velocity.reshape(-1)), norm(fluid, missed)))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders[:, 0] > 1.95) and np.all(orders[:, 1] > 1.4)


# -- characteristics --------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(
    seed=st.integers(0, 1000),
    dimension=st.sampled_from([2, 3]),
    cells=st.integers(1, 5),
    dt=st.floats(0.0, 0.4),
)
def test_a_uniform_flow_carries_linear_fields_exactly_and_creates_no_extremum(seed, dimension, cells, dt):
    rng, grid = np.random.default_rng(seed), box(dimension, cells)
    wind = rng.uniform(-1.0, 1.0, dimension)
    flow = np.tile(wind, (grid.node_count, 1))
    slope = rng.normal(size=(dimension, 2))
    after = advected(grid, flow, dt, places(grid) @ slope)
    feet = np.clip(places(grid) - dt * wind, grid.origin, grid.upper)
    np.testing.assert_allclose(after, feet @ slope, atol=1e-12)
    rough = rng.normal(size=(grid.node_count, 3))
    swirl = 5.0 * rng.normal(size=(grid.node_count, dimension))
    carried = advected(grid, swirl, dt, rough)
    assert np.all(carried.max(axis=0) <= rough.max(axis=0)) and np.all(
        carried.min(axis=0) >= rough.min(axis=0)
    )


def test_a_linear_flow_is_followed_to_second_order_in_time():
    """The midpoint rule in u = A x: the foot is x - dt A x + dt^2 A^2 x / 2, where a linear field is read exactly."""
    grid = RegularGrid([-1.0, -1.0], [0.1, 0.1], [20, 20])
    spin, dt = np.array([[0.0, -0.3], [0.3, 0.0]]), 0.05
    x = places(grid)
    feet = x @ (np.eye(2) - dt * spin + 0.5 * dt**2 * spin @ spin).T
    inside = np.all(np.abs(feet) < 1.0, axis=1)
    np.testing.assert_allclose(advected(grid, x @ spin.T, dt)[inside], (feet @ spin.T)[inside], atol=1e-14)


def test_a_turning_hill_comes_back_at_better_than_second_order():
    errors = []
    for cells in (32, 64):
        grid = RegularGrid([-0.5, -0.5], [1.0 / cells] * 2, [cells] * 2)
        x = places(grid)
        flow = 2.0 * math.pi * np.stack([-x[:, 1], x[:, 0]], axis=1)
        hill = np.exp(-np.sum((x - [0.2, 0.0]) ** 2, axis=1, keepdims=True) / (2 * 0.07**2))
        found = hill
        for _ in range(cells):
            found = advected(grid, flow, 1.0 / cells, found)
        assert found.min() >= 0.0 and found.max() <= 1.0
        errors.append(np.linalg.norm(found - hill) / np.linalg.norm(hill))
    assert math.log2(errors[0] / errors[1]) > 2.0
    assert errors[1] < 0.02


def test_space_carries_a_field_of_the_plane_as_the_plane_does():
    flat, deep = RegularGrid.from_box([1.0, 1.0], [6, 5]), RegularGrid.from_box([1.0, 0.5, 1.0], [6, 3, 5])
    rng = np.random.default_rng(3)
    flow, field = rng.normal(size=(7, 6, 2)), rng.normal(size=(7, 6, 1))
    wide = np.repeat(np.stack([flow[..., 0], np.zeros((7, 6)), flow[..., 1]], axis=-1)[:, None], 4, axis=1)
    tall = np.repeat(field[:, None], 4, axis=1)
    plane = advected(flat, flow.reshape(-1, 2), 0.3, field.reshape(-1, 1)).reshape(7, 6)
    space = advected(deep, wide.reshape(-1, 3), 0.3, tall.reshape(-1, 1)).reshape(7, 4, 6)
    for k in range(4):
        np.testing.assert_allclose(space[:, k], plane, atol=1e-13)


# -- the lid-driven cavity --------------------------------------------------------------------------------------------------

# Ghia, Ghia and Shin, J. Comput. Phys. 48 (1982), tables I and II, Re = 100.
ALONG_VERTICAL = np.array(
    [[0.0547, -0.03717], [0.1719, -0.10150], [0.2813, -0.15662], [0.4531, -0.21090], [0.5, -0.20581],
     [0.6172, -0.13641], [0.7344, 0.00332], [0.8516, 0.23151], [0.9531, 0.68717], [0.9766, 0.84123]]
)  # fmt: skip
ALONG_HORIZONTAL = np.array(
    [[0.0625, 0.09233], [0.0938, 0.12317], [0.1563, 0.16077], [0.2266, 0.17507], [0.2344, 0.17527],
     [0.5, 0.05454], [0.8047, -0.24533], [0.8594, -0.22445], [0.9063, -0.16914], [0.9453, -0.10313]]
)  # fmt: skip


def _cavity(cells: int, pressure: str, schedule: list[tuple[float, int]]) -> tuple[float, float]:
    """Largest errors of u and v on the centre lines after (dt, steps) of the schedule, from rest."""
    grid = RegularGrid.from_box([1.0, 1.0], [cells] * 2)
    sides = Sides(dict(everywhere("stick", 2).faces) | {"z_max": Side("stick", velocity=(1.0, 0.0))})
    fluid = FluidGrid(grid, sides, pressure)
    free, values = sides.fixed(grid, np.arange(grid.node_count))
    steps, K, u = solver(fluid), fluid.stiffness(0.01), values
    for dt, count in schedule:
        mass = np.repeat(fluid.volumes / dt, 2)
        for _ in range(count):
            load = mass * advected(grid, u, dt).reshape(-1)
            found = steps.solve(
                mass, K, load, free=free.reshape(-1), values=values.reshape(-1), tolerance=1e-6
            )
            u = found.u.reshape(-1, 2)
    assert fluid.largest_divergence(u) < 1e-10
    middle = np.full(len(ALONG_VERTICAL), 0.5)
    on_vertical = interpolate(grid, u, np.stack([middle, ALONG_VERTICAL[:, 0]], axis=1))[:, 0]
    on_horizontal = interpolate(grid, u, np.stack([ALONG_HORIZONTAL[:, 0], middle], axis=1))[:, 1]
    return (
        float(np.abs(on_vertical - ALONG_VERTICAL[:, 1]).max()),
        float(np.abs(on_horizontal - ALONG_HORIZONTAL[:, 1]).max()),
    )


@pytest.mark.parametrize("pressure", ["layers", pytest.param("coarse", marks=pytest.mark.slow)])
def test_cavity_at_reynolds_100(pressure):
    assert max(_cavity(32, pressure, [(0.05, 240)])) < 0.01


@pytest.mark.slow
def test_fine_cavity_at_reynolds_100():
    assert max(_cavity(64, "layers", [(0.05, 300), (0.02, 300)])) < 0.01
