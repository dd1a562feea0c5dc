"""Couette flow of the modified Poliquen model: what the regularisation eps changes, beside what the level does.

Seed C, 6.6: Tables 20-21, Fig. 26-30.
"""

from __future__ import annotations

from barchan.reproductions.couette_lines import (
    couette_job,
    distance,
    distance_to_exact,
    draw_lines,
    figures,
)
from barchan.reproductions.flow_solves import beside
from barchan.reproductions.workshop import Finished, Report, Table, Workshop, all_converged, published

TITLE = "Couette flow of granular matter: choice of the regularisation (seed C, Tables 20-21 and Fig. 26-30)"

LEVELS = (2, 3, 4, 5, 6)
QUICK_LEVELS = (2, 3, 4)
EXPONENTS = (1, 2, 3, 4)
COMPARED = ("u", "shear_rate")

Runs = dict[tuple[int, int], Finished]


def reproduce(workshop: Workshop) -> Report:
    """eps = 1e-1 to 1e-4 on levels 2 to 6; quickly up to level 4, which is then the reference."""
    levels = QUICK_LEVELS if workshop.quick else LEVELS
    keys = [(level, exponent) for level in levels for exponent in EXPONENTS]
    jobs = [couette_job(level, float(f"1e-{exponent}")) for level, exponent in keys]
    runs = dict(zip(keys, workshop.run(jobs), strict=True))
    workshop.write_csv(
        "distances.csv",
        ("level_i", "eps_i", "level_j", "eps_j", "quantity", "xi"),
        [
            (i[0], f"1e-{i[1]}", j[0], f"1e-{j[1]}", quantity, distance(runs[i], runs[j], quantity))
            for i in keys
            for j in keys
            for quantity in COMPARED
            if i != j
        ],
    )
    for level in (levels[0], levels[-1]):
        shown = {f"eps = 1e-{exponent}": runs[level, exponent] for exponent in EXPONENTS}
        exact = [("exact", runs[level, exponent]) for exponent in EXPONENTS[-1:]]
        workshop.save(f"lines-level{level}.png", draw_lines(shown, exact))
    tables = [_eps_table(levels, runs), _level_table(levels, runs), _exact_table(levels, runs)]
    notes = [
        f"xi in percent; the reference of Table 21 is level 6, here level {levels[-1]}.",
        "Dotted lines in the pictures: the exact solution for eps = 1e-4.",
    ]
    return Report(tables, notes, all_converged(list(runs.values())))


def _eps_table(levels: tuple[int, ...], runs: Runs) -> Table:
    """Table 20: eps against the next smaller one, level by level."""
    theirs = {(row["pair"], row["quantity"]): row for row in published("couette_eps")}
    rows = [
        (
            f"xi_{i}{i - 1}, {quantity}",
            [theirs[f"{i}{i - 1}", quantity][f"l{level}"] for level in levels],
            [figures(distance(runs[level, i], runs[level, i - 1], quantity)) for level in levels],
        )
        for i in EXPONENTS[1:]
        for quantity in COMPARED
    ]
    return beside(
        "Table 20: xi_ij between eps = 10^-i and 10^-j", "", [f"level {level}" for level in levels], rows
    )


def _level_table(levels: tuple[int, ...], runs: Runs) -> Table:
    """Table 21: every eps and level against the finest level with three eps."""
    theirs = {(int(row["reference"]), row["quantity"]): row for row in published("couette_eps_levels")}
    coarse, finest = levels[:-1], levels[-1]
    keys = [(exponent, level) for exponent in EXPONENTS[:3] for level in coarse]
    rows = [
        (
            f"eps = 1e-{i}, {quantity}",
            [theirs[i, quantity][f"{exponent}:l{level}"] for exponent, level in keys],
            [figures(distance(runs[finest, i], runs[level, exponent], quantity)) for exponent, level in keys],
        )
        for i in EXPONENTS[:3]
        for quantity in COMPARED
    ]
    columns = [f"1e-{exponent}, level {level}" for exponent, level in keys]
    return beside("Table 21: xi of (eps, level) to the finest level", "finest level", columns, rows)


def _exact_table(levels: tuple[int, ...], runs: Runs) -> Table:
    """Errors of the discretisation alone: against the exact solution with the same eps."""
    rows = [
        (f"1e-{i}, {quantity}", *(figures(distance_to_exact(runs[level, i], quantity)) for level in levels))
        for i in EXPONENTS
        for quantity in COMPARED
    ]
    columns = ("eps", *(f"level {level}" for level in levels))
    return Table("ours: xi to the exact line with the same eps", columns, rows)
