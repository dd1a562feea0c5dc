"""Flow past a cylinder, DFG 2D-1, of four fluids: drag, lift and nonlinear iterations by level (seed C, 5.2, Tables 6-9).

Every level starts from the solution on the next coarser one; iterations are those of the level itself.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from barchan.flows.quasi_newtonian import NonlinearOptions, PowerLaw, Weights
from barchan.reproductions.flow_solves import History, Wanted, solve_all
from barchan.reproductions.workshop import (
    Finished,
    Job,
    Report,
    Table,
    Workshop,
    all_converged,
    new_figure,
    published,
)

TITLE = "Flow of four fluids past a cylinder: drag, lift, iterations (seed C, Tables 6-9)"

FLUIDS = ("newtonian", "shear-thinning", "shear-thickening", "bingham")
LEVELS = (3, 4, 5)
METHODS = ("newton", "fixed-point")
TOLERANCE = 1e-8
MOST = 60
"""Steps after which an iteration is stopped; the longest published fixed point takes 32."""
THICKENING = PowerLaw(1e-3, 3.0, 0.1**0.5)
DAMPING = 0.7
"""Of a damped fixed point for the thickening fluid, the plain one of which hardly converges: in it errors change sign."""
MULTIGRID_FROM = 5
"""Level from which multigrid solves its systems."""

Key = tuple[str, int, str]


def reproduce(workshop: Workshop) -> Report:
    """Four fluids on three levels, by Newton's method and by the fixed point; quickly the coarsest level only."""
    levels = LEVELS[:1] if workshop.quick else LEVELS
    keys = [(fluid, level, method) for level in levels for fluid in FLUIDS for method in _methods(fluid)]
    runs = dict(zip(keys, workshop.run([_job(*key) for key in keys]), strict=True))
    damped = solve_all(workshop, [_damped(level) for level in levels])
    counts = {level: histories[0] for level, histories in zip(levels, damped, strict=True)}
    _write(workshop, runs)
    _draw(workshop, runs, levels)
    tables = [*(_table(fluid, levels, runs, counts) for fluid in FLUIDS), _residual_table(runs, levels)]
    notes = [
        "Deviations are from the published values of the same level and from the references that seed C quotes.",
        _order_note(runs, levels),
    ]
    own = [run for (_, _, method), run in runs.items() if method != "fixed-point"]
    return Report(tables, notes, all_converged(own))


def _methods(fluid: str) -> tuple[str, ...]:
    """The stress-velocity method differs from Newton's where there is a yield stress."""
    return (*METHODS, "stress-velocity") if fluid == "bingham" else METHODS


def _job(fluid: str, level: int, method: str) -> Job:
    return Job(
        f"{fluid}-{method}-{level}",
        "cylinder_dfg",
        {
            "fluid": fluid,
            "level": level,
            "method": method,
            "max_iterations": MOST,
            "tolerance": TOLERANCE,
            "start": "nested",
            # Few cycles of multigrid for a step would hide that Newton's method converges quadratically.
            "linear_solver": "direct" if method == "newton" else "auto",
        },
    )


def _damped(level: int) -> Wanted:
    options = NonlinearOptions(
        "damped-newton", TOLERANCE, MOST, delta=Weights(0.0, 0.0, 0.0), damping=DAMPING
    )
    solver = "multigrid" if level >= MULTIGRID_FROM else "direct"
    return Wanted(
        f"thickening-damped-{level}", "cylinder_dfg", level, (THICKENING,), options, solver, nested=True
    )


def _table(
    fluid: str, levels: tuple[int, ...], runs: dict[Key, Finished], damped: dict[int, History]
) -> Table:
    theirs = {row["level"]: row for row in published("cylinder_benchmark") if row["fluid"] == fluid}
    reference = theirs["reference"]
    rows = []
    for level in levels:
        row, found = theirs[str(level)], runs[fluid, level, "newton"].summary
        cells = [str(level), str(found["unknowns"])]
        for name, form in (("drag", ".7g"), ("lift", ".6e")):
            value = float(found[name])
            cells += [
                row[name], format(value, form), _deviation(value, row[name]), _deviation(value, reference[name]),
            ]  # fmt: skip
        cells += [row["fixed_point_its"], _steps(runs[fluid, level, "fixed-point"])]
        cells += [row["newton_its"], _steps(runs[fluid, level, "newton"])]
        if fluid == "bingham":
            cells.append(_steps(runs[fluid, level, "stress-velocity"]))
        if fluid == "shear-thickening":
            cells.append(damped[level].count)
        rows.append(cells)
    columns = [
        "level", "unknowns", "drag", "ours", "deviation", "from reference", "lift", "ours", "deviation", "from reference",
        "fixed point", "ours", "Newton", "ours",
    ]  # fmt: skip
    if fluid == "bingham":
        columns.append("stress-velocity")
    if fluid == "shear-thickening":
        columns.append(f"fixed point damped by {DAMPING:g}")
    number = 6 + FLUIDS.index(fluid)
    return Table(
        f"Table {number}, {fluid}: reference drag {reference['drag']}, lift {reference['lift']}",
        columns,
        rows,
    )


def _steps(run: Finished) -> str:
    steps = f"{run.summary['nonlinear_iterations']:.0f}"
    return steps if run.summary["converged"] else f"not in {steps}"


def _deviation(value: float, reference: str) -> str:
    return f"{100.0 * (value / float(reference) - 1.0):+.3f} %"


def orders(residuals: np.ndarray) -> list[float]:
    """Orders of convergence log(R_n+1 / R_n) / log(R_n / R_n-1) of falling residuals above round-off."""
    kept = [float(norm) for norm in residuals if norm > 1e-13 * np.max(residuals)]
    falls = [float(np.log(after / before)) for before, after in pairwise(kept)]
    return [late / early for early, late in pairwise(falls) if early < 0.0]


def _residual_table(runs: dict[Key, Finished], levels: tuple[int, ...]) -> Table:
    """Residuals of Newton's method on the finest level, each started from the level before."""
    lines = [(fluid, runs[fluid, levels[-1], "newton"].observables["residuals"]) for fluid in FLUIDS]
    longest = max(len(norms) for _, norms in lines)
    rows = [
        (fluid, *(f"{norm:.1e}" for norm in norms), *[""] * (longest - len(norms))) for fluid, norms in lines
    ]
    heads = ("fluid", "start", *(f"step {n}" for n in range(1, longest)))
    return Table(f"residuals of Newton's method, level {levels[-1]}", heads, rows)


def _order_note(runs: dict[Key, Finished], levels: tuple[int, ...]) -> str:
    texts = []
    for fluid in FLUIDS:
        found = orders(runs[fluid, levels[-1], "newton"].observables["residuals"])
        texts.append(f"{fluid} " + (f"{max(found):.1f}" if found else "too few steps"))
    return "Orders of convergence that Newton's method reaches on the finest level: " + ", ".join(texts) + "."


def _write(workshop: Workshop, runs: dict[Key, Finished]) -> None:
    rows: list[tuple[Any, ...]] = []
    residuals: list[tuple[Any, ...]] = []
    for key, run in runs.items():
        found = run.summary
        rows.append(
            (*key, found["drag"], found["lift"], _steps(run), found["worst_certificate"], found["unknowns"])
        )
        residuals += [(*key, step, norm) for step, norm in enumerate(run.observables["residuals"])]
    columns = ("fluid", "level", "method", "drag", "lift", "iterations", "residual", "unknowns")
    workshop.write_csv("benchmark.csv", columns, rows)
    workshop.write_csv("residuals.csv", (*columns[:3], "step", "residual"), residuals)


def _draw(workshop: Workshop, runs: dict[Key, Finished], levels: tuple[int, ...]) -> None:
    """Residuals on the finest level, fluid by fluid."""
    figure = new_figure(12.0, 3.4)
    for axis, fluid in zip(figure.subplots(1, len(FLUIDS)), FLUIDS, strict=True):
        for method in _methods(fluid):
            residuals = runs[fluid, levels[-1], method].observables["residuals"]
            axis.semilogy(residuals, ".-", label=method, linewidth=1.0)
        axis.set(xlabel="nonlinear iteration", title=f"{fluid}, level {levels[-1]}")
        axis.set_ylabel("residual")
        axis.title.set_fontsize(9)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    workshop.save("benchmark.png", figure)
