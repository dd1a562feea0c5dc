"""The Couette device of seed C (Table 14) solved level by level: nonlinear steps, multigrid cycles, seconds a step, memory.

Every level starts from the solution of the one before and meets 1e-8 of the residual at rest. The peer is the sparse direct
solver in the same loop, on the levels where it still fits. Times are of the level alone.
"""

from __future__ import annotations

import argparse
import resource
import sys
from time import perf_counter

import numpy as np

from _couette import device, hierarchy
from _table import print_table
from barchan.flows.quasi_newtonian import (
    DirectSolver,
    MultigridSolver,
    NonlinearOptions,
    solve_flow,
)
from barchan.flows.quasi_newtonian.nested import prolonged

HEADS = (
    "level", "unknowns", "steps", "cycles a step", "set-up s", "s", "s a step", "over last level",
    "direct / multigrid", "GiB", "met",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--finest", type=int, default=6, help="level to stop at (7: 1.45 million unknowns, about 4 GiB)"
    )
    parser.add_argument("--direct", type=int, default=5, help="last level that the direct solver solves, too")
    parser.add_argument("--eps", type=float, default=1e-2, help="regularisation (1/s)")
    parser.add_argument(
        "--f3",
        action="store_true",
        help="adaptive Newton with f3 and delta_0 = 0.5 instead of ours",
    )
    options = parser.parse_args()
    nonlinear = (
        NonlinearOptions("adaptive-newton", strategy="f3", delta0=0.5) if options.f3 else NonlinearOptions()
    )
    every, start, rows, before = hierarchy(options.finest), None, [], None
    for level in range(1, options.finest + 1):
        spaces = every[:level]
        if level > 1:
            start = prolonged(start, spaces[-2], spaces[-1])
        flow = device(spaces[-1], options.eps)
        direct = None
        if level <= options.direct:
            began = perf_counter()
            found = solve_flow(flow, DirectSolver(flow), NonlinearOptions(), start)
            direct = (perf_counter() - began) / max(found.iterations, 1)
        began = perf_counter()
        linear = DirectSolver(flow) if level == 1 else MultigridSolver(flow, spaces)
        made, began = perf_counter() - began, perf_counter()
        found = solve_flow(flow, linear, nonlinear, start)
        spent = perf_counter() - began
        start = found.state
        step = spent / max(found.iterations, 1)
        rows.append((
            level, flow.space.size, found.iterations, f"{np.mean(found.cycles):.2f}",
            f"{made:.1f}", f"{spent:.1f}", f"{step:.3f}",
            "-" if before is None else f"{step / before:.2f}", "-" if direct is None else f"{direct / step:.2f}",
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f}", str(found.converged),
        ))  # fmt: skip
        before = step
        sys.stderr.write(f"level {level}: {found.iterations} steps, {spent:.1f} s\n")
    print_table(f"Couette, eps = {options.eps:g}", HEADS, rows)


if __name__ == "__main__":
    main()
