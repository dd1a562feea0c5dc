"""Table 4.3 of seed B: its eleven local solvers, and ours, inside the same sequential Gauss-Seidel on the same problems.

Every solver gets the same problems, start, order of sweeps and sweep limit. Counts come from one run; processor times from
others, without counting (shortest of the repeats, in turn). All solvers of Coulomb's law share the tests of take-off and of
sticking and the final check; the Newton kernels for s = 3 are unrolled for both functions alike. The pyramid alone cannot
meet the certificate; as in the seed's footnote 6 it is stopped by the length of its steps, at the length that
"fischer-burmeister+enumerative" typically (median) shows when it meets it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import thread_time

import numpy as np

from barchan.friction import Problem, Progress, Solution, solve
from barchan.friction.local import LocalCounts

PRIMARY = ("pyramid", "duriez", "alart-curnier", "alart-curnier-damped", "fischer-burmeister")
HYBRID = "fischer-burmeister+enumerative"
ELEVEN = (*PRIMARY, "enumerative", *(f"{name}+enumerative" for name in PRIMARY))
TWELVE = (*ELEVEN, "secular")
HEADS = (
    "local solver", "fail-safe %", "local failures %", "unsolved %", "iterations", "ms a problem", "ns a block",
    "over MFB+Enum",
)  # fmt: skip


@dataclass
class Row:
    """What one local solver did on all problems.

    counts : of its local solves.  iterations, solved, seconds, steps : of each problem: sweeps, whether it was solved,
    shortest processor time of the sweeps [s], relative change of the forces in the last sweep.
    """

    counts: LocalCounts = field(default_factory=LocalCounts)
    iterations: list[int] = field(default_factory=list)
    solved: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class LocalTable:
    """rows : of each local solver by name.  typical : steps at which the pyramid alone was stopped.  tolerance, sweeps."""

    rows: dict[str, Row]
    typical: float
    tolerance: float
    sweeps: int

    def lines(self) -> list[tuple[object, ...]]:
        """A line a solver, under HEADS."""
        fastest = float(np.mean(self.rows[HYBRID].seconds))
        return [_line(name, row, fastest) for name, row in self.rows.items()]


def compare(
    problems: Sequence[Problem],
    tolerance: float = 1e-6,
    sweeps: int = 2000,
    repeats: int = 3,
    tell: Callable[[str], object] = lambda name: None,
) -> LocalTable:
    """All twelve on `problems` (blocks of 3, Coulomb's law), to certificate `tolerance` within `sweeps`; `tell` hears names.

    Cost: (1 + repeats) solves a problem and local solver.
    """
    rows = {name: Row() for name in TWELVE}
    for name in TWELVE[1:]:
        tell(name)
        _count(rows[name], problems, name, tolerance, sweeps, 0.0)
    hybrid = rows[HYBRID]
    met = [step for step, solved in zip(hybrid.steps, hybrid.solved, strict=True) if solved]
    typical = float(np.median(met)) if met else tolerance
    _count(rows["pyramid"], problems, "pyramid", tolerance, sweeps, typical)
    for _ in range(repeats):
        for name in TWELVE:
            _time(rows[name], problems, name, tolerance, sweeps, typical if name == "pyramid" else 0.0)
    return LocalTable(rows, typical, tolerance, sweeps)


class _StepWatch:
    """Callback that measures the change of the forces per sweep, relative to them, and stops below `limit`."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.step = np.inf
        self.last: np.ndarray | None = None
        self.iteration = 0
        self.times: list[float] = []

    def __call__(self, progress: Progress, r: np.ndarray) -> bool:
        """True when the steps are shorter than the limit; notes the processor time of the thread."""
        self.times.append(thread_time())
        if self.last is not None:
            sweeps = max(progress.iteration - self.iteration, 1)
            self.step = float(np.linalg.norm(r - self.last)) / sweeps / max(float(np.linalg.norm(r)), 1e-300)
        self.last, self.iteration = r.copy(), progress.iteration
        return self.step < self.limit


def _run(
    problem: Problem, local_solver: str, tolerance: float, sweeps: int, watch: _StepWatch, counts: LocalCounts | None
) -> Solution:  # fmt: skip
    """One solve by sequential sweeps over the stored W."""
    return solve(
        problem, "gauss_seidel", tol=tolerance, max_iterations=sweeps, callback=watch, local_solver=local_solver,
        operator="explicit", parallel=False, check_every=5, counts=counts,
    )  # fmt: skip


def _count(
    row: Row, problems: Sequence[Problem], local_solver: str, tolerance: float, sweeps: int, limit: float
) -> None:
    """Fill everything of `row` but the seconds."""
    for problem in problems:
        watch = _StepWatch(limit)
        solution = _run(problem, local_solver, tolerance, sweeps, watch, row.counts)
        row.iterations.append(solution.iterations)
        row.steps.append(watch.step)
        row.solved.append(solution.converged or watch.step < limit)


def _time(
    row: Row, problems: Sequence[Problem], local_solver: str, tolerance: float, sweeps: int, limit: float
) -> None:
    """Add, or improve, the seconds each problem spends in the sweeps."""
    spent = []
    for problem in problems:
        watch = _StepWatch(limit)
        _run(problem, local_solver, tolerance, sweeps, watch, None)
        spent.append(watch.times[-1] - watch.times[0])
    row.seconds = [min(pair) for pair in zip(spent, row.seconds or spent, strict=True)]


def _line(name: str, row: Row, fastest: float) -> tuple[object, ...]:
    solves = max(row.counts.solves, 1)
    mean = float(np.mean(row.seconds))
    handed_on = 100.0 * row.counts.failsafe_calls / solves if "+" in name else None
    return (
        name,
        handed_on,
        100.0 * row.counts.failures / solves,
        100.0 * (1.0 - float(np.mean(row.solved))),
        float(np.mean(row.iterations)),
        1e3 * mean,
        1e9 * float(np.sum(row.seconds)) / solves,
        mean / fastest,
    )
