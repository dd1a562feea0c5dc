"""A method run inside another: the convex problems of the fixed points of seed B 2.3.2, solved inexactly and warm-started."""

from __future__ import annotations

from typing import Any

import numpy as np

from barchan.errors import InputError
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder


def check_inner(method_name: str, options: dict[str, Any]) -> None:
    """InputError unless `method_name` is a known method that takes these options."""
    from barchan.friction.methods import METHODS  # the registry imports the methods that call this

    if method_name not in METHODS:
        raise InputError("inner", method_name, "one of " + ", ".join(METHODS))
    for name in options:
        if name not in METHODS[method_name].options:
            known = ", ".join(METHODS[method_name].options)
            raise InputError(f"option of inner {method_name}", name, f"one of {known}" if known else "absent")


def run_inner(
    problem_variant: Problem,
    method_name: str,
    r0: np.ndarray,
    tolerance: float,
    max_iterations: int | None,
    **options: Any,
) -> tuple[np.ndarray, int]:
    """Best forces (n, s) of `method_name` from `r0` (n, s) on the variant, and the iterations it made.

    tolerance : law residual of the variant at which to stop.  options : of the inner method.

    Raises
    ------
    InputError : unknown method or option.
    """
    from barchan.friction.methods import METHODS  # the registry imports the methods that call this

    check_inner(method_name, options)
    recorder = Recorder(tolerance)
    METHODS[method_name].run(problem_variant, recorder, r0.copy(), max_iterations=max_iterations, **options)
    best = r0 if recorder.best is None else recorder.best
    return best, recorder.history[-1].iteration if recorder.history else 0
