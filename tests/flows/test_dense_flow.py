"""Dense flows against what mechanics says: analytic profiles, balance of forces, friction, inertia (seed A, 6.1)."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.dense import (
    DenseFlow,
    DenseState,
    FreeSlip,
    FrictionalWall,
    Material,
    MuI,
    NoSlip,
    Pressure,
    RateViscosity,
    Stress,
    Symmetry,
    Velocity,
    observables,
)
from barchan.spaces.meshes import box, channel_with_cylinder, rectangle, silo
from barchan.spaces.mixed import MixedSpace

METHOD = "interior_point"
ALONG = Velocity((None, 0.0))
CHANNEL = {"top": NoSlip(), "bottom": NoSlip(), "left": ALONG, "right": ALONG}


def poiseuille(bingham, cells, velocity="P2", stress="P1d", kind="triangle"):
    """Channel y in [-1, 1] driven by gravity along x, Re = 1, and the exact speed at the nodes.

    Total shear stress -y; eta u' = -(|y| - Bi)+ sign(y), hence u = ((1 - Bi)^2 - (|y| - Bi)+^2) / 2.
    """
    mesh = rectangle((-0.5, -1.0), (0.0, 1.0), (max(cells // 4, 2), cells), kind)
    space = MixedSpace(mesh, velocity, stress)
    flow = DenseFlow(space, Material.dimensionless(1.0, bingham), CHANNEL, gravity=(1.0, 0.0))
    beyond = np.maximum(np.abs(space.nodes[:, 1]) - bingham, 0.0)
    return flow, 0.5 * ((1.0 - bingham) ** 2 - beyond**2)


def incline(mu, angle, cells, viscosity=1.0):
    """Layer of height 1 on a rough incline, with the stresses of the infinite layer at both ends."""
    sine, cosine = np.sin(angle), np.cos(angle)

    def stress(x):
        depth = 1.0 - x[:, 1]
        sigma = np.empty((len(x), 2, 2))
        sigma[:, 0, 0] = sigma[:, 1, 1] = -depth * cosine
        sigma[:, 0, 1] = sigma[:, 1, 0] = depth * sine
        return sigma

    space = MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells)))
    conditions = {"bottom": NoSlip(), "left": Stress(stress), "right": Stress(stress)}
    return DenseFlow(space, Material(mu=mu, viscosity=viscosity), conditions, gravity=(sine, -cosine))


@pytest.mark.parametrize("bingham", [0.0, 0.1, 0.5, 0.9])
def test_bingham_poiseuille_profile(bingham):
    flow, exact = poiseuille(bingham, 12)
    state = flow.solve(1e-7, METHOD)
    assert state.converged
    u = state.velocity.reshape(-1, 2)
    # The mesh has lines at the edge of the plug only for Bi = 0.5; at Bi = 0.9 less than one cell spans what flows.
    tolerance = {0.0: 1e-7, 0.1: 5e-3, 0.5: 1e-5, 0.9: 0.15}[bingham]
    assert abs(u[:, 0] - exact).max() < tolerance * exact.max()
    assert abs(u[:, 1]).max() < tolerance * exact.max()


TRIANGLES = [("P1", "P0"), ("P2", "P1"), ("P2", "P1d"), ("P2", "P2d"), ("P3", "P2d"), ("P4", "P1d")]
SQUARES = [("Q1", "P0"), ("Q1", "P1d"), ("Q2", "P1"), ("Q2", "P1d"), ("Q2", "P2d")]


@pytest.mark.parametrize(("velocity", "stress"), TRIANGLES + SQUARES)
def test_every_pair_of_elements_is_exact_at_the_nodes_of_a_plug_that_fits_the_mesh(velocity, stress):
    kind = "triangle" if (velocity, stress) in TRIANGLES else "quadrilateral"
    flow, exact = poiseuille(0.5, 4, velocity, stress, kind)
    state = flow.solve(1e-7, METHOD)
    assert state.converged
    assert state.velocity[::2] == pytest.approx(exact, abs=1e-5 * exact.max())


def test_the_plug_of_a_bingham_flow_is_as_wide_as_its_yield_stress():
    flow, _ = poiseuille(0.5, 8)
    state = flow.solve(1e-7, METHOD)
    height = np.abs(flow.space.points[:, 1])
    mask = observables.rigid(flow, state)
    assert mask[height < 0.45].all() and not mask[height > 0.55].any()
    assert observables.shear_rates(flow, state)[height < 0.45].max() < 1e-6
    assert observables.shear_stresses(flow, state)[height > 0.55] == pytest.approx(0.5, rel=1e-5)


def test_a_yield_stress_above_the_driving_stress_stops_the_flow():
    flow, _ = poiseuille(1.2, 8)
    assert abs(flow.solve(1e-8, METHOD).velocity).max() < 1e-8


def test_bagnold_profiles_with_constant_and_with_rate_dependent_viscosity():
    """ERRATA 2: du/dy = (1 - y) c / eta, or sqrt(2 c) (1 - y)^(1/2) with eta = |D| = u'/2, c = sin a - mu cos a."""
    mu, angle = 0.5, np.arctan(0.55)
    c = np.sin(angle) - mu * np.cos(angle)
    flow = incline(mu, angle, 6)
    y = flow.space.nodes[:, 1]
    state = flow.solve(1e-7, METHOD)
    assert state.velocity[::2] == pytest.approx(c * (y - y**2 / 2), abs=1e-4 * c / 2)
    assert observables.drag(flow, state, "bottom") == pytest.approx([np.sin(angle), -np.cos(angle)], rel=1e-6)
    points = flow.space.points
    assert observables.pressures(flow, state) == pytest.approx((1 - points[:, 1]) * np.cos(angle), abs=1e-3)

    flow = incline(mu, angle, 6, RateViscosity(lambda rate: rate))
    state = flow.solve(1e-6, METHOD)
    assert state.converged and 1 < state.sweeps < 15
    exact = 2 / 3 * np.sqrt(2 * c) * (1 - (1 - y) ** 1.5)
    assert abs(state.velocity[::2] - exact).max() < 2e-3 * exact.max()


def test_below_the_angle_of_friction_nothing_moves():
    flow = incline(0.5, np.arctan(0.45), 6)
    state = flow.solve(1e-9, METHOD)
    assert abs(state.velocity).max() < 1e-8


def test_cohesion_holds_a_hanging_bar_up():
    """Uniaxial tension rho g h at the top; with mu = 1 the largest principal stress is the cohesion c."""
    space = MixedSpace(rectangle((0.0, 0.0), (0.5, 1.0), (3, 6)))
    speeds = {}
    for cohesion in (0.5, 3.0):
        material = Material(mu=1.0, tensile_yield=cohesion)
        flow = DenseFlow(space, material, {"top": NoSlip()})
        state = flow.solve(1e-8, METHOD)
        assert observables.pressures(flow, state).min() >= -cohesion - 1e-6
        speeds[cohesion] = abs(state.velocity).max()
    assert speeds[3.0] < 1e-7
    assert speeds[0.5] > 1e-3


def test_associated_dilatancy_opens_the_matter_in_shear():
    """div u >= zeta-weighted shear: gamma_N = zeta |gamma_T| where the matter shears under pressure."""
    mu, angle = 0.3, 0.6
    for zeta in (0.0, 0.1):
        flow = incline(mu, angle, 4)
        material = Material(mu=mu, dilatancy=zeta)
        flow = DenseFlow(flow.space, material, flow.conditions, flow.gravity)
        state = flow.solve(1e-8, METHOD)
        assert state.converged
        rate = flow.space.strain_rates(state.velocity)
        shear = np.linalg.norm(rate[:, 1:], axis=1)
        loaded = observables.pressures(flow, state) > 0.05
        assert rate[loaded, 0] == pytest.approx(zeta * shear[loaded], abs=1e-4 * shear.max())


def test_solutions_do_not_depend_on_the_frame():
    """A silo turned by 0.7 rad, its slip and no-slip sides with it, flows the same way."""
    mesh = silo(2.0, 8.0, 8.0, 60)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    turned = type(mesh)(turn @ mesh.p, mesh.t).with_boundaries(dict(mesh.boundaries))
    conditions = {"axis": Symmetry(), "wall": FreeSlip(), "bottom": NoSlip()}
    velocities, forces = [], []
    for grid, gravity in ((mesh, (0.0, -1.0)), (turned, turn @ [0.0, -1.0])):
        flow = DenseFlow(MixedSpace(grid), Material(mu=0.4), conditions, gravity)
        state = flow.solve(1e-7, METHOD)
        velocities.append(flow.space.vertex_velocities(state.velocity))
        forces.append(observables.drag(flow, state, "bottom"))
    size = abs(velocities[0]).max()
    assert size > 1e-2
    assert velocities[1] @ turn == pytest.approx(velocities[0], abs=1e-4 * size)
    assert forces[1] @ turn == pytest.approx(forces[0], rel=1e-4, abs=1e-4)


def test_forces_on_the_parts_balance_weight_and_pressure():
    """Drag in volume form on a cylinder, its channel, and the pressure at the outflow add up to the weight."""
    mesh = channel_with_cylinder(1.0, 4.0, 1.0, 1.5, 80)
    area = MixedSpace(mesh).weights.sum()
    for cylinder in (NoSlip(), FreeSlip(), FrictionalWall(0.2)):
        conditions = {"sides": NoSlip(), "cylinder": cylinder, "outflow": Pressure(1.0)}
        flow = DenseFlow(
            MixedSpace(mesh), Material.dimensionless(10.0, mu=0.5), conditions, gravity=(1.0, 0.0)
        )
        state = flow.solve(1e-4, METHOD)
        total = sum(observables.drag(flow, state, name) for name in ("cylinder", "sides"))
        assert total + np.array([4.0, 0.0]) == pytest.approx([area, 0.0], abs=1e-6)
        assert observables.drag(flow, state, "cylinder")[0] > 0.0


def test_the_parts_of_the_drag_on_a_plate_are_yield_stress_and_viscous_shear():
    """Total shear stress 1 at the walls: Bi of it from contacts, exactly, as it is constant across the cells there."""
    bingham, length, cells = 0.5, 0.5, 12
    flow, _ = poiseuille(bingham, cells)
    state = flow.solve(1e-8, METHOD)
    for name in ("top", "bottom"):
        contact, viscous = observables.drag_parts(flow, state, name)
        assert contact[0] == pytest.approx(bingham * length, rel=1e-4)
        assert viscous[0] == pytest.approx((1.0 - bingham) * length, abs=length * 2.0 / cells)
        # what is missing is the weight of less than the layer of cells along the plate
        missing = observables.drag(flow, state, name)[0] - contact[0] - viscous[0]
        assert 0.0 < missing < length * 2.0 / cells


def test_the_parts_of_the_drag_on_a_cylinder_add_up_as_the_mesh_is_refined():
    missing = []
    for vertices in (80, 400):
        mesh = channel_with_cylinder(1.0, 4.0, 1.0, 1.5, vertices)
        conditions = {"sides": NoSlip(), "cylinder": FrictionalWall(0.2), "outflow": Pressure(1.0)}
        flow = DenseFlow(
            MixedSpace(mesh), Material.dimensionless(10.0, mu=0.3), conditions, gravity=(1.0, 0.0)
        )
        state = flow.solve(1e-4)
        drag = observables.drag(flow, state, "cylinder")[0]
        missing.append(1.0 - sum(part[0] for part in observables.drag_parts(flow, state, "cylinder")) / drag)
    assert abs(missing[1]) < 0.6 * abs(missing[0]) < 0.06


def test_discharge_equals_inflow_where_the_volume_is_kept():
    flow, _ = poiseuille(0.5, 8)
    state = flow.solve(1e-8, METHOD)
    out, into = (observables.discharge(flow, state, name) for name in ("right", "left"))
    assert out > 0.01
    assert out + into == pytest.approx(0.0, abs=1e-6)
    psi = observables.stream_function(flow, state)
    y = flow.space.mesh.p[1]
    across = psi[y == 1.0].mean() - psi[y == -1.0].mean()
    assert across == pytest.approx(out, rel=1e-2)


def test_matter_that_has_come_apart_is_not_rigid():
    """Behind the cylinder of a fast flow nothing presses: shear stress and yield stress are both remainders there."""
    mesh = channel_with_cylinder(0.25, 1.0, 1.0, 1.0, 200, half=True)
    conditions = {"axis": Symmetry(), "cylinder": NoSlip(), "sides": FreeSlip()}
    flow = DenseFlow(MixedSpace(mesh), Material.dimensionless(100.0, mu=0.3), conditions, gravity=(1.0, 0.0))
    state = flow.solve(1e-5)
    apart = (observables.divergences(flow, state) > 1e-2) & (observables.pressures(flow, state) < 1e-6)
    assert flow.space.weights[apart].sum() > 0.01
    assert not observables.rigid(flow, state)[apart].any()


def test_the_volume_never_shrinks():
    mesh = silo(2.0, 8.0, 8.0, 60)
    conditions = {"axis": Symmetry(), "wall": NoSlip(), "bottom": NoSlip()}
    flow = DenseFlow(MixedSpace(mesh), Material(mu=0.4), conditions)
    state = flow.solve(1e-8, METHOD)
    divergence = observables.divergences(flow, state)
    assert divergence.min() > -1e-5 * divergence.max()
    assert (observables.pressures(flow, state) * divergence).max() < 1e-4
    flux = sum(observables.discharge(flow, state, name) for name in mesh.boundaries)
    assert flux == pytest.approx(flow.space.weights @ divergence, rel=1e-9)


def test_a_heap_in_a_box_rests_in_three_dimensions():
    space = MixedSpace(box((0, 0, 0), (1, 1, 1), (1, 1, 2)))
    conditions = dict.fromkeys(("left", "right", "front", "back"), FreeSlip()) | {"bottom": NoSlip()}
    flow = DenseFlow(space, Material(mu=0.5), conditions)
    state = flow.solve(1e-9, METHOD)
    assert abs(state.velocity).max() < 1e-6
    assert observables.drag(flow, state, "bottom")[2] == pytest.approx(-1.0, abs=1e-2)
    p = observables.pressures(flow, state)
    assert space.weights @ p == pytest.approx(0.5, abs=0.2)


# -- walls with friction -----------------------------------------------------------------------------------------------


def test_a_layer_slides_down_a_frictional_wall_like_a_block():
    """Stiff in itself, it accelerates at sin a - mu cos a, and the wall bears its weight."""
    angle, mu = 0.5, 0.2
    space = MixedSpace(rectangle((0.0, 0.0), (1.0, 0.25), (4, 1)))
    gravity = (np.sin(angle), -np.cos(angle))
    matter = Material.dimensionless(100.0, bingham=1.0, mu=0.5, tensile_yield=1.0)
    flow = DenseFlow(space, matter, {"bottom": FrictionalWall(mu)}, gravity)
    state = flow.at_rest()
    for _ in range(3):
        state = flow.step(state, 0.1, 1e-8, METHOD)
    speed = state.time * (np.sin(angle) - mu * np.cos(angle))
    assert space.vertex_velocities(state.velocity) == pytest.approx(
        np.tile([speed, 0.0], (len(space.mesh.p.T), 1)), abs=1e-6
    )
    weight = 0.25 * np.cos(angle)
    assert observables.drag(flow, state, "bottom") == pytest.approx([mu * weight, -weight], rel=1e-5)
    steep = DenseFlow(space, matter, {"bottom": FrictionalWall(0.6)}, gravity)
    assert abs(steep.step(steep.at_rest(), 0.1, 1e-9, METHOD).velocity).max() < 1e-7


@pytest.mark.parametrize("mu", [0.3, 2.0])
def test_a_moving_wall_drags_the_matter_up_to_its_friction(mu):
    """Matter pressed by gravity on a wall above it that moves at speed 1: u' = min(mu p, eta V / h) / eta."""
    shear = min(mu, 1.0)

    def stress(x):
        sigma = -x[:, 1, None, None] * np.eye(2)
        sigma[:, 0, 1] = sigma[:, 1, 0] = shear
        return sigma

    space = MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (3, 3)))
    conditions = {
        "bottom": NoSlip(),
        "left": Stress(stress),
        "right": Stress(stress),
        "top": FrictionalWall(mu, (1.0, 0.0)),
    }
    flow = DenseFlow(space, Material(), conditions, gravity=(0.0, 1.0))
    state = flow.solve(1e-8, METHOD)
    u = state.velocity.reshape(-1, 2)
    assert u[:, 0] == pytest.approx(shear * space.nodes[:, 1], abs=1e-4)
    assert observables.drag(flow, state, "top") == pytest.approx([-shear, 1.0], rel=1e-4)


def test_a_creeping_flow_may_hang_on_friction_alone():
    """Viscosity does not resist its rigid fall; friction at the walls does, and the fixed point leaves no drag behind."""
    mesh = silo(2.0, 8.0, 8.0, 40)
    conditions = {"axis": Symmetry(), "wall": FrictionalWall(0.3), "bottom": FrictionalWall(0.3)}
    flow = DenseFlow(MixedSpace(mesh), Material(mu=0.5), conditions)
    state = flow.solve(1e-4, METHOD)
    assert state.converged
    lift = observables.drag(flow, state, "wall")[1] + observables.drag(flow, state, "bottom")[1]
    assert lift == pytest.approx(-32.0, rel=1e-3)


# -- inertia and flow-dependent laws -----------------------------------------------------------------------------------


def test_steps_approach_the_steady_flow():
    flow, exact = poiseuille(0.5, 8)
    state = flow.at_rest()
    for _ in range(12):
        state = flow.step(state, 0.5, 1e-7, METHOD)
        assert state.converged
    steady = flow.solve(1e-8, METHOD)
    assert state.velocity == pytest.approx(steady.velocity, abs=1e-3 * exact.max())
    assert state.time == pytest.approx(6.0)


def test_a_step_is_that_of_its_problem():
    """The shared factorisation of `step` and the problem handed out for a step give the same velocities."""
    from barchan import friction

    flow, _ = poiseuille(0.2, 4)
    state = flow.step(flow.at_rest(), 0.3, 1e-9, METHOD)
    after = flow.step(state, 0.3, 1e-9, METHOD)
    problem = flow.problem(state, 0.3)
    solution = friction.solve(problem, METHOD, 1e-9)
    assert flow.reduction.expand(solution.v) == pytest.approx(after.velocity, abs=1e-7)
    assert friction.certify(problem, after.forces, flow.reduction.restrict(after.velocity)).residual < 1e-6


def test_matter_without_viscosity_falls_freely_with_inertia():
    space = MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (2, 2)))
    flow = DenseFlow(space, Material.dimensionless(np.inf, mu=0.5), {})
    state = flow.step(flow.at_rest((0.5, 0.0)), 0.1, 1e-8, METHOD)
    assert space.vertex_velocities(state.velocity) == pytest.approx(np.tile([0.5, -0.1], (9, 1)), abs=1e-7)
    with pytest.raises(InputError, match=r"viscosity"):
        DenseFlow(space, Material.dimensionless(np.inf), {"bottom": NoSlip()}).solve()


def test_transport_carries_velocities_along():
    """In uniform flow the velocity of the last step arrives from upstream: u o X of a linear field."""
    space = MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (4, 4)))
    flow = DenseFlow(space, Material(), {})
    v = space.interpolate(lambda x: np.stack([np.full(len(x), 0.5), x[:, 0]], axis=1))
    arriving = flow.carrier.arriving(v, 0.1)
    x = space.velocity_points
    assert arriving[:, 0] == pytest.approx(0.5)
    foot_inside = (x[:, 0] > 0.05) & (x[:, 1] - 0.1 * x[:, 0] > 0.0)
    assert arriving[foot_inside, 1] == pytest.approx(x[foot_inside, 0] - 0.05)


def test_inertial_friction_lies_between_its_bounds_and_slows_the_flow():
    mesh = silo(2.0, 8.0, 8.0, 40)
    conditions = {"axis": Symmetry(), "wall": NoSlip(), "bottom": NoSlip()}
    speeds = []
    for mu in (0.3, MuI(0.3, 0.6, 0.4, 0.1), 0.6):
        flow = DenseFlow(MixedSpace(mesh), Material.dimensionless(10.0, mu=mu), conditions)
        state = flow.solve(1e-5, METHOD)
        assert state.converged
        speeds.append(observables.discharge(flow, state, "outlet"))
    assert speeds[0] > speeds[1] > speeds[2] > 0.0
    flow = DenseFlow(MixedSpace(mesh), Material.dimensionless(10.0, mu=MuI(0.3, 0.6, 0.4, 0.1)), conditions)
    state = flow.step(flow.step(flow.at_rest(), 0.1, 1e-4, METHOD), 0.1, 1e-4, METHOD)
    mu = flow.law(state).mu
    assert mu.min() >= 0.3 and mu.max() <= 0.6 and np.ptp(mu) > 0.1


def test_states_survive_their_arrays_byte_by_byte():
    flow, _ = poiseuille(0.3, 4)
    state = flow.step(flow.at_rest(), 0.2, 1e-6, METHOD)
    again = DenseState.from_arrays(state.arrays())
    after, after_again = (flow.step(start, 0.2, 1e-6, METHOD) for start in (state, again))
    for name, array in after.arrays().items():
        assert array.tobytes() == after_again.arrays()[name].tobytes(), name
    with pytest.raises(InputError, match="velocity"):
        DenseState.from_arrays({"counts": np.zeros(3), "time": np.zeros(())})


def test_vertex_fields_stay_within_the_values_at_the_points():
    for stress in ("P0", "P1", "P1d", "P2d"):
        space = MixedSpace(rectangle((0.0, 0.0), (1.0, 1.0), (4, 4)), "P2", stress)
        flow = DenseFlow(space, Material(), {"bottom": NoSlip()})
        values = np.random.default_rng(0).random(space.n)
        field = observables.vertex_field(flow, values)
        assert values.min() <= field.min() and field.max() <= values.max()
        assert observables.vertex_field(flow, np.full(space.n, 2.0)) == pytest.approx(2.0)
        with pytest.raises(InputError, match="values"):
            observables.vertex_field(flow, values[:-1])


def test_bad_steps_are_refused():
    flow, _ = poiseuille(0.3, 4)
    for dt in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="dt"):
            flow.step(flow.at_rest(), dt)
    with pytest.raises(InputError, match="state"):
        flow.problem(None, 0.1)
    with pytest.raises(InputError, match=r"material\.density"):
        DenseFlow(flow.space, Material(density=0.0), CHANNEL).step(flow.at_rest(), 0.1)
