"""Implicit time stepping: orders of the schemes, steady limits, energy (quasi-Newtonian flows)."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import (
    SCHEMES,
    Bingham,
    ChannelEnd,
    FreeSlip,
    Newtonian,
    NonlinearOptions,
    NoSlip,
    PowerLaw,
    QuasiNewtonianFlow,
    Velocity,
    backward_difference,
    solve,
)
from barchan.spaces.meshes import rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

CLOSE = NonlinearOptions(tolerance=1e-11)
SIDES = ("top", "bottom", "left", "right")


def box(cells: tuple[int, int] = (4, 4), upper: tuple[float, float] = (np.pi, np.pi)) -> QuadraticSpace:
    return QuadraticSpace(QuadraticMesh.of(rectangle((0.0, 0.0), upper, cells, "quadrilateral")))


def march(
    flow: QuasiNewtonianFlow, velocity: np.ndarray, dt: float, steps: int, scheme: str = "backward-euler"
) -> list[np.ndarray]:
    """Velocities at the start and after every step."""
    velocities, state = [velocity], (velocity, flow.at_rest()[1], None)
    for _ in range(steps):
        before = velocities[-2] if len(velocities) > 1 else None
        inertia = backward_difference(scheme, dt, velocities[-1], before)
        found = solve(flow, CLOSE, start=state, inertia=inertia)
        assert found.converged, found.message
        velocities.append(found.velocity)
        state = found.state
    return velocities


def energy(flow: QuasiNewtonianFlow, velocity: np.ndarray) -> float:
    space = flow.space
    u = np.einsum("qk,cka->cqa", space.values, velocity[space.cell_nodes])
    return 0.5 * flow.density * float(np.sum(space.weights * np.sum(u**2, axis=2)))


def cells_of_vortices(space: QuadraticSpace) -> np.ndarray:
    """Taylor and Green's: decays as exp(-2 eta t / rho) between walls without friction, its shear stress being zero there."""
    x, y = space.mesh.nodes.T
    return np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)], axis=1)


def slippery(space: QuadraticSpace, model, **more) -> QuasiNewtonianFlow:
    return QuasiNewtonianFlow(space, model, {name: FreeSlip() for name in SIDES}, **more)


def test_vortices_decay_at_their_exact_rate():
    space, eta, rho = box((6, 6)), 0.3, 2.0
    flow = slippery(space, Newtonian(eta), density=rho)
    start = cells_of_vortices(space)
    end = march(flow, start, 0.05, 20, "bdf2")[-1]
    assert np.allclose(end, np.exp(-2.0 * eta / rho) * start, atol=2e-3)


@pytest.mark.parametrize(("scheme", "order"), list(zip(SCHEMES, (1.0, 2.0), strict=True)))
@pytest.mark.parametrize(
    "model", [Newtonian(0.5), PowerLaw(0.5, 1.5, eps=0.5)], ids=["newtonian", "thinning"]
)
def test_schemes_have_their_orders(scheme, order, model):
    """Differences between runs of dt, dt/2 and dt/4 on one mesh shrink by 2^order: errors in time alone."""
    space = box((3, 3))
    flow = slippery(space, model)
    ends = [march(flow, cells_of_vortices(space), 0.4 / n, n, scheme)[-1] for n in (4, 8, 16)]
    ratio = np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2])
    assert np.log2(ratio) == pytest.approx(order, abs=0.25)


def test_start_up_of_plane_couette_flow_is_that_of_its_series():
    """u = U y + sum of 2 U (-1)^n / (n pi) sin(n pi y) exp(-n^2 pi^2 eta t / rho) between plates at rest and at U."""
    space, eta, rho, speed = box((1, 8), (1.0, 1.0)), 0.4, 2.0, 1.5
    ends = {"left": ChannelEnd(0.0), "right": ChannelEnd(0.0)}
    conditions = {"bottom": NoSlip(), "top": Velocity((speed, 0.0)), **ends}
    flow = QuasiNewtonianFlow(space, Newtonian(eta), conditions, density=rho)
    end = march(flow, np.zeros((space.N, 2)), 0.025, 20, "bdf2")[-1]
    y, n = space.mesh.nodes[:, 1], np.arange(1, 40)[:, None]
    decay = np.exp(-(n**2) * np.pi**2 * eta / rho * 0.5)
    exact = speed * (y + np.sum(2.0 * (-1.0) ** n / (n * np.pi) * np.sin(n * np.pi * y) * decay, axis=0))
    assert np.allclose(end[:, 0], exact, atol=5e-3 * speed)
    assert np.abs(end[:, 0] - speed * y).max() > 0.1 * speed  # still on the way
    assert np.allclose(end[:, 1], 0.0, atol=1e-12)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_limit_of_many_steps_is_the_steady_flow(scheme):
    space = box((3, 3), (1.0, 1.0))
    lid = Velocity((lambda x: x[:, 0] * (1.0 - x[:, 0]), 0.0))
    conditions = {"top": lid, **{name: NoSlip() for name in SIDES[1:]}}
    flow = QuasiNewtonianFlow(space, Bingham(0.1, 0.02, eps=0.05), conditions, density=5.0)
    steady = solve(flow, CLOSE)
    end = march(flow, flow.at_rest()[0], 20.0, 14, scheme)[-1]
    assert np.allclose(end, steady.velocity, atol=1e-7)
    stay = march(flow, steady.velocity, 0.1, 2, scheme)[-1]
    assert np.allclose(stay, steady.velocity, atol=1e-9)


@pytest.mark.parametrize("dt", [0.02, 1.0])
def test_without_forces_energy_never_grows(dt):
    """Backward Euler loses energy whatever the step; so does the discrete flow of a Bingham fluid between walls."""
    space = box((4, 4))
    for model in (Newtonian(0.05), Bingham(0.05, 0.05, eps=0.05)):
        flow = slippery(space, model, density=3.0)
        energies = [energy(flow, u) for u in march(flow, cells_of_vortices(space), dt, 5)]
        assert np.all(np.diff(energies) < 0.0), energies


def test_a_yield_stress_stops_a_flow_in_finite_time():
    """A Newtonian flow decays for ever; one with a yield stress rests soon, but for the creep of the regularisation."""
    space, left = box((4, 4)), []
    for model in (Newtonian(0.1), Bingham(0.1, 0.4, eps=1e-3)):
        flow = slippery(space, model)
        energies = [energy(flow, u) for u in march(flow, cells_of_vortices(space), 0.5, 8)]
        left.append(energies[-1] / energies[0])
    assert left[0] > 1e-2
    assert left[1] < 1e-5


def test_velocity_of_the_step_before_enters_by_the_scheme_only():
    now, before = np.ones((3, 2)), np.zeros((3, 2))
    euler, first = (
        backward_difference("backward-euler", 0.5, now, before),
        backward_difference("bdf2", 0.5, now),
    )
    assert (euler.rate, first.rate) == (2.0, 2.0)
    assert np.array_equal(euler.past, first.past)
    second = backward_difference("bdf2", 0.5, now, before)
    assert second.rate == 3.0 and np.array_equal(second.past, 4.0 * now)
    # Constant and linear motions have their exact rates.
    u = 7.0 * now
    assert np.allclose(
        backward_difference("bdf2", 0.5, u, u).rate * u, backward_difference("bdf2", 0.5, u, u).past
    )
    for scheme in SCHEMES:
        linear = backward_difference(scheme, 0.5, 1.0 * now, 0.5 * now)
        assert np.allclose(linear.rate * 1.5 * now - linear.past, 1.0)


@pytest.mark.parametrize(
    ("scheme", "dt", "field"), [("leapfrog", 0.1, "scheme"), ("bdf2", 0.0, "dt"), ("bdf2", np.nan, "dt")]
)
def test_unknown_schemes_and_steps_are_refused(scheme, dt, field):
    with pytest.raises(InputError) as refused:
        backward_difference(scheme, dt, np.zeros((1, 2)))
    assert refused.value.field == field
