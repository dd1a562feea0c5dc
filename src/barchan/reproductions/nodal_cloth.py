"""The dual route and the nodal algorithm on steps of cloth against bodies (seed B, Table 4.4)."""

from __future__ import annotations

import sys

import numpy as np

from barchan.bench.nodal import NAME_OF_DUAL, Timing, time_dual, time_nodal
from barchan.friction import Problem
from barchan.friction.methods.nodal import applicable
from barchan.friction.methods.nodal.method import VARIANTS
from barchan.friction.operators import LARGEST_DENSE_DELASSUS
from barchan.reproductions.hair_problems import Source, step_problems
from barchan.reproductions.workshop import Report, Table, Workshop, published

TITLE = "Dual route and nodal algorithm for cloth against bodies (seed B, Table 4.4)"

TOLERANCE = 1e-4
REPEATS = 2
HEADS = (
    "scene", "vertices", "contacts", "dual: build", "solve", "nodal: build", "solve", "ratio", "Cadoux", "projected gradient",
    "seed B: vertices", "contacts", "dual: build", "solve", "nodal: build", "solve", "ratio",
)  # fmt: skip


def sources(quick: bool) -> tuple[tuple[str, Source], ...]:
    """(the seed's scene, ours): a cloth on a ball for that on a bunny, a skirt, and a longer one for the dress."""
    if quick:
        return (("skirt", Source("skirt", "skirt", {"cloth.spacing": 0.04}, (4, 12))),)
    dress = {"cloth.spacing": 0.0135, "cloth.length": 0.65, "cloth.hem_radius": 0.36}
    return (
        ("bunny", Source("ball", "cloth_on_sphere", {"cloth.spacing": 0.0134}, (30, 45, 60))),
        ("skirt", Source("skirt", "skirt", {"cloth.spacing": 0.0125}, (10, 40, 80))),
        ("dress", Source("long skirt", "skirt", dress, (10, 40))),
    )


def reproduce(workshop: Workshop) -> Report:
    """A row for each scene, means over its steps; a file with every timing."""
    rows, lines, solved = [], [], True
    theirs = {row["scene"]: row for row in published("nodal_cloth")}
    for seed, source in sources(workshop.quick):
        taken = []
        for name, problem in step_problems(source):
            if not (0 < 3 * problem.n <= LARGEST_DENSE_DELASSUS and applicable(problem)):
                continue
            timings = _timings(problem)
            taken.append((problem, timings))
            lines += [(name, problem.size // 3, problem.n, *timing) for timing in timings.values()]
            solved &= all(timing.certificate <= TOLERANCE for timing in timings.values())
            sys.stderr.write(
                f"{name}: {timings[NAME_OF_DUAL].total / timings[VARIANTS[0]].total:.0f} times\n"
            )
        if taken:
            rows.append(_row(source.name, taken, theirs[seed]))
    workshop.write_csv("timings.csv", ("step", "vertices", "contacts", *Timing._fields), lines)
    table = Table(
        f"Seconds of processor time to a certificate of {TOLERANCE:g}, from zero forces", HEADS, rows
    )
    return Report([table], _notes(), solved)


def _timings(problem: Problem) -> dict[str, Timing]:
    time_nodal(problem, TOLERANCE, max_iterations=4)  # compiles
    found = {NAME_OF_DUAL: time_dual(problem, TOLERANCE)}
    for variant in VARIANTS:
        trials = [time_nodal(problem, TOLERANCE, variant) for _ in range(REPEATS)]
        found[variant] = min(trials, key=lambda timing: timing.total)
    return found


def _row(name: str, taken: list[tuple[Problem, dict[str, Timing]]], seed: dict[str, str]) -> list[str]:
    problem = taken[0][0]
    contacts = np.mean([each.n for each, _ in taken])
    mean = {
        route: (
            float(np.mean([t[route].build for _, t in taken])),
            float(np.mean([t[route].solve for _, t in taken])),
        )
        for route in taken[0][1]
    }
    dual, nodal = mean[NAME_OF_DUAL], mean["inversion"]
    ours = [f"{value:.3g}" for value in (*dual, *nodal)]
    ratios = [f"{sum(dual) / sum(mean[variant]):.0f}" for variant in VARIANTS]
    columns = ("vertices", "mean_contacts", "dual_build", "dual_solve", "nodal_build", "nodal_solve")
    their_dual = float(seed["dual_build"]) + float(seed["dual_solve"])
    their_nodal = float(seed["nodal_build"]) + float(seed["nodal_solve"])
    theirs = [*(seed[column] for column in columns), f"{their_dual / their_nodal:.0f}"]
    return [name, str(problem.size // 3), f"{contacts:.0f}", *ours, *ratios, *theirs]


def _notes() -> list[str]:
    return [
        "ratio: dual over nodal, build and solve together, by local inversion, Cadoux's fixed point, the projected gradient.",
        "The seed's nodal column is Cadoux's fixed point with Gauss-Seidel; ours alternates sweeps with corrections.",
        "Building the dual is the factor of M and the dense W; the certificate, made alike for all, is not counted.",
    ]
