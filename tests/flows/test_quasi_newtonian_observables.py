"""Observables of quasi-Newtonian flows: exact on polynomials, forces in balance, xi, nodal fields, plugs (seed C, 5.1, 6.4)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import skfem

from barchan.errors import InputError
from barchan.flows.conditions import NoSlip, Velocity
from barchan.flows.quasi_newtonian import observables
from barchan.flows.quasi_newtonian.couette import couette_profile
from barchan.flows.quasi_newtonian.direct import DirectSolver
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import Bingham, ModifiedPoliquen, Newtonian, Poliquen, PowerLaw
from barchan.flows.quasi_newtonian.newton import NonlinearOptions, solve_flow
from barchan.flows.quasi_newtonian.sampling import (
    interpolate,
    interpolate_within,
    locate,
    magnitude,
)
from barchan.flows.quasi_newtonian.temperature import Arrhenius, WithTemperature
from barchan.spaces.meshes.annulus import annulus
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

INNER, OUTER = 1.0, 2.0
KINDS = ["quadrilateral", "triangle"]
PAIRS = [("quadrilateral", "P1d"), ("quadrilateral", "P1d_mapped"), ("triangle", "P1d"), ("triangle", "P1")]


def ring(level: int = 1, kind: str = "quadrilateral", pressure: str = "P1d") -> QuadraticSpace:
    return QuadraticSpace(annulus(level, INNER, OUTER, kind=kind), pressure)


def square(kind: str = "quadrilateral", cells: int = 4, pressure: str = "P1d") -> QuadraticSpace:
    """The unit square with inner nodes moved about, sides straight."""
    ticks = np.linspace(0.0, 1.0, cells + 1)
    make = skfem.MeshQuad.init_tensor if kind == "quadrilateral" else skfem.MeshTri.init_tensor
    mesh = make(ticks, ticks)
    inside = mesh.interior_nodes()
    points = mesh.p.copy()
    points[:, inside] += np.random.default_rng(0).uniform(-0.15, 0.15, (2, len(inside))) / cells
    mesh = type(mesh)(points, mesh.t).with_boundaries(
        {"bottom": lambda x: x[1] == 0.0, "rest": lambda x: x[1] > 0.0}
    )
    return QuadraticSpace(QuadraticMesh.of(mesh), pressure)


def solved(velocity: np.ndarray, pressure: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(velocity=velocity, pressure=pressure)


def flow_of(space: QuadraticSpace, model=None, **options) -> QuasiNewtonianFlow:
    return QuasiNewtonianFlow(
        space, model or Newtonian(1.0), {name: NoSlip() for name in space.mesh.boundaries}, **options
    )


def spin(x: np.ndarray) -> np.ndarray:
    """Newtonian flow between cylinders, the outer one at rest: u = (A r + B / r) e_theta."""
    r2 = np.sum(x**2, axis=1)
    return np.stack([-x[:, 1], x[:, 0]], axis=1) * (4.0 / r2 - 1.0)[:, None] / 3.0


def spin_rate(x: np.ndarray) -> np.ndarray:
    """|g| = |r (u / r)'| / sqrt(2) of `spin`."""
    return np.sqrt(2.0) * 4.0 / 3.0 / np.sum(x**2, axis=1)


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_found_in_curved_cells(kind):
    """The maps of the cells found take the reference places back to the points, also between chord and arc, and on sides."""
    mesh = annulus(1, INNER, OUTER, kind=kind)
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0, 2 * np.pi, 300), rng.uniform(INNER + 1e-3, OUTER - 1e-3, 300)
    points = np.concatenate([radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), mesh.nodes])
    places = locate(mesh, points)
    assert interpolate(mesh, places, mesh.nodes) == pytest.approx(points, abs=1e-12)
    assert np.bincount(places.points, places.shares) == pytest.approx(np.ones(len(points)))
    # A vertex has all its cells, a middle of a side two (or one on the boundary), a point within a cell one.
    have = np.bincount(places.points)[300:]
    assert np.array_equal(have, np.bincount(mesh.cell_nodes.ravel()))


@pytest.mark.parametrize("kind", KINDS)
def test_points_outside_are_refused(kind):
    mesh = annulus(1, INNER, OUTER, kind=kind)
    with pytest.raises(InputError, match="domain"):
        locate(mesh, np.array([[1.5, 0.0], [0.5, 0.0]]))
    with pytest.raises(InputError, match="domain"):
        locate(mesh, np.array([[2.2, 0.0]]))
    # The true circle runs slightly outside of the curved sides: its points belong to the domain.
    angle = np.linspace(0.0, 2 * np.pi, 77)
    places = locate(mesh, OUTER * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    assert places.count == 77


@pytest.mark.parametrize(("kind", "pressure"), PAIRS)
def test_cut_lines_are_exact_for_what_the_space_contains(kind, pressure):
    """Quadratic velocities and linear pressures on straight cells: every profile is exact, along sides as well."""
    space = square(kind, pressure=pressure)
    x, y = space.mesh.nodes.T
    velocity = np.stack([x**2 - x * y, 3 * y**2 - 2 * x * y + x], axis=1)
    flat = space.points.reshape(-1, 2)
    # Coefficients of p = 2 x - y + 1 by least squares at the quadrature points.
    coefficients = np.zeros(space.P)
    target = (2 * flat[:, 0] - flat[:, 1] + 1).reshape(space.weights.shape)
    for c in range(space.cells):
        coefficients[space.cell_pressures[c]] = np.linalg.lstsq(
            space.pressure_values[c], target[c], rcond=None
        )[0]
    for start, end in (((0.0, 0.0), (1.0, 1.0)), ((0.0, 0.0), (1.0, 0.0)), ((0.13, 0.9), (0.77, 0.21))):
        line = observables.cut_line(flow_of(space), solved(velocity, coefficients), start, end, 37)
        a, b = line.points.T
        assert line.points[[0, -1]] == pytest.approx(np.array([start, end]))
        assert line.positions[-1] == pytest.approx(np.hypot(end[0] - start[0], end[1] - start[1]))
        assert line.velocity == pytest.approx(
            np.stack([a**2 - a * b, 3 * b**2 - 2 * a * b + a], axis=1), abs=1e-11
        )
        assert line.speed == pytest.approx(np.hypot(*line.velocity.T))
        rates = np.stack([2 * a - b, 6 * b - 2 * a, 0.5 * (-a - 2 * b + 1)], axis=1)
        assert line.rates == pytest.approx(rates, abs=1e-10)
        assert line.shear_rate == pytest.approx(
            np.sqrt(rates[:, 0] ** 2 + rates[:, 1] ** 2 + 2 * rates[:, 2] ** 2), abs=1e-10
        )
        if pressure != "P1d_mapped":  # bilinear cells: mapped functions do not contain the linear ones
            assert line.pressure == pytest.approx(2 * a - b + 1, abs=1e-10)
        assert line.viscosity == pytest.approx(np.ones(37))


@pytest.mark.parametrize("kind", KINDS)
def test_cut_lines_converge_on_curved_cells(kind):
    """Halving the cells divides the errors of speed by 8 and of shear rate by 4, on a line across cells."""
    errors = []
    for level in (1, 2, 3):
        space = ring(level, kind)
        line = observables.cut_line(
            flow_of(space), solved(spin(space.mesh.nodes), np.zeros(space.P)), (1.0, 0.05), (1.2, 1.5), 301
        )
        errors.append(
            [
                observables.xi(line.positions, magnitude_of(spin(line.points)), line.speed),
                observables.xi(line.positions, spin_rate(line.points), line.shear_rate),
            ]
        )
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders[-1] > [2.7, 1.8])
    assert np.all(np.array(errors[-1]) < [0.01, 0.5])


def magnitude_of(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)


@pytest.mark.parametrize(
    ("model", "method", "radii", "speed"),
    [
        (PowerLaw(1.0, 1.4, eps=0.01), "newton", (INNER, OUTER), 1.0),
        (
            ModifiedPoliquen(0.15, 0.27, 0.06, 1e-3, 1.0, 0.99133, eps=1e-2),
            "stress-velocity",
            (0.019, 0.024),
            0.019886667,
        ),
    ],
)
def test_defaults_of_cut_lines_are_the_nearer_to_the_exact_flow(model, method, radii, speed):
    """Between cylinders, against the exact profile: viscosities averaged, rates direct.

    Averages of the viscosity have less than half the error, also where matter all but stops within a cell.
    """
    space = QuadraticSpace(annulus(2, *radii))
    turning = Velocity(lambda x: speed / radii[0] * np.stack([-x[:, 1], x[:, 0]], axis=1))
    flow = QuasiNewtonianFlow(space, model, {"inner": turning, "outer": NoSlip()})
    options = NonlinearOptions(method=method, tolerance=1e-6, max_iterations=60)
    state = solve_flow(flow, DirectSolver(flow), options)
    assert state.converged, state.message
    errors = {}
    for recovery in observables.RECOVERIES:
        line = observables.cut_line(flow, state, (radii[0], 0.0), (radii[1], 0.0), 401, recovery=recovery)
        speeds, rates, viscosities = couette_profile(model, *radii, speed).at(radii[0] + line.positions)
        errors[recovery] = observables.xi(line.positions, viscosities, line.viscosity)
        assert line.viscosity.min() > 0.0
        assert observables.xi(line.positions, speeds, line.speed) < 1.0
    assert errors["averaged"] < 0.5 * errors["direct"], errors
    averaged = observables.nodal(space, flow.rates(state.velocity))
    nodal = magnitude(interpolate(space.mesh, locate(space.mesh, line.points), averaged))
    assert observables.xi(line.positions, rates, line.shear_rate) < observables.xi(
        line.positions, rates, nodal
    )


def test_viscosity_follows_a_temperature_given_at_the_quadrature_points():
    """Both recoveries meet eta = exp(E / (R theta)) for a temperature linear in space."""
    space = square(cells=8)
    theta = 300.0 + 20.0 * space.points[..., 0]
    law = Arrhenius(2e4)
    flow = flow_of(space, WithTemperature(Newtonian(0.7), law, theta))
    state = solved(np.zeros((space.N, 2)), np.zeros(space.P))
    for recovery in observables.RECOVERIES:
        line = observables.cut_line(flow, state, (0.0, 0.3), (1.0, 0.4), 21, recovery=recovery)
        assert line.viscosity == pytest.approx(0.7 * law(300.0 + 20.0 * line.points[:, 0]), rel=2e-3)


def test_a_wall_feels_shear_stress_and_pressure():
    """Under u = (y, 0) and p = 3 the wall y = 0 feels (eta, -3); at its ends the side walls' shares cancel each other."""
    space = square()
    moving = {
        name: Velocity(lambda x: np.stack([x[:, 1], 0 * x[:, 1]], axis=1)) for name in ("bottom", "rest")
    }
    flow = QuasiNewtonianFlow(space, Newtonian(0.2), moving, density=2.0, convection=False)
    velocity = np.stack([space.mesh.nodes[:, 1], np.zeros(space.N)], axis=1)
    state = solved(velocity, 3.0 * space.unit_pressure)
    result = observables.drag_lift(flow, state, "bottom", speed=0.5, length=3.0)
    assert result.force == pytest.approx([0.2, -3.0])
    assert (result.drag, result.lift) == pytest.approx((2 * 0.2 / (2 * 0.25 * 3), -2 * 3.0 / (2 * 0.25 * 3)))


def test_a_turning_cylinder_feels_no_net_force():
    space = ring(2)
    state = solved(spin(space.mesh.nodes), 5.0 * space.unit_pressure)
    result = observables.drag_lift(flow_of(space, Newtonian(0.2)), state, "inner", 1.0, 1.0)
    assert result.force == pytest.approx([0.0, 0.0], abs=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_a_pressure_gradient_pushes_a_hole_by_its_area(kind):
    """Archimedes: p = -x on the inner circle gives the force +area of the hole along x, to the accuracy of the circle."""
    space = ring(3, kind)
    coefficients = np.zeros(space.P)
    for c in range(space.cells):
        coefficients[space.cell_pressures[c]] = np.linalg.lstsq(
            space.pressure_values[c], -space.points[c, :, 0], rcond=None
        )[0]
    # The gradient of p is balanced by the body force (-1, 0), so the fluid is at rest.
    flow = flow_of(space, density=1.0, force=(-1.0, 0.0))
    state = solved(np.zeros((space.N, 2)), coefficients)
    result = observables.drag_lift(flow, state, "inner", 1.0, 2.0)
    assert result.force == pytest.approx([np.pi * INNER**2, 0.0], abs=1e-4)
    assert result.drag == pytest.approx(np.pi, abs=1e-4)


def test_xi_is_the_relative_distance_in_percent():
    x = np.linspace(0.0, 0.005, 400)
    assert observables.xi(x, 1.0 + x, 1.0 + x) == 0.0
    assert observables.xi(x, 3 * np.ones(400), 2.7 * np.ones(400)) == pytest.approx(10.0)
    assert observables.xi(x, np.sin(900 * x), 0.0 * x) == pytest.approx(100.0)
    # Not symmetric: the first plot is the norm.
    assert observables.xi(x, np.ones(400), 2 * np.ones(400)) == pytest.approx(100.0)
    assert observables.xi(x, 2 * np.ones(400), np.ones(400)) == pytest.approx(50.0)
    coarse = np.linspace(0.0, 0.005, 7)
    assert observables.xi(x, 1.0 + x, 1.0 + coarse, coarse) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_nodal_fields_are_exact_for_linear_ones_and_bounded(kind):
    space = square(kind)
    linear = 2.0 * space.points[..., 0] - space.points[..., 1]
    assert observables.nodal(space, linear) == pytest.approx(
        2 * space.mesh.nodes[:, 0] - space.mesh.nodes[:, 1], abs=1e-12
    )
    pair = np.stack([linear, np.ones_like(linear)], axis=2)
    assert observables.nodal(space, pair)[:, 1] == pytest.approx(np.ones(space.N))
    jump = np.where(space.points[..., 0] > 0.45, 1000.0, 1.0)
    kept = observables.nodal(space, jump, positive=True)
    assert kept.min() >= 0.5 and kept.max() <= 2000.0
    assert observables.nodal(space, jump).min() < 0.0
    # Between the nodes such a field stays positive too.
    places = locate(space.mesh, np.random.default_rng(0).uniform(0, 1, (300, 2)))
    assert interpolate_within(space.mesh, places, kept).min() >= 0.5
    assert interpolate_within(space.mesh, places, np.ones(space.N)) == pytest.approx(np.ones(300))


def test_plug_is_where_the_stress_is_below_the_yield_stress():
    """Bingham channel y in (0, 1), u' = 0 for y > 0.5: exactly the upper half is rigid; a Newtonian fluid has none."""
    ticks = np.linspace(0.0, 1.0, 9)
    space = QuadraticSpace(QuadraticMesh.of(skfem.MeshQuad.init_tensor(ticks, ticks)))
    y = space.mesh.nodes[:, 1]
    velocity = np.stack([np.minimum(y - 0.5, 0.0) * (0.5 - y), 0 * y], axis=1)
    state = solved(velocity, space.unit_pressure)
    flow = QuasiNewtonianFlow(space, Bingham(1.0, 1.0, eps=1e-4), {})
    rigid = observables.plug(flow, state)
    middles = np.mean(space.points[..., 1], axis=1)
    assert np.array_equal(rigid, middles > 0.5)
    assert not observables.plug(QuasiNewtonianFlow(space, Newtonian(1.0), {}), state).any()
    granular = Poliquen(0.3, 0.2, 0.1, 0.1, 1.0, eps=1e-4)
    grains = QuasiNewtonianFlow(space, granular, {}, mean_pressure=1.0)
    assert np.array_equal(observables.plug(grains, state), middles > 0.5)
    # Without pressure nothing holds grains together: they are not a plug.
    loose = solved(velocity, 0.0 * space.unit_pressure)
    assert not observables.plug(grains, loose).any()


@pytest.mark.parametrize(
    ("ask", "field"),
    [
        (lambda flow, s: observables.drag_lift(flow, s, "cylinder", 1.0, 1.0), "boundary"),
        (lambda flow, s: observables.drag_lift(flow, s, "inner", 0.0, 1.0), "speed"),
        (lambda flow, s: observables.drag_lift(flow, s, "inner", 1.0, np.nan), "length"),
        (lambda flow, s: observables.cut_line(flow, s, (1.0, 0.0), (1.0, 0.0)), "end"),
        (lambda flow, s: observables.cut_line(flow, s, (1.0, 0.0), (3.0, 0.0)), "points"),
        (lambda flow, s: observables.cut_line(flow, s, (1.0, 0.0), (2.0, 0.0), 1), "points"),
        (lambda flow, s: observables.cut_line(flow, s, (1.0, 0.0), (2.0, 0.0), recovery="best"), "recovery"),
        (lambda flow, s: observables.xi([0.0, 1.0], [0.0, 0.0], [1.0, 1.0]), "values_i"),
        (lambda flow, s: observables.xi([0.0, 0.0], [1.0, 1.0], [1.0, 1.0]), "positions"),
        (lambda flow, s: observables.xi([0.0, 1.0], [1.0, 1.0], [1.0, 1.0, 1.0]), "values_j"),
        (lambda flow, s: observables.nodal(flow.space, np.ones(3)), "values"),
        (lambda flow, s: observables.plug(flow, s, -0.1), "margin"),
    ],
)
def test_bad_questions_are_refused_by_name(ask, field):
    space = ring()
    with pytest.raises(InputError) as refusal:
        ask(flow_of(space), solved(spin(space.mesh.nodes), np.zeros(space.P)))
    assert refusal.value.field == field
