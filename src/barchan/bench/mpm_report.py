"""What `barchan bench mpm` leaves behind: steps.csv, results.md, results.json and column.png; each whole or not at all."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import platform
import statistics
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barchan.bench.mpm import DT, EQUAL, NEWTON, OWN, ColumnPlan, Comparison
from barchan.errors import InputError
from barchan.storage import replacing, unwritable, write_text

FILES = ("steps.csv", "results.md", "results.json", "column.png")
COLUMNS = ("solver", "block", "step", "milliseconds", "processor", "sweeps", "certificate")
HEADS = (
    "program",
    "ms a step",
    "Newton / this",
    "processor ms",
    "Newton / this",
    "sweeps",
    "median certificate",
    "worst certificate",
)
SHAPE_HEADS = ("program", "time (s)", "mean height (m)", "top (m)", "reach (m)", "excess (%)")
SAME_HEADS = ("block", "Newton (ms)", "its certificate", "barchan (ms)", "certificate", "sweeps")
SOLVERS = (NEWTON, EQUAL, OWN)


def write_report(out: Path, plan: ColumnPlan, found: Comparison) -> None:
    """Write the files into the folder `out`, made if needed. Raises InputError where that cannot be."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise InputError(str(out), "a file", "a folder") from error
    except OSError as error:
        raise unwritable(out, error) from error
    write_text(out / "steps.csv", as_csv(found))
    write_text(out / "results.md", as_markdown(plan, found))
    write_text(out / "results.json", json.dumps({"plan": vars(plan), **summary(found)}, indent=1) + "\n")
    draw(out / "column.png", found)


def as_csv(found: Comparison) -> str:
    """A line for every step of every program."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for step in found.steps:
        writer.writerow(
            (step.solver, step.block, step.step, f"{1e3 * step.seconds:.6g}", f"{1e3 * step.processor:.6g}", step.sweeps,
             f"{step.certificate:.6g}")
        )  # fmt: skip
    return stream.getvalue()


def standing(found: Comparison) -> list[list[str]]:
    """Rows of HEADS, a program each."""
    rows = []
    for solver, figures in summary(found)["solvers"].items():
        ratio, worked = figures["newton_over_this"], figures["newton_over_this_processor"]
        rows.append(
            [
                solver,
                f"{1e3 * figures['median_seconds']:.4g}",
                "-" if math.isnan(ratio) else f"{ratio:.3g}",
                f"{1e3 * figures['median_processor']:.4g}",
                "-" if math.isnan(worked) else f"{worked:.3g}",
                f"{figures['median_sweeps']:g}",
                f"{figures['median_certificate']:.1e}",
                f"{figures['worst_certificate']:.1e}",
            ]
        )
    return rows


def verdict(found: Comparison) -> str:
    """The comparison in a sentence."""
    if not found.of(EQUAL):
        return "Newton did not take part: the figures are those of barchan alone."
    return (
        f"At Newton's certificate or a better one in {100.0 * found.no_worse:.3g} % of the steps barchan is "
        f"{found.ratio(EQUAL):.3g} times as fast a step; at its own tolerance {found.ratio(OWN):.3g} times."
    )


def as_markdown(plan: ColumnPlan, found: Comparison) -> str:
    """The tables of the comparison."""
    machine = f"{os.cpu_count()} processors, {platform.machine()}, Python {platform.python_version()}"
    versions = ", ".join(f"{name} {version}" for name, version in found.versions.items())
    shapes = [
        [shape.solver, f"{shape.time:.4f}", f"{shape.mean_height:.4f}", f"{shape.top:.4f}", f"{shape.reach:.4f}",
         f"{100.0 * shape.excess:.1f}"]
        for shape in found.shapes
    ]  # fmt: skip
    same = [
        [str(entry.block + 1), f"{1e3 * entry.newton_seconds:.4g}", f"{entry.newton_certificate:.1e}",
         f"{1e3 * entry.seconds:.4g}", f"{entry.certificate:.1e}", str(entry.sweeps)]
        for entry in found.same
    ]  # fmt: skip
    lines = [
        f"# Column of {found.particles} particles, steps of 1/{1.0 / DT:.0f} s ({machine})\n",
        f"Newton: {versions or 'absent'}; one thread. barchan: threads = {plan.threads}, "
        f"tolerance {plan.tolerance:g}.\n",
        f"{verdict(found)}\n",
        *_table(HEADS, standing(found)),
        "\n## The column\n",
        *_table(SHAPE_HEADS, shapes),
    ]
    if same:
        lines += [
            "\n## Problems of Newton's steps, solved by both from Newton's start\n",
            *_table(SAME_HEADS, same),
        ]
    return "\n".join([*lines, *(f"\n{note}" for note in found.notes), ""])


def _table(heads: tuple[str, ...], rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in (list(heads), *rows)
    ]
    return [lines[0], "| " + " | ".join("-" * width for width in widths) + " |", *lines[1:]]


def draw(path: Path, found: Comparison) -> None:
    """Seconds and certificate of every step, and the shape of the column in time."""
    figure = Figure(figsize=(12.0, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    times, certificates, shape = figure.subplots(1, 3)
    for k, solver in enumerate(SOLVERS):
        steps = found.of(solver)
        if not steps:
            continue
        numbers = [step.step for step in steps]
        style = {"color": f"C{k}", "linewidth": 1.0}
        times.semilogy(numbers, [1e3 * step.seconds for step in steps], label=solver, **style)
        certificates.semilogy(numbers, [step.certificate for step in steps], **style)
        mine = [entry for entry in found.shapes if entry.solver == solver]
        now = [entry.time for entry in mine]
        shape.plot(now, [entry.top for entry in mine], "o-", markersize=3, **style)
        shape.plot(now, [entry.reach for entry in mine], "s--", markersize=3, **style)
    times.set(xlabel="step", ylabel="milliseconds a step")
    certificates.set(xlabel="step", ylabel="certificate")
    shape.set(xlabel="time (s)", ylabel="top (full), reach (dashed) (m)")
    for axis in (times, certificates, shape):
        axis.grid(alpha=0.3)
    times.legend(fontsize=7)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)


def summary(found: Comparison) -> dict[str, Any]:
    """The figures in short, for JSON."""
    solvers = {}
    for solver in SOLVERS:
        steps = found.of(solver)
        if steps:
            certificates = [step.certificate for step in steps]
            solvers[solver] = {
                "median_seconds": found.median_seconds(solver),
                "mean_seconds": statistics.fmean(step.seconds for step in steps),
                "median_sweeps": statistics.median(step.sweeps for step in steps),
                "median_certificate": statistics.median(certificates),
                "worst_certificate": max(certificates),
                "newton_over_this": found.ratio(solver),
                "median_processor": found.median_processor(solver),
                "newton_over_this_processor": found.median_processor(NEWTON) / found.median_processor(solver),
            }
    return {
        "particles": found.particles,
        "versions": found.versions,
        "solvers": solvers,
        "share_no_worse_than_newton": found.no_worse,
        "newton_own_residuals": found.own_residuals[-1] if found.own_residuals else None,
        "shapes": [vars(shape) for shape in found.shapes],
        "same_problems": [vars(entry) for entry in found.same],
        "notes": found.notes,
    }
