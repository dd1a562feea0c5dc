"""FCLIB files of bodies mean the same to FCLIB's C library and to Siconos as to us: its answers pass our certificate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from barchan import friction
from barchan.bench.fclib_exchange import PACKAGES, fclib_is_there, siconos_answer
from barchan.bench.siconos import SYSTEM_PYTHON, reduced
from barchan.bodies.moreau import Assembly
from barchan.bodies.rigid import Body, Fixed, HalfSpace, Sphere
from barchan.cli import main
from barchan.errors import InputError
from barchan.friction.samples import sample

needs_siconos = pytest.mark.skipif(
    not fclib_is_there(), reason=f"{SYSTEM_PYTHON} has no Siconos or there is no libfclib ({PACKAGES})"
)


def heap(d: int, path: Path) -> friction.Problem:
    """A step of seven discs or balls that fall onto each other on a rough floor, as a file."""
    rng = np.random.default_rng(d)
    bodies = [Body(HalfSpace(np.eye(d)[-1]), "floor", 0.5, motion=Fixed())]
    for layer, across in ((0, (-1.0, 0.0, 1.0)), (1, (-0.5, 0.5)), (2, (-0.1, 0.9))):
        for place in across:
            x = np.zeros(d)
            x[0], x[-1] = 0.2 * place + 0.01 * rng.random(), 0.1 + 0.19 * layer
            bodies.append(Body(Sphere(0.1, d), "", 0.4, 2500.0, position=x, velocity=rng.standard_normal(d)))
    assembly = Assembly(bodies)
    assembly.write_problem(path, assembly.started(), 0.01)
    return friction.read(path)


@needs_siconos
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("local", [False, True])
def test_siconos_solves_the_steps_of_bodies_that_we_write(d: int, local: bool, tmp_path: Path) -> None:
    path = tmp_path / "step.hdf5"
    problem = heap(d, path)
    assert problem.n >= 8 and not problem.is_reduced
    if local:
        problem = reduced(problem)
        friction.write(path, problem)
    before = path.read_bytes()
    answer = siconos_answer(path, 1e-10)
    assert answer.content and answer.certificate.residual <= 1e-8
    ours = friction.solve(problem, tol=1e-10)
    # forces of several contacts on a body need not be unique, but the relative velocities are those of one motion
    np.testing.assert_allclose(answer.solution.u, ours.u.ravel(), atol=1e-6)
    assert np.linalg.norm(answer.solution.r) > 0.1 * np.linalg.norm(ours.r) > 0.0
    assert path.read_bytes() == before


@needs_siconos
def test_a_stored_solution_does_not_stand_in_the_way(tmp_path: Path) -> None:
    problem = sample(5, 3, 1.0, 0.5, seed=2).problem
    path = tmp_path / "solved.hdf5"
    friction.write(path, problem, friction.solve(problem, tol=1e-8))
    assert siconos_answer(path).certificate.residual <= 1e-6
    assert main(["bench", "siconos", str(path)]) == 0


def test_files_that_siconos_cannot_take_are_refused(tmp_path: Path) -> None:
    tied = tmp_path / "tied.hdf5"
    friction.write(tied, sample(5, 3, 1.0, 0.5, seed=1, constraints=2).problem)
    text = tmp_path / "text.dat"
    friction.write(text, sample(5, 3, 1.0, 0.5, seed=1).problem)
    with pytest.raises(InputError, match="bilateral rows"):
        siconos_answer(tied)
    with pytest.raises(InputError, match="not HDF5"):
        siconos_answer(text)
    assert main(["bench", "siconos", str(text)]) == 2
