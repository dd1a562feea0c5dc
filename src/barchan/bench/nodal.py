"""The dual route and the nodal algorithm on one problem, timed in turn (seed B, Table 4.4): building, solving, certificates.

Dual: a factor of M, the dense W = H M^-1 H^T from as many solves as H has rows, exact Gauss-Seidel sweeps on it. Nodal:
G M G^T and the nodal method. Both start from zero forces; the certificate and its metric are made for both and not timed.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from barchan.friction import Problem, certify
from barchan.friction.methods import METHODS
from barchan.friction.methods.nodal import nodal_form
from barchan.friction.operators import build_operator
from barchan.friction.solution import Recorder
from barchan.linalg import factorise, one_blas_thread

SAFETY = 0.9
NAME_OF_DUAL = "dual"


class Timing(NamedTuple):
    """Seconds to build and to solve, passes or sweeps, the certificate reached."""

    route: str
    build: float
    solve: float
    iterations: int
    certificate: float

    @property
    def total(self) -> float:
        """Seconds in all."""
        return self.build + self.solve


def time_dual(problem: Problem, tolerance: float, max_iterations: int | None = None) -> Timing:
    """Build W and sweep on it to `tolerance`. Raises InputError where W would be too large to store."""
    problem.release()
    assert problem.rho is not None  # the metric of the residual, not part of the route
    begun = time.process_time()
    with one_blas_thread():
        factorise(problem.M)
        build_operator(problem, "explicit")
        built = time.process_time()
        found = _run(problem, "gauss_seidel", tolerance, max_iterations, {"operator": "explicit"})
    return _timing(NAME_OF_DUAL, problem, begun, built, time.process_time(), found)


def time_nodal(
    problem: Problem, tolerance: float, variant: str = "inversion", max_iterations: int | None = None
) -> Timing:
    """Build the nodal form and solve by a variant of the nodal method. Raises InputError where there is no such form."""
    problem.release()
    begun = time.process_time()
    with one_blas_thread():
        nodal_form(problem)
        built = time.process_time()
        found = _run(problem, "nodal", tolerance, max_iterations, {"variant": variant})
    return _timing(variant, problem, begun, built, time.process_time(), found)


def _run(
    problem: Problem, method: str, tolerance: float, limit: int | None, options: dict[str, str]
) -> Recorder:
    recorder = Recorder(SAFETY * tolerance)
    start = np.zeros((problem.n, problem.s))
    METHODS[method].run(problem, recorder, start, max_iterations=limit, **options)
    return recorder


def _timing(
    route: str, problem: Problem, begun: float, built: float, ended: float, recorder: Recorder
) -> Timing:
    assert recorder.best is not None
    residual = certify(problem, recorder.best).residual
    return Timing(route, built - begun, ended - built, recorder.history[-1].iteration, residual)
