"""What performance profiles say, in a table: shares solved within multiples of the best time, and who wins (Dolan, More)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barchan import friction
from barchan.bench import Measurement
from barchan.bench.profile import cost_table, performance_profile
from barchan.reproductions.workshop import Table

WITHIN = (1.0, 2.0, 10.0)  # multiples of the time of the fastest


def size_table(problems: Sequence[tuple[str, friction.Problem]]) -> Table:
    """How large the problems are."""
    return Table(
        "problems", ("problem", "blocks", "block size", "velocities"),
        [[name, str(problem.n), str(problem.s), str(problem.size)] for name, problem in problems],
    )  # fmt: skip


def profile_table(found: Sequence[Measurement], tolerance: float) -> Table:
    """Share of the problems that each solver brings to `tolerance` within a multiple of the time of the fastest."""
    problems, solvers, costs = cost_table(found)
    x, share = performance_profile(costs)
    heads = ("solver", *(f"within {multiple:g}x (%)" for multiple in WITHIN), "solved (%)", "median seconds")
    rows = []
    for k, solver in enumerate(solvers):
        shares = [share[np.searchsorted(x, multiple, side="right") - 1, k] for multiple in WITHIN]
        times = costs[np.isfinite(costs[:, k]), k]
        median = f"{np.median(times):.3g}" if len(times) else "-"
        rows.append(
            [solver, *(f"{100.0 * value:.0f}" for value in shares), f"{100.0 * len(times) / len(problems):.0f}", median]
        )  # fmt: skip
    return Table(f"{len(problems)} problems, certificate {tolerance:g}", heads, rows)


def wins(found: Sequence[Measurement]) -> dict[str, int]:
    """How many problems each solver solves fastest of all."""
    _, solvers, costs = cost_table(found)
    solved = np.isfinite(costs).any(axis=1)
    best = costs.min(axis=1, initial=np.inf)
    return {solver: int(np.sum(solved & (costs[:, k] <= best))) for k, solver in enumerate(solvers)}


def all_solved(found: Sequence[Measurement], problems: Sequence[tuple[str, friction.Problem]]) -> bool:
    """Whether some solver solved each problem."""
    return len({entry.problem for entry in found if entry.converged}) == len(problems)
