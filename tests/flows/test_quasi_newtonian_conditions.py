"""Boundary conditions of seed C 8.2 against exact flows and balances: slip, pressure drop, outflow, mean pressure, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import (
    Bingham,
    ChannelEnd,
    FlowSolution,
    FreeSlip,
    Newtonian,
    NonlinearOptions,
    NoSlip,
    Poliquen,
    PowerLaw,
    Pressure,
    QuasiNewtonianFlow,
    Schaeffer,
    Slip,
    Stress,
    Symmetry,
    Velocity,
    solve,
)
from barchan.flows.quasi_newtonian.stress_velocity import contracted
from barchan.spaces.meshes import annulus, rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

LENGTH, HEIGHT = 2.0, 1.0
GRAINS = Poliquen(0.3, 0.3, 0.1, 0.01, 1.0, eps=0.01)
CLOSE = NonlinearOptions(tolerance=1e-12)


def channel(
    cells: tuple[int, int] = (4, 3), length: float = LENGTH, kind: str = "quadrilateral", bend: float = 0.0
):
    """The channel 0 <= x <= length, 0 <= y <= 1; `bend` moves inner vertices about."""
    mesh = rectangle((0.0, 0.0), (length, HEIGHT), cells, kind)
    points, inside = mesh.p.copy(), mesh.interior_nodes()
    points[:, inside] += bend * np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(inside)))
    mesh = QuadraticMesh.of(type(mesh)(points, mesh.t, _boundaries=mesh.boundaries))
    return QuadraticSpace(mesh, "P1d" if kind == "quadrilateral" else "P1")


def ring(level: int = 2) -> QuadraticSpace:
    return QuadraticSpace(annulus(level, 1.0, 2.0))


def solved(space, conditions, model=None, options=CLOSE, **more) -> tuple[QuasiNewtonianFlow, FlowSolution]:
    flow = QuasiNewtonianFlow(space, model or Newtonian(1.0), conditions, **more)
    solution = solve(flow, options)
    assert solution.converged, solution.message
    return flow, solution


def walls(condition=None, **ends):
    condition = condition or NoSlip()
    return {"top": condition, "bottom": condition, **ends}


def pressures(space: QuadraticSpace, solution: FlowSolution) -> np.ndarray:
    """(C, Q) at the quadrature points."""
    return np.einsum("cqm,cm->cq", space.pressure_values, solution.pressure[space.cell_pressures])


def through(space: QuadraticSpace, velocity: np.ndarray, part: str) -> float:
    """Flux out of a part."""
    side = space.boundary(part)
    values = np.einsum("fqk,fka->fqa", side.values, velocity[space.cell_nodes[side.cells]])
    return float(np.einsum("fq,fqa,fqa->", side.weights, values, side.normals))


def dissipated(flow: QuasiNewtonianFlow, solution: FlowSolution) -> float:
    here = flow.fields(solution.velocity, solution.pressure)
    return float(np.sum(flow.space.weights * contracted(here.stress, here.rate)))


def turning(rate: float):
    return lambda x: rate * np.stack([-x[:, 1], x[:, 0]], axis=1)


# -- pressure drops and outflow ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["quadrilateral", "triangle"])
def test_pressure_drop_between_channel_ends_drives_the_parabola(kind):
    """u = G y (1 - y) / (2 eta), G = drop / length, exact on cells of any straight shape; the flux is G / (12 eta)."""
    space, eta, drop = channel(kind=kind, bend=0.05), 0.7, 3.0
    flow, solution = solved(space, walls(left=ChannelEnd(4.0), right=ChannelEnd(4.0 - drop)), Newtonian(eta))
    x, y = space.mesh.nodes.T
    exact = drop / LENGTH * y * (1.0 - y) / (2.0 * eta)
    assert np.allclose(solution.velocity, np.stack([exact, 0.0 * x], axis=1), atol=1e-11)
    assert np.allclose(pressures(space, solution), 4.0 - drop / LENGTH * space.points[..., 0], atol=1e-10)
    assert through(space, solution.velocity, "right") == pytest.approx(drop / LENGTH / (12.0 * eta))
    assert solution.iterations == 1
    assert not flow.enclosed


def test_a_power_law_fluid_in_a_channel_flows_as_in_the_books():
    """eta = K |g|^(m - 2), |g| = |u'| / sqrt2: |u'|^(m - 1) proportional to the distance from the middle."""
    m, K, drop = 1.5, 0.8, 2.0
    space = channel((1, 16))
    _, solution = solved(space, walls(left=ChannelEnd(drop), right=ChannelEnd(0.0)), PowerLaw(K, m, eps=1e-4))
    y = space.mesh.nodes[:, 1]
    gradient, n = drop / LENGTH, 1.0 / (m - 1.0)
    factor = (gradient / K * 2.0 ** (0.5 * m - 1.0)) ** n / (n + 1.0)
    exact = factor * (0.5 ** (n + 1.0) - np.abs(y - 0.5) ** (n + 1.0))
    assert np.allclose(solution.velocity[:, 0], exact, atol=1e-4 * exact.max())


@pytest.mark.parametrize("model", [Newtonian(0.7), Bingham(0.7, 0.2, eps=1e-2)], ids=["newtonian", "bingham"])
def test_work_of_pressures_is_dissipated(model):
    """Free ends under two pressures: (p_in - p_out) times the flux is the dissipation, whatever the fluid."""
    space = channel()
    flow, solution = solved(space, walls(left=Pressure(5.0), right=Pressure(1.0)), model, convection=False)
    flux = through(space, solution.velocity, "right")
    assert through(space, solution.velocity, "left") == pytest.approx(-flux, rel=1e-9)
    assert 4.0 * flux == pytest.approx(dissipated(flow, solution), rel=1e-9)


def test_far_from_free_ends_the_flow_is_the_parabola_of_its_flux():
    space = channel((24, 4), length=6.0)
    _, solution = solved(space, walls(left=Pressure(6.0), right=Pressure(0.0)), convection=False)
    x, y = space.mesh.nodes.T
    middle, flux = np.isclose(x, 3.0), through(space, solution.velocity, "right")
    assert np.allclose(solution.velocity[middle, 0], 6.0 * flux * (y * (1.0 - y))[middle], atol=1e-4 * flux)
    free = np.isclose(x, 6.0)
    assert np.abs(solution.velocity[free, 0] - 6.0 * flux * (y * (1.0 - y))[free]).max() > 1e-2 * flux


def test_doing_nothing_is_a_stress_of_zero():
    """A part without condition equals `Pressure(0)` and `Stress(0)`; the pressure there balances the viscous stress."""
    space = channel()
    inflow = Velocity((lambda x: x[:, 1] * (1.0 - x[:, 1]), 0.0))
    found = [
        solved(space, walls(left=inflow, **end), Bingham(0.5, 0.1, eps=0.05))[1]
        for end in ({}, {"right": Pressure(0.0)}, {"right": Stress(np.zeros((2, 2)))})
    ]
    for other in found[1:]:
        assert np.array_equal(found[0].velocity, other.velocity)
    assert through(space, found[0].velocity, "right") == pytest.approx(1.0 / 6.0)


def test_a_plug_between_frictionless_walls_leaves_without_pressure():
    space = channel(bend=0.05)
    conditions = walls(FreeSlip(), left=Velocity((1.0, 0.0)))
    for model in (Newtonian(0.3), Bingham(0.3, 0.5, eps=1e-2)):
        _, solution = solved(space, conditions, model)
        assert np.allclose(solution.velocity, [1.0, 0.0], atol=1e-11)
        assert np.allclose(pressures(space, solution), 0.0, atol=1e-10)


def test_a_component_left_free_opens_the_end_like_a_channel_end():
    """`Velocity((None, 0))` sets the direction of the flow and a normal stress of zero: the pressure is determined."""
    space, inflow = channel(), Velocity((lambda x: x[:, 1] * (1.0 - x[:, 1]), 0.0))
    flow, solution = solved(space, walls(left=inflow, right=Velocity((None, 0.0))))
    assert not flow.enclosed
    _, same = solved(space, walls(left=inflow, right=ChannelEnd(0.0)))
    assert np.allclose(solution.velocity, same.velocity, atol=1e-12)
    y = space.mesh.nodes[:, 1]
    assert np.allclose(solution.velocity[:, 0], y * (1.0 - y), atol=1e-10)


def test_atmospheric_pressure_only_shifts_the_pressure_of_a_newtonian_fluid():
    space, inflow = channel(), Velocity((lambda x: x[:, 1] * (1.0 - x[:, 1]), 0.0))
    (_, one), (_, two) = (solved(space, walls(left=inflow, right=Pressure(p))) for p in (0.0, 10.0))
    assert np.allclose(one.velocity, two.velocity, atol=1e-11)
    assert np.allclose(one.pressure + 10.0 * space.unit_pressure, two.pressure, atol=1e-9)


def test_atmospheric_pressure_slows_a_fluid_whose_viscosity_depends_on_it():
    """Two channel ends at p_atm + 1 and p_atm: friction grows with the pressure, and the flux falls (seed C 8.2.2)."""
    flux = []
    for p in (1.0, 2.0, 4.0):
        space = channel()
        _, solution = solved(
            space, walls(left=ChannelEnd(p + 1.0), right=ChannelEnd(p)), replace(GRAINS, eps=0.1)
        )
        flux.append(through(space, solution.velocity, "right"))
    assert flux[0] > 1.5 * flux[1] > 2.25 * flux[2] > 0.0


def test_free_ends_under_pressure_carry_grains():
    """Started at the pressure of the boundary: at p = 0 the fluid would have no viscosity at all."""
    space = channel()
    flow, solution = solved(space, walls(left=Pressure(3.0), right=Pressure(1.0)), replace(GRAINS, eps=0.1))
    assert np.all(flow.at_rest()[1][::3] == 2.0)
    flux = through(space, solution.velocity, "right")
    assert flux > 0.0
    gain = 2.0 * flux - dissipated(flow, solution)
    assert abs(gain) < 1e-2 * flux  # the rest is inertia


# -- slip ----------------------------------------------------------------------------------------------------------------


def test_plane_couette_flow_slips_at_a_wall_with_friction():
    """Shear stress eta U / (1 + eta / beta), slip velocity that stress over beta: linear in y, exact."""
    eta, beta, speed = 0.8, 2.5, 1.5
    space = channel(bend=0.05)
    conditions = {
        "bottom": Slip(beta), "top": Velocity((speed, 0.0)), "left": ChannelEnd(0.0), "right": ChannelEnd(0.0)
    }  # fmt: skip
    _, solution = solved(space, conditions, Newtonian(eta))
    slope = speed / (1.0 + eta / beta)
    y = space.mesh.nodes[:, 1]
    assert np.allclose(solution.velocity[:, 0], slope * (y + eta / beta), atol=1e-11)
    # Seen from a frame moving with the driven wall: the sliding wall moves backwards.
    conditions |= {"bottom": Slip(beta, (-speed, 0.0)), "top": NoSlip()}
    _, moving = solved(space, conditions, Newtonian(eta))
    assert np.allclose(moving.velocity[:, 0], solution.velocity[:, 0] - speed, atol=1e-11)


def test_poiseuille_flow_slips_on_both_walls():
    """u = G (y (1 - y) / (2 eta) + 1 / (2 beta)); friction may vary along the wall or be given as a function."""
    eta, beta, drop = 0.8, 2.5, 3.0
    space = channel(bend=0.05)
    for friction in (beta, lambda x: np.full(len(x), beta)):
        _, solution = solved(
            space, walls(Slip(friction), left=ChannelEnd(drop), right=ChannelEnd(0.0)), Newtonian(eta)
        )
        y = space.mesh.nodes[:, 1]
        exact = drop / LENGTH * (0.5 * y * (1.0 - y) / eta + 0.5 / beta)
        assert np.allclose(solution.velocity[:, 0], exact, atol=1e-11)


def test_limits_of_slip_are_no_slip_and_free_slip():
    space, ends = channel(), {"left": ChannelEnd(1.0), "right": ChannelEnd(0.0)}
    model = Bingham(0.5, 0.02, eps=0.05)

    def velocity(bottom, top=None) -> np.ndarray:
        return solved(space, {"bottom": bottom, "top": top or NoSlip(), **ends}, model)[1].velocity

    assert np.allclose(velocity(Slip(1e9)), velocity(NoSlip()), atol=1e-8)
    assert np.allclose(velocity(Slip(0.0)), velocity(FreeSlip()), atol=1e-10)
    assert np.allclose(velocity(Symmetry()), velocity(FreeSlip()), atol=1e-12)


@pytest.mark.parametrize(
    "model", [Bingham(0.5, 0.2, eps=1e-2), PowerLaw(0.5, 1.3, eps=1e-2)], ids=["bingham", "thinning"]
)
def test_friction_of_the_walls_carries_the_pressure_drop_of_any_fluid(model):
    """Balance of momentum: 2 beta u_wall length = drop height."""
    beta, drop = 2.5, 3.0
    space = channel()
    _, solution = solved(space, walls(Slip(beta), left=ChannelEnd(drop), right=ChannelEnd(0.0)), model)
    at_wall = solution.velocity[space.mesh.part_nodes("top"), 0]
    assert np.allclose(at_wall, drop * HEIGHT / (2.0 * beta * LENGTH), rtol=1e-9)


def test_a_turning_cylinder_in_a_ring_that_slips():
    """u = A r + B / r with stress -2 eta B / R^2 = -beta u at the outer wall; the moments of the walls balance."""
    eta, beta, outer = 0.8, 0.6, 2.0
    space = ring(3)
    flow, solution = solved(
        space, {"inner": Velocity(turning(1.0)), "outer": Slip(beta)}, Newtonian(eta), convection=False
    )
    matrix = [[1.0, 1.0], [beta * outer, beta / outer - 2.0 * eta / outer**2]]
    A, B = np.linalg.solve(matrix, [1.0, 0.0])
    r = np.linalg.norm(space.mesh.nodes, axis=1)
    exact = turning(1.0)(space.mesh.nodes) * (A + B / r**2)[:, None]
    assert np.allclose(solution.velocity, exact, atol=2e-4)
    nodes, force = space.mesh.nodes, flow.reaction(solution.velocity, solution.pressure)
    inner = space.mesh.part_nodes("inner")
    moment = float(np.sum(turning(1.0)(nodes[inner]) * force[inner]))
    assert moment == pytest.approx(4.0 * np.pi * eta * B, rel=1e-3)
    side = space.boundary("outer")
    values = np.einsum("fqk,fka->fqa", side.values, solution.velocity[space.cell_nodes[side.cells]])
    arm = turning(1.0)(side.points.reshape(-1, 2)).reshape(values.shape)
    along = np.stack([-side.normals[..., 1], side.normals[..., 0]], axis=2)
    lost = beta * side.weights * np.sum(values * along, axis=2) * np.sum(arm * along, axis=2)
    assert moment == pytest.approx(float(np.sum(lost)), rel=1e-9)


@pytest.mark.parametrize(
    "outer", [FreeSlip(), Slip(0.0), Slip(3.0, turning(0.7))], ids=["free", "zero", "turning"]
)
def test_rigid_rotation_costs_nothing(outer):
    """Where nothing holds it back a fluid turns with the wall, even a stiff one; the pressure is centrifugal."""
    space = ring()
    for model in (Newtonian(0.8), Bingham(0.8, 2.0, eps=1e-2)):
        conditions = {"inner": Velocity(turning(0.7)), "outer": outer}
        flow, solution = solved(space, conditions, model, NonlinearOptions(), convection=False)
        assert np.allclose(solution.velocity, turning(0.7)(space.mesh.nodes), atol=1e-8)
        assert abs(dissipated(flow, solution)) < 1e-10
    _, heavy = solved(space, conditions, Newtonian(0.8), density=2.0)
    r2 = np.sum(space.points**2, axis=2)
    centrifugal = 0.5 * 2.0 * 0.7**2 * (r2 - np.sum(space.weights * r2) / space.area)
    assert np.allclose(pressures(space, heavy), centrifugal, atol=3e-2)


def test_nothing_passes_a_wall_that_slips():
    space = ring()
    _, solution = solved(
        space,
        {"inner": FreeSlip(), "outer": Slip(1.0)},
        force=lambda x: np.stack([0.0 * x[:, 0], x[:, 0]], axis=1),
    )
    for part in ("inner", "outer"):
        on = space.mesh.part_nodes(part)
        radial = space.mesh.nodes[on] / np.linalg.norm(space.mesh.nodes[on], axis=1, keepdims=True)
        assert np.allclose(np.sum(solution.velocity[on] * radial, axis=1), 0.0, atol=1e-12)
        assert np.abs(solution.velocity[on]).max() > 1e-3


# -- mean pressure -------------------------------------------------------------------------------------------------------


def lid(space: QuadraticSpace, model, mean: float | None, **more):
    lid = Velocity((lambda x: x[:, 0] * (LENGTH - x[:, 0]), 0.0))
    conditions = {"top": lid, "bottom": NoSlip(), "left": NoSlip(), "right": NoSlip()}
    return solved(space, conditions, model, mean_pressure=mean, **more)


@pytest.mark.parametrize("mean", [5.0, 20.0])
def test_mean_pressure_is_the_one_asked_for(mean):
    space = channel()
    for model in (Newtonian(0.5), GRAINS):
        flow, solution = lid(space, model, mean)
        assert flow.enclosed
        assert space.pressure_weights @ solution.pressure / space.area == pytest.approx(mean, rel=1e-10)


def test_mean_pressure_changes_the_flow_of_grains_but_not_of_a_newtonian_fluid():
    space = channel()
    (_, a), (_, b) = (lid(space, Newtonian(0.5), mean) for mean in (5.0, 20.0))
    assert np.allclose(a.velocity, b.velocity, atol=1e-11)
    (_, a), (_, b) = (lid(space, GRAINS, mean) for mean in (5.0, 20.0))
    assert np.abs(a.velocity - b.velocity).max() > 1e-3


def test_without_inertia_forces_in_coulomb_grains_grow_with_their_pressure_and_the_flow_stays():
    """Schaeffer's viscosity is proportional to p: (u, c p) solves the equations wherever (u, p) does."""
    space, model = channel(), Schaeffer(20.0, eps=0.1)
    (flow, one), (other, two) = (lid(space, model, mean, convection=False) for mean in (2.0, 6.0))
    assert np.allclose(one.velocity, two.velocity, atol=1e-8)
    top = space.mesh.part_nodes("top")
    forces = [f.reaction(s.velocity, s.pressure)[top].sum(axis=0) for f, s in ((flow, one), (other, two))]
    assert np.allclose(3.0 * forces[0], forces[1], rtol=1e-7)


def test_a_start_of_another_mean_pressure_does_not_matter():
    space = channel()
    flow, solution = lid(space, Newtonian(0.5), 5.0)
    start = (solution.velocity, solution.pressure - 3.0 * space.unit_pressure, None)
    again = solve(flow, CLOSE, start=start)
    assert space.pressure_weights @ again.pressure / space.area == pytest.approx(5.0, rel=1e-12)
    assert again.iterations <= 1


def test_turning_grains_are_driven_by_a_moment_that_grows_with_the_mean_pressure():
    moments = []
    for mean in (1.0, 2.0):
        space = ring()
        conditions = {"inner": Velocity(turning(1.0)), "outer": NoSlip()}
        flow, solution = solved(space, conditions, GRAINS, mean_pressure=mean, convection=False)
        inner = space.mesh.part_nodes("inner")
        force = flow.reaction(solution.velocity, solution.pressure)[inner]
        moments.append(float(np.sum(turning(1.0)(space.mesh.nodes[inner]) * force)))
        assert np.allclose(pressures(space, solution), mean, rtol=2e-2)  # a shear flow along circles
    # mu(I) falls with the pressure, so that friction grows a little less than it.
    assert 1.5 < moments[1] / moments[0] < 2.0


# -- symmetry ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [Bingham(0.1, 0.2, eps=0.05), GRAINS], ids=["bingham", "grains"])
def test_mirrored_conditions_give_the_mirrored_flow(model):
    """x -> length - x: u_x changes its sign, everything else its place."""
    space, mean = channel((4, 4)), 5.0 if model.uses_pressure else None
    speed = lambda x: x[:, 0] ** 2 * (LENGTH - x[:, 0])  # noqa: E731

    def velocity(drive) -> np.ndarray:
        fixed = {name: NoSlip() for name in ("bottom", "left", "right")}
        return solved(
            space, {"top": Velocity((drive, 0.0)), **fixed}, model, density=3.0, mean_pressure=mean
        )[1].velocity

    there = velocity(speed)
    back = velocity(lambda x: -speed(np.stack([LENGTH - x[:, 0], x[:, 1]], axis=1)))
    nodes = space.mesh.nodes
    distance = np.linalg.norm(nodes[:, None] - (nodes * [-1.0, 1.0] + [LENGTH, 0.0])[None], axis=2)
    image = np.argmin(distance, axis=0)
    assert np.allclose(back[image] * [-1.0, 1.0], there, atol=1e-8)
    assert np.abs(there - back).max() > 0.1


# -- refusals ------------------------------------------------------------------------------------------------------------

CLOSED = {name: NoSlip() for name in ("top", "bottom", "left", "right")}


@pytest.mark.parametrize(
    ("conditions", "options", "field", "says"),
    [
        ({**CLOSED, "lid": NoSlip()}, {}, "conditions", "top"),
        (CLOSED, {"density": -1.0}, "density", ">= 0"),
        (CLOSED, {"density": np.nan}, "density", "finite"),
        (CLOSED, {"model": GRAINS}, "mean_pressure", "depends on the pressure"),
        (CLOSED, {"model": GRAINS, "mean_pressure": -1.0}, "mean_pressure", "negative viscosity|negative or undefined"),
        (CLOSED, {"model": GRAINS, "mean_pressure": 0.0}, "mean_pressure", "positive"),
        (CLOSED, {"mean_pressure": np.inf}, "mean_pressure", "positive"),
        ({**CLOSED, "left": Velocity((1.0, 0.0))}, {}, "conditions", "net flux"),
        (walls(left=NoSlip()), {"mean_pressure": 1.0}, "mean_pressure", "right sets the pressure"),
        (walls(left=ChannelEnd(1.0), right=NoSlip()), {"mean_pressure": 1.0}, "mean_pressure", "left sets"),
        ({**CLOSED, "right": Velocity((None, 0.0))}, {"mean_pressure": 1.0}, "mean_pressure", "right sets"),
        (walls(left=Pressure(2.0), right=Pressure(-1.0)), {"model": GRAINS}, "conditions.right.pressure", "positive"),
        (walls(left=ChannelEnd(-2.0), right=ChannelEnd(1.0)), {"model": GRAINS}, "conditions.left.pressure", "positive"),
        (walls(left=Stress(np.eye(2)), right=Pressure(1.0)), {"model": GRAINS}, "conditions.left.pressure", "positive"),
        ({**CLOSED, "top": Slip(-1.0)}, {}, "slip.friction", "at least 0"),
        ({**CLOSED, "top": Slip(np.nan)}, {}, "slip.friction", "finite"),
        ({**CLOSED, "top": Velocity((1.0,))}, {}, "velocity", "2 components"),
        (CLOSED, {"force": (1.0,)}, "force", "shape"),
    ],
)  # fmt: skip
def test_what_has_no_flow_is_refused_by_name(conditions, options, field, says):
    options = dict(options)
    with pytest.raises(InputError, match=says) as refused:
        QuasiNewtonianFlow(channel(), options.pop("model", Newtonian(1.0)), conditions, **options)
    assert refused.value.field == field


def test_grains_without_pressure_at_the_outlet_are_refused_with_the_remedy():
    """The natural condition sets a mean pressure of zero, at which this fluid has no viscosity (seed C 8.2.2)."""
    inflow = Velocity((lambda x: x[:, 1] * (1.0 - x[:, 1]), 0.0))
    flow = QuasiNewtonianFlow(channel(), GRAINS, walls(left=inflow))
    with pytest.raises(InputError, match="p_atm"):
        solve(flow)


def test_negative_pressures_are_no_concern_of_a_newtonian_fluid():
    _, solution = solved(channel(), walls(left=ChannelEnd(-1.0), right=ChannelEnd(-3.0)))
    assert solution.velocity[:, 0].max() == pytest.approx(1.0 / 8.0)
