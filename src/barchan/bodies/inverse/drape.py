"""The draping of a shell, the equilibrium that belongs to a rest shape, and its derivative (seed B 4.4.2, Eqs. 4.22-4.24).

Phi(p) minimises E(q, p) + |q - t|^2 / (2 lambda), E with the weight, over V = {q: H (q - t) in prod K_{1/mu_i}}, t the target
and H its contacts, one a vertex. A Newton step is a convex friction problem (4.24): u = H (q - t) in K_{1/mu}, r in K_mu,
u . r = 0.
At a solution 0 = P_V(q - a g) - q with g the gradient and any a > 0: the implicit function theorem on it gives dPhi/dp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.cloth import ClothContacts, ShellEnergy
from barchan.cones import SecondOrderCone, project_dual_cone
from barchan.cones.complementarity import Coefficients
from barchan.cones.derivatives import projection_jacobian
from barchan.errors import InputError
from barchan.friction import Problem
from barchan.friction.methods._inner import run_inner
from barchan.linalg.factor import sparse_solver
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]
SUFFICIENT, SHORTEST = 1e-4, 2.0**-20
INEXACT, MOST_PASSES = 1e-10, 3000
NOISE = 1e-10


@dataclass(frozen=True, eq=False)
class Draped:
    """An equilibrium: positions (n, 3) [m], forces (k, 3) of the contacts [N] (normal, tangents), Newton steps.

    residual : |P_V(q - a g) - q| / a relative to the weight; `converged` when that is within the tolerance.
    """

    positions: Vector
    forces: Vector
    steps: int
    residual: float
    converged: bool


class Drape:
    """The draping function of a cloth about a target shape.

    energy : of the shell; its rest shape is changed by `energy.with_rest`.  masses : (n,) [kg], kept.  gravity : (3,) [m/s^2].
    target : (n, 3) [m].  contacts : of the target with obstacles, at most one a vertex.  held : (n,) mask of pinned vertices.

    Raises InputError for contacts of the cloth with itself, or two at a vertex, or masses and targets of the wrong size.
    """

    def __init__(
        self,
        energy: ShellEnergy,
        masses: Vector,
        gravity: Vector,
        target: Vector,
        contacts: ClothContacts,
        held: NDArray[np.bool_] | None = None,
    ) -> None:
        n = energy.mesh.vertices.shape[0]
        self.energy, self.target = energy, np.ascontiguousarray(target, dtype=float)
        if self.target.shape != (n, 3) or not np.isfinite(self.target).all():
            raise InputError("target", self.target.shape, f"finite positions of shape {(n, 3)}")
        if np.shape(masses) != (n,):
            raise InputError("masses", np.shape(masses), f"of shape {(n,)}")
        self.weight = np.asarray(masses)[:, None] * np.asarray(gravity, dtype=float)
        self.vertices = _alone(contacts)
        self.frames = contact_frames(contacts.normals)
        self.friction = np.asarray(contacts.friction, dtype=float)
        self.held = np.zeros(n, bool) if held is None else np.asarray(held, dtype=bool)
        self.size = float(np.linalg.norm(self.weight))
        k = len(self.vertices)
        self.rows = sp.bsr_array((self.frames, self.vertices, np.arange(k + 1)), shape=(3 * k, 3 * n))
        blocks = self.energy.hessian(self.target, convex=True).diagonal()
        self.step = 1.0 / float(np.mean(blocks))  # a [m/N]
        self._least = 1e-5 / self.step
        self._shift = 0.0

    def positions(
        self, rest: Vector, start: Vector, proximal: float, tolerance: float = 1e-8, most: int = 60
    ) -> Draped:
        """Phi(rest) from `start` (n, 3), an element of V; proximal : 1 / lambda [N/m], > 0.  most : Newton steps.

        Convex problems with the whole Hessian, more of the proximal term where it is not positive definite, line search on the
        energy. Raises InputError for a rest shape that has no energy.
        """
        energy, q = self.energy.with_rest(rest), self.onto(start)
        forces = np.zeros((len(self.vertices), 3))
        for made in range(most + 1):
            gradient = self.gradient(energy, q, proximal)
            residual = self._residual(q, gradient)
            if residual <= tolerance or made == most:
                break
            direction, forces = self._newton(energy, q, gradient, proximal, forces)
            moved = self._searched(energy, q, gradient, direction, proximal)
            if moved is None:
                break
            q = moved
        return Draped(q, forces, made, residual, residual <= tolerance)

    def gradient(self, energy: ShellEnergy, q: Vector, proximal: float) -> Vector:
        """(n, 3) [N] of the energy, the weight and the proximal term; zero at vertices that are held."""
        out = energy.gradient(q) - self.weight + proximal * (q - self.target)
        out[self.held] = 0.0
        return out

    def onto(self, q: Vector) -> Vector:
        """Nearest positions (n, 3) of V, held vertices at the target."""
        out = np.array(q, dtype=float)
        away = np.einsum("kij,kj->ki", self.frames, out[self.vertices] - self.target[self.vertices])
        away = project_dual_cone(away, self.friction)
        out[self.vertices] = self.target[self.vertices] + np.einsum("kij,ki->kj", self.frames, away)
        out[self.held] = self.target[self.held]
        return out

    def pulled_back(self, rest: Vector, draped: Draped, change: Vector, proximal: float) -> Vector:
        """(dPhi/dp)^T change (n, 3) for a `change` (n, 3) of the positions.

        With D the derivative of P_V at q - a g: (I - D + a D (E_qq + 1/lambda)) dq = -a D E_qp dp, solved transposed. Where the
        projection has kinks, one of its derivatives.
        """
        energy, q = self.energy.with_rest(rest), draped.positions
        n = 3 * len(q)
        stiffness = sp.csr_array(energy.hessian(q)) + proximal * sp.eye_array(n)
        slope = self._slope(q - self.step * self.gradient(energy, q, proximal))
        system = sp.csr_array(sp.eye_array(n) - slope + self.step * (stiffness @ slope))
        found = sparse_solver(system, "d2E/dq2", positive=False)(
            np.ascontiguousarray(change, dtype=float).reshape(-1)
        )
        mixed = sp.csr_array(energy.mixed_derivative(q))
        return np.asarray(-self.step * (mixed.T @ (slope @ found))).reshape(q.shape)

    def imbalance(self, rest: Vector) -> float:
        """How far the target is from rest: |g - P_C g| over the weight, C = H^T prod K_mu the forces contacts can exert."""
        gradient = self.gradient(self.energy.with_rest(rest), self.target, 0.0)
        local = np.einsum("kij,kj->ki", self.frames, gradient[self.vertices])
        left = local - SecondOrderCone(self.friction).project(local) if len(local) else local
        gradient[self.vertices] = np.einsum("kij,ki->kj", self.frames, left)
        return float(np.linalg.norm(gradient)) / self.size

    def _residual(self, q: Vector, gradient: Vector) -> float:
        return float(np.linalg.norm(self.onto(q - self.step * gradient) - q)) / (self.step * self.size)

    def _newton(
        self, energy: ShellEnergy, q: Vector, gradient: Vector, proximal: float, start: Vector
    ) -> tuple[Vector, Vector]:
        """Step (n, 3) and forces (k, 3) of (4.24) linearised at q."""
        problem = self._problem(
            energy.hessian(q), gradient, proximal, self.rows @ (q - self.target).reshape(-1)
        )
        if len(self.vertices) == 0:
            return np.asarray(problem.factor.solve(problem.f)).reshape(-1, 3), start
        forces, _ = run_inner(problem, "nodal", start, INEXACT, MOST_PASSES)
        load = problem.f + self.rows.T @ forces.reshape(-1)
        problem.release()
        return np.asarray(problem.factor.solve(load)).reshape(-1, 3), forces

    def _problem(self, hessian: sp.bsr_array, gradient: Vector, proximal: float, away: Vector) -> Problem:
        """(4.24) with as much of a multiple of the unit matrix as makes the Hessian positive definite (Levenberg)."""
        none = self._least
        while True:
            try:
                matrix = self._held_apart(hessian, proximal + self._shift)
                problem = Problem(
                    M=matrix, f=-gradient.reshape(-1), H=self.rows, w=away, law=SecondOrderCone(self.friction), block_size=3
                )  # fmt: skip
            except InputError:
                if self._shift > 1e6 * none:
                    raise
                self._shift = max(4.0 * self._shift, none)
                continue
            self._shift = 0.25 * self._shift if self._shift > none else 0.0
            return problem

    def _held_apart(self, hessian: sp.bsr_array, proximal: float) -> sp.csr_array:
        """Hessian and proximal term, with unit rows and columns for held vertices."""
        free = sp.diags_array(np.repeat(~self.held, 3).astype(float))
        fixed = sp.diags_array(np.repeat(self.held, 3) / self.step)
        matrix = free @ sp.csr_array(hessian) @ free
        return sp.csr_array(0.5 * (matrix + matrix.T) + proximal * free + fixed)

    def _searched(
        self, energy: ShellEnergy, q: Vector, gradient: Vector, direction: Vector, proximal: float
    ) -> Vector | None:
        """The first of the steps 1, 1/2, 1/4 ... that lessens the energy enough; None where none does.

        Where the energy is too round to tell, the whole step if it lessens the residual.
        """
        slope, before, length = float(np.vdot(gradient, direction)), self._value(energy, q, proximal), 1.0
        if abs(slope) <= NOISE * abs(before):
            trial = self.onto(q + direction)
            better = self._residual(trial, self.gradient(energy, trial, proximal)) < self._residual(
                q, gradient
            )
            return trial if better else None
        while length >= SHORTEST:
            trial = q + length * direction
            if self._value(energy, trial, proximal) <= before + SUFFICIENT * length * slope:
                return self.onto(trial)
            length *= 0.5
        return None

    def _value(self, energy: ShellEnergy, q: Vector, proximal: float) -> float:
        away = q - self.target
        return energy.value(q) - float(np.vdot(self.weight, q)) + 0.5 * proximal * float(np.vdot(away, away))

    def _slope(self, trial: Vector) -> sp.csr_array:
        """Derivative D (3 n, 3 n) of P_V at `trial` (n, 3), symmetric."""
        n = len(trial)
        blocks = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        away = np.einsum("kij,kj->ki", self.frames, trial[self.vertices] - self.target[self.vertices])
        # Moreau: the projection on the dual cone is x + P_K(-x), with derivative I - P_K'(-x).
        none = np.zeros(len(away))
        law = Coefficients(self.friction, none, none, self.friction)
        inner = np.eye(3) - projection_jacobian(-away, law)
        blocks[self.vertices] = np.einsum("kai,kab,kbj->kij", self.frames, inner, self.frames)
        blocks[self.held] = 0.0
        return sp.csr_array(sp.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)))


def _alone(contacts: ClothContacts) -> NDArray[np.int64]:
    """The vertex (k,) of each contact."""
    first = np.max(contacts.vertices, axis=1, initial=-1) if len(contacts) else np.zeros(0, np.int64)
    several = np.sum(contacts.vertices >= 0, axis=1) != 1
    if several.any() or len(np.unique(first)) != len(first):
        raise InputError(
            "contacts", "of several vertices, or several at a vertex", "one vertex each, at most one a vertex"
        )
    return np.asarray(first, dtype=np.int64)
