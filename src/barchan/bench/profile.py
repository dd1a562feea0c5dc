"""What a campaign says: Dolan and More's performance profiles, geometric-mean ratios to a peer, tables as CSV and Markdown.

Seed B, Figures 4.8 and 4.13: share of problems that a solver solves within a multiple x of the time of the fastest one.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

import numpy as np

from barchan.bench.measurement import LATE, Measurement

COLUMNS = ("problem", "solver", "converged", "certificate", "iterations", "milliseconds", "note")
STANDING = ("solver", "solved", "fastest", "time of the best peer / its time (geometric mean)")


def cost_table(
    measurements: Sequence[Measurement],
) -> tuple[list[str], list[str], np.ndarray]:
    """Names of problems and solvers, in order of appearance, and seconds (problems, solvers), infinite where not solved."""
    problems = list(dict.fromkeys(entry.problem for entry in measurements))
    solvers = list(dict.fromkeys(entry.solver for entry in measurements))
    costs = np.full((len(problems), len(solvers)), np.inf)
    for entry in measurements:
        costs[problems.index(entry.problem), solvers.index(entry.solver)] = entry.cost
    return problems, solvers, costs


def performance_profile(costs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Performance profiles.

    Parameters
    ----------
    costs : (problems, solvers), infinite where a solver failed.

    Returns
    -------
    x : (k,) increasing multiples of the best cost, from 1.  share : (k, solvers) of all problems, solved
        within x times the best. Source: Dolan and More 2002, Eqs. (2.1)-(2.2).
    """
    best = costs.min(axis=1, initial=np.inf)
    solved = np.isfinite(best)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(solved[:, None], costs / np.maximum(best, np.finfo(float).tiny)[:, None], np.inf)
    x = np.unique(np.concatenate([[1.0], ratios[np.isfinite(ratios)]]))
    share = (
        (ratios[None, :, :] <= x[:, None, None]).mean(axis=1) if len(costs) else np.zeros((1, costs.shape[1]))
    )
    return x, share


def ratio_to_best(costs: np.ndarray, solver: int, rivals: Sequence[int]) -> tuple[float, int]:
    """Geometric mean of (best rival / solver) over the problems that both solve, and how many those are."""
    if not len(rivals):
        return math.nan, 0
    theirs, ours = costs[:, list(rivals)].min(axis=1), costs[:, solver]
    both = np.isfinite(theirs) & np.isfinite(ours)
    if not both.any():
        return math.nan, 0
    return float(np.exp(np.log(theirs[both] / ours[both]).mean())), int(both.sum())


def as_csv(measurements: Sequence[Measurement]) -> str:
    """One line per problem and solver."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in measurements:
        writer.writerow(
            (
                entry.problem,
                entry.solver,
                entry.converged,
                f"{entry.certificate:.6g}",
                entry.iterations,
                f"{1e3 * entry.seconds:.6g}",
                entry.note,
            )
        )
    return stream.getvalue()


def as_markdown(measurements: Sequence[Measurement], peers: Sequence[str], heading: str) -> str:
    """A table of milliseconds (or the certificate missed), then the standing of every solver."""
    problems, solvers, _ = cost_table(measurements)
    cells = {(entry.problem, entry.solver): _cell(entry) for entry in measurements}
    body = [[name, *(cells.get((name, solver), "") for solver in solvers)] for name in problems]
    return "\n".join(
        [
            f"# {heading}\n",
            "Milliseconds and iterations of each solve; where the tolerance was missed, the certificate reached.\n",
            *_table(["problem", *solvers], body),
            "\n## Standing\n",
            *_table(list(STANDING), standing(measurements, peers)),
            "",
        ]
    )


def standing(measurements: Sequence[Measurement], peers: Sequence[str]) -> list[list[str]]:
    """Rows (solver, problems solved, times fastest, geometric mean of the best peer's time over its own)."""
    _, solvers, costs = cost_table(measurements)
    rivals = [k for k, solver in enumerate(solvers) if solver in peers]
    return [_standing(solvers, costs, k, rivals) for k in range(len(solvers))]


def _standing(solvers: list[str], costs: np.ndarray, k: int, rivals: list[int]) -> list[str]:
    ratio, shared = ratio_to_best(costs, k, [rival for rival in rivals if rival != k])
    solved = int(np.isfinite(costs[:, k]).sum())
    fastest = int((np.isfinite(costs[:, k]) & (costs[:, k] <= costs.min(axis=1, initial=np.inf))).sum())
    mean = f"{ratio:.3g} on {shared} problems" if shared else "-"
    return [solvers[k], f"{solved} of {len(costs)}", str(fastest), mean]


def _cell(entry: Measurement) -> str:
    if entry.converged:
        return f"{1e3 * entry.seconds:.3g} ms, {entry.iterations}"
    if math.isnan(entry.certificate):
        return entry.note.split(":")[0]
    return (
        f"{'late' if entry.note == LATE else 'no'}: {entry.certificate:.1e} in {1e3 * entry.seconds:.3g} ms"
    )


def _table(heads: list[str], rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[column]) for row in (heads, *rows)) for column in range(len(heads))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in (heads, *rows)
    ]
    rule = "| " + " | ".join("-" * width for width in widths) + " |"
    return [lines[0], rule, *lines[1:]]
