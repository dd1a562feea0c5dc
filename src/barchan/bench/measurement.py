"""One solver on one problem, measured: a method of barchan on a problem made anew, best of several repeats.

Every solve starts from zero after one that compiles; the time is that of the method with its set-up, not of the certificate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from barchan import friction
from barchan.errors import InputError

LONG = 1.0
LATE = "over the time limit"


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a solver did on a problem.

    certificate : residual reached, NaN where nothing was returned.  iterations, seconds : of the solve.
    converged : certificate <= tolerance in time.  history : (seconds, residual) pairs for curves.
    note : why it did not converge.
    """

    problem: str
    solver: str
    certificate: float = float("nan")
    iterations: int = 0
    seconds: float = float("nan")
    converged: bool = False
    history: list[tuple[float, float]] = field(default_factory=list)
    note: str = ""

    @property
    def cost(self) -> float:
        """Seconds of a success, infinite otherwise."""
        return self.seconds if self.converged else np.inf


def measure(
    name: str,
    problem: friction.Problem,
    method: str,
    tolerance: float,
    time_limit: float,
    repeats: int,
    label: str | None = None,
    **options: Any,
) -> Measurement:
    """Solve with a method of barchan; the shortest of `repeats` solves counts (one, where the first took LONG seconds).

    label : what the measurement calls the solver, `method` unless given.  options : of the method.

    The limit of time (s) acts through the callback of `solve`, hence at the next iterate that the method records: methods that
    record rarely (conic programs, Lemke) may overrun it.
    """

    def too_long(progress: friction.Progress, _: np.ndarray) -> bool:
        return progress.seconds > time_limit

    best: friction.Solution | None = None
    try:
        first = friction.solve(replace(problem), method, tol=tolerance, callback=too_long, **options)
        for _ in range(repeats if first.elapsed < LONG else 1):
            solution = friction.solve(replace(problem), method, tol=tolerance, callback=too_long, **options)
            if best is None or solution.elapsed < best.elapsed:
                best = solution
    except InputError as error:
        return Measurement(
            name, label or method, note=f"not for this problem: {error.field} must be {error.allowed}"
        )
    assert best is not None
    history = [(entry.seconds, entry.residual) for entry in best.history if np.isfinite(entry.residual)]
    late = best.elapsed > time_limit
    note = LATE if late else "" if best.converged else best.status
    return Measurement(
        name,
        label or method,
        best.certificate.residual,
        best.iterations,
        best.elapsed,
        best.converged and not late,
        [*history, (best.elapsed, best.certificate.residual)],
        note,
    )


Solver = Callable[[str, friction.Problem, float, float, int], Measurement]
"""(name of the problem, problem, tolerance, time limit in s, repeats) -> measurement."""
