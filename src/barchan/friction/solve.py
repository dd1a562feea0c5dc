"""One entrance to every solver: `solve(problem, method, tol)`; any method on any law and operator.

A solve that misses its tolerance returns the best iterate with `converged=False` and never pretends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.friction.existence import NONE, data_size, existence_of
from barchan.friction.methods import METHODS, Method, method_for
from barchan.friction.problem import Problem
from barchan.friction.solution import Progress, Recorder, Solution, finish
from barchan.linalg import one_blas_thread

SAFETY = 0.9
LARGEST_CHECKED = 6000
DOUBTFUL = 1e3


def methods() -> tuple[str, ...]:
    """Names accepted by `solve(method=...)`; for `FacetedCoulomb` these are "auto" and "faceted_gauss_seidel"."""
    return tuple(METHODS)


def solve(
    problem: Problem,
    method: str = "auto",
    tol: float = 1e-6,
    r0: np.ndarray | None = None,
    max_iterations: int | None = None,
    callback: Callable[[Progress, np.ndarray], object] | None = None,
    check_existence: bool = False,
    **options: Any,
) -> Solution:
    """Solve a frictional problem.

    Parameters
    ----------
    method : one of `methods()`; "auto" is a portfolio of the others (see `barchan.friction.auto`).
    tol : required residual of the certificate.
    r0 : (n s,) or (n, s) initial forces.
    max_iterations : of the method (None: its own default).
    callback : called with (Progress, r) at each recorded iterate; returning True stops the solve.
    check_existence : first ask whether there is a solution (`barchan.friction.existence`); where there is none the method is
        not run and the status is "no solution". Asked of itself when "auto" fails within its own limits, and when forces
        grew beyond all proportion to the data.
    options : passed on to the method (see `gauss_seidel`, `aspg`).

    Raises
    ------
    InputError : unknown method or option, a method that does not solve the law, tol <= 0, r0 of the wrong size or not finite.
    """
    chosen = method_for(problem.law, method)
    if not (math.isfinite(tol) and tol > 0.0):
        raise InputError("tol", tol, "finite and > 0")
    if max_iterations is not None and max_iterations < 0:
        raise InputError("max_iterations", max_iterations, ">= 0")
    _check_options(method, chosen, options)
    start = _start(problem, r0)
    recorder = Recorder(SAFETY * tol, callback)
    with one_blas_thread():
        proof = existence_of(problem) if check_existence else None
        if problem.n == 0 or (proof is not None and proof.verdict == NONE):
            recorder.record(0, 0.0 if problem.n == 0 else math.inf, start)
        else:
            chosen.run(problem, recorder, start, max_iterations=max_iterations, **options)
        unlimited = method == "auto" and max_iterations is None
        if proof is None and _is_doubtful(problem, recorder, unlimited):
            proof = existence_of(problem)
        return finish(problem, recorder, method, tol, proof)


def _is_doubtful(problem: Problem, recorder: Recorder, unlimited: bool) -> bool:
    """Whether to ask if there is a solution: "auto" failed within its own limits, or forces are out of proportion to the data.

    Without a solution forces grow for ever and the residual, relative to them, falls: it alone would call that convergence.
    """
    if recorder.stopped or recorder.best is None or not 0 < problem.n * problem.s <= LARGEST_CHECKED:
        return False
    if recorder.best_residual > recorder.tolerance:
        return unlimited
    size = float(np.linalg.norm(recorder.best / np.sqrt(problem.rho)[:, None]))
    return size > DOUBTFUL * data_size(problem)


def _start(problem: Problem, r0: np.ndarray | None) -> np.ndarray:
    if r0 is None:
        return np.zeros((problem.n, problem.s))
    start = np.asarray(r0, dtype=float)
    if start.size != problem.n * problem.s:
        raise InputError("r0", f"array of shape {start.shape}", f"of {problem.n * problem.s} entries")
    if not np.isfinite(start).all():
        raise InputError("r0", "array with NaN or infinite entries", "finite")
    return start.reshape(problem.n, problem.s)


def _check_options(method: str, chosen: Method, options: dict[str, Any]) -> None:
    allowed = chosen.options
    for name in options:
        if name not in allowed:
            known = "one of " + ", ".join(allowed) if allowed else "absent: this method has no options"
            raise InputError(f"option of {method}", name, known)
