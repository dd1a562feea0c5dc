"""`barchan reproduce`: published figures and tables computed again, theirs beside ours."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from barchan import reproductions
from barchan.cli import NOT_CONVERGED
from barchan.storage import write_text

RUNS_FOLDER = Path("runs")
WIDE = 200


def reproduce_command(name: str | None, out: Path | None, quick: bool, processes: int) -> int:
    """Run a reproduction and show its tables; the exit code. Raises InputError for bad input."""
    if name is None:
        list_reproductions()
        return 0
    words = reproductions.title(name)  # an unknown name leaves nothing behind
    folder = out or RUNS_FOLDER / f"reproduce-{name}{'-quick' if quick else ''}"
    report = reproductions.reproduce(name, folder, quick, processes)
    console = Console(width=None if sys.stdout.isatty() else WIDE)  # a file or pipe gets whole tables
    console.print(words, highlight=False)
    for table in report.tables:
        console.print(_shown(table))
    for note in report.notes:
        console.print(note, highlight=False, soft_wrap=True)
    write_text(folder / "tables.md", _markdown(words, report))
    console.print(f"tables, pictures and runs: {folder}", highlight=False, soft_wrap=True)
    if report.converged:
        return 0
    sys.stderr.write("barchan: not converged: some certificate misses its tolerance; the results are there\n")
    return NOT_CONVERGED


def list_reproductions() -> None:
    """A table of the reproductions on standard output."""
    table = Table("name", "what", title="reproductions", title_justify="left")
    for name in reproductions.NAMES:
        table.add_row(name, reproductions.title(name))
    Console().print(table)


def _markdown(words: str, report: reproductions.Report) -> str:
    """The report as it is kept beside the pictures."""
    lines = [f"# {words}", ""]
    for table in report.tables:
        lines += [
            table.title,
            "",
            "| " + " | ".join(table.columns) + " |",
            "| --- " * len(table.columns) + "|",
        ]
        lines += ["| " + " | ".join(row) + " |" for row in table.rows] + [""]
    return "\n".join(lines + list(report.notes)) + "\n"


def _shown(table: reproductions.Table) -> Table:
    shown = Table(*table.columns, title=table.title, title_justify="left")
    for row in table.rows:
        shown.add_row(*row)
    return shown
