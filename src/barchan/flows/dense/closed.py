"""The pressure of a flow closed on all sides, known up to a constant (seed B 6.4.1, homogeneous Dirichlet conditions).

An interior point ends in the middle of all solutions, far up; residuals relative to such stresses would mean little.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from barchan import friction

ROUNDING = 1e-10


def lowest_pressure(problem: friction.Problem, r: np.ndarray) -> float:
    """Normal stress that can be taken from all forces r (n, s) alike: 0 where a constant pressure does work or none is spare.

    Every block stays admissible: |r_T| <= sigma_S + mu (r_N + tau_t), r_N >= -tau_t.
    """
    uniform = np.zeros_like(r)
    uniform[:, 0] = 1.0
    work = problem.H.T @ uniform.reshape(-1)
    scale = abs(problem.H).T @ uniform.reshape(-1)
    if np.linalg.norm(work) > ROUNDING * np.linalg.norm(scale):
        return 0.0
    mu, sigma, tensile, _ = problem.parameters.T
    needed = np.maximum(np.linalg.norm(r[:, 1:], axis=1) - sigma, 0.0)
    spare = r[:, 0] + tensile - np.divide(needed, mu, out=np.zeros_like(needed), where=mu > 0.0)
    return max(0.0, float(spare.min()))


def solve_at_lowest_pressure(
    problem: friction.Problem, method: str, tolerance: float, **options: Any
) -> friction.Solution:
    """`friction.solve`, its answer at the lowest pressure; solved again, more exactly, where that misses the tolerance."""
    solution = friction.solve(problem, method, tolerance, **options)
    for attempt in range(2):
        r = np.array(solution.r).reshape(-1, problem.s)
        spare = lowest_pressure(problem, r)
        if spare == 0.0:
            break
        before = float(np.linalg.norm(r))
        r[:, 0] -= spare
        certificate = friction.certify(problem, r.reshape(-1), solution.v)
        converged = solution.status != "no solution" and certificate.residual <= tolerance
        solution = replace(solution, r=r.reshape(-1), certificate=certificate, converged=converged)
        if converged or attempt == 1:
            break
        exact = 0.5 * tolerance * float(np.linalg.norm(r)) / before
        solution = friction.solve(problem, method, exact, **{**options, "r0": solution.r})
    return solution
