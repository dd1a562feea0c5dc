"""Run by the system's Python, not by barchan: one solver of Siconos on one `.dat` problem, at ever smaller tolerances.

Arguments: source.dat, target.npz, solver, iterations, seconds of patience, repeats, powers of ten... After every tolerance the
answers so far are written, so that a crash or a kill loses only the solve in hand.
"""

import os
import sys
import time
from typing import Any

import numpy as np
import siconos.numerics as sn  # type: ignore[import-not-found]

source, target, solver, iterations, patience, repeats = sys.argv[1:7]
found: dict[str, list[Any]] = {"powers": [], "forces": [], "seconds": [], "iterations": []}
for power in map(int, sys.argv[7:]):
    times = []
    for _ in range(int(repeats)):
        # Both anew: a solver may leave conversions in the problem and its own state in the options.
        problem = sn.frictionContactProblemFromFile(source)
        options = sn.SolverOptions(getattr(sn, solver))
        options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = int(iterations)
        options.dparam[sn.SICONOS_DPARAM_TOL] = 10.0**-power
        driver = sn.fc2d_driver if problem.dimension == 2 else sn.fc3d_driver
        size = problem.numberOfContacts * problem.dimension
        r, u = np.zeros(size), np.zeros(size)
        began = time.perf_counter()
        driver(problem, r, u, options)
        times.append(time.perf_counter() - began)
    found["powers"].append(power)
    found["forces"].append(r)
    found["seconds"].append(min(times))
    found["iterations"].append(options.iparam[sn.SICONOS_IPARAM_ITER_DONE])
    np.savez(
        target + ".part.npz",
        powers=found["powers"],
        forces=found["forces"],
        seconds=found["seconds"],
        iterations=found["iterations"],
    )
    os.replace(target + ".part.npz", target)
    if found["iterations"][-1] >= int(iterations) or times[-1] > float(patience):
        break
