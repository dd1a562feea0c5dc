"""What the benchmarks share: a small Markdown table, and where barchan lies when it is not installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

SOURCES = Path(__file__).resolve().parent.parent / "src"
sys.path.insert(0, str(SOURCES))


def environment(**changes: str) -> dict[str, str]:
    """Environment of a child process that imports the barchan of this repository."""
    return {**os.environ, "PYTHONPATH": str(SOURCES), **changes}


def print_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print rows under heads as Markdown; numbers with three significant digits, columns of equal width."""
    cells = [list(heads), *([_text(value) for value in row] for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(heads))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "| " + " | ".join("-" * width for width in widths) + " |"
    print("\n".join([f"\n{title}\n", lines[0], rule, *lines[1:]]), flush=True)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return "" if value is None else str(value)
