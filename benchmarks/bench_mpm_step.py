"""Seconds of a time step of the presets: in all, by phase, with sweeps, certificate, particles, blocks and memory.

Each scene runs in a process of its own, so that the largest memory is its own; the first steps, which compile, do not count.
With several methods the same scene runs once with each: the peers of the table.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from _table import environment, print_table

PHASES = {
    "assembly": ("build_step_problem",),  # with the way from the particles to the grid
    "solve": ("solve",),
    "correction": ("volume_shift", "within_energy"),
    "particles": ("follow_flow",),  # the way back, and the move
}
"""Functions the stepper calls, by phase; the rest of a step is book-keeping."""


def timed(function: Callable[..., Any], spent: dict[str, float], phase: str) -> Callable[..., Any]:
    """The function, adding the seconds it takes to its phase."""

    def call(*arguments: Any, **options: Any) -> Any:
        began = perf_counter()
        try:
            return function(*arguments, **options)
        finally:
            spent[phase] += perf_counter() - began

    return call


def measure(scene: str, method: str, skip: float, warm_up: int, steps: int) -> dict[str, Any]:
    """Run a scene from the start; `skip` simulated seconds, then `warm_up` steps, are not timed."""
    from barchan import scenes
    from barchan.flows.mpm import stepper

    spent: dict[str, float] = defaultdict(float)
    for phase, names in PHASES.items():
        for name in names:
            setattr(stepper, name, timed(getattr(stepper, name), spent, phase))
    model = scenes.load(scene, method=method).model()
    state = model.initial()
    made = 0
    while state.time < skip or made < warm_up:
        state, _ = model.advance(state, model.longest_step(state))
        made += 1
    spent.clear()
    records = []
    began = perf_counter()
    for _ in range(steps):
        state, record = model.advance(state, model.longest_step(state))
        records.append(record)
    seconds = perf_counter() - began
    return {
        "time": state.time,
        "particles": len(state.volumes),
        "blocks": records[-1].blocks,
        "seconds": seconds / steps,
        "phases": {phase: spent[phase] / steps for phase in PHASES},
        "sweeps": float(np.mean([record.sweeps for record in records])),
        "certificate": max(record.residual for record in records),
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def main() -> None:
    """Print one table, or as a child the figures of one scene as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["collapse_2d", "collapse_3d"])
    parser.add_argument("--methods", nargs="+", default=["auto"], help="for example: auto gauss_seidel aspg")
    parser.add_argument("--skip", type=float, default=0.1, help="simulated seconds before the timed steps")
    parser.add_argument("--warm-up", type=int, default=5)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    choice = parser.parse_args()
    if choice.child:
        figures = measure(choice.scenes[0], choice.methods[0], choice.skip, choice.warm_up, choice.steps)
        print(json.dumps(figures))
        return
    rows = []
    for scene in choice.scenes:
        for method in choice.methods:
            command = [sys.executable, __file__, "--child", "--scenes", scene, "--methods", method]
            command += [
                "--skip",
                str(choice.skip),
                "--warm-up",
                str(choice.warm_up),
                "--steps",
                str(choice.steps),
            ]
            answer = subprocess.run(command, env=environment(), check=True, stdout=subprocess.PIPE, text=True)
            figures = json.loads(answer.stdout)
            rows.append(
                (
                    *(scene, method, figures["particles"], figures["blocks"], figures["seconds"]),
                    *figures["phases"].values(),
                    *(figures["sweeps"], figures["certificate"], round(figures["megabytes"])),
                )
            )
    heads = (
        "scene",
        "method",
        "particles",
        "blocks",
        "s a step",
        *PHASES,
        "sweeps",
        "worst certificate",
        "MB",
    )
    print_table(f"Time steps from t = {choice.skip:g} s on, {choice.steps} timed", heads, rows)


if __name__ == "__main__":
    main()
