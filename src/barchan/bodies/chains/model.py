"""What the three descriptions of a chain share: the implicit step (seed B, 2.15-2.16) and how to look at a state.

With the coordinates q, rates v and theta = 1, a step to q+ = q + dt v+,

    M(q+) (v+ - v) / dt = f(q+, v+) + H^T r + G^T l,   C(q+) = 0,

is linearised about an iterate (q', v'), at first (q, v), into the friction problem

    (M / dt + D + dt K) v+ = M v / dt + f + D v' - K (q - q') + H^T r + G^T l,     G v+ = -(C + G (q - q')) / dt,
    u = H v+ + w,  w_N = (h + N (q - q')) / dt,     all at (q', v'), h the gaps, N their derivative.

K and D are symmetric positive semi-definite parts of -df/dq and -df/dv. The print of (2.16) has G v+ = G v' - C, which lacks
the factor 1 / dt, and K v' dt on the right of the first iterate, where q' = q is not q + dt v'; it is left out here.
"""

from __future__ import annotations

import math
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.chains.chain import Chain
from barchan.bodies.chains.obstacles import Obstacles
from barchan.bodies.chains.options import ChainOptions
from barchan.bodies.chains.state import ChainState
from barchan.bodies.moreau import AssemblyRecord
from barchan.bodies.rigid import Body
from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction import Certificate, Problem, Solution, solve

Vector = NDArray[np.float64]

_NEAR = 0.1  # of the mean length of a segment: contacts are looked for at least so far
_PATIENCE, _APART = (
    3,
    2.0,
)  # linearisations before, and growth of their change at which, they count as moving apart
_ROUNDING = 1e-13  # of the chain's length: an error of a joint that is rounding
_INSIDE = 1e-6  # of the chain's length: joints may start so deep in an obstacle


@dataclass(frozen=True, eq=False)
class _Step:
    """A step at an iterate: names of contacts, frames (k, 2, 2), joints (N + 1, 2), linearised problem."""

    keys: NDArray[np.int64]
    frames: Vector
    joints: Vector
    problem: Problem


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A solved linearisation: end velocities (m,), whether they have settled, solver iterations of all so far."""

    step: _Step
    solution: Solution
    speeds: Vector
    settled: bool
    sweeps: int


class ChainModel(ABC):
    """A chain in some coordinates, with fixed obstacles that its joints touch under Coulomb's law.

    obstacles : fixed plane bodies (`barchan.bodies.rigid.Body`), half-planes and discs for instance.

    Raises InputError for other bodies, and for joints that start inside an obstacle.
    """

    def __init__(
        self, chain: Chain, obstacles: Sequence[Body] = (), options: ChainOptions | None = None
    ) -> None:
        self.chain = chain
        self.options = ChainOptions() if options is None else options
        free = np.arange(1 if chain.held else 0, chain.segments + 1)
        self.obstacles = Obstacles.of(obstacles, chain.friction, free)
        gaps = self.obstacles.gaps(chain.joints_at(chain.root, chain.angles))
        if np.any(gaps < -_INSIDE * chain.length):
            depth = -float(np.min(gaps))
            raise InputError(
                "obstacles", f"a joint {depth:.3g} m inside", "outside of the joints at the start"
            )

    @abstractmethod
    def start(self) -> tuple[Vector, Vector]:
        """Coordinates and rates (m,) at the start."""

    @abstractmethod
    def mass(self, q: Vector) -> Vector:
        """M (m, m)."""

    @abstractmethod
    def loads(self, q: Vector, v: Vector) -> Vector:
        """(m,) gravity, bending, air friction."""

    @abstractmethod
    def stiffness(self, q: Vector) -> Vector:
        """K (m, m), the symmetric positive semi-definite part of -df/dq that a step uses."""

    @abstractmethod
    def damping(self, q: Vector) -> Vector:
        """D (m, m), likewise of -df/dv."""

    @abstractmethod
    def constraints(self, q: Vector) -> tuple[Vector, Vector] | None:
        """C (c,) [m] and its derivative G (c, m); None for coordinates that need none."""

    @abstractmethod
    def joints_of(self, q: Vector) -> Vector:
        """(N + 1, 2) ends and joints [m]."""

    @abstractmethod
    def joint_rows(self, q: Vector) -> Vector:
        """(N + 1, 2, m) their derivatives."""

    @abstractmethod
    def angles_of(self, q: Vector) -> Vector:
        """(N,) angles of the segments [rad]."""

    @abstractmethod
    def bends_of(self, q: Vector) -> Vector:
        """(b,) turns of the joints with a spring [rad]."""

    def coriolis(self, q: Vector, shift: Vector, v: Vector) -> Vector:
        """(m,) what inertia adds to the loads at rates v of coordinates that change at rates `shift`; zero for constant M."""
        return np.zeros(len(q))

    def carried(self, q: Vector, before: Vector, v: Vector) -> Vector:
        """(m,) momentum in the directions of coordinates q of the motion at coordinates `before` with rates v."""
        return np.asarray(self.mass(q) @ v)

    def forces(self, q: Vector, v: Vector) -> Vector:
        """f (m,) of M dv/dt = f + G^T l: loads and Coriolis forces."""
        return self.loads(q, v) + self.coriolis(q, v, v)

    def started(self) -> ChainState:
        """The chain where it starts."""
        return ChainState.at_start(*self.start())

    def restored(self, arrays: Mapping[str, NDArray[Any]]) -> ChainState:
        """The state that `arrays()` of a state wrote."""
        return ChainState.from_arrays(arrays)

    def angles(self, state: ChainState) -> Vector:
        """(N,) angles of the segments from the x axis [rad]; of lumped chains between -pi and pi."""
        return self.angles_of(state.coordinates)

    def joints(self, state: ChainState) -> Vector:
        """(N + 1, 2) first end, joints, last end [m]."""
        return self.joints_of(state.coordinates)

    def joint_velocities(self, state: ChainState) -> Vector:
        """(N + 1, 2) [m/s]."""
        return np.asarray(self.joint_rows(state.coordinates) @ state.velocities)

    def tip(self, state: ChainState) -> Vector:
        """(2,) last end [m]."""
        return self.joints(state)[-1]

    def kinetic_energy(self, state: ChainState) -> float:
        """[J]."""
        return 0.5 * float(state.velocities @ self.mass(state.coordinates) @ state.velocities)

    def potential_energy(self, state: ChainState) -> float:
        """Bending energy and that of weight, from z = 0 [J]."""
        chain, joints = self.chain, self.joints(state)
        centres = 0.5 * (joints[1:, 1] + joints[:-1, 1])
        bends = self.bends_of(state.coordinates)
        return chain.gravity * float(chain.masses @ centres) + 0.5 * chain.bending_stiffness * float(
            bends @ bends
        )

    def problem(self, state: ChainState, dt: float) -> Problem:
        """The friction problem of the linearised step of `dt` seconds."""
        return self._linearised(state, self._near(state, dt), state.coordinates, state.velocities, dt).problem

    def advance(self, state: ChainState, dt: float) -> tuple[ChainState, AssemblyRecord]:
        """State after one step of `dt` seconds, and its record: certificate of the last linearisation, iterations of all.

        `converged` is False when the certificate misses the tolerance, or repeated linearisations did not settle.
        Raises InputError for dt that is not finite and positive.
        """
        began = clock.perf_counter()
        keys = self._near(state, dt)
        looking = clock.perf_counter() - began
        last = self._repeated(state, keys, dt)
        new = ChainState(
            state.time + dt, state.step + 1, state.coordinates + dt * last.speeds, last.speeds, keys,
            last.step.joints[self.obstacles.pairs(keys)[0]], np.ascontiguousarray(last.step.frames[:, 0]),
            last.solution.r.reshape(-1, 2).copy(),
        )  # fmt: skip
        seconds = clock.perf_counter() - began - looking
        return new, self._record(state, new, dt, last, (looking, seconds))

    def _repeated(self, state: ChainState, keys: NDArray[np.int64], dt: float) -> _Iterate:
        """Linearisations until the velocities settle; where they move apart, the one with the least change."""
        options = self.options
        here, speed, forces = state.coordinates, state.velocities, self._kept_forces(state, keys)
        kept, least, sweeps = None, math.inf, 0
        for number in range(options.iterations):
            step = self._linearised(state, keys, here, speed, dt)
            solution = solve(
                step.problem,
                method=options.method,
                tol=options.tolerance,
                r0=forces,
                max_iterations=options.max_sweeps,
            )
            assert solution.v is not None
            step.problem.release()
            sweeps += solution.iterations
            change = float(np.linalg.norm(solution.v - speed))
            speed, forces = solution.v, solution.r
            here = state.coordinates + dt * speed
            settled = options.iterations == 1 or change <= options.settled * float(np.linalg.norm(speed))
            if kept is None or change < least:
                kept, least = _Iterate(step, solution, speed, settled, sweeps), change
            if settled or (number >= _PATIENCE and change > _APART * least):
                break
        assert kept is not None
        return replace(kept, sweeps=sweeps)

    def _near(self, state: ChainState, dt: float) -> NDArray[np.int64]:
        """Names of the contacts that joints may come to in a step."""
        if not math.isfinite(dt) or dt <= 0.0:
            raise InputError("dt", dt, "a finite number > 0 (s)")
        if not self.obstacles.bodies:
            return np.zeros(0, np.int64)
        speed = float(np.max(np.linalg.norm(self.joint_velocities(state), axis=1)))
        near = _NEAR * self.chain.length / self.chain.segments
        return self.obstacles.within(self.joints(state), near + 2.0 * dt * (speed + dt * self.chain.gravity))

    def _kept_forces(self, state: ChainState, keys: NDArray[np.int64]) -> Vector:
        """Forces (k, 2) of the last step, for the solver to start from."""
        start = np.zeros((len(keys), 2))
        _, here, before = np.intersect1d(keys, state.contact_keys, assume_unique=True, return_indices=True)
        start[here] = state.forces[before]
        return start

    def _linearised(
        self, state: ChainState, keys: NDArray[np.int64], here: Vector, guess: Vector, dt: float
    ) -> _Step:
        """The step from `state` linearised about coordinates `here` and rates `guess` (m,)."""
        back = state.coordinates - here
        mass, stiffness, damping = self.mass(here), self.stiffness(here), self.damping(here)
        load = self.carried(here, state.coordinates, state.velocities) / dt
        load += self.loads(here, guess) + self.coriolis(here, guess + back / dt, guess)
        load += damping @ guess - stiffness @ back
        bilateral = self.constraints(here)
        C, k = (
            (None, None) if bilateral is None else (bilateral[1], -(bilateral[0] + bilateral[1] @ back) / dt)
        )
        joint, obstacle = self.obstacles.pairs(keys)
        joints = self.joints_of(here)
        gaps, frames = self.obstacles.contacts(keys, joints)
        rows = np.einsum("kij,kjm->kim", frames, self.joint_rows(here)[joint])
        before = gaps if here is state.coordinates else self.obstacles.contacts(keys, self.joints(state))[0]
        offsets = np.zeros((len(keys), 2))
        kept = (1.0 - self.options.recovery) * np.minimum(
            before, 0.0
        )  # of an overlap at the start of the step
        offsets[:, 0] = (gaps + rows[:, 0] @ back - kept) / dt
        problem = Problem(
            M=sp.csr_array(mass / dt + damping + dt * stiffness), f=load, H=rows.reshape(2 * len(keys), len(here)),
            w=offsets.reshape(-1), law=Coulomb(self.obstacles.frictions[obstacle]), C=C, k=k, block_size=2,
            reference_force=float(np.min(self.chain.masses)) * self.chain.gravity,
        )  # fmt: skip
        return _Step(keys, frames, joints, problem)

    def _certificate(self, last: _Iterate, dt: float) -> Certificate:
        """That of the last linearisation, in which errors of joints that are rounding alone count as none.

        They are measured relative to the velocities, which vanish where a chain is at rest.
        """
        found, problem = last.solution.certificate, last.step.problem
        if problem.C is None:
            return found
        error = dt * float(np.max(np.abs(problem.C @ last.speeds - problem.k), initial=0.0))
        return replace(found, bilateral=0.0) if error <= _ROUNDING * self.chain.length else found

    def _record(
        self, before: ChainState, state: ChainState, dt: float, last: _Iterate, seconds: tuple[float, float]
    ) -> AssemblyRecord:
        certificate, bilateral = self._certificate(last, dt), self.constraints(state.coordinates)
        gaps = self.obstacles.gaps(self.joints(before))
        return AssemblyRecord(
            step=state.step, time=state.time, dt=dt, candidates=len(state.contact_keys),
            contacts=int(np.count_nonzero(state.forces[:, 0] > 0.0)), sweeps=last.sweeps, residual=certificate.residual,
            law_residual=certificate.law, balance_residual=certificate.balance, bilateral_residual=certificate.bilateral,
            converged=last.settled and certificate.residual <= self.options.tolerance,
            kinetic_energy=self.kinetic_energy(state), potential_energy=self.potential_energy(state),
            max_speed=float(np.max(np.linalg.norm(self.joint_velocities(state), axis=1))),
            deepest=max(0.0, -float(np.min(gaps, initial=0.0))),
            joint_error=0.0 if bilateral is None else float(np.max(np.abs(bilateral[0]), initial=0.0)),
            detection_seconds=seconds[0], solve_seconds=seconds[1],
        )  # fmt: skip
