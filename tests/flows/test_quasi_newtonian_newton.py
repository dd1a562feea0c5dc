"""Nonlinear methods: one solution for all, quadratic convergence, the printed strategies, few steps from rest (seed C 4-5)."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from barchan.errors import InputError
from barchan.flows.quasi_newtonian import (
    METHODS,
    STRATEGIES,
    Bingham,
    ChannelEnd,
    DirectSolver,
    FlowSolution,
    ModifiedPoliquen,
    Newtonian,
    NonlinearOptions,
    NoSlip,
    Poliquen,
    PowerLaw,
    QuasiNewtonianFlow,
    Velocity,
    Weights,
    solve,
    solve_continued,
)
from barchan.flows.quasi_newtonian.newton import solve_flow
from barchan.flows.quasi_newtonian.weights import FACTORS, LEAST, AdaptiveWeight
from barchan.spaces.meshes import annulus, dfg_channel, rectangle
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace

MEAN, WIDTH = 0.2, 0.41
WALL = 0.019886667


def parabola(x: np.ndarray) -> np.ndarray:
    """Inflow of the cylinder benchmark (seed C 5.1): maximum 0.3 m/s."""
    return 1.5 * MEAN * 4.0 * x[:, 1] * (WIDTH - x[:, 1]) / WIDTH**2


def past_cylinder(model, level: int = 1) -> QuasiNewtonianFlow:
    """The benchmark of seed C 5."""
    space = QuadraticSpace(dfg_channel(level))
    conditions = {"inflow": Velocity((parabola, 0.0)), "walls": NoSlip(), "cylinder": NoSlip()}
    return QuasiNewtonianFlow(space, model, conditions)


def rings(levels: int) -> list[QuadraticSpace]:
    mesh = annulus(1, 0.019, 0.024)
    spaces = [QuadraticSpace(mesh)]
    while len(spaces) < levels:
        mesh = mesh.refined()
        spaces.append(QuadraticSpace(mesh))
    return spaces


def couette(space: QuadraticSpace, eps: float = 1e-2) -> QuasiNewtonianFlow:
    """The device of seed C 6."""
    model = ModifiedPoliquen(0.15, 0.27, 0.06, 1e-3, 1.0, 1487.0 / 1500.0, eps=eps)
    turning = Velocity(lambda x: WALL / 0.019 * np.stack([-x[:, 1], x[:, 0]], axis=1))
    return QuasiNewtonianFlow(space, model, {"inner": turning, "outer": NoSlip()})


def converged(flow: QuasiNewtonianFlow, options: NonlinearOptions, **more) -> FlowSolution:
    solution = solve(flow, options, **more)
    assert solution.converged, solution.message
    return solution


# -- one solution --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bingham() -> tuple[QuasiNewtonianFlow, FlowSolution]:
    """A mild flow, solved closely."""
    flow = past_cylinder(Bingham(1e-1, 1e-2, eps=0.1))
    return flow, converged(flow, NonlinearOptions(tolerance=1e-13))


VARIANTS = [
    *(NonlinearOptions(method, 1e-9, max_iterations=200) for method in METHODS),
    *(NonlinearOptions("adaptive-newton", 1e-9, strategy=strategy, radius=1e-4) for strategy in STRATEGIES),
    NonlinearOptions("damped-newton", 1e-9, max_iterations=200, damping=0.7),
    NonlinearOptions("newton", 1e-9, delta=Weights(0.5, 1.0, 1.0)),
]


@pytest.mark.parametrize(
    "options", VARIANTS, ids=lambda o: f"{o.method} {o.strategy} {o.damping} {o.delta.viscous}"
)
def test_every_method_reaches_the_same_solution(options, bingham):
    flow, reference = bingham
    found = converged(flow, options)
    assert np.abs(found.velocity - reference.velocity).max() <= 1e-7
    scale = np.abs(reference.pressure).max()
    assert np.abs(found.pressure - reference.pressure).max() <= 1e-7 * scale
    assert len(found.weights) == len(found.cycles) == found.iterations == len(found.residuals) - 1


def test_multigrid_and_direct_give_the_same_flow():
    spaces = rings(3)
    flow = couette(spaces[-1])
    direct = converged(flow, NonlinearOptions(tolerance=1e-11))
    grids = converged(flow, NonlinearOptions(tolerance=1e-10), linear_solver="multigrid", spaces=spaces)
    assert np.allclose(direct.velocity, grids.velocity, atol=1e-8 * WALL)
    scale = np.abs(flow.fields(direct.velocity, direct.pressure).stress).max()
    assert np.allclose(direct.pressure, grids.pressure, atol=1e-6 * scale)
    assert min(grids.cycles) >= 1 and max(direct.cycles) == 0


def test_the_same_flow_is_the_same_bytes():
    one, two = (converged(past_cylinder(Bingham(1e-1, 1e-2, eps=0.1)), NonlinearOptions()) for _ in range(2))
    assert one.velocity.tobytes() == two.velocity.tobytes()
    assert one.pressure.tobytes() == two.pressure.tobytes()


# -- rates of convergence ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "model", [Newtonian(1e-3), PowerLaw(1e-3, 1.5, eps=0.1**0.5), PowerLaw(1e-3, 3.0, eps=0.1**0.5)],
    ids=["newtonian", "thinning", "thickening"],
)  # fmt: skip
def test_newton_converges_quadratically_from_the_coarser_level(model):
    """Tables 6-8: |R_n+1| <= C |R_n|^2 until rounding, in at most five steps from the solution on the coarser mesh."""
    spaces = [QuadraticSpace(mesh) for mesh in (dfg_channel(1), dfg_channel(2))]
    flow = past_cylinder(model, 2)
    flow = QuasiNewtonianFlow(spaces[1], model, flow.conditions)
    found = converged(flow, NonlinearOptions("newton", 1e-12), spaces=spaces, nested=True)
    r = [value for value in found.residuals if value > 1e-14 * found.residuals[0]]
    orders = [
        math.log(c / b) / math.log(b / a) for a, b, c in zip(r, r[1:], r[2:], strict=False) if b < 0.1 * a
    ]
    assert found.iterations <= 5 + 1  # the published tolerance is looser by a step
    assert max(orders) > 1.55, (orders, found.residuals)


def test_the_fixed_point_converges_linearly_and_slowly():
    flow = past_cylinder(Bingham(1e-1, 1e-1, eps=0.1))
    slow = converged(flow, NonlinearOptions("fixed-point", 1e-8, max_iterations=300))
    fast = converged(flow, NonlinearOptions("stress-velocity", 1e-8))
    rates = np.array(slow.residuals[-5:]) / np.array(slow.residuals[-6:-1])
    assert np.ptp(rates) < 0.05 and rates.mean() > 0.3
    assert slow.iterations > 3 * fast.iterations


def test_the_stress_velocity_method_ends_as_newton_does():
    """Near the solution w = g / sqrt(s), and the two Jacobians agree: quadratic convergence."""
    flow = past_cylinder(Bingham(1.0, 0.5, eps=0.1))
    r = converged(flow, NonlinearOptions(tolerance=1e-13)).residuals
    r = [value for value in r if value > 1e-12 * r[0]]
    assert math.log(r[-1] / r[-2]) / math.log(r[-2] / r[-3]) > 1.6, r


@pytest.mark.parametrize("tau", [1e-3, 1.0, 5.0])
@pytest.mark.parametrize("squared", [1e-2, 1e-5])
@pytest.mark.parametrize("level", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_stress_velocity_needs_fifteen_steps_from_rest_at_most(level, tau, squared):
    """Bingham past the cylinder, eta_0 = 1e-3, no continuation, where Newton's method diverges (Tables 10-13)."""
    flow = past_cylinder(Bingham(1e-3, tau, eps=squared**0.5), level)
    assert converged(flow, NonlinearOptions(max_iterations=15)).iterations <= 15


@pytest.mark.parametrize("eps", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("mean", [1.0, 20.0])
def test_stress_velocity_keeps_grains_under_pressure(mean, eps):
    """Full steps may end at negative pressures, where nothing resists; they are halved."""
    mesh = QuadraticMesh.of(rectangle((0.0, 0.0), (2.0, 1.0), (4, 3), "quadrilateral"))
    sides = {name: NoSlip() for name in ("bottom", "left", "right")}
    lid = Velocity((lambda x: x[:, 0] * (2.0 - x[:, 0]), 0.0))
    for convection in (True, False):
        flow = QuasiNewtonianFlow(
            QuadraticSpace(mesh), Poliquen(0.3, 0.3, 0.1, 0.01, 1.0, eps=eps), {"top": lid, **sides},
            mean_pressure=mean, convection=convection,
        )  # fmt: skip
        found = converged(flow, NonlinearOptions(max_iterations=20))
        assert flow.fields(found.velocity, found.pressure).pressure.min() > 0.0


def test_without_a_yield_stress_the_default_is_newton():
    flow = past_cylinder(PowerLaw(1e-2, 1.5, eps=0.1))
    default, newton = (converged(flow, NonlinearOptions(method)) for method in ("stress-velocity", "newton"))
    assert default.residuals == newton.residuals
    assert default.direction is None


# -- adaptive Newton -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "points"),
    [
        # The restrictions from which seed C builds its functions, to the digits of their rounded constants.
        ("f1", {0.0: 2.5, 0.8: 1.2, 1.0: 0.97, np.inf: 0.2}),
        ("f2", {0.0: 4.0, 0.9: 1.2, 1.0: 0.99, np.inf: 0.2}),
        ("f3", {0.0: 2.0, 0.6: 1.5, 1.0: 0.99, np.inf: 0.2}),
        ("phase3", {0.0: 3.48, 0.8: 1.4, 0.9: 1.1, 1.0: 0.8, 2.0: 0.4}),
        ("phase2", {0.5: 1.2, 1.5: 0.8}),
        ("phase2-slow", {0.3: 1.1, 0.7: 1.05, 1.5: 0.8}),
    ],
)
def test_strategies_are_the_printed_functions(name, points):
    for q, value in points.items():
        assert FACTORS[name](q) == pytest.approx(value, abs=0.06), q


@pytest.mark.parametrize("name", ["f1", "f2", "f3"])
def test_final_strategies_fall_from_growth_to_the_lowest_value(name):
    f = [FACTORS[name](q) for q in np.linspace(0.0, 5.0, 200)]
    assert np.all(np.diff(f) < 0.0) and f[0] > 1.0 and 0.2 < f[-1] < 0.21


def test_f1_stagnates_where_the_seed_says_so():
    """Section 8.1.1: f1(0.987) = 0.985 lets the weight fall though the residual falls; f3 does not."""
    assert FACTORS["f1"](0.987) == pytest.approx(0.985, abs=2e-3)
    assert FACTORS["f3"](0.973) > 1.0


def test_weights_follow_the_residuals_between_their_bounds():
    weight = AdaptiveWeight("f1", 0.5)
    assert weight.update(1.0, None) == 0.5
    assert weight.update(0.5, 1.0) == pytest.approx(min(1.0, 0.5 * FACTORS["f1"](0.5)))
    assert weight.update(1e-6, 0.5) == 1.0
    for _ in range(5):
        assert weight.update(1e3, 1.0) == pytest.approx(LEAST, rel=1.0)
    switched = AdaptiveWeight("phase1", 0.5, radius=1e-2)
    assert [switched.update(r, 1.0) for r in (1.0, 0.1, 1e-3, 1.0)] == [0.5, 0.5, 1.0, 1.0]


def test_adaptive_newton_reports_the_weights_it_used():
    found = converged(
        past_cylinder(Bingham(1e-1, 1e-1, eps=0.1)), NonlinearOptions("adaptive-newton", delta0=0.4)
    )
    assert found.weights[0] == 0.4 and found.weights[-1] == 1.0
    for k in range(1, found.iterations):
        q = found.residuals[k] / found.residuals[k - 1]
        assert found.weights[k] == pytest.approx(
            min(1.0, max(LEAST, found.weights[k - 1] * FACTORS["f1"](q))), rel=1e-9
        )


def test_damped_newton_never_lets_the_residual_grow_much():
    found = converged(
        past_cylinder(Bingham(1e-2, 1e-1, eps=0.1)), NonlinearOptions("damped-newton", max_iterations=200)
    )
    assert np.all(np.diff(found.residuals) < 0.0)


# -- starts --------------------------------------------------------------------------------------------------------------


def test_continuation_ends_at_the_solution_of_its_last_model():
    flow = past_cylinder(Bingham(1e-1, 0.1, eps=1.0))
    models = [flow.model.with_eps(eps) for eps in (1.0, 0.3, 0.1)]
    options = NonlinearOptions("newton", 1e-11)
    found = solve_continued(flow, models, DirectSolver, options)
    assert [solution.converged for solution in found] == [True] * 3
    alone = converged(flow.with_model(models[-1]), NonlinearOptions(tolerance=1e-12))
    assert np.allclose(found[-1].velocity, alone.velocity, atol=1e-8)
    with pytest.raises(InputError, match="models"):
        solve_continued(flow, [], DirectSolver, options)


def test_a_nested_start_saves_steps_on_the_finest_level_and_changes_nothing_else():
    spaces = rings(3)
    flow = couette(spaces[-1])
    rest = converged(flow, NonlinearOptions(tolerance=1e-10))
    nested = converged(flow, NonlinearOptions(tolerance=1e-10), spaces=spaces, nested=True)
    assert np.allclose(rest.velocity, nested.velocity, atol=1e-7 * WALL)
    assert nested.iterations < rest.iterations
    assert nested.residuals[0] < 0.2 * rest.residuals[0]


def test_a_solution_is_a_start_that_needs_no_step():
    flow = past_cylinder(Bingham(1e-1, 1e-2, eps=0.1))
    first = converged(flow, NonlinearOptions())
    again = converged(flow, NonlinearOptions(), start=first.state)
    assert again.iterations == 0
    assert np.array_equal(first.velocity, again.velocity)


def test_a_solve_that_misses_its_tolerance_says_so():
    flow = past_cylinder(Bingham(1e-3, 1.0, eps=0.1))
    found = solve(flow, NonlinearOptions("fixed-point", max_iterations=3))
    assert not found.converged and found.iterations == 3
    assert "3 steps" in found.message
    lost = solve(flow, NonlinearOptions("newton", max_iterations=40))
    assert lost.converged or lost.message


def test_progress_is_reported_step_by_step():
    flow, seen = past_cylinder(Bingham(1e-1, 1e-2, eps=0.1)), []
    options = NonlinearOptions("adaptive-newton")
    found = solve_flow(flow, DirectSolver(flow), options, callback=lambda *step: seen.append(step))
    assert [step[0] for step in seen] == list(range(1, found.iterations + 1))
    assert [step[1] for step in seen] == found.residuals[1:]
    assert [step[2] for step in seen] == found.weights


# -- refusals ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"method": "bisection"}, "method"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"damping": 0.0}, "damping"),
        ({"damping": 1.5}, "damping"),
        ({"strategy": "f4"}, "strategy"),
        ({"delta0": 1.5}, "delta0"),
        ({"delta0": -0.1}, "delta0"),
        ({"radius": 0.0}, "radius"),
    ],
)
def test_options_out_of_range_are_refused_by_name(options, field):
    with pytest.raises(InputError) as refused:
        NonlinearOptions(**options)
    assert refused.value.field == field


def test_calls_that_do_not_fit_are_refused():
    spaces = rings(2)
    flow = couette(spaces[-1])
    start = (*flow.at_rest(), None)
    for options, field in (
        ({"linear_solver": "gauss"}, "linear_solver"),
        ({"linear_solver": "multigrid"}, "spaces"),
        ({"linear_solver": "multigrid", "spaces": spaces[:1]}, "spaces"),
        ({"nested": True}, "spaces"),
        ({"nested": True, "spaces": spaces, "start": start}, "start"),
        ({"linear_solver": "multigrid", "spaces": spaces, "gain": 2.0}, "gain, max_cycles"),
    ):
        with pytest.raises(InputError) as refused:
            solve(flow, **options)
        assert refused.value.field == field


def test_multigrid_on_triangles_is_refused():
    meshes = [annulus(level, 1.0, 2.0, kind="triangle") for level in (1, 2)]
    spaces = [QuadraticSpace(mesh, "P1") for mesh in meshes]
    flow = QuasiNewtonianFlow(spaces[-1], Newtonian(1.0), {"inner": ChannelEnd(1.0), "outer": NoSlip()})
    with pytest.raises(InputError, match="quadrilaterals"):
        solve(flow, linear_solver="multigrid", spaces=spaces)


# -- the page ------------------------------------------------------------------------------------------------------------


def test_the_examples_of_the_page_run_as_they_stand():
    """Each goes on from the one before."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "quasi_newtonian.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(examples) >= 4
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, "quasi_newtonian.md", "exec"), names)


def test_a_flow_that_rests_is_solved_at_once() -> None:
    """Rest under a mean pressure is the solution: what rounding leaves of its residual is not iterated on."""
    space = QuadraticSpace(annulus(2, 1.0, 2.0))
    flow = QuasiNewtonianFlow(
        space, Newtonian(1.0), {"inner": NoSlip(), "outer": NoSlip()}, mean_pressure=1e5
    )
    solution = solve_flow(flow, DirectSolver(flow), NonlinearOptions())
    assert solution.converged and solution.iterations <= 1
    assert np.max(np.abs(solution.velocity)) < 1e-9


def test_a_viscosity_that_vanishes_at_rest_is_refused_with_its_cure() -> None:
    """A thickening power law has no viscosity where nothing shears: without eps the first system is singular."""
    space = QuadraticSpace(annulus(1, 1.0, 2.0))
    conditions = {"inner": Velocity(lambda x: np.stack([-x[:, 1], x[:, 0]], axis=1)), "outer": NoSlip()}
    flow = QuasiNewtonianFlow(space, PowerLaw(1.0, 3.0), conditions, convection=False)
    with pytest.raises(InputError, match="eps"):
        solve_flow(flow, DirectSolver(flow), NonlinearOptions())
