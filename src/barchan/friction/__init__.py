"""Discrete Coulomb friction problems: data, certificate, solvers, files (seed B chapters 2-4).

p = friction.read("problem.hdf5")
s = friction.solve(p, tol=1e-6)
s.certificate.residual
"""

from barchan.friction.certificate import Certificate, certify
from barchan.friction.existence import Existence, existence
from barchan.friction.interchange import read, write
from barchan.friction.problem import Problem
from barchan.friction.solution import Progress, Solution
from barchan.friction.solve import methods, solve

__all__ = [
    "Certificate",
    "Existence",
    "Problem",
    "Progress",
    "Solution",
    "certify",
    "existence",
    "methods",
    "read",
    "solve",
    "write",
]
