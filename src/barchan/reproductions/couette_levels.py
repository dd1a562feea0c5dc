"""Couette flow of the modified Poliquen model: cut lines by level, against each other and the exact ones.

Seed C, 6.4 and 6.5: Tables 18-19, Fig. 18-19 (eps = 0.01).
"""

from __future__ import annotations

from barchan.reproductions.couette_lines import (
    QUANTITIES,
    couette_job,
    distance,
    distance_to_exact,
    draw_lines,
    figures,
)
from barchan.reproductions.flow_solves import beside
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, published

TITLE = "Couette flow of granular matter: cut lines by level (seed C, Tables 18-19 and Fig. 18-19)"

LEVELS = (2, 3, 4, 5, 6, 7)
QUICK_LEVELS = (2, 3, 4)
EPS = 0.01


def reproduce(workshop: Workshop) -> Report:
    """Levels 2 to 7; quickly 2 to 4."""
    levels = QUICK_LEVELS if workshop.quick else LEVELS
    runs = dict(zip(levels, workshop.run([couette_job(level, EPS) for level in levels]), strict=True))
    rows = [
        (i, j, quantity, distance(runs[i], runs[j], quantity))
        for i in levels
        for j in levels
        for quantity in QUANTITIES
        if i != j
    ]
    workshop.write_csv("distances.csv", ("i", "j", "quantity", "xi"), rows)
    exact = [(level, q, distance_to_exact(run, q)) for level, run in runs.items() for q in QUANTITIES]
    workshop.write_csv("errors.csv", ("level", "quantity", "xi"), exact)
    shown = {f"level {level}": runs[level] for level in levels[-3:]}
    workshop.save("lines.png", draw_lines(shown, [("exact", runs[levels[-1]])]))
    notes = [
        "xi in percent; an entry of Table 18 is the distance of the line of its column from that of its row.",
        "Seed C takes level 7 for the solution in Table 19; the exact lines come from the law of the stress, T / r^2.",
    ]
    tables = [_pairs_table(levels, runs), _errors_table(levels, runs), _mesh_table()]
    return Report(tables, notes, all_converged(list(runs.values())))


def _pairs_table(levels: tuple[int, ...], runs: dict[int, Finished]) -> Table:
    """Table 18, without the other code."""
    theirs = {(int(row["level"]), row["quantity"]): row for row in published("couette_level_pairs")}
    rows = [
        (
            f"{i}, {quantity}",
            [theirs[i, quantity][f"l{j}"] for j in levels],
            ["" if i == j else figures(distance(runs[i], runs[j], quantity)) for j in levels],
        )
        for i in levels
        for quantity in QUANTITIES
    ]
    return beside("Table 18: xi_ij", "level", [f"level {j}" for j in levels], rows)


def _errors_table(levels: tuple[int, ...], runs: dict[int, Finished]) -> Table:
    """Table 19: against the finest level; beside it the true errors."""
    theirs = {row["level"]: row for row in published("couette_errors")}
    finest = levels[-1]
    rows = []
    for level in levels:
        for quantity in QUANTITIES:
            ours = "" if level == finest else figures(distance(runs[finest], runs[level], quantity))
            said = theirs.get(str(level), {}).get(quantity, "")
            rows.append((str(level), quantity, said, ours, figures(distance_to_exact(runs[level], quantity))))
    columns = (
        "level",
        "quantity",
        "published, to level 7",
        f"ours, to level {finest}",
        "ours, to the exact one",
    )
    return Table("Table 19: xi by level", columns, rows)


def _mesh_table() -> Table:
    """What Table 19 says of the finite volumes of Freiberg."""
    last = {row["quantity"]: row for row in published("couette_level_pairs") if row["level"] == "7"}
    sizes = ("1", "0.5", "0.25", "0.125")
    rows = [(quantity, *(row[f"Fr-{size}"] for size in sizes)) for quantity, row in last.items()]
    columns = ("quantity", *(f"mesh size {size}" for size in sizes))
    return Table("Table 19: xi of published finite volumes (Freiberg) to published level 7", columns, rows)
