"""`barchan bench solvers`: chosen methods, and the solvers of Siconos, over a folder of problems; tables and pictures."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from barchan.bench import Measurement, Plan, problems_of_folder, run_campaign
from barchan.bench.profile import STANDING, standing
from barchan.friction import methods
from barchan.friction.samples import family

RUNS_FOLDER = Path("runs")


def bench_solvers(
    folder: Path | None, made: str, chosen: str, plan: Plan, out: Path | None, convexified: bool
) -> int:
    """Run the comparison and say where its files are; the exit code. Raises InputError for bad input."""
    names = (
        methods() if chosen == "all" else tuple(name.strip() for name in chosen.split(",") if name.strip())
    )
    plan = replace(plan, methods=names, peers=plan.peers and not convexified)
    problems = family(made) if folder is None else problems_of_folder(folder)
    if convexified:
        problems = [(name, replace(problem, law=problem.law.convexified())) for name, problem in problems]
    out = out or _new_folder()
    campaign = run_campaign(problems, plan, out, _tell)
    table = Table(*STANDING, title=f"certificate {plan.tolerance:g}", title_justify="left")
    for row in standing(campaign.measurements, campaign.peers):
        table.add_row(*row)
    Console().print(table)
    sys.stdout.write(f"results.csv, results.md, profile.png, residuals.png: {out}\n")
    return 0


def _tell(entry: Measurement) -> None:
    """One line of progress on standard error."""
    figures = (
        "" if math.isnan(entry.certificate) else f"{entry.certificate:.1e} in {1e3 * entry.seconds:.4g} ms"
    )
    sys.stderr.write(f"{entry.problem}  {entry.solver}  {figures or entry.note}\n")


def _new_folder() -> Path:
    """The first runs/bench-solvers-<n> that does not exist."""
    number = 1
    while (RUNS_FOLDER / f"bench-solvers-{number}").exists():
        number += 1
    return RUNS_FOLDER / f"bench-solvers-{number}"
