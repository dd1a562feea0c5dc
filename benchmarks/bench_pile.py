"""A pile of 1e5 contacts solved to a certificate of 1e-4: seconds, sweeps, memory, and where the time goes, by method.

Each method runs in a process of its own, which builds the pile anew, compiles on small piles first and reports its peak memory.
Piles: `rest` (every gap closed), `settling` (unequal spheres, gaps that may close in the step), `moving` (thrown spheres too).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from _table import environment, print_table

PILES: dict[str, dict[str, Any]] = {
    "rest": {"closed": True},
    "settling": {"spread": 0.02},
    "moving": {"speed": 0.1},
}
RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    "auto": ("auto", {}),
    "sweeps, matrix-free, in order": ("gauss_seidel", {"operator": "matrix-free", "parallel": False}),
    "sweeps, matrix-free, coloured": ("gauss_seidel", {"operator": "matrix-free", "parallel": True}),
    "sweeps, explicit, in order": ("gauss_seidel", {"operator": "explicit", "parallel": False}),
    "ASPG, matrix-free": ("aspg", {"operator": "matrix-free"}),
    "ASPG, explicit": ("aspg", {"operator": "explicit"}),
}
CONTACTS_PER_BODY = {2: 2.9, 3: 5.7}
WARM_BODIES = (30, 600)
MARKS = (1e-1, 1e-2, 1e-3, 3e-4, 1e-4)


def run_one(task: dict[str, Any]) -> dict[str, Any]:
    """Solve one pile by one method in this process."""
    import resource

    from barchan.friction import solve
    from barchan.friction.samples import pile

    method, options = RUNS[task["run"]]
    shape = {"dimension": task["dimension"], "mu": task["mu"], **PILES[task["pile"]]}
    for bodies in WARM_BODIES:
        solve(pile(bodies, 0, **shape).problem, method, tol=1e-12, max_iterations=250, **options)
    began = perf_counter()
    made = pile(round(task["contacts"] / CONTACTS_PER_BODY[task["dimension"]]), 1, **shape)
    built = perf_counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    processor = process_time()
    solution = solve(
        made.problem, method, tol=task["tolerance"],
        callback=lambda progress, _: progress.seconds > task["limit"], **options,
    )  # fmt: skip
    history = solution.history
    reached = {mark: next((p for p in history if p.residual <= mark), None) for mark in MARKS}
    return {
        "contacts": made.problem.n,
        "build": built - began,
        "first": history[0].seconds,
        "seconds": perf_counter() - built,
        "processor": process_time() - processor,
        "iterations": solution.iterations,
        "certificate": solution.certificate.residual,
        "converged": solution.converged,
        "before": before / 1024.0,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "history": [f"{p.seconds:.3g} s, {p.iteration}" if p else "" for p in reached.values()],
    }


def run_in_child(task: dict[str, Any]) -> dict[str, Any]:
    """The same in a process of its own with the given number of threads."""
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(task)]
    child = subprocess.run(
        command,
        env=environment(NUMBA_NUM_THREADS=str(task["threads"])),
        capture_output=True,
        text=True,
        check=False,
    )
    if child.returncode:
        raise SystemExit(f"{task['run']} failed:\n{child.stderr}")
    answer: dict[str, Any] = json.loads(child.stdout)
    return answer


def main() -> None:
    """Print one table of totals and one of histories."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--contacts", type=float, default=1e5)
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=3)
    parser.add_argument("--mu", type=float, default=0.5)
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds after which a solve is stopped")
    parser.add_argument("--piles", nargs="*", choices=PILES, default=["rest"])
    parser.add_argument("--runs", nargs="*", choices=RUNS, default=list(RUNS))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    choice = parser.parse_args()
    if choice.child:
        print(json.dumps(run_one(json.loads(choice.child))))
        return
    common = {
        name: getattr(choice, name)
        for name in ("contacts", "dimension", "mu", "tolerance", "threads", "limit")
    }
    totals, histories = [], []
    for name in choice.piles:
        for run in choice.runs:
            found = run_in_child({**common, "pile": name, "run": run})
            totals.append(
                (
                    name, run, found["contacts"], "yes" if found["converged"] else "no", found["certificate"],
                    found["iterations"], found["build"], found["first"], found["seconds"], found["processor"],
                    round(found["peak"]), round(found["peak"] - found["before"]),
                )
            )  # fmt: skip
            histories.append((name, run, *found["history"]))
    heads = (
        "pile", "run", "contacts", "solved", "certificate", "iterations", "s to build", "s to first iterate", "s in all",
        "s of processor", "peak MB", "MB of the solve",
    )  # fmt: skip
    print_table(f"Pile to {choice.tolerance:g}, {choice.threads} threads, {choice.dimension}D", heads, totals)
    marks = [f"{mark:g}" for mark in MARKS]
    print_table("Seconds and iterations to a residual", ("pile", "run", *marks), histories)


if __name__ == "__main__":
    main()
