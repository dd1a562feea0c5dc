"""Flows closed on all sides: pressures start from zero, and the certificate is relative to those."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.flows.dense import DenseFlow, Material, NoSlip, Velocity
from barchan.flows.dense.closed import lowest_pressure
from barchan.friction import certify
from barchan.spaces.meshes import rectangle
from barchan.spaces.mixed import MixedSpace


def cavity(mu: float, bingham: float, closed: bool = True) -> DenseFlow:
    mesh = rectangle((0.0, 0.0), (1.0, 1.0), (6, 6))
    lid = {"top": Velocity((1.0, 0.0))} if closed else {}
    conditions = {"left": NoSlip(), "right": NoSlip(), "bottom": NoSlip(), **lid}
    return DenseFlow(MixedSpace(mesh), Material(mu=mu, bingham=bingham), conditions, gravity=(0.0, 0.0))


@pytest.mark.parametrize("bingham", [0.0, 2.0])
def test_the_least_pressure_of_a_closed_flow_is_zero_and_the_certificate_is_that_of_what_is_returned(
    bingham: float,
) -> None:
    flow = cavity(0.0, bingham)
    state = flow.solve(1e-6, "split_interior_point")
    assert state.converged and state.certificate.residual <= 1e-6
    assert state.forces[:, 0].min() == pytest.approx(0.0, abs=1e-9)
    problem = flow.problem()
    shifted = state.forces.copy()
    shifted[:, 0] += 1000.0
    assert lowest_pressure(problem, shifted) == pytest.approx(1000.0, rel=1e-9)
    v = flow.reduction.restrict(state.velocity - flow.reduction.prescribed)
    # The same velocities balance both; relative to the larger stresses the same misfit looks smaller.
    low, high = (certify(problem, forces.ravel(), v) for forces in (state.forces, shifted))
    assert high.law < low.law <= 1e-6 and high.balance < 1e-6


def test_friction_binds_the_pressure() -> None:
    """With mu > 0 the constant is spare only as far as every point stays within its cone."""
    flow = cavity(0.4, 0.1)
    problem = flow.problem()
    r = np.zeros((problem.n, problem.s))
    r[:, 0], r[:, 1] = 5.0, 0.5
    spare = lowest_pressure(problem, r)
    assert spare == pytest.approx(5.0 - (0.5 - 0.1) / 0.4, rel=1e-9)


def test_an_opening_fixes_the_pressure() -> None:
    flow = cavity(0.0, 0.0, closed=False)
    problem = flow.problem()
    assert lowest_pressure(problem, np.ones((problem.n, problem.s))) == 0.0
