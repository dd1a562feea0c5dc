"""One entrance to every solver: `solve(problem, method, tol)`; any method on any law and operator.

A solve that misses its tolerance returns the best iterate with `converged=False` and never pretends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.friction.methods import METHODS
from barchan.friction.problem import Problem
from barchan.friction.solution import Progress, Recorder, Solution, finish
from barchan.linalg import one_blas_thread

SAFETY = 0.9


def methods() -> tuple[str, ...]:
    """Names accepted by `solve(method=...)`."""
    return tuple(METHODS)


def solve(
    problem: Problem,
    method: str = "auto",
    tol: float = 1e-6,
    r0: np.ndarray | None = None,
    max_iterations: int | None = None,
    callback: Callable[[Progress, np.ndarray], object] | None = None,
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
    options : passed on to the method (see `gauss_seidel`, `aspg`).

    Raises
    ------
    InputError : unknown method or option, tol <= 0, r0 of the wrong size or not finite.
    """
    if method not in methods():
        raise InputError("method", method, "one of " + ", ".join(methods()))
    if not (math.isfinite(tol) and tol > 0.0):
        raise InputError("tol", tol, "finite and > 0")
    if max_iterations is not None and max_iterations < 0:
        raise InputError("max_iterations", max_iterations, ">= 0")
    _check_options(method, options)
    start = _start(problem, r0)
    recorder = Recorder(SAFETY * tol, callback)
    with one_blas_thread():
        if problem.n == 0:
            recorder.record(0, 0.0, start)
        else:
            METHODS[method].run(problem, recorder, start, max_iterations=max_iterations, **options)
        return finish(problem, recorder, method, tol)


def _start(problem: Problem, r0: np.ndarray | None) -> np.ndarray:
    if r0 is None:
        return np.zeros((problem.n, problem.s))
    start = np.asarray(r0, dtype=float)
    if start.size != problem.n * problem.s:
        raise InputError("r0", f"array of shape {start.shape}", f"of {problem.n * problem.s} entries")
    if not np.isfinite(start).all():
        raise InputError("r0", "array with NaN or infinite entries", "finite")
    return start.reshape(problem.n, problem.s)


def _check_options(method: str, options: dict[str, Any]) -> None:
    allowed = METHODS[method].options
    for name in options:
        if name not in allowed:
            known = "one of " + ", ".join(allowed) if allowed else "absent: this method has no options"
            raise InputError(f"option of {method}", name, known)
