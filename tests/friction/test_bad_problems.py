"""Bad problems of every kind named in one error; repeated constraints and empty contact sets are no mistakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem

from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction import Problem, methods, read, solve, write

LAW = Coulomb(np.array([0.5]))
CHAIN = 100


def full(**changes: object) -> Problem:
    given = {"M": np.eye(3), "f": np.zeros(3), "H": np.eye(3), "w": np.zeros(3), "law": LAW}
    return Problem(**{**given, **changes})


def reduced(W: object, b: object = np.zeros(3)) -> Problem:
    return Problem.reduced(W=W, b=b, law=LAW)


def free_chain() -> sp.sparray:
    """Stiffness of a chain that nothing holds: singular, every diagonal entry positive."""
    diagonal = np.full(CHAIN, 2.0)
    diagonal[[0, -1]] = 1.0
    beside = -np.ones(CHAIN - 1)
    return sp.diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: full(M=np.diag([1.0, 1.0, 0.0])), "M = .*positive definite"),
        (lambda: full(M=np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 1]])), "M = .*positive definite"),
        (
            lambda: Problem(
                M=free_chain(), f=np.zeros(CHAIN), H=sp.eye_array(3, CHAIN), w=np.zeros(3), law=LAW
            ),
            "M = ",
        ),
        (lambda: full(H=np.diag([1.0, np.nan, 1.0])), "H = .*finite"),
        (lambda: full(w=np.array([0.0, np.nan, 0.0])), "w = .*finite"),
        (lambda: full(C=np.full((1, 3), np.nan), k=np.zeros(1)), "C = .*finite"),
        (lambda: full(C=np.ones((1, 3)), k=np.array([np.inf])), "k = .*finite"),
        (lambda: reduced(np.nan * np.eye(3)), "W = .*finite"),
        (lambda: reduced(np.eye(3), np.array([0.0, 0.0, np.nan])), "b = .*finite"),
        (lambda: reduced(np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]])), "W = .*semi-definite"),
        (lambda: full(f="heavy"), "f = heavy: must be an array of numbers"),
        (lambda: full(f=[[1, 2], [3]]), "f = .*numbers"),
        (lambda: full(M=np.eye(3) * 1j), "M = .*real"),
        (lambda: full(H=sp.csr_array(np.eye(3) * 1j)), "H = .*real"),
        (lambda: full(H=np.zeros((2, 2, 2))), "H = .*a matrix"),
        (lambda: full(law=Coulomb(np.array([-0.1]))), "mu = .*non-negative"),
        (lambda: solve(full(), "simplex"), "method = simplex: must be one of auto, gauss_seidel"),
    ],
)
def test_each_mistake_is_one_error_that_names_it(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


class TestConstraints:
    base = random_problem(4, 10, 3, bodies=40)
    C = np.random.default_rng(1).standard_normal((3, base.size))
    k = np.array([0.3, -0.2, 0.1])

    def constrained(self, C: np.ndarray, k: np.ndarray) -> Problem:
        b = self.base
        return Problem(M=b.M, f=b.f, H=b.H, w=b.w, law=b.law, C=C, k=k)

    @pytest.mark.parametrize(
        "mix",
        [
            np.array([[1.0, 0.0, 0.0]]),
            np.array([[2.0, -1.0, 0.5]]),
            np.zeros((1, 3)),
            np.eye(3),
            np.array([[1e-6, 0.0, 0.0], [0.0, 1e6, 0.0]]),
        ],
    )
    def test_rows_that_repeat_others_change_nothing(self, mix: np.ndarray) -> None:
        plain = solve(self.constrained(self.C, self.k), tol=1e-9)
        again = self.constrained(np.vstack([self.C, mix @ self.C]), np.append(self.k, mix @ self.k))
        solution = solve(again, tol=1e-9)
        assert solution.converged and solution.certificate.bilateral < 1e-12
        assert solution.v == pytest.approx(plain.v, abs=1e-7)

    @pytest.mark.parametrize("mix", [np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)), np.eye(3)])
    def test_rows_that_contradict_others_are_refused(self, mix: np.ndarray) -> None:
        wrong = mix @ self.k
        wrong[-1] += 0.1
        with pytest.raises(InputError, match="C, k = rows that contradict each other"):
            self.constrained(np.vstack([self.C, mix @ self.C]), np.append(self.k, wrong))

    def test_more_rows_than_velocities_are_accepted_when_they_agree(self) -> None:
        C = np.vstack([np.eye(3)] * 2)
        problem = full(C=C, k=np.tile([1.0, 0.0, 0.0], 2))
        assert solve(problem).v == pytest.approx([1.0, 0.0, 0.0])

    def test_the_size_of_a_row_does_not_matter(self) -> None:
        plain = solve(self.constrained(self.C, self.k), tol=1e-9)
        solution = solve(self.constrained(1e-9 * self.C, 1e-9 * self.k), tol=1e-9)
        assert solution.v == pytest.approx(plain.v, abs=1e-7)


class TestNoContact:
    def problems(self) -> dict[str, Problem]:
        nothing = {"H": np.zeros((0, 2)), "w": np.zeros(0), "law": Coulomb(np.zeros(0)), "block_size": 3}
        given = {"M": np.eye(2), "f": np.array([1.0, 2.0]), **nothing}
        return {
            "full": Problem(**given),
            "constrained": Problem(**given, C=np.array([[1.0, 1.0]]), k=np.array([1.0])),
            "reduced": Problem.reduced(
                W=np.zeros((0, 0)), b=np.zeros(0), law=Coulomb(np.zeros(0)), block_size=3
            ),
        }

    def test_every_method_solves_it(self) -> None:
        for name, problem in self.problems().items():
            for method in methods():
                solution = solve(problem, method, check_existence=True)
                assert solution.converged and len(solution.r) == 0, (name, method)

    def test_constraints_still_hold(self) -> None:
        assert solve(self.problems()["constrained"]).v == pytest.approx([0.0, 1.0])

    @pytest.mark.parametrize("name", ["full", "reduced", "constrained"])
    def test_it_survives_a_file(self, tmp_path: Path, name: str) -> None:
        problem = self.problems()[name]
        write(tmp_path / "empty.hdf5", problem)
        solution = solve(read(tmp_path / "empty.hdf5"))
        assert solution.converged and solution.certificate.residual < 1e-12
