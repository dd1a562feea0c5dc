"""The cost of a Moreau-Jean step against the number of spheres, 1e3 to 1e5: contact detection, friction problem, all the rest.

Spheres stand on a lattice over a plane, loose by a hundredth of a radius, and settle for some steps; the median step of those
after counts. A picture with straight lines through the origin is written when --out is given.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from _table import environment, print_table

RADIUS = 0.01
DENSITY = 2500.0
STEP = 1e-3


def packing(count: int, seed: int = 0) -> list[Any]:
    """`count` spheres in a box, about as high as wide, on a plane between planes."""
    from barchan.bodies.rigid import Body, Fixed, HalfSpace, Sphere

    rng = np.random.default_rng(seed)
    edge = 2.0 * RADIUS * 1.01
    across = round(count ** (1.0 / 3.0))
    corners = np.stack(np.unravel_index(np.arange(count), (count, across, across)), axis=1)[:, ::-1]
    places = (corners + 0.5) * edge + rng.uniform(-0.005, 0.005, (count, 3)) * RADIUS
    ball, side = Sphere(RADIUS), across * edge
    bodies = [Body(ball, f"ball_{k}", density=DENSITY, position=place) for k, place in enumerate(places)]
    walls = [(axis, sign) for axis in (0, 1) for sign in (1.0, -1.0)] + [(2, 1.0)]
    for axis, sign in walls:
        place = np.zeros(3) if sign > 0.0 else np.full(3, side)
        bodies.append(
            Body(HalfSpace(sign * np.eye(3)[axis]), f"wall_{axis}_{sign}", position=place, motion=Fixed())
        )
    return bodies


def run_one(task: dict[str, Any]) -> dict[str, Any]:
    """Median seconds of the parts of a step in this process."""
    from barchan.bodies.moreau import Assembly, Options

    options = Options(tolerance=task["tolerance"], max_sweeps=2000)
    assembly = Assembly(packing(task["bodies"]), options=options)
    state = assembly.started()
    found = []
    for number in range(task["settle"] + task["steps"]):
        began = perf_counter()
        state, record = assembly.advance(state, STEP)
        whole = perf_counter() - began
        if number >= task["settle"]:
            found.append(
                (
                    whole,
                    record.detection_seconds,
                    record.solve_seconds,
                    record.sweeps,
                    record.contacts,
                    record.residual,
                )
            )
    whole, detection, solving, sweeps, contacts, residual = np.median(found, axis=0)
    return {
        "whole": whole, "detection": detection, "solving": solving, "rest": whole - detection - solving,
        "sweeps": sweeps, "contacts": contacts, "residual": residual,
    }  # fmt: skip


def draw(path: Path, rows: list[tuple[int, dict[str, Any]]]) -> None:
    """Seconds of a step against bodies, both on logarithmic axes, with the line of a cost proportional to bodies."""
    sys.path.insert(0, environment()["PYTHONPATH"])
    from barchan.results.figures import new_figure, save_figure

    figure = new_figure(6.0, 4.0)
    axis = figure.subplots()
    bodies = np.array([count for count, _ in rows])
    for part, words in (
        ("whole", "whole step"),
        ("detection", "detection"),
        ("solving", "friction problem"),
        ("rest", "rest"),
    ):
        axis.plot(bodies, [found[part] for _, found in rows], "o-", label=words)
    axis.plot(bodies, bodies * rows[0][1]["whole"] / bodies[0], "--", color="0.5", label="linear")
    axis.set(xscale="log", yscale="log", xlabel="bodies", ylabel="seconds of a step")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    save_figure(figure, path)


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=float, nargs="*", default=[1e3, 3e3, 1e4, 3e4, 1e5])
    parser.add_argument("--steps", type=int, default=15, help="steps that are timed")
    parser.add_argument("--settle", type=int, default=25, help="steps before")
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, help="PNG file of the plot")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    choice = parser.parse_args()
    if choice.child:
        print(json.dumps(run_one(json.loads(choice.child))))
        return
    measured = []
    for count in (int(bodies) for bodies in choice.bodies):
        task = {
            "bodies": count,
            "steps": choice.steps,
            "settle": choice.settle,
            "tolerance": choice.tolerance,
        }
        command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(task)]
        child = subprocess.run(
            command,
            env=environment(NUMBA_NUM_THREADS=str(choice.threads)),
            capture_output=True,
            text=True,
            check=False,
        )
        if child.returncode:
            raise SystemExit(f"{count} bodies failed:\n{child.stderr}")
        measured.append((count, json.loads(child.stdout)))
    heads = (
        "bodies", "contacts", "sweeps", "certificate", "s of a step", "s of detection", "s of the problem's solution",
        "s of the rest", "us a body", "us a body and sweep",
    )  # fmt: skip
    rows = [
        (
            count, int(found["contacts"]), int(found["sweeps"]), found["residual"], found["whole"], found["detection"],
            found["solving"], found["rest"], 1e6 * found["whole"] / count,
            1e6 * found["solving"] / count / max(found["sweeps"], 1.0),
        )
        for count, found in measured
    ]  # fmt: skip
    print_table(
        f"A step of {STEP:g} s to the certificate {choice.tolerance:g} on {choice.threads} threads",
        heads,
        rows,
    )
    if choice.out is not None:
        draw(choice.out, measured)


if __name__ == "__main__":
    main()
