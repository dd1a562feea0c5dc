"""Table 4.3 of seed B in kind: eleven local solvers, and ours, inside the same sequential Gauss-Seidel on made problems.

Every solver gets the same problems (`samples.family("table")`: 120 of 10 to 200 contacts, s = 3), start, order of sweeps and
sweep limit. Counts come from one run; processor times from others, without counting (shortest of the repeats, in turn).
All solvers of Coulomb's law share the tests of take-off and of sticking and the final check; the Newton kernels for s = 3 are
unrolled for both functions alike. The pyramid alone cannot meet the certificate; as in the seed's footnote 6 it is stopped by
the length of its steps, at the length that "fischer-burmeister+enumerative" typically (median) shows when it meets it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from time import thread_time

import numba
import numpy as np

from _table import print_table
from barchan.friction import Problem, Solution, samples, solve
from barchan.friction.local import LocalCounts
from barchan.friction.solution import Progress

PRIMARY = ("pyramid", "duriez", "alart-curnier", "alart-curnier-damped", "fischer-burmeister")
HYBRID = "fischer-burmeister+enumerative"
ELEVEN = (*PRIMARY, "enumerative", *(f"{name}+enumerative" for name in PRIMARY))
TWELVE = (*ELEVEN, "secular")


@dataclass
class Row:
    """What one local solver did on all problems: counts, iterations, unsolved problems, seconds and last steps of each."""

    counts: LocalCounts = field(default_factory=LocalCounts)
    iterations: list[int] = field(default_factory=list)
    solved: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)


class StepWatch:
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


def run(
    problem: Problem, local_solver: str, sweeps: int, watch: StepWatch | None, counts: LocalCounts | None
) -> Solution:
    """One solve to 1e-6 by sequential sweeps over the stored W."""
    return solve(
        problem, "gauss_seidel", tol=1e-6, max_iterations=sweeps, callback=watch, local_solver=local_solver,
        operator="explicit", parallel=False, check_every=5, counts=counts,
    )  # fmt: skip


def count(row: Row, problems: list[Problem], local_solver: str, sweeps: int, limit: float) -> None:
    """Fill everything of `row` but the seconds."""
    for problem in problems:
        watch = StepWatch(limit)
        solution = run(problem, local_solver, sweeps, watch, row.counts)
        row.iterations.append(solution.iterations)
        row.steps.append(watch.step)
        row.solved.append(solution.converged or watch.step < limit)


def time(row: Row, problems: list[Problem], local_solver: str, sweeps: int, limit: float) -> None:
    """Add, or improve, the seconds each problem spends in the sweeps."""
    spent = []
    for problem in problems:
        watch = StepWatch(limit)
        run(problem, local_solver, sweeps, watch, None)
        spent.append(watch.times[-1] - watch.times[0])
    row.seconds = [min(pair) for pair in zip(spent, row.seconds or spent, strict=True)]


def line(name: str, row: Row, fastest: float) -> tuple[object, ...]:
    """A line of the table."""
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


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--family", default="table", help="a family of barchan.friction.samples with s = 3")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sweeps", type=int, default=2000, help="limit on the sweeps of a problem")
    parser.add_argument("--repeats", type=int, default=3)
    choice = parser.parse_args()
    numba.set_num_threads(1)
    named = samples.family(choice.family, choice.seed)
    problems = [problem for _, problem in named if problem.s == 3]
    rows = {name: Row() for name in TWELVE}
    for name in TWELVE[1:]:
        count(rows[name], problems, name, choice.sweeps, 0.0)
    hybrid = rows[HYBRID]
    typical = float(np.median([step for step, met in zip(hybrid.steps, hybrid.solved, strict=True) if met]))
    count(rows["pyramid"], problems, "pyramid", choice.sweeps, typical)
    for _ in range(choice.repeats):
        for name in TWELVE:
            time(rows[name], problems, name, choice.sweeps, typical if name == "pyramid" else 0.0)
    heads = (
        "local solver", "fail-safe %", "local failures %", "unsolved %", "iterations", "ms a problem",
        "ns a block", "over MFB+Enum",
    )  # fmt: skip
    fastest = float(np.mean(hybrid.seconds))
    title = (
        f"{len(problems)} problems, tolerance 1e-6, at most {choice.sweeps} sweeps, one thread; the pyramid alone stops at "
        f"steps of {typical:.1e}"
    )
    print_table(title, heads, [line(name, rows[name], fastest) for name in TWELVE])


if __name__ == "__main__":
    main()
