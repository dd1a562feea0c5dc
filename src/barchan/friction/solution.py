"""What a solve returns: the best iterate, its certificate, and how it ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from barchan.friction.certificate import Certificate, balanced, certify
from barchan.friction.existence import NONE, Existence
from barchan.friction.problem import Problem


class Progress(NamedTuple):
    """One entry of a history: iteration, residual (the method's own estimate of the law residual), seconds."""

    iteration: int
    residual: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of `solve`.

    r : (n s,) forces.  u : (n s,) relative velocities.  v : (m,) velocities, None in reduced form.
    multipliers : (c,) of the bilateral constraints (pressures), None without.
    certificate : the independent proof.  converged : certificate.residual <= tol, unless proven to have no solution.
    history : list of `Progress`.
    elapsed : seconds of the method with its set-up, without the certificate.
    status : "converged", "stopped by callback", "iteration limit reached" or "no solution".
    message : status, in the last case with the proof.  existence : the verdict, where it was asked for or needed.
    """

    r: np.ndarray
    u: np.ndarray
    v: np.ndarray | None
    certificate: Certificate
    converged: bool
    iterations: int
    elapsed: float
    history: list[Progress]
    method: str
    status: str = ""
    message: str = ""
    existence: Existence | None = None
    multipliers: np.ndarray | None = None


@dataclass
class Recorder:
    """Keeps the best iterate and the history of a running method; `callback(Progress, r)` returning True stops it."""

    tolerance: float
    callback: Callable[[Progress, np.ndarray], object] | None = None
    best: np.ndarray | None = None
    best_residual: float = np.inf
    last: np.ndarray | None = None
    history: list[Progress] = field(default_factory=list)
    stopped: bool = False
    _before: int = 0
    _start: float = field(default_factory=time.perf_counter)

    def record(self, iteration: int, residual: float, r: np.ndarray) -> bool:
        """Note an iterate r (n, s); True when the method should end (tolerance met or callback)."""
        entry = Progress(self._before + iteration, residual, self.seconds)
        self.history.append(entry)
        self.last = r
        if residual < self.best_residual or self.best is None:
            self.best_residual = residual
            self.best = r.copy()
        if self.callback is not None and self.callback(entry, r):
            self.stopped = True
        return residual <= self.tolerance or self.stopped

    @property
    def ended(self) -> bool:
        """Whether the best iterate so far meets the tolerance, or the callback has stopped the solve."""
        return self.best_residual <= self.tolerance or self.stopped

    def begin_next(self) -> None:
        """The next method continues the count of iterations where the last one stopped."""
        self._before = self.history[-1].iteration if self.history else 0

    @property
    def seconds(self) -> float:
        """Wall-clock seconds since the method began."""
        return time.perf_counter() - self._start


def finish(
    problem: Problem, recorder: Recorder, method: str, tolerance: float, proof: Existence | None = None
) -> Solution:
    """Certify the best iterate and say how the method ended; `proof` tells whether there is a solution at all."""
    seconds = recorder.seconds
    r = np.zeros(problem.n * problem.s) if recorder.best is None else recorder.best.reshape(-1)
    if problem.is_reduced:
        v, multipliers = None, None
        u = problem.W @ r + problem.b
    else:
        v, multipliers = balanced(problem, r)
        u = problem.H @ v + problem.w
    certificate = certify(problem, r, v, multipliers)
    converged = certificate.residual <= tolerance and (proof is None or proof.verdict != NONE)
    status = _status(converged, recorder.stopped, proof)
    message = str(proof) if proof is not None and proof.verdict == NONE else status
    iterations = recorder.history[-1].iteration if recorder.history else 0
    return Solution(
        r, u, v, certificate, converged, iterations, seconds, recorder.history, method, status, message, proof,
        multipliers,
    )  # fmt: skip


def _status(converged: bool, stopped: bool, proof: Existence | None) -> str:
    if proof is not None and proof.verdict == NONE:
        return "no solution"
    if converged:
        return "converged"
    return "stopped by callback" if stopped else "iteration limit reached"
