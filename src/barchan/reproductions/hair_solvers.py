"""Solvers on the friction problems of hair: performance profiles (seed B, Fig. 4.8).

The hybrid Gauss-Seidel with and without sleeping contacts, on the stored and on the factored Delassus operator; projected
gradients; both inside Cadoux's fixed point; global Newton methods. From nothing to one certificate for all.
"""

from __future__ import annotations

import sys

from barchan.bench import Measurement, Plan, Variant, run_campaign
from barchan.reproductions.hair_problems import hair_problems
from barchan.reproductions.profiles import all_solved, profile_table, size_table, wins
from barchan.reproductions.workshop import Report, Workshop

TITLE = "Performance profiles of friction solvers on steps of hair (seed B, Fig. 4.8)"

HYBRID = {"local_solver": "fischer-burmeister+enumerative"}
BEST = "GS, sleeping"
VARIANTS = (
    Variant(BEST, "gauss_seidel", {"operator": "explicit", "sleeping": True, **HYBRID}),
    Variant("GS", "gauss_seidel", {"operator": "explicit", **HYBRID}),
    Variant("GS, matrix-free", "gauss_seidel", {"operator": "matrix-free", **HYBRID}),
    Variant("ASPG", "aspg"),
    Variant("APGD", "apgd"),
    Variant("Cadoux, GS", "cadoux", {"inner": "gauss_seidel"}),
    Variant("Cadoux, ASPG", "cadoux", {"inner": "aspg"}),
    Variant("Newton, Fischer-Burmeister", "newton_fischer_burmeister"),
    Variant("Newton, Alart-Curnier", "newton_alart_curnier"),
)
TOLERANCE = 1e-4
LIMITS = {True: 5.0, False: 30.0}  # seconds for one solve, quickly or not


def reproduce(workshop: Workshop) -> Report:
    """Every solver on every problem; tables and profile of the campaign stay in the folder."""
    problems = hair_problems(workshop.quick)
    plan = Plan(
        methods=(), variants=VARIANTS, tolerance=TOLERANCE, time_limit=LIMITS[workshop.quick], repeats=1, peers=False
    )  # fmt: skip
    found = run_campaign(problems, plan, workshop.out, _tell).measurements
    tables = [size_table(problems), profile_table(found, TOLERANCE)]
    return Report(tables, _notes(found, workshop.quick), all_solved(found, problems))


def _notes(found: list[Measurement], quick: bool) -> list[str]:
    won = wins(found)
    first = max(won, key=won.__getitem__)
    return [
        "Published: the hybrid Gauss-Seidel is the most efficient and robust of all, sleeping contacts gain, the stored "
        f"Delassus operator beats the factored one. Most often the fastest: {first} ({won[first]} of {sum(won.values())}).",
        f"A solve is stopped after {LIMITS[quick]:g} s. The seed's problems are not published; ours are smaller.",
    ]


def _tell(entry: Measurement) -> None:
    figures = f"{entry.certificate:.1e} in {entry.seconds:.3g} s"
    sys.stderr.write(f"{entry.problem}  {entry.solver}  {entry.note or figures}\n")
