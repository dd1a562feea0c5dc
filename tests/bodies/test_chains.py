"""Plane chains: three descriptions of one motion, their equations against derivatives, energies, friction, bad input."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from barchan.bodies.chains import (
    CHAIN_MODELS,
    Chain,
    ChainModel,
    ChainOptions,
    ChainState,
    MaximalChain,
    ReducedChain,
    ReferenceMotion,
    slowest_period,
)
from barchan.bodies.rigid import Body, Fixed, HalfSpace, Sphere
from barchan.errors import InputError
from barchan.friction import solve

Vector = NDArray[np.float64]
NAMES = tuple(CHAIN_MODELS)
FLOOR = Body(HalfSpace((0.0, 1.0)), "floor", friction=0.4, motion=Fixed())


def end_of(model: ChainModel, time: float, steps: int) -> Vector:
    state = model.started()
    for _ in range(steps):
        state, record = model.advance(state, time / steps)
        assert record.converged
    return model.joints(state)


def refined(model: ChainModel, time: float, coarsest: int, levels: int) -> tuple[list[Vector], Vector]:
    """Joints of runs with 1, 2, 4, ... times the coarsest number of steps, and their limit by Richardson."""
    runs = [end_of(model, time, coarsest * 2**level) for level in range(levels)]
    table = runs
    for order in range(1, levels):
        table = [(2**order * fine - coarse) / (2**order - 1) for coarse, fine in pairwise(table)]
    return runs, table[0]


def derivative(function: Any, q: Vector, step: float = 1e-6) -> Vector:
    """(..., m) central differences."""
    columns = [(function(q + step * e) - function(q - step * e)) / (2.0 * step) for e in np.eye(len(q))]
    return np.stack(columns, axis=-1)


def curled(inertia: str = "consistent", held: bool = True) -> Chain:
    """A chain with everything in it."""
    return Chain(
        3, [0.5, 0.3, 0.4], masses=[1.0, 0.7, 0.4], angles=[-0.4, 0.6, 1.5], spins=[0.5, -1.0, 2.0],
        bending_stiffness=1.7, air_friction=0.3, clamp_angle=-0.2 if held else None, inertia=inertia,  # type: ignore[arg-type]
        held=held, root=(0.1, 0.4), velocity=(0.0, 0.0) if held else (0.3, -0.2),
    )  # fmt: skip


class TestMotion:
    @pytest.mark.parametrize(("name", "coarsest"), [("maximal", 50), ("lumped", 50), ("reduced", 200)])
    def test_a_model_tends_to_the_exact_pendulum_at_first_order(self, name: str, coarsest: int) -> None:
        chain = Chain(2, 0.25, line_density=1.0, angles=-0.5 * np.pi + np.array([0.3, 0.45]))
        period = slowest_period(chain)
        exact = ReferenceMotion(chain, period).joints([period])[0]
        runs, limit = refined(CHAIN_MODELS[name](chain), period, coarsest, 4)
        errors = [float(np.max(np.abs(run - exact))) for run in runs]
        assert 1.8 < errors[-2] / errors[-1] < 2.4
        assert np.max(np.abs(limit - exact)) < 1e-6 * chain.length

    @pytest.mark.slow
    @pytest.mark.parametrize(("name", "coarsest"), [("maximal", 100), ("lumped", 100), ("reduced", 600)])
    @pytest.mark.parametrize("inertia", ["consistent", "lumped"])
    def test_three_segments_agree_over_a_period(self, name: str, coarsest: int, inertia: Any) -> None:
        chain = Chain(
            3,
            [0.2, 0.15, 0.15],
            line_density=1.0,
            angles=-0.5 * np.pi + np.array([0.3, 0.35, 0.4]),
            inertia=inertia,
        )
        period = slowest_period(chain)
        exact = ReferenceMotion(chain, period).joints([period])[0]
        _, limit = refined(CHAIN_MODELS[name](chain), period, coarsest, 4)
        assert np.max(np.abs(limit - exact)) < 1e-6 * chain.length

    def test_a_single_rod_swings_as_a_physical_pendulum_and_its_lumped_likeness_slower(self) -> None:
        rod, lumped = (Chain(1, 0.5, masses=1.0, inertia=kind) for kind in ("consistent", "lumped"))
        assert slowest_period(rod) == pytest.approx(2.0 * np.pi * np.sqrt(2.0 / 3.0 / 9.81), rel=1e-12)
        assert slowest_period(lumped) == pytest.approx(2.0 * np.pi * np.sqrt(1.0 / 9.81), rel=1e-12)

    def test_the_reference_keeps_its_energy(self) -> None:
        chain = Chain(3, 0.2, line_density=1.0, angles=[0.1, 0.5, -0.3], bending_stiffness=0.5)
        motion, model = ReferenceMotion(chain, 2.0), ReducedChain(chain)
        size = chain.segments
        both = [motion._curve(t) for t in np.linspace(0.0, 2.0, 9)]
        states = [ChainState.at_start(y[:size], y[size:]) for y in both]
        energies = [model.kinetic_energy(state) + model.potential_energy(state) for state in states]
        assert np.ptp(energies) < 1e-9

    @pytest.mark.parametrize("name", NAMES)
    def test_a_chain_hangs_still_from_a_hinge_or_a_clamp(self, name: str) -> None:
        for chain in (
            Chain(4, 0.1, masses=0.2, angles=-0.5 * np.pi),
            Chain(4, 0.1, masses=0.2, angles=-0.5 * np.pi, bending_stiffness=1.0, clamp_angle=-0.5 * np.pi),
        ):
            model = CHAIN_MODELS[name](chain)
            start = model.joints(model.started())
            np.testing.assert_allclose(end_of(model, 0.5, 25), start, atol=1e-12)

    def test_joints_drift_by_the_square_of_the_step_or_not_at_all(self) -> None:
        chain = Chain(3, 0.2, line_density=1.0, angles=0.0)
        worst = {}
        for iterations, dt in ((1, 0.01), (1, 0.005), (30, 0.01)):
            model = MaximalChain(chain, options=ChainOptions(iterations=iterations))
            state, errors = model.started(), []
            for _ in range(round(0.3 / dt)):
                state, record = model.advance(state, dt)
                errors.append(record.joint_error)
            worst[iterations, dt] = max(errors)
        assert 2.5 < worst[1, 0.01] / worst[1, 0.005] < 6.0
        assert worst[30, 0.01] < 1e-12


class TestEquations:
    @pytest.mark.parametrize("held", [True, False])
    def test_the_reduced_equations_are_those_of_lagrange(self, held: bool) -> None:
        chain = curled(held=held)
        model = ReducedChain(chain)
        q, v = model.start()
        nodes, weights = np.polynomial.legendre.leggauss(3)
        shares, weights = 0.5 * (1.0 + nodes), 0.5 * weights

        def points(q: Vector) -> Vector:
            """(N, 3, 2) quadrature points of all segments."""
            joints = model.joints_of(q)
            return joints[:-1, None] + shares[None, :, None] * np.diff(joints, axis=0)[:, None]

        def mass(q: Vector, of: Vector) -> Vector:
            slopes = derivative(points, q)
            return np.einsum("i,k,ikdm,ikdn->mn", of, weights, slopes, slopes)

        def potential(q: Vector) -> Vector:
            heights = points(q)[:, :, 1] @ weights
            bends = model.bends_of(q)
            return np.array(
                chain.gravity * chain.masses @ heights + 0.5 * chain.bending_stiffness * bends @ bends
            )

        np.testing.assert_allclose(model.mass(q), mass(q, chain.masses), rtol=1e-6, atol=1e-8)
        drag = mass(q, 2.0 * chain.half_lengths * chain.air_friction) @ v
        loads = -derivative(potential, q) - drag
        np.testing.assert_allclose(model.loads(q, v), loads, rtol=1e-6, atol=1e-7)
        change = derivative(model.mass, q)  # (m, m, m), the last of the coordinate
        inertial = 0.5 * np.einsum("ijk,i,j->k", change, v, v) - np.einsum("ijk,j,k->i", change, v, v)
        np.testing.assert_allclose(model.coriolis(q, v, v), inertial, rtol=1e-6, atol=1e-7)

    @pytest.mark.parametrize("inertia", ["consistent", "lumped"])
    @pytest.mark.parametrize("held", [True, False])
    @pytest.mark.parametrize("name", ["maximal", "lumped"])
    def test_the_other_descriptions_have_the_same_inertia_and_loads(
        self, name: str, held: bool, inertia: str
    ) -> None:
        chain = curled(inertia, held)
        reduced, other = ReducedChain(chain), CHAIN_MODELS[name](chain)
        q, v = reduced.start()

        def lifted(q: Vector) -> Vector:
            joints, angles = reduced.joints_of(q), reduced.angles_of(q)
            if name == "maximal":
                return np.column_stack([0.5 * (joints[1:] + joints[:-1]), angles]).reshape(-1)
            return joints[int(held) :].reshape(-1)

        slope, (place, rates) = derivative(lifted, q), other.start()
        np.testing.assert_allclose(lifted(q), place, atol=1e-12)
        np.testing.assert_allclose(slope @ v, rates, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(slope.T @ other.mass(place) @ slope, reduced.mass(q), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(
            slope.T @ other.loads(place, rates), reduced.loads(q, v), rtol=1e-6, atol=1e-7
        )
        start, same = other.started(), reduced.started()
        assert other.kinetic_energy(start) == pytest.approx(reduced.kinetic_energy(same), rel=1e-12)
        assert other.potential_energy(start) == pytest.approx(reduced.potential_energy(same), rel=1e-12)

    @pytest.mark.parametrize("held", [True, False])
    @pytest.mark.parametrize("name", NAMES)
    def test_slopes_are_derivatives(self, name: str, held: bool) -> None:
        model = CHAIN_MODELS[name](curled(held=held))
        q, v = model.start()
        np.testing.assert_allclose(model.joint_rows(q), derivative(model.joints_of, q), rtol=1e-6, atol=1e-8)
        found = model.constraints(q)
        if found is not None:
            assert np.max(np.abs(found[0])) < 1e-12
            slopes = derivative(lambda x: model.constraints(x)[0], q)  # type: ignore[index]
            np.testing.assert_allclose(found[1], slopes, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(
            model.damping(q), -derivative(lambda x: model.loads(q, x), v), rtol=1e-6, atol=1e-7
        )
        assert np.min(np.linalg.eigvalsh(model.stiffness(q))) > -1e-12

    def test_the_stiffness_of_the_segments_is_exact(self) -> None:
        model = MaximalChain(curled())
        q, v = model.start()
        np.testing.assert_allclose(
            model.stiffness(q), -derivative(lambda x: model.loads(x, v), q), rtol=1e-6, atol=1e-7
        )


@settings(max_examples=6, deadline=None)
@given(
    angles=st.lists(st.floats(-2.5, -0.6), min_size=3, max_size=3), spins=st.floats(-2.0, 2.0),
    stiffness=st.sampled_from([0.0, 0.5]), drag=st.sampled_from([0.0, 0.2]),
)  # fmt: skip
def test_a_settled_step_never_makes_energy(
    angles: list[float], spins: float, stiffness: float, drag: float
) -> None:
    chain = Chain(
        3, 0.2, line_density=1.0, angles=angles, spins=spins, bending_stiffness=stiffness, air_friction=drag
    )
    scale = chain.gravity * float(np.sum(chain.masses)) * chain.length
    for build in CHAIN_MODELS.values():
        model = build(chain, options=ChainOptions(iterations=60))
        state = model.started()
        energy = model.kinetic_energy(state) + model.potential_energy(state)
        for _ in range(10):
            state, record = model.advance(state, 0.005)
            assert record.converged
            assert record.kinetic_energy + record.potential_energy <= energy + 1e-9 * scale
            energy = record.kinetic_energy + record.potential_energy


class TestContact:
    @pytest.mark.parametrize("name", NAMES)
    def test_a_chain_on_the_floor_is_slowed_by_friction_and_stays(self, name: str) -> None:
        chain = Chain(4, 0.1, line_density=1.0, held=False, velocity=(0.5, 0.0), friction=0.4)
        model = CHAIN_MODELS[name](chain, [FLOOR])
        state = model.started()
        for step in range(1, 41):
            state, record = model.advance(state, 0.005)
            assert record.converged and record.residual <= 1e-6
            left = max(0.0, 0.5 - 0.4 * 9.81 * 0.005 * step)
            np.testing.assert_allclose(model.joint_velocities(state)[:, 0], left, atol=1e-5)
            weight = 9.81 * float(np.sum(chain.masses))
            assert np.sum(state.forces[:, 0]) == pytest.approx(weight, rel=1e-5)
        assert np.max(np.abs(model.joint_velocities(state))) < 1e-5

    @pytest.mark.parametrize(("mu", "slides"), [(0.5, True), (0.62, False)])
    def test_on_a_slope_it_slides_below_the_tangent_of_the_angle(self, mu: float, slides: bool) -> None:
        lean = np.radians(30.0)
        slope = Body(HalfSpace((np.sin(lean), np.cos(lean))), "slope", friction=mu, motion=Fixed())
        chain = Chain(3, 0.1, line_density=1.0, held=False, angles=-lean, friction=mu)
        for build in CHAIN_MODELS.values():
            model = build(chain, [slope])
            state = model.started()
            for _ in range(20):
                state, record = model.advance(state, 0.005)
                assert record.converged
            speed = np.linalg.norm(model.joint_velocities(state), axis=1)
            expected = 9.81 * (np.sin(lean) - mu * np.cos(lean)) * 0.1 if slides else 0.0
            np.testing.assert_allclose(speed, expected, atol=2e-5)

    def test_a_chain_lies_down_on_a_disc_in_every_description(self) -> None:
        disc = Body(Sphere(0.3, dimension=2), "disc", friction=0.4, motion=Fixed())
        chain = Chain(
            8, 0.05, line_density=1.0, held=False, root=(-0.4, 0.32), friction=0.4, air_friction=0.05
        )
        ends = {}
        for name, build in CHAIN_MODELS.items():
            model = build(chain, [disc], ChainOptions(iterations=20))
            state = model.started()
            for _ in range(60):
                state, record = model.advance(state, 0.004)
                assert record.residual <= 1e-6
                assert np.min(model.obstacles.gaps(model.joints(state))) > -1e-5
            ends[name] = model.joints(state)
            assert record.contacts >= 3
        np.testing.assert_allclose(ends["maximal"], ends["lumped"], atol=0.01)
        np.testing.assert_allclose(ends["maximal"], ends["reduced"], atol=0.02)

    @pytest.mark.parametrize("name", NAMES)
    def test_a_step_is_a_friction_problem_that_any_method_solves(self, name: str) -> None:
        chain = Chain(
            3, 0.1, line_density=1.0, held=False, angles=-0.4, root=(0.0, 0.24), velocity=(1.0, -2.0)
        )
        model = CHAIN_MODELS[name](chain, [FLOOR])
        problem = model.problem(model.started(), 0.01)
        velocities = [
            solve(problem, method=method, tol=1e-9).v for method in ("gauss_seidel", "newton_alart_curnier")
        ]
        assert problem.n > 0
        first, second = (np.asarray(v) for v in velocities)
        np.testing.assert_allclose(first, second, atol=1e-6)


def test_a_state_goes_through_its_arrays_and_back() -> None:
    model = ReducedChain(curled(), [Body(HalfSpace((0.0, 1.0)), position=(0.0, -1.0), motion=Fixed())])
    state, _ = model.advance(model.started(), 0.01)
    again, _ = model.advance(model.restored(state.arrays()), 0.01)
    here, _ = model.advance(state, 0.01)
    for name, values in here.arrays().items():
        np.testing.assert_array_equal(values, again.arrays()[name])
    with pytest.raises(InputError, match=r"state.velocities = missing"):
        model.restored({name: value for name, value in state.arrays().items() if name != "velocities"})


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("segments", {"segments": 0}),
        ("half_lengths", {"half_lengths": [0.1, 0.0]}),
        ("half_lengths", {"half_lengths": [0.1, 0.1, 0.1]}),
        ("masses", {"masses": -1.0}),
        ("masses", {"masses": None}),
        ("masses", {"line_density": 1.0}),
        ("angles", {"angles": [0.0, np.nan]}),
        ("angles", {"angles": [0.0, 3.2], "bending_stiffness": 1.0}),
        ("bending_stiffness", {"bending_stiffness": -1.0}),
        ("air_friction", {"air_friction": np.inf}),
        ("clamp_angle", {"clamp_angle": 0.0, "held": False}),
        ("velocity", {"velocity": (1.0, 0.0)}),
        ("inertia", {"inertia": "none"}),
    ],
)
def test_bad_chains_are_refused_by_name(field: str, change: dict[str, Any]) -> None:
    good: dict[str, Any] = {"segments": 2, "half_lengths": 0.1, "masses": 1.0}
    Chain(**good)
    with pytest.raises(InputError, match=rf"chain\.{field} = "):
        Chain(**{**good, **change})


def test_bad_obstacles_and_steps_are_refused() -> None:
    chain = Chain(2, 0.1, masses=1.0)
    with pytest.raises(InputError, match="obstacles"):
        MaximalChain(chain, [Body(HalfSpace((0.0, 1.0)), position=(0.0, 0.1), motion=Fixed())])
    with pytest.raises(InputError, match="fixed bodies"):
        MaximalChain(chain, [Body(Sphere(0.1, dimension=2), density=1.0, position=(0.0, -1.0))])
    with pytest.raises(InputError, match="plane"):
        MaximalChain(chain, [Body(Sphere(0.1), motion=Fixed())])
    with pytest.raises(InputError, match="dt = 0"):
        MaximalChain(chain).advance(MaximalChain(chain).started(), 0.0)
    with pytest.raises(InputError, match=r"options\.iterations"):
        ChainOptions(iterations=0)
    with pytest.raises(InputError, match="hangs"):
        slowest_period(Chain(2, 0.1, masses=1.0, gravity=0.0))
