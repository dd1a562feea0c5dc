"""`barchan bench`: tables and pictures of a comparison.

`solvers`: chosen methods, and the solvers of Siconos, over a folder of problems. `siconos`: Siconos on single FCLIB files.
`mpm`: a column of sand beside NVIDIA Newton.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from barchan import friction
from barchan.bench import Measurement, Plan, problems_of_folder, run_campaign
from barchan.bench.fclib_exchange import siconos_answer
from barchan.bench.mpm import ColumnPlan, compare
from barchan.bench.mpm_report import FILES, HEADS, verdict, write_report
from barchan.bench.mpm_report import standing as standing_of_programs
from barchan.bench.newton import ADVICE, find_newton
from barchan.bench.profile import STANDING, standing
from barchan.errors import InputError
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
    out = out or _new_folder("solvers")
    campaign = run_campaign(problems, plan, out, _tell)
    table = Table(*STANDING, title=f"certificate {plan.tolerance:g}", title_justify="left")
    for row in standing(campaign.measurements, campaign.peers):
        table.add_row(*row)
    Console().print(table)
    sys.stdout.write(f"results.csv, results.md, profile.png, residuals.png: {out}\n")
    return 0


def bench_siconos(files: list[Path], tolerance: float) -> int:
    """Let Siconos solve FCLIB files and certify its answers; the exit code. Raises InputError for bad input."""
    table = Table("file", "contacts", "iterations", "law", "balance", title="Siconos, our certificate")
    missed = False
    for path in files:
        answer = siconos_answer(path, tolerance)
        found = answer.certificate
        missed |= not answer.content
        contacts = len(answer.solution.r) // friction.read(path).s
        table.add_row(
            path.name, str(contacts), str(answer.iterations), f"{found.law:.1e}", f"{found.balance:.1e}"
        )
    Console().print(table)
    return 3 if missed else 0


def bench_mpm(plan: ColumnPlan, newton: Path | None, alone: bool, out: Path | None) -> int:
    """Run the column, with Newton where it is and wanted, and say where the files are; the exit code."""
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(str(out), "a file", "a folder")
    interpreter = None if alone else find_newton(newton)
    if interpreter is None and not alone:
        sys.stderr.write(f"barchan: Newton is not there, only barchan is measured; {ADVICE}\n")
    found = compare(plan, interpreter, _line)
    for note in found.notes:
        sys.stderr.write(f"barchan: {note}\n")
    out = out or _new_folder("mpm")
    write_report(out, plan, found)
    table = Table(*HEADS, title=f"{found.particles} particles", title_justify="left")
    for row in standing_of_programs(found):
        table.add_row(*row)
    Console().print(table)
    sys.stdout.write(f"{verdict(found)}\n{', '.join(FILES)}: {out}\n")
    return 0


def _line(text: str) -> None:
    sys.stderr.write(f"{text}\n")


def _tell(entry: Measurement) -> None:
    """One line of progress on standard error."""
    figures = (
        "" if math.isnan(entry.certificate) else f"{entry.certificate:.1e} in {1e3 * entry.seconds:.4g} ms"
    )
    sys.stderr.write(f"{entry.problem}  {entry.solver}  {figures or entry.note}\n")


def _new_folder(name: str) -> Path:
    """The first runs/bench-<name>-<n> that does not exist."""
    number = 1
    while (RUNS_FOLDER / f"bench-{name}-{number}").exists():
        number += 1
    return RUNS_FOLDER / f"bench-{name}-{number}"
