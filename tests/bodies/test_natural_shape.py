"""Natural shapes found from shapes at rest hold them there, and curves become Super-Helices (seed B, 4.4.1)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from barchan.bodies.fibres.assembly import FibreAssembly
from barchan.bodies.fibres.helices import Helices, HelixShape, even_pieces
from barchan.bodies.fibres.helices.fitting import fitted
from barchan.bodies.fibres.roots import StillRoots, frames_along
from barchan.bodies.inverse.natural_shape import InverseOptions, hanging, natural_shape
from barchan.bodies.moreau import Options
from barchan.bodies.rigid import Body, Fixed, Sphere
from barchan.cones import SecondOrderCone
from barchan.errors import InputError

Vector = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.81])
STEP = 0.02


@cache
def bundle() -> tuple[FibreAssembly[HelixShape], Vector]:
    """Six curly fibres on a ball and on one another, and the curvatures with which they lie there."""
    rng = np.random.default_rng(1)
    lengths, firsts = even_pieces(np.full(6, 0.25), 5)
    places = np.stack([np.linspace(-0.006, 0.006, 6), np.zeros(6), np.full(6, 0.12)], axis=1)
    roots = StillRoots(places, frames_along(np.tile([0.0, 1.0, 0.2], (6, 1))))
    model = Helices(
        lengths, firsts, roots, 1e-3, 1300.0, 3e7, natural=2.0 * rng.normal(size=(30, 3)), internal_damping=0.05,
        air_friction=0.02,
    )  # fmt: skip
    ball = Body(Sphere(0.06), name="ball", friction=0.5, position=(0.0, 0.1, 0.0), motion=Fixed())
    options = Options(tolerance=1e-8, margin=1e-4)
    assembly = FibreAssembly(model, [ball], friction_fibres=0.3, options=options)
    state = assembly.started()
    for _ in range(100):
        state, record = assembly.advance(state, STEP)
    assert record.max_speed < 1e-4 and record.contacts >= 6
    return assembly, state.shape.curvatures


def groomed() -> tuple[FibreAssembly[HelixShape], Vector]:
    """The bundle started where it lies, with the curvatures it has there as natural ones."""
    assembly, lying = bundle()
    return replace(assembly, model=assembly.model.with_natural(lying, lying)), lying


@pytest.mark.parametrize("options", [
    {"target": "input"}, {"target": "end"}, {"target": "straight"}, {"target": "straight", "metric": "curvature"},
    {"target": "end", "regularisation": 0.0},
])  # fmt: skip
def test_what_is_recovered_hangs_still(options: dict[str, Any]) -> None:
    """For a second, under gravity and contact; forces are in their cones and balance the weight."""
    naive, lying = groomed()
    assembly, found = hanging(naive, STEP, InverseOptions(**options, tolerance=1e-8))
    assert found.solution is not None and found.solution.certificate.residual <= 1e-8
    assert found.unbalanced < 1e-12
    cones = SecondOrderCone(0.5)
    np.testing.assert_allclose(cones.project(found.forces, 3), found.forces, atol=1e-12)
    state = assembly.started()
    for _ in range(50):
        state, record = assembly.advance(state, STEP)
    assert record.max_speed < 1e-6
    moved = assembly.model.centre_line(state.shape) - assembly.model.centre_line(assembly.started().shape)
    assert np.max(np.abs(moved)) < 2e-4
    # fibres alone would be explained by other shapes than those that lean on a ball
    assert np.max(np.abs(found.natural - lying)) > 0.1


def test_without_inversion_the_groom_sags() -> None:
    assembly, _ = groomed()
    state = assembly.started()
    for _ in range(12):
        state, _ = assembly.advance(state, STEP)
    moved = assembly.model.centre_line(state.shape) - assembly.model.centre_line(assembly.started().shape)
    assert np.max(np.abs(moved)) > 2e-3


def test_the_nearest_natural_shape_is_found() -> None:
    """No other forces in the cones bring natural shapes nearer to the target."""
    assembly, lying = groomed()
    model, problem = assembly.model, assembly.problem(assembly.started(), STEP)
    closed = np.flatnonzero(problem.w.reshape(-1, 3)[:, 0] * STEP <= 1e-6)
    rows = problem.H[(3 * closed[:, None] + np.arange(3)).reshape(-1)]
    friction = problem.parameters[closed, 0]
    shape = assembly.started().shape
    rng = np.random.default_rng(0)
    for metric in ("energy", "curvature"):
        options = InverseOptions("straight", metric, regularisation=0.0, tolerance=1e-9)
        found = natural_shape(model, shape, GRAVITY, rows, friction, options)
        weights = model.stiffness if metric == "energy" else np.ones_like(model.stiffness)

        def distance(forces: Vector, weights: Vector = weights) -> float:
            pulled = model.weight_forces(shape, GRAVITY) + rows.T @ forces.reshape(-1)
            return float(np.sum(weights * (lying - pulled.reshape(-1, 3) / model.stiffness) ** 2))

        best = distance(found.forces)
        for _ in range(200):
            other = found.forces + 10.0 ** rng.uniform(-5, -2) * rng.normal(size=found.forces.shape)
            assert distance(SecondOrderCone(friction).project(other, 3)) >= best * (1.0 - 1e-9)


def test_a_fibre_that_touches_nothing_bears_its_weight_alone() -> None:
    """The known formula q0 = q - K^-1 weight, and no choice."""
    assembly, _ = groomed()
    model, shape = assembly.model, assembly.started().shape
    weight = model.weight_forces(shape, GRAVITY).reshape(-1, 3)
    for target in ("input", "end", "straight"):
        found = natural_shape(model, shape, GRAVITY, np.zeros((0, 90)), 0.3, InverseOptions(target))
        np.testing.assert_allclose(found.natural, shape.curvatures - weight / model.stiffness, rtol=1e-12)
        assert found.solution is None


@pytest.mark.parametrize(
    ("field", "choices"),
    [
        ("inverse.target", {"target": "curly"}),
        ("inverse.metric", {"metric": "distance"}),
        ("inverse.regularisation", {"regularisation": -1.0}),
        ("inverse.tolerance", {"tolerance": 0.0}),
    ],
)
def test_bad_choices_are_named(field: str, choices: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        InverseOptions(**choices)
    assert caught.value.field == field


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10_000))
@example(7198)
def test_super_helices_are_fitted_to_themselves(seed: int) -> None:
    """The nodes of Super-Helices give curves whose fit is the same fibres, to the error of the spline."""
    rng = np.random.default_rng(seed)
    lengths, firsts = even_pieces([0.2, 0.3], 3)
    roots = StillRoots(rng.normal(size=(2, 3)), frames_along(rng.normal(size=(2, 3))))
    model = Helices(
        lengths, firsts, roots, 1e-3, 1000.0, 1e7, natural=12.0 * rng.normal(size=(6, 3)), nodes_per_piece=60
    )
    nodes = model.centre_line(model.started())
    curves = np.split(nodes, model.node_offsets[1:-1])
    fit = fitted(curves, 3)
    np.testing.assert_allclose(fit.lengths, lengths, rtol=1e-3)
    assert np.max(fit.errors) < 2e-4


def test_a_helix_of_many_turns_needs_one_piece() -> None:
    u = np.linspace(0.0, 1.0, 200)
    curve = np.stack([0.02 * np.cos(40.0 * u), 0.02 * np.sin(40.0 * u), -0.3 * u], axis=1)
    fit = fitted([curve], 1)
    assert fit.errors[0] < 1e-5
    rate, climb = 40.0 * 0.02, 0.3
    total = rate**2 + climb**2
    assert np.linalg.norm(fit.curvatures[0, 1:]) == pytest.approx(0.02 * 40.0**2 / total, rel=1e-3)
    assert abs(fit.curvatures[0, 0]) == pytest.approx(climb * 40.0 / total, rel=1e-3)


def test_more_pieces_follow_a_wave_better() -> None:
    u = np.linspace(0.0, 0.3, 60)
    curve = np.stack([u, 0.02 * np.sin(40.0 * u), 0.01 * np.cos(25.0 * u)], axis=1)
    errors = [fitted([curve], n).errors[0] for n in (3, 6, 12)]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]


@pytest.mark.parametrize(
    "curve", [np.zeros((1, 3)), np.zeros((4, 3)), np.full((3, 3), np.nan), np.zeros((3, 2))]
)
def test_curves_that_cannot_be_fitted_are_named(curve: Vector) -> None:
    with pytest.raises(InputError) as caught:
        fitted([curve], 2)
    assert caught.value.field == "curves[0]"
