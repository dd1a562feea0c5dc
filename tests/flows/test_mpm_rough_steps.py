"""Steps of rough matter, where sweeps creep along the null space of W: the way of "auto" through such problems."""

import importlib

import numpy as np
import pytest

from barchan.cones import Coulomb
from barchan.flows.mpm import Material, Options, State, Stepper, Walls, fill_box
from barchan.friction import Problem, solve
from barchan.friction.methods import _continuum
from barchan.friction.methods._newton_systems import newton_system
from barchan.friction.methods._velocity_newton import VelocityNewton
from barchan.friction.methods.interior_point import CentralPath, follow
from barchan.friction.operators import build_operator
from barchan.friction.solution import Recorder
from barchan.spaces import RegularGrid

DT = 1 / 240


def rough_column(friction: float = 0.7) -> tuple[Stepper, State]:
    """A plane column, twice as high as wide, on a sticking floor."""
    material = Material(1500.0, friction)
    grid = RegularGrid(np.zeros(2), np.full(2, 0.01), np.array([20, 12]))
    walls = Walls.cuve(2)
    start = fill_box(grid, [0.0, 0.0], [0.06, 0.12], 2, material)
    return Stepper(grid, material, walls, options=Options(max_sweeps=40_000)), start


@pytest.fixture(scope="module")
def hard_problem() -> Problem:
    stepper, state = rough_column()
    for _ in range(6):
        state, _ = stepper.advance(state, DT)
    return stepper.problem(state, DT)


def test_grid_steps_are_problems_of_a_continuum_and_contacts_of_bodies_are_not(hard_problem):
    assert _continuum.is_continuum(hard_problem)
    rng = np.random.default_rng(0)
    H, w = rng.normal(size=(9, 12)), rng.normal(size=9)
    bodies = Problem(M=np.eye(12), f=np.zeros(12), H=H, w=w, law=Coulomb(np.full(3, 0.5)), block_size=3)
    assert not _continuum.is_continuum(bodies)


def test_the_central_path_alone_certifies_a_rough_step(hard_problem, monkeypatch):
    monkeypatch.setattr(_continuum, "FIRST_WORK", 0.0)
    solution = solve(hard_problem, tol=1e-4, max_iterations=40_000)
    assert solution.certificate.residual <= 1e-4
    assert solution.iterations <= _continuum.PATH_STEPS


@pytest.mark.parametrize("path_steps", [8, 12])
def test_newton_in_velocity_space_finishes_what_the_path_begins(hard_problem, path_steps):
    operator = build_operator(hard_problem)
    recorder = Recorder(1e-10)
    path = CentralPath(hard_problem, operator, newton_system(hard_problem, "velocities"))
    done, end = follow(hard_problem, recorder, path, path_steps, shortest_step=0.0)
    assert done == path_steps
    assert not recorder.ended
    used = VelocityNewton(hard_problem, operator).finish(recorder, end, 60)
    assert used <= 60
    assert solve(hard_problem, r0=recorder.best, max_iterations=0).certificate.residual <= 1e-9


@pytest.mark.parametrize("budget", [0, 1, 30, 500, 5_000])
def test_the_work_stays_within_what_is_allowed(hard_problem, budget):
    solution = solve(hard_problem, tol=1e-12, max_iterations=budget)
    assert solution.iterations <= budget
    assert np.isfinite(solution.certificate.residual)


def test_sweeps_that_run_out_are_taken_up_by_the_path_then_by_newton(hard_problem, monkeypatch):
    asked = []
    auto = importlib.import_module("barchan.friction.methods.auto")
    path, islands = _continuum.follow, auto._by_islands
    few = {"FIRST_WORK": 1.0, "PATH_STEPS": 3, "FEWEST_STEPS": 3, "NEWTON_STEPS": 1, "POLISH_WORK": 20}
    for name, value in few.items():
        monkeypatch.setattr(_continuum, name, value)
    monkeypatch.setattr(_continuum, "follow", lambda *a, **o: asked.append("path") or path(*a, **o))
    monkeypatch.setattr(auto, "_by_islands", lambda *a: asked.append("islands") or islands(*a))
    solution = solve(hard_problem, tol=1e-9, max_iterations=40_000)
    assert asked == ["path", "islands"]
    assert solution.certificate.residual <= 1e-6


def test_rough_steps_are_certified_and_the_same_bytes_each_time():
    ends = []
    for _ in range(2):
        stepper, state = rough_column()
        for _ in range(12):
            state, record = stepper.advance(state, DT)
            assert record.converged
        ends.append(state)
    assert ends[0].positions.tobytes() == ends[1].positions.tobytes()
    assert ends[0].node_stresses.tobytes() == ends[1].node_stresses.tobytes()
