"""The cost of a step of the ponytail of 2,000 fibres, by phase: detection, friction problem, all the rest.

Wall-clock and processor seconds of each step printed: on a machine that does other things the second tells more.
"""

from __future__ import annotations

import argparse
import sys
from time import perf_counter, process_time

from _table import environment, print_table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--every", type=int, default=4, help="of the steps that are shown")
    parser.add_argument("--fibres", type=int, default=2000)
    parser.add_argument("--model", choices=("helices", "rods"), default="helices")
    asked = parser.parse_args()
    sys.path.insert(0, environment()["PYTHONPATH"])
    from barchan import scenes

    segments = 5 if asked.model == "helices" else 15
    over = {"fibres.count": asked.fibres, "fibres.model": asked.model, "fibres.segments": segments}
    model = scenes.load("ponytail", **over).model()
    state, rows = model.initial(), []
    for step in range(1, asked.steps + 1):
        began, worked = perf_counter(), process_time()
        state, record = model.advance(state, model.longest_step(state))
        whole, work = perf_counter() - began, process_time() - worked
        if step % asked.every == 0:
            phases = (record.detection_seconds, record.solve_seconds)
            solved = (record.candidates, record.contacts, record.sweeps, record.residual)
            rows.append((step, *solved, whole, work, *phases))
    heads = [
        "step",
        "contacts",
        "with force",
        "sweeps",
        "certificate",
        "s",
        "processor s",
        "detection",
        "solve",
    ]
    print_table(f"ponytail of {asked.fibres} {asked.model}", heads, rows)


if __name__ == "__main__":
    main()
