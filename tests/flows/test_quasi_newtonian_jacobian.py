"""The Jacobian is the derivative of the residual for all models and conditions; weights do what they say (seed C 4.1.8)."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.flows.quasi_newtonian import (
    Arrhenius,
    Bingham,
    ChannelEnd,
    HerschelBulkley,
    Inertia,
    ModifiedPoliquen,
    Newtonian,
    Poliquen,
    PowerLaw,
    QuasiNewtonianFlow,
    Schaeffer,
    Slip,
    Tardos,
    UserModel,
    Weights,
    WithTemperature,
)
from barchan.flows.quasi_newtonian.flow import Fields
from barchan.flows.quasi_newtonian.stress_velocity import contracted, flow_direction, next_direction
from barchan.linalg.cell_pattern import CellPattern
from barchan.spaces.meshes import annulus
from barchan.spaces.quadratic import QuadraticSpace

MODELS = {
    "newtonian": Newtonian(1.3),
    "thinning": PowerLaw(0.7, 1.4, eps=0.1),
    "thickening": PowerLaw(0.7, 3.2),
    "bingham": Bingham(0.4, 0.9, eps=0.1),
    "herschel-bulkley": HerschelBulkley(0.4, 1.5, 0.9, eps=0.1),
    "schaeffer": Schaeffer(25.0, eps=0.1),
    "tardos": Tardos(25.0, 0.3, 0.6, eps=0.1),
    "poliquen": Poliquen(0.4, 0.3, 0.2, 0.1, 1.5, eps=0.1),
    "modified poliquen": ModifiedPoliquen(0.4, 0.3, 0.2, 0.1, 1.5, 2.0, eps=0.1),
    "user's": UserModel(lambda s: 1.0 + (1.0 + s) ** -0.3, lambda s: -0.3 * (1.0 + s) ** -1.3),
    "user's with pressure": UserModel(
        lambda s, p: np.exp(0.1 * p) * (1.0 + s) ** -0.3,
        lambda s, p: (-0.3 * np.exp(0.1 * p) * (1.0 + s) ** -1.3, 0.1 * np.exp(0.1 * p) * (1.0 + s) ** -0.3),
        uses_pressure=True,
    ),
    "warm poliquen": WithTemperature(
        Poliquen(0.4, 0.3, 0.2, 0.1, 1.5, eps=0.1), Arrhenius(2e3), temperature=300.0
    ),
}
PAIRS = [("quadrilateral", "P1d"), ("quadrilateral", "P1d_mapped"), ("triangle", "P1"), ("triangle", "P1d")]
YIELDING = (
    "bingham",
    "herschel-bulkley",
    "schaeffer",
    "tardos",
    "poliquen",
    "modified poliquen",
    "warm poliquen",
)


def ring_flow(model, kind: str = "quadrilateral", pressure: str = "P1d", **options) -> QuasiNewtonianFlow:
    """Curved cells, a wall with friction that turns, an end that sets the pressure."""
    space = QuadraticSpace(annulus(1, 1.0, 2.0, around=6, across=1, kind=kind), pressure)
    turning = Slip(0.8, lambda x: np.stack([-x[:, 1], x[:, 0]], axis=1))
    options = {"density": 1.7, "force": lambda x: np.stack([x[:, 1], x[:, 0] ** 2], axis=1), **options}
    return QuasiNewtonianFlow(space, model, {"inner": turning, "outer": ChannelEnd(3.0)}, **options)


def state(flow: QuasiNewtonianFlow, seed: int = 0) -> np.ndarray:
    """Unknowns with shear rates about one and pressures about three: a smooth flow, disturbed."""
    space, random = flow.space, np.random.default_rng(seed)
    x, y = space.mesh.nodes.T
    velocity = np.stack([np.sin(x) * y, np.cos(x * y)], axis=1) + 0.1 * random.standard_normal((space.N, 2))
    pressure = 3.0 * space.unit_pressure + 0.1 * random.standard_normal(space.P)
    return np.concatenate([velocity.ravel(), pressure])


def split(flow: QuasiNewtonianFlow, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x[: 2 * flow.space.N].reshape(-1, 2), x[2 * flow.space.N :]


def fields(flow: QuasiNewtonianFlow, x: np.ndarray) -> Fields:
    return flow.fields(*split(flow, x))


def residual(flow: QuasiNewtonianFlow, x: np.ndarray, inertia: Inertia | None = None) -> np.ndarray:
    return flow.residual(fields(flow, x), split(flow, x)[0], inertia)


def matrix(flow: QuasiNewtonianFlow, x: np.ndarray, *options, **named):
    pattern = CellPattern(flow.space.cell_unknowns, flow.space.size)
    return pattern.matrix(pattern.assemble(flow.jacobian(fields(flow, x), *options, **named)))


def derivative(function, x: np.ndarray, along: np.ndarray, step: float = 4e-4) -> np.ndarray:
    """Central differences with one step of Richardson's extrapolation."""
    coarse, fine = (
        (function(x + h * along) - function(x - h * along)) / (2.0 * h) for h in (step, 0.5 * step)
    )
    return (4.0 * fine - coarse) / 3.0


def check_derivative(flow: QuasiNewtonianFlow, inertia: Inertia | None = None) -> None:
    """Velocities and pressures apart, each part of the residual in units of its own."""
    x, velocities = state(flow), 2 * flow.space.N
    J = matrix(flow, x, inertia=inertia)
    for part in (slice(0, velocities), slice(velocities, None)):
        along = np.zeros_like(x)
        along[part] = np.random.default_rng(1).standard_normal(along[part].shape)
        found, wanted = J @ along, derivative(lambda y: residual(flow, y, inertia), x, along)
        for rows in (slice(0, velocities), slice(velocities, None)):
            error = np.linalg.norm(found[rows] - wanted[rows])
            assert error <= 1e-7 * max(np.linalg.norm(wanted[rows]), 1e-3 * np.linalg.norm(wanted))


@pytest.mark.parametrize("name", MODELS)
def test_jacobian_is_the_derivative_of_the_residual(name):
    check_derivative(ring_flow(MODELS[name]))


@pytest.mark.parametrize(("kind", "pressure"), PAIRS)
def test_jacobian_is_exact_in_every_pair_of_spaces_with_inertia_and_friction(kind, pressure):
    flow = ring_flow(MODELS["poliquen"], kind, pressure)
    past = np.random.default_rng(2).standard_normal((flow.space.N, 2))
    check_derivative(flow, Inertia(2.5, past))


def test_jacobian_is_exact_for_temperatures_at_the_points():
    space = ring_flow(Newtonian(1.0)).space
    temperature = 300.0 + 20.0 * space.points[..., 0]
    check_derivative(ring_flow(WithTemperature(MODELS["poliquen"], Arrhenius(2e3), temperature)))


def test_creeping_flow_has_no_convection_in_residual_or_jacobian():
    flow = ring_flow(MODELS["bingham"], convection=False)
    check_derivative(flow)
    heavy = ring_flow(MODELS["bingham"], convection=False, density=50.0)
    x = state(flow)
    assert np.array_equal(residual(flow, x), residual(heavy, x))


@pytest.mark.parametrize("name", MODELS)
def test_weights_of_zero_give_the_matrix_of_the_fixed_point(name):
    """A(x) x = internal forces at x: the fixed point solves the equations with viscosity and carrying velocity of before."""
    flow = ring_flow(MODELS[name])
    x, past = state(flow), np.zeros((flow.space.N, 2))
    A = matrix(flow, x, Weights(0.0, 0.0, 0.0), inertia=Inertia(0.7, past))
    internal = flow.residual(fields(flow, x), split(flow, x)[0], Inertia(0.7, past), loaded=False)
    assert np.linalg.norm(A @ x - internal) <= 1e-12 * np.linalg.norm(internal)


def test_each_weight_scales_its_own_part_of_the_jacobian():
    flow = ring_flow(MODELS["poliquen"])
    x, N2 = state(flow), 2 * flow.space.N
    base = matrix(flow, x, Weights(0.0, 0.0, 0.0))
    parts = [matrix(flow, x, Weights(*unit)) - base for unit in np.eye(3)]
    assert min(abs(part).max() for part in parts) > 1e-2
    mixed = base + 0.3 * parts[0] + 0.5 * parts[1] + 0.7 * parts[2]
    assert abs(matrix(flow, x, Weights(0.3, 0.5, 0.7)) - mixed).max() <= 1e-12 * abs(base).max()
    viscous, convective, pressure = (part.tocsr() for part in parts)
    assert abs(viscous - viscous.T).max() <= 1e-12 * abs(viscous).max()
    assert abs(pressure[:, :N2]).max() == 0.0 and abs(pressure[N2:]).max() == 0.0
    for part in (viscous, convective):
        assert abs(part[:, N2:]).max() == 0.0 and abs(part[N2:]).max() == 0.0


def test_an_unused_array_for_the_elements_is_reused():
    flow = ring_flow(MODELS["bingham"])
    here = fields(flow, state(flow))
    out = np.full_like(flow.jacobian(here), 7.0)
    assert flow.jacobian(here, out=out) is out
    assert np.array_equal(out, flow.jacobian(here))


# -- stress-velocity ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", YIELDING)
def test_along_the_flow_the_stress_velocity_jacobian_is_that_of_newton(name):
    flow = ring_flow(MODELS[name])
    x = state(flow)
    newton = matrix(flow, x)
    dual = matrix(flow, x, direction=flow_direction(fields(flow, x)))
    assert abs(dual - newton).max() <= 1e-12 * abs(newton).max()
    other = matrix(flow, x, direction=0.5 * flow_direction(fields(flow, x)))
    assert abs(other - newton).max() > 1e-3 * abs(newton).max()


def test_without_a_direction_a_bingham_fluid_takes_the_step_of_the_fixed_point():
    flow = ring_flow(MODELS["bingham"])
    x = state(flow)
    rest = matrix(flow, x, direction=np.zeros_like(fields(flow, x).rate))
    fixed_point = matrix(flow, x, Weights(0.0, 1.0, 1.0))
    assert abs(rest - fixed_point).max() <= 1e-12 * abs(fixed_point).max()


def test_viscous_part_stays_positive_for_every_direction_in_the_unit_ball():
    """eta_0 |d|^2 is kept of 2 eta d:d - sqrt2 tau (w:d)(g:d)/s: with |w| <= 1 the tangent loses no viscosity."""
    flow = ring_flow(Bingham(0.4, 5.0, eps=1e-3), convection=False)
    x, random = state(flow), np.random.default_rng(3)
    w = random.standard_normal(fields(flow, x).rate.shape)
    w /= np.sqrt(contracted(w, w))[..., None]
    A = matrix(flow, x, direction=w)
    plain = matrix(ring_flow(Newtonian(0.4), convection=False), x)
    for _ in range(20):
        d = np.concatenate([random.standard_normal(2 * flow.space.N), np.zeros(flow.space.P)])
        assert d @ (A @ d) >= d @ (plain @ d)


def test_the_direction_solves_its_linearised_equation_inside_the_unit_ball():
    """sqrt(s) w' + (g : dg) / sqrt(s) w = g + dg, the linearisation of sqrt(s) w = g; outside, what comes back has |w| <= 1."""
    flow = ring_flow(MODELS["bingham"])
    old, new = fields(flow, state(flow, 0)), fields(flow, 0.6 * state(flow, 0) + 0.3 * state(flow, 5))
    w = 0.4 * flow_direction(old)
    found = next_direction(w, old, new)
    root = np.sqrt(old.s)[..., None]
    inner = contracted(old.rate, new.rate - old.rate)[..., None]
    exact = (new.rate - inner / root * w) / root
    inside = contracted(exact, exact) <= 1.0
    assert 0.2 < inside.mean() < 1.0
    assert np.allclose(found[inside], exact[inside], atol=1e-13)
    assert np.all(contracted(found, found) <= 1.0 + 1e-12)
