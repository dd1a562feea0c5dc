"""Solvers on the friction problems of material point steps: performance profiles (seed B, Fig. 7.24).

Gauss-Seidel and projected gradients, on the factored and on the stored Delassus operator, alone and inside Cadoux's fixed
point, from nothing to one certificate for all. The seed's problems are not published; ours are steps of small scenes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from barchan import friction
from barchan.bench import Measurement, Plan, Variant, run_campaign
from barchan.flows.mpm import Material, Options, State, Stepper, Wall, Walls, fill_box
from barchan.reproductions.profiles import all_solved, profile_table, size_table, wins
from barchan.reproductions.workshop import Report, Workshop
from barchan.spaces import RegularGrid

TITLE = "Performance profiles of friction solvers on material point steps (seed B, Fig. 7.24)"

BEST = "GS, matrix-free"
VARIANTS = (
    Variant(BEST, "gauss_seidel", {"operator": "matrix-free"}),
    Variant("GS, explicit", "gauss_seidel", {"operator": "explicit"}),
    Variant("APGD", "apgd"),
    Variant("ASPG", "aspg"),
    Variant("Cadoux, GS", "cadoux", {"inner": "gauss_seidel"}),
    Variant("Cadoux, APGD", "cadoux", {"inner": "apgd"}),
    Variant("Cadoux, ASPG", "cadoux", {"inner": "aspg"}),
)
TOLERANCE = 1e-4
LIMITS = {True: 5.0, False: 30.0}  # seconds for one solve, quickly or not
DT = 1.0 / 240.0


@dataclass(frozen=True)
class Source:
    """A column in a box: its cells and those of the box (the last axis is vertical), its sand, and the steps to take.

    edge : of a cell [m].
    """

    name: str
    column: tuple[int, ...]
    box: tuple[int, ...]
    material: Material
    steps: tuple[int, ...]
    edge: float = 1.0 / 32.0


def sources(quick: bool) -> tuple[Source, ...]:
    """Columns in the plane and in space, of a constant friction and of mu(I), slender and broad."""
    plain = Material(1500.0, 0.5)
    inertial = Material(1500.0, 0.32, friction_increment=0.28, grain_diameter=0.005)
    weak = Material(1500.0, 0.2)
    if quick:
        return (
            Source("plane", (6, 8), (24, 12), plain, (2, 20)),
            Source("space", (4, 4, 5), (12, 12, 8), plain, (2, 12)),
        )
    return (
        Source("plane-tall", (8, 24), (64, 28), plain, (2, 30, 90)),
        Source("plane-inertial", (20, 20), (96, 24), inertial, (2, 30, 90)),
        Source("plane-weak", (24, 12), (96, 16), weak, (2, 30, 90)),
        Source("space", (8, 8, 11), (32, 32, 16), plain, (2, 30, 60)),
        Source("space-inertial", (10, 10, 6), (32, 32, 10), inertial, (2, 25, 50)),
        Source("space-weak", (6, 6, 14), (28, 28, 16), weak, (2, 30, 60)),
    )


def step_problems(source: Source) -> Iterator[tuple[str, friction.Problem]]:
    """(name, problem) of the wanted steps; every problem is fresh, without the stresses of the step before."""
    grid = RegularGrid.from_box([source.edge * count for count in source.box], list(source.box))
    last = len(source.box) - 1
    lower = np.array([source.edge * (b - c) / 2 for b, c in zip(source.box, source.column, strict=True)])
    lower[last] = 0.0
    state: State = fill_box(grid, lower, lower + source.edge * np.array(source.column), 2, source.material)
    floor = Wall("friction", source.material.friction)
    stepper = Stepper(grid, source.material, Walls({"z_min": floor}), options=Options(tolerance=TOLERANCE))
    for number in range(max(source.steps) + 1):
        if number in source.steps:
            yield f"{source.name}-{number}", stepper.problem(state, DT)
        state, _ = stepper.advance(state, DT)


def reproduce(workshop: Workshop) -> Report:
    """Every solver on every problem; tables and profile of the campaign stay in the folder."""
    problems = [entry for source in sources(workshop.quick) for entry in step_problems(source)]
    plan = Plan(
        methods=(), variants=VARIANTS, tolerance=TOLERANCE, time_limit=LIMITS[workshop.quick], repeats=1, peers=False
    )  # fmt: skip
    campaign = run_campaign(problems, plan, workshop.out, _tell)
    found = campaign.measurements
    tables = [size_table(problems), profile_table(found, TOLERANCE)]
    return Report(tables, _notes(found, workshop.quick), all_solved(found, problems))


def _notes(found: list[Measurement], quick: bool) -> list[str]:
    won = wins(found)
    first = max(won, key=won.__getitem__)
    return [
        f"Published: the matrix-free Gauss-Seidel performs best, Cadoux's algorithm gains nothing. Ours most often the "
        f"fastest: {first} ({won[first]} of {sum(won.values())}); {BEST}: {won[BEST]}.",
        f"A solve is stopped after {LIMITS[quick]:g} s. The seed judges by the function of Alart and Curnier, we by our "
        "certificate; its problems, solver library and four cores are not ours.",
    ]


def _tell(entry: Measurement) -> None:
    figures = f"{entry.certificate:.1e} in {entry.seconds:.3g} s"
    sys.stderr.write(f"{entry.problem}  {entry.solver}  {entry.note or figures}\n")
