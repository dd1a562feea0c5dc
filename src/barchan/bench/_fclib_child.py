"""Run by the system's Python, not by barchan: Siconos on an FCLIB file, read and answered through FCLIB's own library.

Arguments: file, "local" or "global", tolerance, iterations. The answer becomes the file's solution. The last line printed is
JSON: what the solver returned (0 when it is content) and its iterations.
"""

import ctypes as c
import ctypes.util
import json
import sys
from typing import Any

import numpy as np
import siconos.numerics as sn  # type: ignore[import-not-found]

DOUBLES, INTS = c.POINTER(c.c_double), c.POINTER(c.c_int)


class Matrix(c.Structure):
    """A matrix of FCLIB: nz = -2 for compressed rows, -1 for compressed columns, else nz triplets (i; p)."""

    _fields_ = [
        ("nzmax", c.c_int), ("m", c.c_int), ("n", c.c_int), ("p", INTS), ("i", INTS), ("x", DOUBLES), ("nz", c.c_int),
        ("info", c.c_void_p),
    ]  # fmt: skip

    def dense(self) -> Any:
        """(m, n) array."""
        found = np.zeros((self.m, self.n))
        if self.nz >= 0:
            np.add.at(found, (self.i[: self.nz], self.p[: self.nz]), self.x[: self.nz])
            return found
        lines = self.m if self.nz == -2 else self.n
        starts = self.p[: lines + 1]
        line, other = np.repeat(np.arange(lines), np.diff(starts)), self.i[: starts[-1]]
        np.add.at(found, (line, other) if self.nz == -2 else (other, line), self.x[: starts[-1]])
        return found

    def siconos(self) -> Any:
        """The same matrix as triplets of Siconos."""
        full = self.dense()
        made = sn.NM_create(sn.NM_SPARSE, self.m, self.n)
        rows, columns = np.nonzero(full)
        sn.NM_triplet_alloc(made, max(len(rows), 1))
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            sn.NM_zentry(made, row, column, float(full[row, column]), 0.0)
        return made


MATRIX = c.POINTER(Matrix)


class Global(c.Structure):
    """M v = f + H r, u = H^T v + w."""

    _fields_ = [
        ("M", MATRIX), ("H", MATRIX), ("G", MATRIX), ("mu", DOUBLES), ("f", DOUBLES), ("b", DOUBLES), ("w", DOUBLES),
        ("spacedim", c.c_int), ("info", c.c_void_p),
    ]  # fmt: skip


class Local(c.Structure):
    """u = W r + q."""

    _fields_ = [
        ("W", MATRIX), ("V", MATRIX), ("R", MATRIX), ("mu", DOUBLES), ("q", DOUBLES), ("s", DOUBLES),
        ("spacedim", c.c_int), ("info", c.c_void_p),
    ]  # fmt: skip


class Solution(c.Structure):
    """Velocities, relative velocities, forces, multipliers."""

    _fields_ = [("v", DOUBLES), ("u", DOUBLES), ("r", DOUBLES), ("l", DOUBLES)]


def options_of(solver: int, tolerance: float, iterations: int) -> Any:
    """Options of a solver of Siconos."""
    options = sn.SolverOptions(solver)
    options.dparam[sn.SICONOS_DPARAM_TOL] = tolerance
    options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = iterations
    return options


def solve_local(d: int, W: Any, q: Any, mu: Any, request: tuple[float, int]) -> tuple[Any, Any, int, int]:
    """u, r, what the solver returned and its iterations; Gauss-Seidel in 2D and 3D."""
    options = options_of(sn.SICONOS_FRICTION_2D_NSGS if d == 2 else sn.SICONOS_FRICTION_3D_NSGS, *request)
    r, u = np.zeros(len(q)), np.zeros(len(q))
    ended = (sn.fc2d_driver if d == 2 else sn.fc3d_driver)(
        sn.FrictionContactProblem(d, W, q, mu), r, u, options
    )
    return u, r, ended, int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE])


def solve_global(problem: Global, request: tuple[float, int]) -> tuple[Any, Any, Any, int, int]:
    """v, u, r, what the solver returned and its iterations."""
    d, H = problem.spacedim, problem.H.contents
    m, size = H.m, H.n
    f, w = np.array(problem.f[:m]), np.array(problem.w[:size])
    mu = np.array(problem.mu[: size // d])
    if d == 2:  # Siconos solves reduced problems alone in the plane
        columns, masses = H.dense(), problem.M.contents.dense()
        made = np.linalg.solve(masses, np.column_stack([columns, f]))
        W, q = columns.T @ made[:, :-1], columns.T @ made[:, -1] + w
        u, r, ended, count = solve_local(d, W, q, mu, request)
        return np.linalg.solve(masses, f + columns @ r), u, r, ended, count
    M, H = problem.M.contents.siconos(), H.siconos()  # kept alive while the problem points at them
    given = sn.GlobalFrictionContactProblem()
    given.dimension, given.numberOfContacts, given.M, given.H = d, size // d, M, H
    given.q, given.b, given.mu = f, w, mu
    options = options_of(sn.SICONOS_GLOBAL_FRICTION_3D_NSGS_WR, *request)
    r, u, v = np.zeros(size), np.zeros(size), np.zeros(m)
    ended = sn.gfc3d_driver(given, r, u, v, options)
    return v, u, r, ended, int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE])


def main() -> None:
    """Read, solve, write."""
    path, form, tolerance, iterations = sys.argv[1:5]
    request = float(tolerance), int(iterations)
    library = c.CDLL(ctypes.util.find_library("fclib"))
    read = library.fclib_read_local if form == "local" else library.fclib_read_global
    read.restype = c.POINTER(Local if form == "local" else Global)
    found = read(path.encode())
    if not found:
        sys.exit("FCLIB cannot read the file")
    problem = found.contents
    if form == "local":
        size, d = problem.W.contents.m, problem.spacedim
        q, mu = np.array(problem.q[:size]), np.array(problem.mu[: size // d])
        v = np.zeros(1)  # a reduced problem has none
        u, r, ended, count = solve_local(d, problem.W.contents.dense(), q, mu, request)
    else:
        v, u, r, ended, count = solve_global(problem, request)
    answer = Solution(*(np.ascontiguousarray(part).ctypes.data_as(DOUBLES) for part in (v, u, r)), None)
    if not library.fclib_write_solution(c.byref(answer), path.encode()):
        sys.exit("FCLIB cannot write its solution")
    sys.stdout.write("\n" + json.dumps({"ended": int(ended), "iterations": count}) + "\n")


main()
