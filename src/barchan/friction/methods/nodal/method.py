"""The nodal method in its three variants (seed B 4.3.1): local inversion, Cadoux's fixed point, projected gradient.

The first two sweep over the vertices. Sweeps alone carry what happens at a contact one vertex further each time; here two of
them alternate with a linear correction on the face they found (contacts keep their regime and their thresholds of friction),
by conjugate gradients, as nonsmooth multigrid methods do (Kornhuber 1994, Graeser and Sander 2019, there with coarse grids).
"""

from __future__ import annotations

import numpy as np

from barchan.friction.methods._options import check_choice, check_positive
from barchan.friction.methods.nodal._kernels import CONVEX, INVERSION, faces, move, sweeps
from barchan.friction.methods.nodal.gradient import nodal_gradient
from barchan.friction.methods.nodal.state import NodalState
from barchan.friction.problem import Problem
from barchan.friction.solution import Recorder

VARIANTS = ("inversion", "cadoux", "projected_gradient")
DEFAULT_WORK = 20_000
SWEEPS = 2
MOST_STEPS, REDUCTION = 100, 0.1
GROWTH, CLEAR_GAIN, PATIENCE = 3.0, 0.9, 3
SOLVED = 0.3
RESTS = 4
SLOWEST = 0.1


def nodal(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    variant: str = "inversion",
    corrections: bool = True,
    reduction: float = REDUCTION,
) -> None:
    """Iterate from `r0` (n, 3). An iteration passes once over M: a sweep, a step of conjugate gradients or of the gradient.

    variant : "inversion" solves each contact exactly by u_i = A_ii^-1 (r_i - c_i), A = G M G^T; "cadoux" sweeps on the convex
    problems of a frozen shift, r = A u + c with cones of aperture 1 / mu, and moves the shift once they are solved well enough;
    "projected_gradient" projects accelerated gradient steps in velocities, which is explicit since G is orthonormal.
    corrections : alternate the sweeps of the first two with corrections on their face; False is the algorithm of the seed.
    reduction : of the residual of a correction.

    Raises
    ------
    InputError : unknown variant, reduction not positive, or a problem without nodal form (`form.nodal_form`: more than one
        contact a vertex, for example); a yield stress for the projected gradient.
    """
    check_choice("variant", variant, VARIANTS)
    check_positive(reduction=reduction)
    limit = DEFAULT_WORK if max_iterations is None else max_iterations
    state = NodalState(problem, recorder, r0)
    if variant == "projected_gradient":
        nodal_gradient(state, limit)
    else:
        _Sweeps(state, variant == "cadoux", corrections, reduction).run(limit)


class _Sweeps:
    """Sweeps and corrections, with the shift (n,) of the convex problems of Cadoux's fixed point."""

    def __init__(self, state: NodalState, convex: bool, corrections: bool, reduction: float) -> None:
        self.state, self.convex = state, False
        self.corrections, self.reduction = corrections, reduction
        self.laws, self.w = state.laws.copy(), state.w.copy()
        self.shift = np.zeros(len(state.w))
        self.multiplier = np.zeros(len(self.laws))
        self.stiff, self.flexible = np.empty((2, *state.form.blocks[0].shape))
        if convex:
            self._make_convex()

    def run(self, limit: int) -> None:
        """Until the state is content or `limit` passes over the matrix are made."""
        state, work, trust = self.state, 0, _Trust()
        over = state.over or limit == 0
        while not over:
            self._sweep(min(SWEEPS, limit - work))
            work = min(work + SWEEPS, limit)
            left = state.imbalance()
            if trust.was_harmful(left):
                left = trust.restore(state)
            over = state.record(work, max(left, self._gap()), work >= limit)
            if over:
                return
            trust.watch(max(left, self._gap()))
            if trust.rests >= RESTS and not self.convex:
                self._make_convex()
                trust = _Trust()
            if self.convex and left <= SOLVED * self._gap():
                self._move_shift(max(SLOWEST, 0.5**trust.rests))
                trust.kept = None
            elif self.corrections and trust.allows():
                trust.keep(state, left)
                work += self._correct(min(MOST_STEPS, limit - work))

    def _sweep(self, count: int) -> None:
        state, form = self.state, self.state.form
        kind = CONVEX if self.convex else INVERSION
        sweeps(
            count, kind, form.matrix, form.blocks, form.contact, form.local, self.laws, self.w, state.f, state.y, state.r,
            self.multiplier,
        )  # fmt: skip

    def _correct(self, limit: int) -> int:
        """Solve for what is left of the balance with the contacts in their regimes; the steps it took."""
        state, form = self.state, self.state.form
        faces(form.contact, form.blocks, self.laws, self.w, state.y, state.r, self.stiff, self.flexible)
        made = state.solve(self.stiff, self.flexible, limit, self.reduction)
        move(form.contact, self.laws, self.w, state.step, state.y)
        return made

    def _wanted(self) -> np.ndarray:
        state = self.state
        slip = np.hypot(*(state.y[state.form.nodes] + state.w)[:, 1:].T)
        return np.asarray((state.laws[:, 0] - state.laws[:, 3]) * slip)

    def _gap(self) -> float:
        """How far the shift is from that of the velocities, as a force relative to the size of the forces."""
        if not self.convex:
            return 0.0
        return float(np.linalg.norm(self.state.rho * (self._wanted() - self.shift)) / self.state.size)

    def _make_convex(self) -> None:
        """From now on the convex problems of a shift: asked for, or where exact contacts send the sweeps round in a circle."""
        self.convex = True
        self.laws[:, 3] = self.laws[:, 0]
        self.multiplier[:] = 0.0
        self._move_shift(1.0)

    def _move_shift(self, rate: float) -> None:
        self.shift += rate * (self._wanted() - self.shift)
        self.w[:, 0] = self.state.w[:, 0] + self.shift


class _Trust:
    """Whether to correct: not for a while after harm or no gain, a while that doubles, so that in the end sweeps go on alone.

    With strong friction the frozen thresholds of a face may send the iterates round in a circle.
    """

    def __init__(self) -> None:
        self.kept: tuple[float, np.ndarray, np.ndarray] | None = None
        self.pause, self.idle = 0, 0
        self.best, self.poor, self.rests = np.inf, 0, 0

    def was_harmful(self, left: float) -> bool:
        """Whether the imbalance after a correction and sweeps is GROWTH times what it was before."""
        return self.kept is not None and left > GROWTH * self.kept[0]

    def restore(self, state: NodalState) -> float:
        """Back to before the correction; the imbalance there."""
        assert self.kept is not None
        _, state.y[:], state.r[:] = self.kept
        self._rest()
        return state.imbalance()

    def watch(self, estimate: float) -> None:
        """Note what a cycle reached."""
        self.poor = 0 if estimate < CLEAR_GAIN * self.best else self.poor + 1
        self.best = min(self.best, estimate)
        if self.poor > PATIENCE and self.idle == 0:
            self._rest()

    def allows(self) -> bool:
        """Whether the next cycle has a correction."""
        self.kept = None
        self.idle = max(self.idle - 1, 0)
        return self.idle == 0

    def keep(self, state: NodalState, left: float) -> None:
        """The state as it is before a correction."""
        self.kept = (left, state.y.copy(), state.r.copy())

    def _rest(self) -> None:
        self.pause = 2 * self.pause + 2
        self.idle, self.poor = self.pause, 0
        self.rests += 1
