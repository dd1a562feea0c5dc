"""`barchan solve`: one friction problem from a file, its solution and certificate."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from barchan import friction
from barchan.cli import NOT_CONVERGED
from barchan.errors import InputError


def solve_command(file: Path, method: str, tolerance: float, check_existence: bool = False) -> int:
    """Solve the problem in `file`; the exit code. Raises InputError for bad input."""
    if method not in friction.methods():
        raise InputError("--method", method, "one of " + ", ".join(friction.methods()))
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise InputError("--tol", tolerance, "a finite number > 0")
    problem = friction.read(file)
    solution = friction.solve(problem, method=method, tol=tolerance, check_existence=check_existence)
    Console().print(_table(file, problem, solution))
    if solution.converged:
        return 0
    if solution.status == "no solution":
        sys.stderr.write(f"barchan: {solution.message}\n")
        return NOT_CONVERGED
    sys.stderr.write(
        f"barchan: not converged: certificate {solution.certificate.residual:.2e} misses the tolerance "
        f"{tolerance:g} ({solution.message})\n"
    )
    return NOT_CONVERGED


def _table(file: Path, problem: friction.Problem, solution: friction.Solution) -> Table:
    """Size, method, cost and the three parts of the certificate."""
    table = Table(title=file.name, title_justify="left", show_header=False)
    certificate = solution.certificate
    rows = [
        ("blocks n", f"{problem.n}"),
        ("block size s", f"{problem.s}"),
        ("method", solution.method),
        ("iterations", f"{solution.iterations}"),
        (
            "certificate",
            f"{certificate.residual:.2e}  ({'converged' if solution.converged else 'not converged'})",
        ),
        ("  law", f"{certificate.law:.2e}"),
        ("  balance", f"{certificate.balance:.2e}"),
        ("  bilateral", f"{certificate.bilateral:.2e}"),
        ("seconds", f"{solution.elapsed:.3g}"),
    ]
    if solution.existence is not None:
        rows.append(("existence", str(solution.existence)))
    for name, value in rows:
        table.add_row(name, value)
    return table
