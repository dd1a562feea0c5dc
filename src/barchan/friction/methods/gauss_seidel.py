"""Hybrid Gauss-Seidel: exact one-block solves swept until the certificate's law residual is met (seed B Algorithm 4.1).

Proximal term on singular blocks (3.14), sleeping of calm blocks, alternating sweep direction, coloured deterministic
parallel groups. Cost of a sweep: linear in the entries of W (explicit) or of H (matrix-free).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from barchan.errors import InputError
from barchan.friction._gradient_kernels import gradient_sweeps
from barchan.friction._kernels import block_sweeps, sweep_scratch
from barchan.friction.constrained import ConstrainedDelassus
from barchan.friction.gradient_form import GradientDelassus
from barchan.friction.local import LocalCounts, local_blocks, local_code
from barchan.friction.lumped import LumpedDelassus
from barchan.friction.methods._options import check_counts
from barchan.friction.operators import LARGEST_DENSE_DELASSUS, StoredDelassus, build_operator, is_lumped
from barchan.friction.problem import Problem
from barchan.friction.residual import law_residual
from barchan.friction.solution import Recorder
from barchan.linalg import Schedule, coloured_schedule, natural_schedule

DEFAULT_SWEEPS = 10_000
DIRECTIONS = ("alternating", "forward", "symmetric")
OVER_RELAXATION = 1.3
PARALLEL_BLOCKS = 1500
GROUP_SIZE = 16
SLEEP_FRACTION = 0.1
FEWEST_BETWEEN, MOST_BETWEEN = 10, 25  # sweeps between two solves for multipliers, by default
SweptDelassus: TypeAlias = StoredDelassus | LumpedDelassus | GradientDelassus | ConstrainedDelassus


def gauss_seidel(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    local_solver: str = "secular",
    operator: str = "auto",
    sleeping: bool = False,
    parallel: bool | None = None,
    relaxation: float = 1.0,
    check_every: int = 25,
    min_iterations: int = 0,
    direction: str = "alternating",
    counts: LocalCounts | None = None,
    pressure_every: int | None = None,
) -> None:
    """Sweep from `r0` (n, s), recording iterates.

    Parameters
    ----------
    local_solver : see `barchan.friction.local`.  operator : "auto", "explicit" or "matrix-free".
    sleeping : skip, for ten sweeps at a time, the blocks that a full sweep hardly changed (fewer block solves; no gain in
    time on the problems measured, hence off by default).  parallel : coloured sweeps on all threads
    (None: when there are PARALLEL_BLOCKS blocks).  check_every : sweeps between residual evaluations (fewer at first).
    relaxation : 1 is Gauss-Seidel, more over-relaxes each block and projects it back (seed B 3.4.3).
    min_iterations : sweeps made even when the start already meets the tolerance.
    direction : "alternating" (each sweep the other way round), "forward", or "symmetric": an iteration is then two sweeps,
    forward and backward (seed B 3.4.3).
    counts : receives the numbers of local solves, local failures and fail-safe calls; a kernel of its own counts them.
    pressure_every : sweeps between solves for the multipliers of bilateral constraints, where these are not part of a stored
    W (`barchan.friction.constrained`): block descent, as in seed B 8.3.3 (None: see `pressure_period`).

    Raises
    ------
    InputError : unknown option value, relaxation outside (0, 2), or an operator that cannot be swept.
    """
    if direction not in DIRECTIONS:
        raise InputError("direction", direction, "one of " + ", ".join(DIRECTIONS))
    sweeper = prepare_sweeper(problem, operator, local_solver, parallel, counts=counts)
    if pressure_every is not None:
        check_counts(pressure_every=pressure_every)
    sweeper.pressure_every = pressure_period(sweeper.delassus) if pressure_every is None else pressure_every
    sweeper.relaxation = checked_relaxation(relaxation)
    sweeper.turning = direction != "forward"
    run_sweeps(
        sweeper,
        recorder,
        r0,
        DEFAULT_SWEEPS if max_iterations is None else max_iterations,
        sweeps_each=2 if direction == "symmetric" else 1,
        sleeping=sleeping,
        check_every=check_every,
        min_iterations=min_iterations,
    )


def symmetric_gauss_seidel(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    local_solver: str = "secular",
    operator: str = "auto",
    parallel: bool | None = None,
    relaxation: float = 1.0,
    check_every: int = 25,
    counts: LocalCounts | None = None,
    pressure_every: int | None = None,
) -> None:
    """Gauss-Seidel whose iteration is a forward and a backward sweep (seed B 3.4.3); options and errors of `gauss_seidel`."""
    gauss_seidel(
        problem,
        recorder,
        r0,
        max_iterations,
        local_solver,
        operator,
        parallel=parallel,
        relaxation=relaxation,
        check_every=check_every,
        direction="symmetric",
        counts=counts,
        pressure_every=pressure_every,
    )


def sor(
    problem: Problem,
    recorder: Recorder,
    r0: np.ndarray,
    max_iterations: int | None = None,
    relaxation: float = OVER_RELAXATION,
    local_solver: str = "secular",
    operator: str = "auto",
    parallel: bool | None = None,
    check_every: int = 25,
    min_iterations: int = 0,
    direction: str = "forward",
    counts: LocalCounts | None = None,
    pressure_every: int | None = None,
) -> None:
    """Successive over-relaxation (seed B 3.4.3): each block moves `relaxation` times as far as its solution, then is projected.

    The projection on the admissible set, which the seed does not make, keeps every iterate a force of the law. Options
    and errors of `gauss_seidel`, but the sweeps go forward: on the sample problems that takes half the sweeps of alternating.
    """
    gauss_seidel(
        problem,
        recorder,
        r0,
        max_iterations,
        local_solver,
        operator,
        parallel=parallel,
        relaxation=relaxation,
        check_every=check_every,
        min_iterations=min_iterations,
        direction=direction,
        counts=counts,
        pressure_every=pressure_every,
    )


def checked_relaxation(relaxation: float) -> float:
    """The factor itself; InputError unless 0 < relaxation < 2."""
    if not 0.0 < relaxation < 2.0:
        raise InputError("relaxation", relaxation, "between 0 and 2")
    return relaxation


def prepare_sweeper(
    problem: Problem,
    operator: str,
    local_solver: str,
    parallel: bool | None,
    jacobi: bool = False,
    counts: LocalCounts | None = None,
) -> Sweeper:
    """What the sweeps need, set up once per problem; raises InputError when W is neither stored nor factored."""
    either = is_lumped(problem) or _is_made_of_small_blocks(problem)
    delassus = build_operator(problem, "explicit" if operator == "auto" and not either else operator)
    if not isinstance(delassus, SweptDelassus):
        raise InputError("operator", operator, "'explicit': sweeps need W or a diagonal M")
    if parallel is None:
        parallel = problem.n >= PARALLEL_BLOCKS
    key = ("sweeper", id(delassus), local_solver, parallel, jacobi, counts is not None)
    sweeper: Sweeper = problem.prepared(
        key, lambda: Sweeper(problem, delassus, local_solver, parallel, jacobi, counts is not None)
    )
    sweeper.counts = counts
    return sweeper


def run_sweeps(
    sweeper: Sweeper,
    recorder: Recorder,
    r0: np.ndarray,
    limit: int,
    sweeps_each: int = 1,
    sleeping: bool = False,
    check_every: int = 25,
    min_iterations: int = 0,
) -> None:
    """Sweep from `r0` (n, s) until the recorder is content or `limit` iterations of `sweeps_each` sweeps are made."""
    r = sweeper.start(r0)
    done = 0
    pause = 5
    while True:
        residual, size = sweeper.residual()
        if (
            recorder.record(done, residual, r) and (done >= min_iterations or recorder.stopped)
        ) or done >= limit:
            return
        count = min(pause, limit - done)
        calm = (SLEEP_FRACTION * residual * size) ** 2 / len(r) if sleeping and size > 0.0 else -1.0
        sweeper.run(count * sweeps_each, done * sweeps_each, calm)
        done += count
        pause = max(min(2 * pause, check_every), 1)


def pressure_period(delassus: SweptDelassus) -> int:
    """Sweeps between two solves for multipliers: they add little work, and the number hardly matters (docs/solvers.md)."""
    if not isinstance(delassus, ConstrainedDelassus):
        return FEWEST_BETWEEN
    return min(MOST_BETWEEN, max(FEWEST_BETWEEN, math.ceil(3.0 * delassus.reaction_work)))


def _is_made_of_small_blocks(problem: Problem) -> bool:
    """Whether W may be swept stored or factored by the small blocks of M, whichever is cheaper."""
    return not problem.is_reduced and problem.C is None and problem.factor.blocks is not None


def can_sweep(problem: Problem) -> bool:
    """Whether W is stored, or cheap to store, or factored by a diagonal M."""
    small = problem.n * problem.s <= LARGEST_DENSE_DELASSUS
    if problem.is_reduced or small or is_lumped(problem):
        return True
    return problem.C is None and problem.factor.has_sparse_inverse


class Sweeper:
    """State of the sweeps on one operator: forces, multipliers, sleep counters and the kernel."""

    def __init__(
        self,
        problem: Problem,
        delassus: SweptDelassus,
        local_solver: str,
        parallel: bool,
        jacobi: bool,
        counting: bool,
    ) -> None:
        self.problem = problem
        self.delassus = delassus
        self.swept = delassus.free if isinstance(delassus, ConstrainedDelassus) else delassus
        self.b = np.ascontiguousarray(delassus.b)
        self.laws = problem.parameters
        self.jacobi = jacobi
        self.counts: LocalCounts | None = None
        code = local_code(local_solver, problem.s, self.laws)
        origin = problem.origin
        self.diagonal, self.local = origin.prepared("blocks", lambda: local_blocks(delassus.diagonal_blocks))
        swept = self.swept
        form = type(swept).__name__
        self.schedule = origin.prepared(
            ("schedule", form, parallel),
            lambda: _schedule(swept, problem.n) if parallel else natural_schedule(problem.n),
        )
        self.relaxation = 1.0
        self.pressure_every = pressure_period(delassus)
        self.turning = True
        self.system: tuple[Any, ...]
        self.kernel: Callable[..., Any]
        self.scratch = sweep_scratch(self.schedule.widest, problem.s)
        self.tally = np.zeros((self.schedule.widest, 8), dtype=np.int64)
        arrays = (self.diagonal, self.b, self.local, self.laws)
        if isinstance(swept, GradientDelassus):
            order = self.schedule.order
            form = origin.prepared(("form", parallel), lambda: swept.in_order(order))
            if form is not swept.form:
                arrays = (self.diagonal[order], self.b[order], self.local[order], self.laws[order])
            self.system = (form, *arrays)
            self.kernel = gradient_sweeps(problem.s, form[2].shape[1], code, parallel, jacobi, counting)
        else:
            rows = swept.rows if isinstance(swept, StoredDelassus) else swept.g
            width = 0 if isinstance(swept, StoredDelassus) else rows.data.shape[1]
            self.system = ((rows.indptr, rows.indices, rows.data), *arrays)
            self.kernel = block_sweeps(problem.s, width, code, parallel, jacobi, counting)

    def start(self, r0: np.ndarray) -> np.ndarray:
        """Take the start (n, s) and return the array the sweeps update in place."""
        n = self.problem.n
        self.r = np.array(r0, dtype=float, order="C")
        self.multiplier = np.zeros(n)
        self.asleep = np.zeros(n, dtype=np.bool_)
        self.z = self.pressed = np.zeros(0)
        self._refresh()
        self.old = (self.r.copy(), self.z.copy()) if self.jacobi else (self.r, self.z)
        return self.r

    def _refresh(self) -> None:
        """z of the forces, so that no drift accumulates."""
        if not isinstance(self.swept, StoredDelassus):
            self.z, self.pressed = self.swept.spread(self.r), np.zeros(0)
            self._press()

    def _press(self) -> None:
        """Multipliers of the bilateral constraints for the forces as they are; `pressed` (m,) is their part of z."""
        if isinstance(self.delassus, ConstrainedDelassus):
            if self.pressed.size:
                self.z -= self.pressed
            self.pressed = self.delassus.reaction(self.z)
            self.z += self.pressed

    def residual(self) -> tuple[float, float]:
        """Law residual of the current forces, and |r| or the reference; refreshes z, so that no drift accumulates."""
        if isinstance(self.delassus, StoredDelassus):
            u = self.delassus.apply(self.r) + self.b
        else:
            self._refresh()
            u = self.delassus.gather(self.z) + self.b
        return law_residual(self.problem, self.r, u)

    def run(self, sweeps: int, start: int, calm: float) -> None:
        """`sweeps` more sweeps; the parity of `start` fixes the direction of the first."""
        at_once = self.pressure_every if isinstance(self.delassus, ConstrainedDelassus) else sweeps
        for done in range(0, sweeps, max(at_once, 1)):
            if done:
                self._press()
            self._sweep(min(at_once, sweeps - done), start + done, calm)

    def _sweep(self, sweeps: int, start: int, calm: float) -> None:
        self.tally[:] = 0
        self.kernel(
            sweeps,
            start,
            self.turning,
            tuple(self.schedule),
            self.system,
            calm,
            self.relaxation,
            (self.r, self.z, *self.old, self.multiplier, self.asleep),
            self.tally,
            self.scratch,
        )
        if self.counts is not None:
            solves, failures, calls = self.tally[:, :3].sum(axis=0)
            self.counts.solves += int(solves)
            self.counts.failures += int(failures)
            self.counts.failsafe_calls += int(calls)


def _schedule(delassus: StoredDelassus | LumpedDelassus | GradientDelassus, n: int) -> Schedule:
    if isinstance(delassus, GradientDelassus):
        (pointers, indices), columns = delassus.pattern, delassus.columns
    else:
        rows = delassus.rows if isinstance(delassus, StoredDelassus) else delassus.g
        pointers, indices = rows.indptr, rows.indices
        columns = n if isinstance(delassus, StoredDelassus) else rows.columns
    pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, pointers), shape=(n, columns))
    shared = not isinstance(delassus, StoredDelassus)
    return coloured_schedule(pattern, GROUP_SIZE, shared, slabs=isinstance(delassus, GradientDelassus))
