"""Friction problems with a volume to keep: seconds of a warm step of an immersed column, by method, tolerance and pressures.

80 x 20 and 40 x 10 x 20 cells (`barchan.friction.samples.immersed`); columns slump from rest on a grid that stays, each step
starting from the forces of the last. The first steps, cold and compiling, do not count. Processor time of all threads.
"""

from __future__ import annotations

import argparse
from time import process_time

from _table import print_table
from barchan.friction import Solution, solve
from barchan.friction.samples.immersed import Immersed, immersed_column

BOXES = {"2": ((80, 20), (50, 14)), "3": ((40, 10, 20), (10, 10, 16))}


def warm_steps(
    first: Immersed, method: str, tol: float, warm_up: int, steps: int
) -> tuple[list[Solution], list[float]]:
    """Solutions of the steps after the first `warm_up`, and the processor seconds that each took with its certificate."""
    step, r = first, None
    solutions, seconds = [], []
    for _ in range(warm_up + steps):
        began = process_time()
        solution = solve(step.problem, method, tol=tol, r0=r, max_iterations=10_000)
        seconds.append(process_time() - began)
        solutions.append(solution)
        assert solution.v is not None
        step, r = step.following(solution.v), solution.r
    return solutions[warm_up:], seconds[warm_up:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dimension", choices=sorted(BOXES), default="2")
    parser.add_argument("--methods", nargs="+", default=["auto", "gauss_seidel", "aspg", "apgd"])
    parser.add_argument("--pressures", nargs="+", default=["coarse", "penalised"])
    parser.add_argument("--tolerances", nargs="+", type=float, default=[1e-4])
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument("--diameter", type=float, default=1e-3, help="of a grain, m")
    parser.add_argument("--warm-up", type=int, default=3)
    parser.add_argument("--steps", type=int, default=10)
    chosen = parser.parse_args()
    rows = []
    for pressure in chosen.pressures:
        cells, filled = BOXES[chosen.dimension]
        first = immersed_column(cells, filled, chosen.friction, diameter=chosen.diameter, pressure=pressure)
        for tol in chosen.tolerances:
            for method in chosen.methods:
                solutions, seconds = warm_steps(first, method, tol, chosen.warm_up, chosen.steps)
                counts = [solution.iterations for solution in solutions]
                missed = sum(not solution.converged for solution in solutions)
                rows.append([
                    pressure, f"{tol:.0e}", method, sum(counts) / len(counts),
                    1e3 * sum(seconds) / len(seconds), 1e3 * max(seconds), missed,
                ])  # fmt: skip
    heads = ["pressure", "tolerance", "method", "iterations", "ms a step", "slowest", "missed"]
    print_table(
        f"{chosen.dimension}D, {first.problem.n} blocks, {first.problem.size} velocities", heads, rows
    )


if __name__ == "__main__":
    main()
