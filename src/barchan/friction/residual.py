"""The solvers' own estimate of the law residual: the certificate's definition, by code of its own (DESIGN: certificate)."""

from __future__ import annotations

import math

import numpy as np

from barchan.cones import FacetedCoulomb
from barchan.friction._faceted_kernels import faceted_law_residual_squared
from barchan.friction._kernels import law_residual_squared
from barchan.friction.problem import Problem


def law_residual(problem: Problem, r: np.ndarray, u: np.ndarray) -> tuple[float, float]:
    """Law residual of forces r (n, s) and rates u (n, s), and the force it is relative to, max(|r|, r_ref)."""
    faceted = isinstance(problem.law, FacetedCoulomb)
    measure = faceted_law_residual_squared if faceted else law_residual_squared
    violation, square = measure(r, u, problem.parameters, problem.rho)
    size = max(math.sqrt(square), problem.reference_force)
    if violation == 0.0:
        return 0.0, size
    return (math.sqrt(violation) / size if size > 0.0 else math.inf), size
