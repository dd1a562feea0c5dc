"""Problems from and to files: FCLIB and `.dat` (see `barchan.friction.files` for the formats)."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike

import numpy as np
import scipy.sparse as sp

from barchan.cones import Coulomb, DruckerPrager, Law, RoundLaw
from barchan.errors import InputError
from barchan.friction.files import ProblemArrays, SolutionArrays, read_arrays, write_arrays
from barchan.friction.problem import Problem
from barchan.friction.solution import Solution


def read(path: str | PathLike[str]) -> Problem:
    """Read a problem from an FCLIB `.hdf5` (local or global) or `.dat` file.

    The law is Coulomb's, or Drucker-Prager's without yield stresses where the file gives a dilatancy. The bilateral multipliers
    of a mixed local problem are eliminated (seed B, Eq. 2.19); those of a global one stay, as C v = k.

    Raises
    ------
    InputError : missing, truncated, foreign or inconsistent file.
    """
    return problem_of(read_arrays(path))


def problem_of(arrays: ProblemArrays) -> Problem:
    """The problem that file arrays describe: Coulomb's law, or Drucker-Prager where the file gives a dilatancy."""
    law: Law = Coulomb(arrays.mu)
    if arrays.dilatancy is not None:
        law = DruckerPrager(arrays.mu, dilatancy=arrays.dilatancy)
    if arrays.W is not None:
        W, b = _eliminated(arrays) if arrays.P is not None else (arrays.W, arrays.b)
        return Problem.reduced(W=W, b=b, law=law, block_size=arrays.block_size)
    return Problem(
        M=arrays.M,
        f=arrays.f,
        H=arrays.H,
        w=arrays.w,
        law=law,
        C=arrays.C,
        k=arrays.k,
        block_size=arrays.block_size,
    )


def _eliminated(arrays: ProblemArrays) -> tuple[np.ndarray, np.ndarray]:
    """W - B P^-1 B^T and b - B P^-1 c, dense (seed B, Eq. 2.19)."""
    assert arrays.W is not None and arrays.b is not None and arrays.B is not None and arrays.P is not None
    B, P = arrays.B.toarray(), arrays.P.toarray()
    if np.linalg.matrix_rank(P) < len(P):
        raise InputError("R (our P)", "singular", "invertible (independent bilateral rows)")
    spread = np.linalg.solve(P.T, B.T).T
    return arrays.W.toarray() - spread @ B.T, arrays.b - spread @ arrays.c


def arrays_of(problem: Problem, solution: Solution | None = None) -> ProblemArrays:
    """The file arrays of a problem; InputError for a law with yield stresses or facets, which no file format holds."""
    if not isinstance(problem.law, RoundLaw):
        raise InputError(
            "law", type(problem.law).__name__, "Coulomb's or Drucker-Prager's: problem files know no facets"
        )
    mu, shear, tension, dilatancy = problem.parameters.T.copy()
    if shear.any() or tension.any():
        raise InputError(
            "law", type(problem.law).__name__, "without yield stresses: problem files hold coefficients only"
        )
    bare = ProblemArrays(
        dimension=3 if problem.s > 2 else 2,
        block_size=problem.s,
        mu=mu,
        dilatancy=dilatancy if dilatancy.any() else None,
    )
    solved = None if solution is None else SolutionArrays(r=solution.r, u=solution.u, v=solution.v)
    if problem.is_reduced:
        return replace(bare, solution=solved, W=sp.csr_array(problem.W), b=problem.b)
    return replace(
        bare,
        solution=solved,
        M=problem.M,
        f=problem.f,
        H=sp.csr_array(problem.H),
        w=problem.w,
        C=problem.C,
        k=problem.k,
    )


def write(path: str | PathLike[str], problem: Problem, solution: Solution | None = None) -> None:
    """Write a problem, and a solution if given, as FCLIB (`.hdf5`, `.h5`) or `.dat`.

    Raises
    ------
    InputError : unknown suffix, folder not writable, or what the format has no place for: a law with yield stresses in either;
        a dilatancy in FCLIB and in full `.dat` files; a solution or bilateral rows in `.dat`; blocks of 6.
    """
    write_arrays(path, arrays_of(problem, solution))
