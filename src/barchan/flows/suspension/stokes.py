"""The Stokes-like step of the volume-averaged velocity, by projected conjugate gradients (seed B, 8.3.3).

    (M + K) u = load + B^T p      B u + D p = k      u given at the components that are not free

with M > 0 diagonal, K the viscous stiffness, and D = 0, or D = penalty V for penalised pressures. The iteration (Gould, Hribar
and Nocedal, SIAM J. Sci. Comput. 23, 2001) stays on the constraints: its preconditioner is the saddle point of the diagonal
G = M + diag K, solved through S = B G^-1 B^T + D, so B u + D p = k holds to round-off however early it ends. A penalty is a
slack velocity s = D p of inertia 1/D, so one algorithm serves both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.errors import InputError
from barchan.linalg import GramPattern, PatternSolver, one_blas_thread

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class StokesSolution:
    """u (m,) [m/s], p (c,) [Pa] and how the iteration ended.

    residual : |load + B^T p - (M + K) u| over the free components, relative to the larger of |load| and |(M + K) u_0|, u_0
        being the least velocities with what is given, in the norm of G^-1.   missed : max |B u + D p - k| [m^d/s].
    """

    u: Vector
    p: Vector
    iterations: int
    residual: float
    missed: float
    converged: bool


class StokesSolver:
    """Makes such steps again and again with the same constraints: the order of elimination of S is found once.

    Parameters
    ----------
    constraints : B (c, m), of full row rank on the free components unless penalised.
    compliance : (c,) diagonal of D > 0 [m^d/(Pa s)], `1 / FluidGrid.slack_masses`; None for D = 0.

    Raises InputError for a compliance of another size, not positive or not finite.
    """

    def __init__(self, constraints: Any, compliance: Vector | None = None) -> None:
        B = sp.csr_array(constraints, dtype=float)
        c, self.velocities = B.shape
        self.slack_masses = np.zeros(0)
        if compliance is not None:
            _check("compliance", compliance, c, positive=True)
            self.slack_masses = 1.0 / compliance
            B = sp.csr_array(sp.hstack([B, sp.eye_array(c)], format="csr"))
        self.B = B
        self.transposed = sp.csr_array(B.T)
        self._gram = GramPattern(sp.csr_array((c, c)), self.transposed, 1, upper=True)
        self._solver: PatternSolver | None = None

    def solve(
        self,
        mass: Vector,
        stiffness: Any | None,
        load: Vector,
        k: Vector | None = None,
        free: NDArray[np.bool_] | None = None,
        values: Vector | None = None,
        tolerance: float = 1e-8,
        max_iterations: int = 2000,
    ) -> StokesSolution:
        """Velocities and pressures of one step.

        mass : (m,) diagonal of M > 0 [kg/s].  stiffness : K (m, m) symmetric >= 0 [kg/s], None without viscosity (one
        projection then).  load : (m,) [N].  k : (c,) [m^d/s], 0 when None.  free, values : (m,) which components are sought,
        all when None, and the values of the others, 0 when None.  tolerance : of `residual`.

        Raises InputError for arrays of other sizes or not finite, masses that are not positive, or dependent constraints.
        """
        c, m = self.B.shape[0], self.velocities
        sizes = {"mass": (mass, m), "load": (load, m), "k": (k, c), "values": (values, m)}
        for name, (array, size) in sizes.items():
            if array is not None:
                _check(name, array, size, positive=name == "mass")
        if free is not None and np.shape(free) != (m,):
            raise InputError("free", np.shape(free), f"an array of {m}")
        given = np.zeros(m) if free is None or values is None else np.where(free, 0.0, values)
        with one_blas_thread():
            step = _Step(self, mass, stiffness, load, np.zeros(c) if k is None else k, free)
            return step.run(given, tolerance, max_iterations)

    def factorise(self, inverse: Vector) -> PatternSolver:
        """Solver of S = B diag(inverse) B^T for `inverse` >= 0, of velocities and slacks."""
        data = self._gram.data(inverse.reshape(-1, 1, 1))
        if self._solver is None:
            pattern = self._gram.matrix()
            pattern.data[:] = data
            # On one thread: the bytes then do not depend on their number, and solves this small gain nothing from more.
            self._solver = PatternSolver(pattern, "positive", threads=1)
        if not self._solver.factorise(data):
            raise InputError("constraints", f"{len(self.B.indptr) - 1} dependent rows", "independent")
        return self._solver


class _Step:
    """One step. Its unknowns x are the velocities and, behind them, the slacks, which have neither load nor stiffness."""

    def __init__(
        self,
        solver: StokesSolver,
        mass: Vector,
        stiffness: Any | None,
        load: Vector,
        k: Vector,
        free: NDArray[np.bool_] | None,
    ) -> None:
        self.B, self.transposed, self.K, self.m, self.k = solver.B, solver.transposed, stiffness, len(mass), k
        slacks = solver.slack_masses
        self.mass, self.load = np.append(mass, slacks), np.append(load, np.zeros(len(slacks)))
        inverse = 1.0 / (mass if stiffness is None else mass + stiffness.diagonal())
        inverse = inverse if free is None else np.where(free, inverse, 0.0)
        self.inverse = np.append(inverse, 1.0 / slacks)
        self.factor = solver.factorise(self.inverse)

    def run(self, given: Vector, tolerance: float, most: int) -> StokesSolution:
        x = np.append(given, np.zeros(len(self.mass) - self.m))
        x = x + self._correction(x)
        reference = max(self._norm(self.load), self._norm(self._product(x)))
        x, iterations = self._inertial(x), 0
        if self.K is not None:
            x, iterations = self._iterate(x, tolerance * reference, most)
            x = x + self._correction(x)
        r = self.load - self._product(x)
        y = self._projected(r)[1]
        y = y + self._projected(r - self.transposed @ y)[1]
        left = self._norm(r - self.transposed @ y)
        residual = left / reference if reference > 0.0 else left
        missed = float(np.max(np.abs(self.B @ x - self.k), initial=0.0))
        return StokesSolution(x[: self.m], -y, iterations, residual, missed, residual <= tolerance)

    def _inertial(self, x: Vector) -> Vector:
        """From x on the constraints towards load / mass put on them: all the way without viscosity, else as far as is best."""
        other = np.where(self.inverse > 0.0, self.load / self.mass, x)
        way = other + self._correction(other) - x
        if self.K is None:
            return x + way
        resistance = float(way @ self._product(way))
        share = float(way @ (self.load - self._product(x))) / resistance if resistance > 0.0 else 0.0
        # A way that is round-off has no best share.
        return x + min(max(share, 0.0), 1.0) * way

    def _iterate(self, x: Vector, goal: float, most: int) -> tuple[Vector, int]:
        r = self.load - self._product(x)
        g, y = self._projected(r)
        # Taking B^T y off the residual keeps the projections accurate as they shrink (the authors' residual update).
        r = r - self.transposed @ y
        d, size, iterations = g, float(r @ g), 0
        while size > goal**2 and iterations < most:
            image = self._product(d)
            length = size / float(d @ image)
            x, r = x + length * d, r - length * image
            g, y = self._projected(r)
            r = r - self.transposed @ y
            before, size = size, float(r @ g)
            d = g + size / before * d
            iterations += 1
        return x, iterations

    def _projected(self, r: Vector) -> tuple[Vector, Vector]:
        """(g, y): G g = r - B^T y with B g = 0."""
        y = self.factor.solve(self.B @ (self.inverse * r))
        return self.inverse * (r - self.transposed @ y), y

    def _correction(self, x: Vector) -> Vector:
        """The least change, in the norm of G, that puts x on the constraints."""
        return np.asarray(self.inverse * (self.transposed @ self.factor.solve(self.k - self.B @ x)))

    def _product(self, x: Vector) -> Vector:
        """(M + K) x."""
        image = self.mass * x
        if self.K is not None:
            image[: self.m] += self.K @ x[: self.m]
        return image

    def _norm(self, force: Vector) -> float:
        return float(np.sqrt(np.sum(self.inverse * force**2)))


def _check(name: str, array: Any, size: int, positive: bool) -> None:
    if np.shape(array) != (size,):
        raise InputError(name, np.shape(array), f"an array of {size}")
    if not np.all(np.isfinite(array)) or (positive and np.any(np.asarray(array) <= 0.0)):
        raise InputError(name, array, "finite and > 0" if positive else "finite")
