"""The projected gradient of the nodal method (seed B 4.3.1, end): accelerated spectral steps in velocities, the shift frozen.

Feasible velocities have y + w + s in the dual cone K_{1/mu} at every contact; in the orthonormal basis of the form, scaled by
one number a node, their projection is that of each node by itself. Steps and inertia as in `aspg` (seed B, Algorithm B.2).
"""

from __future__ import annotations

import math

import numpy as np

from barchan.errors import InputError
from barchan.friction._kernels import block_rows_times, law_residual_squared, project_blocks
from barchan.friction.methods._inertia import nesterov_inertia
from barchan.friction.methods.nodal.form import SIZE
from barchan.friction.methods.nodal.state import NodalState

SMALLEST_STEP, LARGEST_STEP = 1e-6, 1e6
HALF_SPACE = 1e300  # aperture of the dual of a cone without friction
CHECK_EVERY = 10
SOLVED = 0.3


def nodal_gradient(state: NodalState, limit: int) -> None:
    """At most `limit` steps from the state; raises InputError where the law has a yield stress."""
    if state.laws[:, 1:3].any():
        raise InputError(
            "law", "with a yield stress", "a cone, for the projected gradient of the nodal method"
        )
    if not state.over and limit:
        _Gradient(state).run(limit)


class _Gradient:
    """x = y sqrt(d) with d (m, 1) the mean eigenvalues of the diagonal blocks; gradients alike."""

    def __init__(self, state: NodalState) -> None:
        self.state = state
        form = state.form
        self.root = np.sqrt(np.trace(form.blocks[0], axis1=1, axis2=2) / SIZE)[:, None]
        mu = state.laws[:, 0]
        self.dual = np.zeros_like(state.laws)
        self.dual[:, 0] = np.divide(1.0, mu, out=np.full_like(mu, HALF_SPACE), where=mu > 0.0)
        self.shift = np.zeros(len(mu))
        self.product = np.empty_like(state.y)

    def gradient(self, y: np.ndarray) -> np.ndarray:
        """A y - f (m, 3)."""
        indptr, indices, data, _ = self.state.form.matrix
        block_rows_times(indptr, indices, data, y, self.product)
        return self.product - self.state.f

    def project(self, x: np.ndarray) -> np.ndarray:
        """Nearest feasible velocities, all scaled."""
        state, nodes = self.state, self.state.form.nodes
        moved = state.w.copy()
        moved[:, 0] += self.shift
        scale = self.root[nodes]
        rates = x[nodes] + scale * moved
        project_blocks(rates, self.dual, rates)
        out = x.copy()
        out[nodes] = rates - scale * moved
        return out

    def run(self, limit: int) -> None:
        """Steps with inertia and spectral lengths; the shift moves once its convex problem is solved well enough."""
        x = self.root * self.state.y
        self.shift = self._wanted(self.state.y)
        x = projected = self.project(x)
        slope = self.gradient(x / self.root) / self.root
        step, inertia = 1.0, 1.0
        for iteration in range(1, limit + 1):
            fresh = self.project(x - step * slope)
            if np.vdot(fresh - projected, slope) < 0.0:
                inertia, beta = nesterov_inertia(inertia)
                following = fresh + beta * (fresh - projected)
            else:
                inertia, following = 1.0, fresh
            projected = fresh
            if iteration % CHECK_EVERY == 0 or iteration == limit:
                over, solved = self._check(iteration, fresh / self.root, iteration == limit)
                if over:
                    return
                if solved:
                    self.shift = self._wanted(fresh / self.root)
                    inertia, following = 1.0, self.project(fresh)
            rates = self.gradient(following / self.root) / self.root
            change, moved = rates - slope, following - x
            square = float(np.vdot(change, change))
            spectral = float(np.vdot(moved, change)) / square if square > 0.0 else step
            step = min(LARGEST_STEP, max(SMALLEST_STEP, spectral))
            x, slope = following, rates

    def _check(self, iteration: int, y: np.ndarray, last: bool) -> tuple[bool, bool]:
        """Whether the method is over at y (m, 3), and whether its convex problem is solved better than the shift fits."""
        state, form = self.state, self.state.form
        slope = self.gradient(y)
        state.y[:] = y
        project_blocks(slope[form.nodes], state.laws, state.r)
        left = state.imbalance()
        shifted = state.y[form.nodes] + state.w
        shifted[:, 0] += self.shift
        convex = state.laws.copy()
        convex[:, 3] = convex[:, 0]
        violation, _ = law_residual_squared(state.r, shifted, convex, state.rho)
        unsolved = math.hypot(left, math.sqrt(violation) / state.size)
        gap = float(np.linalg.norm(state.rho * (self._wanted(y) - self.shift))) / state.size
        return state.record(iteration, max(unsolved, gap), last), unsolved <= SOLVED * gap

    def _wanted(self, y: np.ndarray) -> np.ndarray:
        state = self.state
        slip = np.hypot(*(y[state.form.nodes] + state.w)[:, 1:].T)
        return np.asarray((state.laws[:, 0] - state.laws[:, 3]) * slip)
