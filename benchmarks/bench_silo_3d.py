"""The creeping silo in three dimensions: 100,000 velocity unknowns to a certificate of 1e-4, time and memory (bar: 20 minutes).

python benchmarks/bench_silo_3d.py [unknowns] [tolerance]
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import barchan as bc
from barchan.flows.dense import DenseFlow, Material, NoSlip, Symmetry
from barchan.spaces.meshes import silo_3d
from barchan.spaces.mixed import MixedSpace

MU_HAT = 0.5


def build(unknowns: int) -> DenseFlow:
    """A quarter of the silo, 4 L wide and high, outlet L; P2-P1d, about `unknowns` velocities."""
    across = 2
    while True:
        mesh = silo_3d(1.0, 4.0, 4.0, cells=(across, 2 * across))
        space = MixedSpace(mesh, "P2", "P1d")
        if space.size >= unknowns:
            break
        across += 1
    walls = {name: NoSlip() for name in mesh.boundaries if name not in ("axis_x", "axis_y", "top", "outlet")}
    conditions = {"axis_x": Symmetry(), "axis_y": Symmetry(), **walls}
    return DenseFlow(space, Material(mu=MU_HAT), conditions, gravity=(0.0, 0.0, -1.0))


def main() -> None:
    unknowns = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    tolerance = float(sys.argv[2]) if len(sys.argv) > 2 else 1e-4
    start = time.perf_counter()
    flow = build(unknowns)
    problem = flow.problem()
    print(
        f"{flow.space.mesh.nvertices} vertices, {problem.size} free velocities, {problem.n} blocks of {problem.s}"
    )
    print(
        f"built in {time.perf_counter() - start:.1f} s; gravity load {np.linalg.norm(problem.f):.3g}",
        flush=True,
    )

    def tell(progress: bc.friction.Progress, r: np.ndarray) -> bool:
        print(f"  {progress.iteration:4d} {progress.residual:.2e} {progress.seconds:7.1f} s", flush=True)
        return False

    start = time.perf_counter()
    solution = bc.friction.solve(
        problem, "split_interior_point", tol=tolerance, max_iterations=60, callback=tell
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(
        f"{solution.certificate}, {solution.iterations} factorisations, {time.perf_counter() - start:.0f} s, {peak:.1f} GiB"
    )


if __name__ == "__main__":
    main()
