"""Problem validation, and the certificate: it accepts solutions, rejects all else, and does not depend on units."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from problems import random_problem, stacked_blocks

from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve

GOOD = {
    "M": np.eye(3),
    "f": np.zeros(3),
    "H": np.eye(3),
    "w": np.zeros(3),
    "law": Coulomb(np.array([0.5])),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"M": np.array([[1.0, 2, 0], [0, 1, 0], [0, 0, 1]])}, "M .*symmetric"),
        ({"M": np.diag([1.0, -1.0, 1.0])}, "M .*positive definite"),
        ({"M": np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]])}, "M .*positive definite"),
        ({"M": np.diag([1.0, np.nan, 1.0])}, "M .*finite"),
        ({"M": np.ones((3, 2))}, "M .*square"),
        ({"f": np.zeros(4)}, "f .*length 3"),
        ({"f": np.array([0.0, np.inf, 0.0])}, "f .*finite"),
        ({"H": np.eye(4)}, "H .*columns"),
        ({"w": np.zeros(2)}, "w .*length 3"),
        ({"H": None}, "H .*given"),
        ({"law": 0.5}, "law"),
        ({"law": Coulomb(np.array([0.5, 0.5]))}, r"law .*divisor"),
        ({"law": Coulomb(0.5)}, "block_size"),
        ({"block_size": 2}, "block_size"),
        ({"C": np.ones((1, 3))}, "C, k"),
        ({"C": np.ones((1, 2)), "k": np.zeros(1)}, "C .*columns"),
        ({"reference_force": -1.0}, "reference_force"),
    ],
)
def test_each_slip_gets_its_own_message(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Problem(**{**GOOD, **change})


def test_indefinite_sparse_mass_is_refused() -> None:
    n = 100
    chain = sp.diags_array([np.full(n - 1, 0.9), np.ones(n), np.full(n - 1, 0.9)], offsets=[-1, 0, 1])
    with pytest.raises(InputError, match=r"M .*positive"):
        Problem(M=chain, f=np.zeros(n), H=sp.eye_array(3, n), w=np.zeros(3), law=Coulomb(np.array([0.1])))


def test_reduced_operator_must_be_symmetric_and_not_negative() -> None:
    law = Coulomb(np.array([0.5]))
    with pytest.raises(InputError, match=r"W .*symmetric"):
        Problem.reduced(W=np.array([[1.0, 0, 0], [1, 1, 0], [0, 0, 1]]), b=np.zeros(3), law=law)
    with pytest.raises(InputError, match=r"W .*semi-definite"):
        Problem.reduced(W=-np.eye(3), b=np.zeros(3), law=law)


def test_exact_answer_is_certified_and_a_perturbed_one_is_not() -> None:
    levels = 5
    problem = stacked_blocks(levels)
    r = np.zeros((levels, 3))
    r[:, 0] = 9.81 * np.arange(levels, 0, -1)
    assert certify(problem, r.ravel(), np.zeros(problem.size)).residual < 1e-14
    worse = r.copy()
    worse[0, 0] *= 1.01
    assert certify(problem, worse).law > 1e-4
    assert certify(problem, r, np.full(problem.size, 1e-3)).balance > 1e-5


@pytest.mark.parametrize("force", [1e-6, 1e6])
def test_certificate_does_not_depend_on_units(force: float) -> None:
    base = random_problem(8, 10, 3, bodies=8)
    r = solve(base, tol=1e-3, max_iterations=3).r
    scaled = Problem(M=base.M * force, f=base.f * force, H=base.H, w=base.w, law=base.law)
    before, after = certify(base, r), certify(scaled, r * force)
    assert after.law == pytest.approx(before.law, rel=1e-9)


def test_free_fall_is_certified_relative_to_the_reference_force() -> None:
    free = Problem(**{**GOOD, "f": np.array([1.0, 0.0, 0.0]), "reference_force": 10.0})
    assert certify(free, np.zeros(3)).residual == 0.0
    assert certify(free, np.array([1e-3, 0.0, 0.0])).law == pytest.approx(1e-4, rel=1e-6)


def test_bilateral_residual_sees_a_violated_constraint() -> None:
    problem = Problem(**{**GOOD, "C": np.array([[1.0, 0.0, 0.0]]), "k": np.array([2.0])})
    assert certify(problem, np.zeros(3), np.array([2.0, 0.0, 0.0])).residual < 1e-12
    assert certify(problem, np.zeros(3), np.array([1.0, 0.0, 0.0])).bilateral == pytest.approx(0.5)


def test_sizes_of_r_and_v_are_checked() -> None:
    problem = Problem(**GOOD)
    with pytest.raises(InputError, match="r ="):
        certify(problem, np.zeros(4))
    with pytest.raises(InputError, match="v ="):
        certify(problem, np.zeros(3), np.zeros(2))
