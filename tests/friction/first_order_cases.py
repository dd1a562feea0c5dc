"""Small well-conditioned problems on which every first-order method must succeed, shared by two test modules."""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.sparse as sp
from problems import random_problem

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.friction import Problem

CONVEX_LAWS = {
    "cone": lambda n: SecondOrderCone(np.linspace(0.0, 0.8, n)),
    "truncated": lambda n: DruckerPrager(
        np.full(n, 0.4), shear_yield=np.linspace(0.0, 0.2, n), tensile_yield=0.02, dilatancy=0.4
    ),
}
COUNT = 10
CASES = (
    ("lumped", "cone"),
    ("lumped", "truncated"),
    ("general", "truncated"),
    ("constrained", "cone"),
    ("reduced", "truncated"),
)


def small_problem(shape: str, s: int, law: Law) -> Problem:
    """COUNT contacts between 20 bodies: M diagonal, or coupled, with three bilateral rows, or eliminated."""
    return _base(shape, s).variant(law)


@cache
def _base(shape: str, s: int) -> Problem:
    law = Coulomb(np.zeros(COUNT))
    base = random_problem(3, COUNT, s, bodies=20, law=law)
    if shape == "lumped":
        return base
    rng = np.random.default_rng(1)
    m = base.size
    coupling = sp.random_array((m, m), density=0.05, rng=rng)
    M = sp.csr_array(0.1 * (coupling @ coupling.T) + sp.eye_array(m))
    if shape == "general":
        return Problem(M=M, f=base.f, H=base.H, w=0.1 * rng.standard_normal(COUNT * s), law=law)
    if shape == "constrained":
        C = sp.csr_array(rng.standard_normal((3, m)))
        return Problem(M=M, f=base.f, H=base.H, w=base.w, law=law, C=C, k=0.1 * rng.standard_normal(3))
    H = base.H.toarray()
    W = H @ np.linalg.solve(M.toarray(), H.T)
    return Problem.reduced(0.5 * (W + W.T), H @ np.linalg.solve(M.toarray(), base.f), law, block_size=s)
