"""The node algebra of the two-phase model against the two balances solved directly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.flows.suspension.phases import CLOSED, FLUID_HELD, FREE, HELD, Phases, phases

GRAVITY = np.array([0.3, -9.81])
GRAINS, FLUID, DT = 2500.0, 1000.0, 0.01


def _case(seed: int, darcy: bool = False) -> tuple[Phases, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    n, d = 40, 2
    fractions = rng.uniform(0.0, 0.7, n)
    fractions[:6] = 0.0
    volumes = rng.uniform(0.5, 1.5, n)
    kind = rng.integers(0, 4, (n, d)).astype(np.int8)
    held = np.where(kind > 0, rng.normal(size=(n, d)), 0.0)
    drag = 10.0 ** rng.uniform(-3, 8, n) * fractions
    of_grains, of_fluid = GRAINS * fractions * volumes, FLUID * (1 - fractions) * volumes
    case = {
        "grains": rng.normal(size=(n, d)), "fluid": rng.normal(size=(n, d)), "force": 1e4 * rng.normal(size=(n, d)),
        "kind": kind, "held": held, "drag": drag,
    }  # fmt: skip
    return phases(of_grains, of_fluid, fractions, drag, DT, d, kind, held, darcy), case


def _directly(algebra: Phases, case: dict[str, np.ndarray], i: int, k: int) -> np.ndarray:
    """(u_g, u_f) of one component: the 2 x 2 balance, or its restriction at a wall."""
    m_g, m_f, d = algebra.grain_masses[i], algebra.fluid_masses[i], case["drag"][i]
    phi, wall = algebra.fractions[i], case["held"][i, k]
    A = np.array([[m_g / DT + d, -d], [-d, m_f / DT + d]])
    before = np.array([case["grains"][i, k], case["fluid"][i, k]])
    load = np.array([m_g, m_f]) * (before / DT + GRAVITY[k]) + case["force"][i, k] * np.array([phi, 1 - phi])
    kind = case["kind"][i, k]
    if kind == HELD:
        return np.array([wall, wall])
    along = {
        FREE: np.eye(2),
        FLUID_HELD: np.array([[1.0], [0.0]]),
        CLOSED: np.array([[1.0], [-phi / (1 - phi)]]),
    }[kind]
    offset = {
        FREE: np.zeros(2),
        FLUID_HELD: np.array([0.0, wall]),
        CLOSED: np.array([0.0, wall / (1 - phi)]),
    }[kind]
    if phi == 0.0:  # no grains: the fluid alone
        along = along[1:, -1:] if kind == FREE else np.zeros((1, 0))
        fluid = offset[1:] + along @ np.linalg.solve(
            along.T @ A[1:, 1:] @ along, along.T @ (load[1:] - A[1:, 1:] @ offset[1:])
        )
        return np.array([np.nan, fluid[0]])
    return offset + along @ np.linalg.solve(along.T @ A @ along, along.T @ (load - A @ offset))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_unknowns_solve_the_two_balances_at_every_kind_of_boundary(seed: int) -> None:
    algebra, case = _case(seed)
    unknowns = algebra.predicted(case["grains"], case["fluid"], GRAVITY)
    unknowns = algebra.with_volume_force(*unknowns, case["force"])
    fluid, average = algebra.fluid(*unknowns), algebra.volume_average(*unknowns)
    for i, k in np.ndindex(fluid.shape):
        expected = _directly(algebra, case, i, k)
        phi = algebra.fractions[i]
        assert fluid[i, k] == pytest.approx(expected[1], rel=1e-7, abs=1e-7)
        if phi > 0.0:
            assert unknowns[0][i, k] == pytest.approx(expected[0], rel=1e-7, abs=1e-7)
            assert average[i, k] == pytest.approx(
                phi * expected[0] + (1 - phi) * expected[1], rel=1e-7, abs=1e-7
            )
        else:
            assert average[i, k] == pytest.approx(expected[1], rel=1e-7, abs=1e-7)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_compliance_of_the_volume_average_is_its_response_to_a_force(seed: int) -> None:
    algebra, case = _case(seed)
    zero = np.zeros_like(case["force"])
    moved = algebra.with_volume_force(zero, zero, case["force"])
    response = algebra.volume_average(*moved) - algebra.volume_average(zero, zero)
    assert np.allclose(response, algebra.volume_compliance * case["force"], rtol=1e-10, atol=1e-14)


def test_the_darcy_model_forgets_the_fluctuation_and_keeps_the_mean() -> None:
    algebra, case = _case(3, darcy=True)
    free = np.all(case["kind"] == FREE, axis=1) & (algebra.fractions > 0.0)
    grains, rest = algebra.predicted(case["grains"], case["fluid"], GRAVITY)
    fluid = algebra.fluid(grains, rest)
    assert np.allclose(grains[free], fluid[free], rtol=1e-9)
    m_g, m_f = algebra.grain_masses[:, None], algebra.fluid_masses[:, None]
    mean = (m_g * case["grains"] + m_f * case["fluid"]) / (m_g + m_f) + DT * GRAVITY
    assert np.allclose(grains[free], mean[free], rtol=1e-9)


def test_strong_drag_ties_the_phases_and_no_drag_leaves_the_grains_alone() -> None:
    phi, whole = np.array([0.4]), np.array([2.0])
    masses = GRAINS * phi * whole, FLUID * (1 - phi) * whole
    tied = phases(*masses, phi, np.array([1e15]), DT, 2)
    loose = phases(*masses, phi, np.array([0.0]), DT, 2)
    assert tied.grain_inertia[0, 0] == pytest.approx(sum(m[0] for m in masses) / DT, rel=1e-6)
    assert loose.grain_inertia[0, 0] == pytest.approx(masses[0][0] / DT, rel=1e-12)
    before = np.array([[1.0, 0.0]]), np.array([[0.0, 0.0]])
    grains, rest = loose.predicted(*before, np.zeros(2))
    assert np.allclose(grains, before[0]) and np.allclose(loose.fluid(grains, rest), before[1])
