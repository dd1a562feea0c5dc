"""Couette flow of the modified Poliquen model: nonlinear steps, multigrid cycles and seconds by level.

Seed C, 6.3: Tables 14-16. Every solve is timed alone; each starts from coarser levels, whose solution its seconds include.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from barchan.flows.quasi_newtonian import NonlinearOptions
from barchan.reproductions.couette_lines import couette_fluid
from barchan.reproductions.flow_solves import History, Wanted, run_solves, solve_all
from barchan.reproductions.workshop import Report, Table, Workshop, new_figure, published

TITLE = "Couette flow of granular matter: cost by level, direct and multigrid (seed C, Tables 14-16)"

LEVELS = (2, 3, 4, 5, 6)
QUICK_LEVELS = (2, 3)
FINEST = 7
"""Solved by multigrid with the first gain only, and not quickly."""
GAINS = ("1e-1", "1e-2", "1e-3", "1e-4")
EPSILONS = ("1e-2", "1e-3")
METHODS: dict[str, dict[str, Any]] = {
    "f3": {"method": "adaptive-newton", "strategy": "f3", "delta0": 0.5},
    "stress-velocity": {"method": "stress-velocity"},
}
MOST = 200

Key = tuple[str, str, str, int]
"""Method, gain ("direct" for sparse elimination), eps, level."""


def reproduce(workshop: Workshop) -> Report:
    """Levels 2 to 7; quickly 2 and 3 with two gains."""
    levels = QUICK_LEVELS if workshop.quick else LEVELS
    gains = GAINS[:2] if workshop.quick else GAINS
    keys: list[Key] = [
        (method, gain, eps, level)
        for level in levels
        for method in METHODS
        for gain in ("direct", *gains)
        for eps in EPSILONS
        if gain != "direct" or eps == EPSILONS[0]
    ]
    if not workshop.quick:
        keys += [(method, GAINS[0], eps, FINEST) for method in METHODS for eps in EPSILONS]
    run_solves(_wanted(next(iter(METHODS)), GAINS[0], EPSILONS[0], 2))  # compiled before anything is timed
    found = solve_all(workshop, [_wanted(*key) for key in keys], processes=1)
    ours = {key: histories[0] for key, histories in zip(keys, found, strict=True)}
    _write(workshop, ours)
    _draw(workshop, ours)
    shown = sorted({key[3] for key in keys})
    tables = [_cost_table(shown, ours), *(_gain_table(gain, shown, ours) for gain in gains)]
    return Report(tables, _notes(ours), all(history.converged for history in ours.values()))


def _wanted(method: str, gain: str, eps: str, level: int) -> Wanted:
    fluid = replace(couette_fluid(), eps=float(eps))
    options = NonlinearOptions(max_iterations=MOST, **METHODS[method])
    direct = gain == "direct"
    return Wanted(
        f"{method}-{gain}-eps{eps}-level{level}", "couette", level, (fluid,), options,
        "direct" if direct else "multigrid", True, 0.1 if direct else float(gain),
    )  # fmt: skip


def _cell(history: History | None) -> str:
    """Steps / cycles a step, seconds."""
    if history is None:
        return ""
    cycles = f"/{history.mean_cycles:.2g}" if history.mean_cycles else ""
    return f"{history.count}{cycles}, {history.seconds:.3g} s"


def _cost_table(levels: list[int], ours: dict[Key, History]) -> Table:
    """Table 14: sparse elimination and multigrid."""
    theirs = {int(row["level"]): row for row in published("couette")}
    rows = []
    for level in levels:
        row = theirs[level]
        unknowns = next(history.unknowns for key, history in ours.items() if key[3] == level)
        cells = [
            str(level),
            row["unknowns"],
            str(unknowns),
            f"{row['NL_direct_eps1e-2']}, {row['cpu_direct']} s",
        ]
        cells += [_cell(ours.get((method, "direct", "1e-2", level))) for method in METHODS]
        for eps in EPSILONS:
            cells.append(f"{row[f'NL_MG_eps{eps}']}/{row[f'MG_eps{eps}']}, {row[f'cpu_MG_eps{eps}']} s")
            cells += [_cell(ours.get((method, GAINS[0], eps, level))) for method in METHODS]
        rows.append(cells)
    own = [f"ours, {method}" for method in METHODS]
    columns = [
        "level", "unknowns", "ours", "direct, eps = 1e-2", *own, "multigrid, eps = 1e-2", *own, "multigrid, eps = 1e-3", *own,
    ]  # fmt: skip
    return Table("Table 14: steps / multigrid cycles a step, seconds (ours: gain 1e-1)", columns, rows)


def _gain_table(gain: str, levels: list[int], ours: dict[Key, History]) -> Table:
    """Table 15 or 16: one gain."""
    theirs = {
        (row["eps"], int(row["level"])): row for row in published("couette_gains") if row["gain"] == gain
    }
    rows = []
    for level in levels:
        cells = [str(level)]
        for eps in EPSILONS:
            row = theirs[eps, level]
            cells.append(f"{row['NL']}/{row['MG']}, {row['cpu']} s")
            cells += [_cell(ours.get((method, gain, eps, level))) for method in METHODS]
        if any(cells[2::3]):
            rows.append(cells)
    own = [f"ours, {method}" for method in METHODS]
    number = 15 if gain in GAINS[:2] else 16
    columns = ["level", *(head for eps in EPSILONS for head in (f"eps = {eps}", *own))]
    return Table(f"Table {number}: gain {gain}", columns, rows)


def _notes(ours: dict[Key, History]) -> list[str]:
    default = [history for key, history in ours.items() if key[0] == "stress-velocity"]
    adaptive = [history for key, history in ours.items() if key[0] == "f3"]
    cycles = [history.mean_cycles for key, history in ours.items() if key[1] == GAINS[0]]
    return [
        f"Most nonlinear steps: f3 {max(history.iterations for history in adaptive)}, "
        f"stress-velocity {max(history.iterations for history in default)}.",
        f"Most cycles a step with gain {GAINS[0]}: {max(cycles):.2g}.",
        "Published seconds are of another machine, and seed C does not say how its solves start.",
    ]


def _write(workshop: Workshop, ours: dict[Key, History]) -> None:
    rows = [
        (*key, found.unknowns, found.iterations, found.mean_cycles, found.seconds, found.converged)
        for key, found in ours.items()
    ]
    columns = ("method", "gain", "eps", "level", "unknowns", "steps", "cycles", "seconds", "converged")
    workshop.write_csv("solves.csv", columns, rows)


def _draw(workshop: Workshop, ours: dict[Key, History]) -> None:
    """Seconds against unknowns, published and ours."""
    figure = new_figure(6.0, 4.5)
    axis = figure.subplots()
    theirs = published("couette")
    sizes = [int(row["unknowns"]) for row in theirs]
    axis.loglog(
        sizes, [float(row["cpu_direct"]) for row in theirs], "s:", color="0.4", label="published, direct"
    )
    axis.loglog(
        sizes,
        [float(row["cpu_MG_eps1e-2"]) for row in theirs],
        "o:",
        color="0.4",
        label="published, multigrid",
    )
    for method in METHODS:
        for gain in ("direct", GAINS[0]):
            points = [
                (found.unknowns, found.seconds)
                for key, found in ours.items()
                if key[:3] == (method, gain, EPSILONS[0])
            ]
            words = "direct" if gain == "direct" else "multigrid"
            axis.loglog(
                *np.array(points).T, "o-", label=f"ours, {method}, {words}", linewidth=1.0, markersize=4
            )
    axis.set(xlabel="unknowns", ylabel="seconds", title=f"eps = {EPSILONS[0]}")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=7)
    workshop.save("cost.png", figure)
