"""The creeping silo of seed A's Table 2 (P2-P1d, mu = 0.5, Re = 1) and steps of the one with inertia.

    python benchmarks/bench_silo_2d.py [vertices ...]       # default: 670 2703 10403 41509, then 5,000 vertices with inertia

Bars of the project: 1e-4 within 30 factorisations, 1e-6 within 60, the finest mesh in less than 180 s and ten times faster than
ASPG to 1e-4, a warm step with inertia on 5,000 vertices within 2 s. Run it with nothing else running.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import barchan as bc
from barchan.flows.dense import DenseFlow, Material, NoSlip, Symmetry, observables
from barchan.spaces.meshes import silo
from barchan.spaces.mixed import MixedSpace

VERTICES = (670, 2703, 10403, 41509)
LEVELS = (1e-3, 3e-4, 1e-4, 1e-5, 1e-6)
FACTORISATIONS = 60
STEPS = 20


def build(vertices: int, reynolds: float) -> DenseFlow:
    """Half of the silo W = H = 8, D = 1, walls and bottom without slip."""
    space = MixedSpace(silo(1.0, 8.0, 8.0, vertices), "P2", "P1d")
    conditions = {"axis": Symmetry(), "wall": NoSlip(), "bottom": NoSlip()}
    return DenseFlow(space, Material(mu=0.5, viscosity=1.0 / reynolds), conditions)


def reached(history: list[bc.friction.Progress]) -> str:
    """Iterations and seconds to each level."""
    words = []
    for level in LEVELS:
        first = next((entry for entry in history if entry.residual <= level), None)
        words.append(f"{level:g}: " + (f"{first.iteration} in {first.seconds:.1f} s" if first else "-"))
    return ", ".join(words)


def creeping(vertices: int) -> None:
    """Ours against ASPG, which gets twice as long."""
    start = time.perf_counter()
    problem = build(vertices, 1.0).problem()
    rows = problem.n * problem.s
    assert problem.rho is not None
    print(
        f"{vertices} vertices: {problem.size} velocities, {rows} forces, built in {time.perf_counter() - start:.1f} s"
    )
    ours = bc.friction.solve(problem, "split_interior_point", tol=1e-6, max_iterations=FACTORISATIONS)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(
        f"  split_interior_point {ours.iterations} factorisations, {ours.elapsed:.1f} s, certificate "
        f"{ours.certificate.residual:.2e}, peak {peak:.1f} GiB\n    {reached(ours.history)}",
        flush=True,
    )
    limit = time.perf_counter() + 2.0 * ours.elapsed
    theirs = bc.friction.solve(
        problem, "aspg", tol=1e-4, operator="matrix-free", callback=lambda *_: time.perf_counter() > limit
    )
    print(
        f"  aspg {theirs.iterations} iterations, {theirs.elapsed:.1f} s, certificate {theirs.certificate.residual:.2e}\n"
        f"    {reached(theirs.history)}",
        flush=True,
    )


def inertial(vertices: int) -> None:
    """Seconds of steps after the first ten, certificate 2e-4, dt = 0.05, Re = 100."""
    flow = build(vertices, 100.0)
    state, seconds, worst = flow.at_rest(), [], 0.0
    for _ in range(10 + STEPS):
        start = time.perf_counter()
        state = flow.step(state, 0.05, 2e-4)
        seconds.append(time.perf_counter() - start)
        worst = max(worst, state.certificate.residual)
    late = np.array(seconds[10:])
    print(
        f"{vertices} vertices with inertia: mean {late.mean():.2f} s a step, median {np.median(late):.2f}, "
        f"longest {late.max():.2f}; worst certificate {worst:.1e}; "
        f"discharge {2.0 * observables.discharge(flow, state, 'outlet'):.3f}"
    )


def main() -> None:
    bc.friction.solve(build(150, 1.0).problem(), "split_interior_point", tol=1e-3)  # compiles
    for vertices in [int(word) for word in sys.argv[1:]] or VERTICES:
        creeping(vertices)
    if len(sys.argv) == 1:
        inertial(5000)


if __name__ == "__main__":
    main()
