"""A problem in its nodal form, its iterate, and the proof of that iterate by velocities that balance its forces exactly."""

from __future__ import annotations

import math

import numpy as np

from barchan.friction._kernels import law_residual_squared
from barchan.friction.methods.nodal._kernels import imbalance, solve_on_face
from barchan.friction.methods.nodal.form import SIZE, NodalForm, nodal_form
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder
from barchan.linalg import transposed_product

LEAST_RATIO, LARGEST_RATIO = 0.03, 1e8
PROOF, PROOF_STEPS = 1e-2, 1000


class NodalState:
    """y (m, 3) and r (n, 3): velocities in the basis of the form and forces times c; f, w, laws in the same units.

    What a sweep leaves over is an imbalance of forces, which is cheap to measure and bounds the law residual only up to the
    condition of M. Each iterate that may be the last is therefore proved: by the velocities that balance its forces, found to
    PROOF from those at hand by conjugate gradients. The ratio of the two, known from the last proof, tells when the next
    one may succeed. A start that is not zero is balanced by the factor of M; nothing else here needs a factor.
    """

    def __init__(self, problem: Problem, recorder: Recorder, r0: np.ndarray) -> None:
        self.problem, self.recorder = problem, recorder
        self.form: NodalForm = nodal_form(problem)
        scale = self.form.scale[:, None]
        self.f = np.ascontiguousarray((self.form.turn @ problem.f).reshape(-1, SIZE))
        self.w = np.ascontiguousarray(problem.w.reshape(-1, SIZE) / scale)
        self.laws = problem.parameters.copy()
        self.laws[:, 1:3] *= scale
        self.r = np.ascontiguousarray(r0 * scale)
        self.y, self.left, self.step = np.zeros_like(self.f), np.empty_like(self.f), np.empty_like(self.f)
        self.scratch = np.empty((3, *self.f.shape))
        self.ratio = 1.0
        residual = math.inf
        if r0.any():
            v = problem.factor.solve(problem.f + transposed_product(problem.H, r0.reshape(-1)))
            self.y[:] = (self.form.turn @ v).reshape(-1, SIZE)
            residual = self._law_residual(self.y)
        self.over = recorder.record(0, residual, r0)

    @property
    def rho(self) -> np.ndarray:
        """(n,) force over velocity in the units of y and r."""
        return self.form.rho * self.form.scale**2

    @property
    def size(self) -> float:
        """What residuals are relative to: |r| or the reference."""
        size = max(float(np.linalg.norm(self.r / self.form.scale[:, None])), self.problem.reference_force)
        return size if size > 0.0 else 1.0

    def imbalance(self) -> float:
        """|A y - f - r| relative to `size`, the vector itself left in `left`."""
        square = imbalance(self.form.matrix, self.form.contact, self.f, self.y, self.r, self.left)
        return math.sqrt(square) / self.size

    def solve(self, stiff: np.ndarray, flexible: np.ndarray, limit: int, reduction: float) -> int:
        """`step` = -A^-1 `left` on a face (see `faces`) to a reduction of the residual; the steps it took. `left` is lost."""
        made = solve_on_face(
            self.form.matrix, stiff, flexible, self.left, self.step, self.scratch, limit, reduction
        )
        return int(made)

    def record(self, iteration: int, estimate: float, last: bool) -> bool:
        """Note the iterate; whether the method is over. A proof is made only where it may succeed, or at the end."""
        residual = self.ratio * estimate
        if residual <= self.recorder.tolerance or last:
            residual = self._proof()
            if estimate > 0.0 and math.isfinite(residual):
                self.ratio = min(max(residual / estimate, LEAST_RATIO), LARGEST_RATIO)
        return self.recorder.record(iteration, residual, self.r / self.form.scale[:, None]) or last

    def _proof(self) -> float:
        """Law residual of the forces at velocities that balance them."""
        self.imbalance()
        self.solve(*self.form.blocks, PROOF_STEPS, PROOF)
        residual = self._law_residual(self.y + self.step)
        self.imbalance()
        return residual

    def _law_residual(self, y: np.ndarray) -> float:
        """Law residual of the forces at the rates of y (m, 3), in a metric that bounds the certificate's."""
        scale = self.form.scale[:, None]
        forces, rates = self.r / scale, scale * (y[self.form.nodes] + self.w)
        square, own = law_residual_squared(forces, rates, self.problem.parameters, self.form.rho)
        if square == 0.0:
            return 0.0
        size = max(math.sqrt(own), self.problem.reference_force)
        return math.sqrt(square) / size if size > 0.0 else math.inf
