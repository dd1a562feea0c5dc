"""Problems from and to files: FCLIB and `.dat` (see `barchan.friction.files` for the formats)."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike

import scipy.sparse as sp

from barchan.cones import Coulomb, DruckerPrager, Law
from barchan.errors import InputError
from barchan.friction.files import ProblemArrays, SolutionArrays, read_arrays, write_arrays
from barchan.friction.problem import Problem
from barchan.friction.solution import Solution


def read(path: str | PathLike[str]) -> Problem:
    """Read a problem with Coulomb's law from an FCLIB `.hdf5` (local or global) or `.dat` file.

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
        return Problem.reduced(W=arrays.W, b=arrays.b, law=law, block_size=arrays.block_size)
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


def arrays_of(problem: Problem, solution: Solution | None = None) -> ProblemArrays:
    """The file arrays of a problem with Coulomb's law (InputError for another one)."""
    parameters = problem.parameters
    if parameters[:, 1:].any():
        raise InputError(
            "law", type(problem.law).__name__, "Coulomb: problem files hold friction coefficients only"
        )
    bare = ProblemArrays(
        dimension=3 if problem.s > 2 else 2, block_size=problem.s, mu=parameters[:, 0].copy()
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
    """Write a problem, and a solution if given, as FCLIB (`.hdf5`, `.h5`) or reduced `.dat`.

    Raises
    ------
    InputError : a law other than Coulomb's (the formats have no place for it), unknown suffix, folder not writable.
    """
    write_arrays(path, arrays_of(problem, solution))
