"""All contacts of a dense random arrangement of 1e3 to 1e5 bodies: seconds of the broad and the narrow phase, and a body.

Bodies stand on a face-centred lattice, each moved at random: nearly five contacts a sphere, more than in a pile at rest. Times
are the best of several detections in one process, on the wall and of the processor. `scipy` is the time of a k-d tree to find
the same pairs of equal spheres, in the same process: a peer that knows points alone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from _table import environment, print_table

REACH = 0.02  # of the radius


def arrangement(bodies: int, kind: str, seed: int = 0) -> tuple[Any, Any]:
    """Bodies and states of about equal size 1 on a lattice."""
    from barchan.bodies.rigid import Body, BodyStates, Box, Capsule, ConvexHull, Fixed, HalfSpace, Sphere

    rng = np.random.default_rng(seed)
    cells = int(np.ceil((bodies / 4.0) ** (1.0 / 3.0)))
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    base = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]])
    points = ((corners + base).reshape(-1, 3) * 2.0 * np.sqrt(2.0))[:bodies]
    points = points + rng.normal(scale=0.015, size=points.shape)
    hull = rng.normal(size=(12, 3))
    shapes = {
        "spheres": Sphere(1.0),
        "boxes": Box([0.8, 0.7, 0.75]),
        "capsules": Capsule(0.6, 0.5),
        "hulls": ConvexHull(1.1 * hull / np.linalg.norm(hull, axis=1)[:, None]),
    }
    grain = Body(shapes[kind], density=1.0)
    floor = Body(HalfSpace([0.0, 0.0, 1.0], -1.0), motion=Fixed())
    turns = rng.normal(size=(bodies + 1, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    zero = np.zeros((bodies + 1, 3))
    states = BodyStates(np.concatenate([points, zero[:1]]), turns, zero, zero.copy())
    states.rotations[-1] = [1.0, 0.0, 0.0, 0.0]
    return [grain] * bodies + [floor], states


def best_of(task: Callable[[], object], times: int) -> tuple[float, float]:
    """Least wall and processor seconds of several runs."""
    walls, processors = [], []
    for _ in range(times):
        wall, processor = perf_counter(), process_time()
        task()
        walls.append(perf_counter() - wall)
        processors.append(process_time() - processor)
    return min(walls), min(processors)


def run_one(task: dict[str, Any]) -> dict[str, Any]:
    """Detect the contacts of one arrangement in this process, several times."""
    from scipy.spatial import KDTree

    from barchan.bodies.contact import ContactGeometry
    from barchan.bodies.contact._grids import close_pairs

    small, small_states = arrangement(200, task["kind"])
    ContactGeometry.of(small, 3).detect(small_states, REACH)  # compiles, or loads what is compiled
    bodies, states = arrangement(task["bodies"], task["kind"])
    began = perf_counter()
    geometry = ContactGeometry.of(bodies, 3)
    compiled = perf_counter() - began
    wall, processor = best_of(lambda: geometry.detect(states, REACH), task["times"])
    placed = geometry.placed(states)
    still = np.zeros((len(states), 3)), np.zeros(len(states))
    margins = np.full(len(states), 0.5 * REACH)
    broad, _ = best_of(lambda: close_pairs(geometry.extents(placed, margins, *still)), task["times"])
    centres = states.positions[:-1]
    peer, _ = best_of(lambda: KDTree(centres).query_pairs(2.0 + REACH, output_type="ndarray"), 2)
    return {
        "pairs": len(close_pairs(geometry.extents(placed, margins, *still))),
        "contacts": len(geometry.detect(states, REACH)),
        "compiled": compiled,
        "broad": broad,
        "wall": wall,
        "processor": processor,
        "peer": peer,
    }


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=float, nargs="*", default=[1e3, 1e4, 1e5])
    parser.add_argument(
        "--kinds", nargs="*", default=["spheres", "capsules", "boxes", "hulls"], help="shapes of the grains"
    )
    parser.add_argument("--threads", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--times", type=int, default=7)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    choice = parser.parse_args()
    if choice.child:
        print(json.dumps(run_one(json.loads(choice.child))))
        return
    rows = []
    for kind in choice.kinds:
        for bodies in choice.bodies:
            for threads in choice.threads:
                task = {"kind": kind, "bodies": int(bodies), "times": choice.times}
                command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(task)]
                child = subprocess.run(
                    command,
                    env=environment(NUMBA_NUM_THREADS=str(threads)),
                    capture_output=True,
                    text=True,
                    check=False,
                )
                if child.returncode:
                    raise SystemExit(f"{kind} failed:\n{child.stderr}")
                found = json.loads(child.stdout)
                rows.append(
                    (
                        kind, int(bodies), threads, found["pairs"], found["contacts"], found["compiled"], found["broad"],
                        found["wall"], found["processor"], 1e6 * found["wall"] / bodies, found["peer"],
                    )
                )  # fmt: skip
    heads = (
        "grains", "bodies", "threads", "close pairs", "contacts", "s to compile", "s of the broad phase", "s in all",
        "s of processor", "us a body", "s of scipy",
    )  # fmt: skip
    print_table(f"Contact detection within {REACH:g} radii", heads, rows)


if __name__ == "__main__":
    main()
