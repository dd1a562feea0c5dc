"""Seconds of a multigrid solve of Q2/P1 flows: setting up, coarse matrices and inverses, one sweep, one gain of a tenth.

Granular fluid between cylinders (seed C, chapter 6), 16 2^(l-1) by 2 2^(l-1) cells on level l, at a shear flow that decays away
from the inner wall. `wall` suffers from other processes; `cpu` is the processor time of all threads.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import numpy as np

from _couette import INNER, device, hierarchy, turning
from _table import print_table
from barchan.flows.quasi_newtonian.multigrid import MultigridSolver
from barchan.linalg.multigrid import CycleOptions


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result of the work, and its seconds of wall and processor."""
    began = perf_counter(), process_time()
    result = work()
    return result, perf_counter() - began[0], process_time() - began[1]


def measure(level: int, eps: float, precision: str, options: CycleOptions) -> list[tuple[object, ...]]:
    """Rows (level, unknowns, what, wall seconds, cpu seconds, cycles)."""
    spaces, *found = timed(lambda: hierarchy(level))
    fine = spaces[-1]
    flow = device(fine, eps)
    rows: list[tuple[object, ...]] = [(level, fine.size, "spaces", *found, None)]
    x = fine.mesh.nodes
    decay = np.exp(-1400.0 * (np.linalg.norm(x, axis=1) - INNER))
    fields = flow.fields(turning(x) * decay[:, None], np.zeros(fine.P))
    solver, *found = timed(lambda: MultigridSolver(flow, spaces, options=options, precision=precision))
    rows.append((level, fine.size, "setting up", *found, None))
    elements, *found = timed(lambda: flow.jacobian(fields))
    rows.append((level, fine.size, "element matrices", *found, None))
    _, *found = timed(lambda: solver.update(elements))
    rows.append((level, fine.size, "coarse matrices, inverses", *found, None))
    rhs = np.random.default_rng(0).standard_normal(fine.size)
    rhs[2 * fine.N :] = 0.0
    rhs[flow.constraints.fixed] = 0.0
    y = np.zeros(fine.size)
    smoother = solver.grids.smoother
    _, *found = timed(lambda: smoother.sweep(y, rhs, 4))
    rows.append((level, fine.size, "sweep", found[0] / 4, found[1] / 4, None))
    for gain in (1e-1, 1e-4):
        done, *found = timed(lambda gain=gain: solver.grids.solve(rhs, gain, 30))
        rows.append((level, fine.size, f"gain {gain:g}", *found, done.iterations))
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--level", type=int, action="append")
    parser.add_argument("--eps", type=float, default=1e-3)
    parser.add_argument("--precision", choices=("single", "double"), default="single")
    parser.add_argument("--shape", choices=("V", "W", "F"), default="F")
    parser.add_argument("--sweeps", type=int, default=8, help="before and after the coarse correction")
    choice = parser.parse_args()
    options = CycleOptions(choice.shape, choice.sweeps, choice.sweeps)
    for level in (2, 4):
        measure(level, choice.eps, choice.precision, options)  # compiles
    rows = []
    for level in choice.level or (4, 5, 6):
        rows += measure(level, choice.eps, choice.precision, options)
    heads = ("level", "unknowns", "step", "wall s", "cpu s", "cycles")
    print_table(f"multigrid, eps = {choice.eps:g}, {choice.precision} precision", heads, rows)


if __name__ == "__main__":
    main()
