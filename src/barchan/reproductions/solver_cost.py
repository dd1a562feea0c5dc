"""Cost of solving the creeping silo on four meshes, and how methods converge (seed A, Fig. 17 and Table 2)."""

from __future__ import annotations

import csv
import sys
import time
from dataclasses import dataclass, replace
from typing import Any

from barchan import friction, scenes
from barchan.reproductions.workshop import Report, Table, Workshop, new_figure, published

TITLE = "Cost of the creeping silo on four meshes, convergence of the methods (seed A, Fig. 17 and Table 2)"

VERTICES = (670, 2703, 10403, 41509)
FIRST_ORDER = ("projected_gradient", "apgd", "spg", "aspg")
METHODS = (*FIRST_ORDER, "split_interior_point", "auto")
TOLERANCE = 1e-4
LIMITS = {True: 20.0, False: 60.0}  # seconds for one solve, quickly or not
COLUMNS = ("vertices", "method", "seconds", "iterations", "certificate", "converged")


@dataclass(frozen=True)
class Solve:
    """One measured solve, as it stands in solves.csv."""

    vertices: int
    method: str
    seconds: float
    iterations: int
    certificate: float
    converged: bool


def reproduce(workshop: Workshop) -> Report:
    """Every method on the four meshes (quickly the first two); gradient methods stop at a limit and then sit out."""
    meshes = VERTICES[:2] if workshop.quick else VERTICES
    done = _read(workshop)
    solves: list[Solve] = []
    late: set[str] = set()
    for vertices in meshes:
        problem: friction.Problem | None = None
        for method in METHODS:
            if method in late:
                continue
            key = (vertices, method)
            if key not in done:
                if problem is None:
                    problem = _problem(vertices)
                done[key] = _measure(workshop, problem, vertices, method)
            solves.append(done[key])
            _write(workshop, solves)
            if not done[key].converged and method in FIRST_ORDER:
                late.add(method)
    _draw(workshop, solves)
    return Report([_table(solves, meshes)], _notes(workshop), all(any(
        solve.converged for solve in solves if solve.vertices == vertices) for vertices in meshes))  # fmt: skip


def _problem(vertices: int) -> friction.Problem:
    """The silo of Table 2: P2-P1d, mu = 0.5, Re = 1, Bi = 0."""
    scene: Any = scenes.load("silo", mu=0.5, reynolds=1.0, bingham=0.0, outlet=1.0, vertices=vertices)
    problem: friction.Problem = scene.model().flow.problem()
    return problem


def _measure(workshop: Workshop, problem: friction.Problem, vertices: int, method: str) -> Solve:
    """One solve from nothing, the factorisations included; stopped at the limit."""
    limit = LIMITS[workshop.quick]
    history: list[tuple[float, float]] = []

    def watch(progress: Any, _: Any) -> bool:
        history.append((progress.seconds, progress.residual))
        return method in FIRST_ORDER and bool(progress.seconds > limit)

    fresh = replace(problem)  # without factorisation or metric from the solve before
    began = time.perf_counter()
    solution = friction.solve(fresh, method, TOLERANCE, callback=watch)
    seconds = time.perf_counter() - began
    residual = float(solution.certificate.residual)
    sys.stderr.write(f"{vertices} vertices, {method}: {seconds:.1f} s, certificate {residual:.1e}\n")
    workshop.write_csv(f"history-{vertices}-{method}.csv", ("seconds", "residual"), history)
    return Solve(vertices, method, seconds, solution.iterations, residual, solution.converged)


def _table(solves: list[Solve], meshes: tuple[int, ...]) -> Table:
    theirs = {
        (int(row["vertices"]), row["solver"].split()[0]): row for row in published("silo_solver_timings")
    }
    ours = {(solve.vertices, solve.method): solve for solve in solves}
    rows = []
    for vertices in meshes:
        cells = [str(vertices)]
        for solver in ("interior-point", "spectral"):
            row = theirs[vertices, solver]
            cells.append(f"{row['total_s']} s, {row['outer_n']} outer")
        for method in METHODS:
            solve = ours.get((vertices, method))
            cells.append("left out" if solve is None else _cell(solve))
        rows.append(cells)
    columns = ("vertices", "published: MOSEK", "published: SPG", *(f"ours: {method}" for method in METHODS))
    return Table(f"seconds and iterations to the certificate {TOLERANCE:g}", columns, rows)


def _cell(solve: Solve) -> str:
    text = f"{solve.seconds:.3g} s, {solve.iterations}"
    return text if solve.converged else f"{text} (only {solve.certificate:.0e})"


def _notes(workshop: Workshop) -> list[str]:
    return [
        "Published seconds are of a quad-core of 2009 and of a tolerance in another norm; ours of this machine.",
        f"A gradient method that missed the certificate within {LIMITS[workshop.quick]:g} s is left out on finer meshes.",
    ]


def _write(workshop: Workshop, solves: list[Solve]) -> None:
    workshop.write_csv("solves.csv", COLUMNS, [tuple(vars(solve).values()) for solve in solves])


def _read(workshop: Workshop) -> dict[tuple[int, str], Solve]:
    """The solves that an interrupted reproduction has left."""
    path = workshop.out / "solves.csv"
    if not path.exists():
        return {}
    found = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            solve = Solve(
                int(row["vertices"]), row["method"], float(row["seconds"]), int(row["iterations"]),
                float(row["certificate"]), row["converged"] == "True",
            )  # fmt: skip
            found[solve.vertices, solve.method] = solve
    return found


def _draw(workshop: Workshop, solves: list[Solve]) -> None:
    """Residual against time on the first mesh (Fig. 17), seconds against vertices (Table 2)."""
    figure = new_figure(9.5, 4.0)
    residuals, cost = figure.subplots(1, 2)
    first = solves[0].vertices
    for method in METHODS:
        path = workshop.out / f"history-{first}-{method}.csv"
        if path.exists():
            with path.open(encoding="utf-8", newline="") as file:
                points = [(float(row["seconds"]), float(row["residual"])) for row in csv.DictReader(file)]
            if points:
                residuals.loglog(*zip(*points, strict=True), label=method, linewidth=1.0)
        mine = [
            (solve.vertices, solve.seconds) for solve in solves if solve.method == method and solve.converged
        ]
        if mine:
            cost.loglog(*zip(*mine, strict=True), "o-", label=method)
    residuals.set(xlabel="seconds", ylabel="residual of the law", title=f"{first} vertices")
    cost.set(xlabel="vertices", ylabel=f"seconds to certificate {TOLERANCE:g}")
    for axis in (residuals, cost):
        axis.grid(alpha=0.3, which="both")
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=7)
    workshop.save("solver_cost.png", figure)
